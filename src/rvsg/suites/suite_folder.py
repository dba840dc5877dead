"""Folder of a suite, a YAML file for each case, and the runs of its cases.

::

    suite/
      suite.yaml            title, the error rates of the verdicts
      blocked-aisle.yaml    one case: title, what is expected of which requirement, the scenario
"""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any, Self

import yaml
from filelock import FileLock
from pydantic import Field

from rvsg.core.documents import read_document, read_record
from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec, ignore
from rvsg.core.records import Record
from rvsg.evaluation.story import story_of
from rvsg.evaluation.verdict import DEFAULT, Procedure, load_requirement
from rvsg.robots.robot import Robot
from rvsg.runs.attempt import Measurement
from rvsg.runs.runner import Evaluator, FinishedRun, Runner
from rvsg.scenario.builder import FoundWith, check_valid, load_saved, with_robot
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.world_lookup import folder_of, world_of
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import Simulator, check_robot
from rvsg.suites.suite import Case, CaseResult, Expectation, State, SuiteResult, case_result
from rvsg.world.world import Route, World

HEAD = "suite.yaml"
EXPECTED = ("violation", "pass")
"""What a case may be kept for: a known failure, or a scenario the robot must master."""


class TuningNote(Record):
    """A tuning against the suite: its cases are not new to that stack any more."""

    stack: str
    date: str
    by: str
    """The version of RVSG."""
    folder: str
    """Of the tuning, relative to the suite."""
    result: str = ""
    """What the check on held-out cases says."""


class SuiteHead(Record):
    """What `suite.yaml` holds."""

    title: str = "Scenarios that stay"
    judging: Procedure = DEFAULT
    """The error rates of the verdicts, and the runs a case is given at most."""
    tunings: tuple[TuningNote, ...] = ()
    """Stacks that were tuned against the suite, once for each folder."""


class CaseFile(Record):
    """What the file of a case holds. `world` is its world folder, relative to the suite; not for shipped worlds."""

    title: str
    expectations: tuple[Expectation, ...]
    max_runs: int = Field(default=DEFAULT.max_runs, ge=1, le=10_000)
    world: str | None = None
    simulator: Spec | None = None
    stack_file: str | None = None
    """The parameter file the stack was read from, relative to the suite."""
    scenario: Scenario


@dataclass(frozen=True)
class SuiteFolder:
    """A suite in a folder."""

    folder: Path
    head: SuiteHead
    cases: tuple[Case, ...]
    worlds: Mapping[str, World]
    """The world of each case, by the case's name."""

    @classmethod
    def create(cls, folder: str | Path, *, title: str = SuiteHead().title, judging: Procedure = DEFAULT) -> Self:
        """Make an empty suite, or open the one that is there."""
        folder = Path(folder)
        if not (folder / HEAD).exists():
            head = SuiteHead(title=title, judging=judging)
            write_whole(folder / HEAD, _yaml(head.model_dump(mode="json")))
        return cls.open(folder)

    @classmethod
    def open(cls, folder: str | Path) -> Self:
        """Open a suite and check every scenario in it.

        Raises:
            FileError: a file is missing or wrong; DocumentError lists every mistake with its line.
            InvalidScenario: a scenario breaks a rule.
            InputError: the world of a scenario cannot be found or has changed.
        """
        folder = Path(folder)
        if not (folder / HEAD).is_file():
            raise FileError(folder / HEAD, "there is no suite here. Make one with: rvsg suite add FILE --suite DIR")
        head, _ = read_document(folder / HEAD, SuiteHead)
        cases, worlds = [], {}
        for path in sorted(folder.glob("*.yaml")):
            if path.name != HEAD:
                case, world = _read_case(path)
                cases.append(case)
                worlds[case.name] = world
        return cls(folder, head, tuple(cases), worlds)

    def add(
        self,
        source: Scenario | str | Path,
        requirement: str | Requirement | None = None,
        *,
        name: str | None = None,
        title: str | None = None,
        expected: str = "violation",
        reason: str | None = None,
        world: World | str | Path | None = None,
        found: FoundWith | None = None,
    ) -> Self:
        """Add a scenario, or one more requirement to a case that holds the same scenario; return the new suite.

        Args:
            source: a scenario, or a file of one (also of a proposal or an attempt, such as `best_scenario.json`).
            requirement: what it is judged by; by default what it was found with, else R1. A file of requirements is
                looked for beside the suite, then in the current folder.
            name: the case's name and file; by default made from the title.
            expected: `violation` for a known failure, `pass` for a scenario the robot must master.
            reason: why a failure is known; by default that which the suite holds.
            found: what the scenario was found with; by default what its file says.

        Raises:
            UnknownName: there is no such requirement, or `expected` is neither.
            InvalidScenario: the scenario breaks a rule of validity.
        """
        if expected not in EXPECTED:
            raise UnknownName("expectation", expected, EXPECTED)
        if isinstance(source, Scenario):
            scenario, place, saved = source, world_of(source.mission, world), FoundWith()
        else:
            scenario, place, saved = load_saved(source, world)
        found = found or saved
        check_valid(scenario, place)
        requirement = requirement or found.requirement or "R1"
        if isinstance(requirement, str):
            requirement = self._beside(requirement)
            definition = load_requirement(requirement_source(requirement, self.folder))
        else:
            definition, requirement = load_requirement(requirement), requirement.name
        simulator = found.simulator
        asked = {"requirement": requirement, "expected": expected, "definition": definition}
        expectation = Expectation.model_validate(asked | ({} if reason is None else {"reason": reason}))
        with FileLock(self.folder / ".lock"):  # another `rvsg suite add` may have changed the case
            cases = self.open(self.folder).cases
            same = [case for case in cases if case.scenario.id == scenario.id]
            known = next((case for case in same if simulator in (None, case.simulator)), None)
            if known is not None:
                if name not in (None, known.name):
                    raise InputError(
                        f'The scenario is the case "{known.name}" already. Leave --name out, or rename its file.',
                        code="case-known",
                    )
                kept = {each.requirement: each for each in known.expectations}
                if reason is None and requirement in kept and expected == kept[requirement].expected:
                    expectation = expectation.replace(reason=kept[requirement].reason)
                expectations = tuple((kept | {requirement: expectation}).values())
                case = known.replace(expectations=expectations, title=title or known.title)
            else:
                words = title or _title(scenario)
                free = _free_name(name or words, {case.name for case in cases}, given=name is not None)
                case = Case(
                    name=free,
                    title=words,
                    expectations=(expectation,),
                    scenario=scenario,
                    simulator=simulator,
                    stack_file=found.stack_file and _relative(found.stack_file, self.folder),
                    max_runs=self.head.judging.max_runs,
                )
            self._write(case, place)
            return self.open(self.folder)

    def chosen(self, only: Sequence[str]) -> list[Case]:
        """Return the named cases in the order of the suite; all where none is named."""
        if not self.cases:
            raise FileError(self.folder, "the suite has no case. Add one with: rvsg suite add FILE --suite DIR")
        names = {case.name for case in self.cases}
        for name in only:
            if name not in names:
                raise UnknownName("case", name, names, hint=f"Suite: {self.folder}.")
        return [case for case in self.cases if not only or case.name in only]

    def tested(self, name: str) -> SuiteCase:
        """Return a case with its world and its requirements."""
        case = next(case for case in self.cases if case.name == name)
        asked = tuple(requirement_of(expectation, self.folder) for expectation in case.expectations)
        return SuiteCase(case=case, world=self.worlds[name], requirements=asked, judging=self.head.judging)

    def update(self, result: SuiteResult) -> tuple[CaseResult, ...]:
        """Write the verdicts of a run as the new expectations, where they changed; return the changed ones.

        Unclear results change nothing.
        """
        changed = tuple(each for each in result.cases if each.state in (State.BROKEN, State.FIXED))
        for case in self.cases:
            mine = {each.requirement: each for each in changed if each.case == case.name}
            if mine:
                expectations = tuple(_updated(each, mine.get(each.requirement)) for each in case.expectations)
                self._write(case.replace(expectations=expectations), self.worlds[case.name])
        return changed

    def add_tuning(self, note: TuningNote) -> None:
        """Write into the suite that a stack was tuned against it."""
        kept = tuple(each for each in self.head.tunings if each.folder != note.folder)
        head = self.head.replace(tunings=(*kept, note))
        write_whole(self.folder / HEAD, _yaml(head.model_dump(mode="json")))

    def _beside(self, requirement: str) -> str:
        """Return the name of a requirement as the suite has it, also of a file in the current folder."""
        source = requirement_source(requirement, self.folder)
        file = requirement.partition("#")[0]
        if source == requirement or Path(source.partition("#")[0]).exists() or not Path(file).exists():
            return requirement
        return _relative(file, self.folder) + requirement[len(file) :]

    def _write(self, case: Case, world: World) -> None:
        folder = folder_of(world.id)
        values = {
            "title": case.title,
            "expectations": [each.model_dump(mode="json", exclude_defaults=True) for each in case.expectations],
            "max_runs": case.max_runs,
            "simulator": None if case.simulator is None else case.simulator.model_dump(mode="json"),
            "stack_file": case.stack_file,
            "world": None if folder is None else _relative(folder, self.folder),
            "scenario": case.scenario.model_dump(mode="json"),
        }
        write_whole(self.folder / f"{case.name}.yaml", _yaml({k: v for k, v in values.items() if v is not None}))


def read_results(path: str | Path) -> SuiteResult:
    """Read the results of a suite from a file that `rvsg suite run --json` wrote."""
    return read_record(Path(path), SuiteResult)


def _read_case(path: Path) -> tuple[Case, World]:
    file, document = read_document(path, CaseFile)
    try:
        near = path.parent / file.world if file.world is not None else None
        world = world_of(file.scenario.mission, near)
        check_valid(file.scenario, world)
        case = Case(
            name=path.stem,
            title=file.title,
            expectations=file.expectations,
            scenario=file.scenario,
            simulator=file.simulator,
            stack_file=file.stack_file,
            max_runs=file.max_runs,
        )
        for expectation in case.expectations:
            requirement_of(expectation, path.parent, file.scenario.mission.route)
    except FileError:
        raise
    except InputError as error:
        raise FileError(path, str(error), line=document.line("scenario")) from None
    except ValueError:
        wanted = "small letters, digits, dots, hyphens and underscores"
        raise FileError(path, f"a case is named by its file: {wanted}, at most 80.") from None
    return case, world


def requirement_of(expectation: Expectation, folder: Path, route: Route | None = None) -> Requirement:
    """Return the requirement of an expectation in the suite of that folder: as the case holds it, else by its name."""
    kept, name = expectation.definition, expectation.requirement.rpartition("#")[2]
    if kept is not None and kept.name != name and not name.endswith((".yaml", ".yml")):
        raise InputError(f'the requirement "{name}" has the definition of "{kept.name}".')
    return load_requirement(kept or requirement_source(expectation.requirement, folder), route)


def requirement_source(name: str, folder: Path) -> str:
    """Return a requirement's name, or the path of its file, which is given beside the suite."""
    file, hash_, key = name.partition("#")
    return f"{folder / file}{hash_}{key}" if file.endswith((".yaml", ".yml")) else name


def _updated(expectation: Expectation, result: CaseResult | None) -> Expectation:
    if result is None:
        return expectation
    if result.state is State.FIXED:
        return expectation.replace(expected="pass", reason="")
    reason = f"violated by {result.verdict.violations} of {result.verdict.runs} runs"
    return expectation.replace(expected="violation", reason=reason)


def _title(scenario: Scenario) -> str:
    text = " ".join(scenario.description.split()) or f"{len(scenario.people.humans)} people"
    return textwrap.shorten(f"{scenario.mission.route.name}: {text}", 200, placeholder="…")


def _free_name(wanted: str, taken: set[str], *, given: bool) -> str:
    name = re.sub(r"[^a-z0-9._-]+", "-", wanted.lower()).strip("-._")[:60].strip("-._") or "case"
    if given and name in taken:
        raise InputError(f'There is a case "{name}" already, with another scenario. Choose another --name.')
    return next(each for k in range(1, len(taken) + 2) if (each := name if k == 1 else f"{name}-{k}") not in taken)


def _relative(path: str | Path, folder: Path) -> str:
    return os.path.relpath(Path(path).resolve(), folder.resolve())


def _yaml(values: dict[str, Any]) -> str:
    return yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=120)


@dataclass(frozen=True, kw_only=True)
class SuiteCase:
    """A case with its world, the requirements of its expectations, and what judges it."""

    case: Case
    world: World
    requirements: tuple[Requirement, ...]
    judging: Procedure = DEFAULT
    """The error rates of its suite."""

    @property
    def name(self) -> str:
        """The name of the case."""
        return self.case.name

    @property
    def scenario(self) -> Scenario:
        """Its scenario."""
        return self.case.scenario

    @property
    def simulator(self) -> Spec:
        """What runs it by itself."""
        return self.case.simulator or Spec("embedded")

    def run_by(self, simulator: Spec) -> SuiteCase:
        """Return the case with another simulator."""
        return replace(self, case=self.case.replace(simulator=simulator))

    def with_robot(self, robot: Robot | str) -> SuiteCase:
        """Return the case with another robot on the same route."""
        mission = self.scenario.mission.replace(robot=robot)
        return replace(self, case=self.case.replace(scenario=self.scenario.replace(mission=mission)))

    def driven_by(self, robot: Robot | str) -> SuiteCase:
        """Return the case with another robot.

        Goal and time limit are fitted to a robot of another name. One of the same name is another version of the robot
        of the case: it has to do what was asked, so that a version that became too slow breaks the case.
        """
        if not isinstance(robot, Robot) or robot.name == self.scenario.mission.robot_name:
            return self.with_robot(robot)
        return replace(self, case=self.case.replace(scenario=with_robot(self.scenario, robot, self.world)[0]))

    def evaluator(self, runs: int | None = None) -> Evaluator:
        """Return what measures and judges its runs, with limits worked out for its route.

        Args:
            runs: the budget, by default that of the case.
        """
        limit_s = self.scenario.mission.route.time_limit_s
        requirements = [requirement.for_time_limit(limit_s) for requirement in self.requirements]
        procedure = self.judging.replace(max_runs=runs or self.case.max_runs)
        return Evaluator(requirements, procedure=procedure, time_limit_s=limit_s)

    def results(
        self, evaluator: Evaluator, measured: Sequence[tuple[Measurement, ...]], seconds: float, **about: Any
    ) -> tuple[CaseResult, ...]:
        """Return the result of each requirement from what was measured for all of them in each run.

        Args:
            seconds: simulated seconds of all runs.
            about: other fields of a result.
        """
        record = self.scenario.mission.robot_record
        robot = self.scenario.mission.robot_name + (f" ({record.id})" if record else "")
        about |= {"case": self.name, "title": self.case.title, "seconds": seconds, "robot": robot}
        results = []
        for k, (expectation, requirement) in enumerate(
            zip(self.case.expectations, evaluator.requirements, strict=True)
        ):
            mine = [of_run[k] for of_run in measured]
            verdict = evaluator.judge(mine, requirement)
            results.append(case_result(expectation, requirement, verdict, mine, **about))
        return tuple(results)


Finish = Callable[[CaseResult, SuiteCase, Requirement, Run, Sequence[tuple[Run, Measurement]]], CaseResult]
"""Adds to a result what a report shows of its runs; it is given the worst run and all runs with their measurements."""


def run_cases(
    cases: Iterable[SuiteCase],
    simulator: Simulator,
    *,
    runs: int | None = None,
    jobs: int = 1,
    finish: Finish = lambda result, *_: result,
    on_message: Callable[[str], None] = ignore,
) -> Iterator[CaseResult]:
    """Run cases and yield a result for each of their requirements.

    Args:
        runs: runs of every case; by default as few as decide each verdict.
        finish: adds to each result that has a value.

    Raises:
        SimulationError: a run could not be made.
    """
    for _, alike in groupby(cases, lambda tested: id(tested.world)):
        of_world = list(alike)
        with Runner(simulator, of_world[0].world, jobs=jobs, notify=on_message) as runner:
            for tested in of_world:
                check_robot(tested.scenario, simulator)
                evaluator = tested.evaluator(runs)
                finished: list[FinishedRun] = []
                while more := runs - len(finished) if runs else evaluator.runs_wanted(_measured(finished)):
                    seeds = range(len(finished), len(finished) + more)
                    finished += runner.run(tested.scenario, seeds, label=tested.name, measuring=evaluator)
                yield from _results(tested, evaluator, finished, finish)


def _measured(finished: Sequence[FinishedRun]) -> list[tuple[Measurement, ...]]:
    return [run.measurements for run in finished]


def _results(
    tested: SuiteCase, evaluator: Evaluator, finished: Sequence[FinishedRun], finish: Finish
) -> Iterator[CaseResult]:
    """Yield the result of each requirement with what happens in its worst run."""
    runs = [run.unpack() for run in finished]
    results = tested.results(evaluator, _measured(finished), float(sum(run.trajectory.t[-1] for run in runs)))
    for k, (result, requirement) in enumerate(zip(results, evaluator.requirements, strict=True)):
        mine = [run.measurements[k] for run in finished]
        judged = [(requirement.badness(m.objective), -at) for at, m in enumerate(mine) if m.objective is not None]
        if judged:
            worst = runs[-max(judged)[1]]
            story = tuple(sentence.text for sentence in story_of(worst, world=tested.world, scenario=tested.scenario))
            shown = result.replace(story=story, worst_seed=worst.seed)
            result = finish(shown, tested, requirement, worst, list(zip(runs, mine, strict=True)))
        yield result
