"""Tuning of a navigation stack on a suite: from its failures to a changed parameter file with the evidence for it."""

from __future__ import annotations

import datetime
import difflib
import fnmatch
import json
import os
import shlex
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import yaml
from pydantic import Field

import rvsg
from rvsg.app.campaign import Campaign
from rvsg.app.record import differences, other_settings
from rvsg.app.suites import Suite
from rvsg.core import permission
from rvsg.core.documents import read_document
from rvsg.core.errors import FileError, InputError, SimulationError, UnknownName
from rvsg.core.files import write_whole
from rvsg.core.inputs import read_text
from rvsg.core.plugins import Spec, ignore
from rvsg.core.records import Pose, Record, content_id
from rvsg.core.seeds import seed_for
from rvsg.evaluation.verdict import counted
from rvsg.generation.random_search import RandomGenerator
from rvsg.report.comparison_page import ReplayedChange
from rvsg.report.run_facts import run_facts
from rvsg.robots.robot import DEFAULT_ROBOT, Robot, load_robot
from rvsg.runs.attempt import Failure
from rvsg.scenario.brief import Brief
from rvsg.scenario.builder import as_robot
from rvsg.scenario.scenario import HumanConfiguration, Scenario
from rvsg.scenario.world_lookup import folder_of
from rvsg.simulation.embedded.simulator import can_plan
from rvsg.simulation.simulators import as_found, make_simulator
from rvsg.simulation.stacks.nav2_params import read_nav2_text
from rvsg.simulation.stacks.parameter_file import (
    SKELETONS,
    has_filters,
    has_place,
    skeleton,
    with_filters_in_file,
    with_values_in_file,
)
from rvsg.simulation.stacks.parameters import Parameter, value_at, with_values
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg.suites.suite import Case, CaseChange, Change, Comparison, SuiteResult, compare, result_of_attempt
from rvsg.suites.suite_folder import HEAD, SuiteCase, TuningNote
from rvsg.tune.parameter_search import SEEDS, Optimiser, ParameterSearch, TunedSetting, unsolved
from rvsg.tune.setting_runs import SettingRun, SettingRuns, Values, results_of
from rvsg.tune.tuning import Check, Choice, ProposalCheck, Split, Sweep, Tuning, ValueChange, split
from rvsg.tune.tuning_page import part_text, tuning_page
from rvsg.tune.zones import REACH_M, Zones, zones_around
from rvsg.world.occupancy import write_mask

RUNS, ASKED = "runs.jsonl", "asked.json"
RESULT, PAGE = "tuning.json", "index.html"
SWEPT, SWEEP_POINTS = 4, 5
ORDINARY, FEW_SEEDS = 2, 3
"""Scenarios of ordinary traffic for each mission; seeds of each of them, and of each empty route."""
SHOWN_FROM = 40
"""A check of so many runs says how far it is."""
ATTACKED = 3
"""Missions that are attacked at most, those that violate most often first."""


def check_budget(runs: int, cases: int) -> None:
    """Refuse a budget that does not hold the runs of one setting beside those before tuning."""
    whole = cases * SEEDS
    if runs < 2 * whole:
        raise InputError(
            f"A budget of {counted(runs, 'run')} holds no setting: {counted(cases, 'case')} with {SEEDS} seeds each "
            f"take {whole} runs before tuning and up to {whole} for each setting. Give at least {2 * whole}.",
            code="budget-too-small",
        )


class Narrowing(Record):
    """What the user's file says of the parameters that a stack declares."""

    only: tuple[str, ...] = ()
    """Names or patterns such as `costmaps.*`; all where it is empty."""
    fixed: dict[str, float] = Field(default_factory=dict)
    """Values that every setting has."""
    parameters: tuple[Parameter, ...] = ()
    """Other ranges, also of options that the stack does not declare."""


@dataclass(kw_only=True)
class Tuner:
    """Tunes a stack on a suite.

    Args:
        suite: the folder of the suite.
        stack: a name, a parameter file, a class or a command.
        out: the folder of the tuning; an existing one is resumed.
        narrowing: a YAML file that narrows, fixes or adds parameters.
        tries: values of parameters, or zones of Nav2's costmap filters where the stack fails.
        robot: drives every case instead of the robot of its scenario.
        more_time: how much longer the robot may take on average, as a share.
        budget_runs: runs of the search at most, those of the stack before included.
        budget_minutes: ends the search earlier.
        check_runs: runs of each case that check the proposal.
        attack_runs: runs of each of the searches against the stack before and after; 0: none.
        choose: propose this setting of the front instead of the best one.
        on_search: called with the search after every batch.
    """

    suite: Path
    stack: str
    stack_options: Mapping[str, Any] = field(default_factory=dict)
    out: Path
    narrowing: Path | None = None
    tries: Literal["parameters", "zones"] = "parameters"
    robot: str | None = None
    only: Sequence[str] = ()
    optimiser: Optimiser = "tpe"
    more_time: float = 0.05
    budget_runs: int = 3000
    budget_minutes: float | None = None
    check_runs: int = 10
    attack_runs: int = 150
    choose: int | None = None
    seed: int = 0
    jobs: int = 1
    on_message: Callable[[str], None] = ignore
    on_search: Callable[[ParameterSearch], None] = ignore

    def run(self) -> Tuning:
        """Search, check, explain and write everything into the folder; return the tuning.

        Raises:
            InputError: there is nothing to tune, or a parameter cannot be used.
        """
        if self.optimiser not in get_args(Optimiser):
            raise UnknownName("optimiser", self.optimiser, get_args(Optimiser))
        suite = Suite.open(self.suite)
        with (
            permission.only({"stack": self.stack}, self.stack_options),
            closing(StackChoice.of(self.stack, self.stack_options)) as choice,
        ):
            for text in choice.messages:
                self.on_message(text)
            cases = [self._case(suite, case) for case in suite.chosen(self.only)]
            stack = Spec(choice.record.name, choice.record.options)
            parameters: tuple[Parameter, ...] = ()
            fixed: dict[str, float] = {}
            zones: Zones | None = None
            if self.tries == "zones":
                cases, notes = self._in_one_map(cases, stack)
            else:
                parameters, fixed, notes = self._parameters(choice, cases)
            for text in notes:
                self.on_message(text)
            check_budget(self.budget_runs, len(cases))
            what = "zones" if self.tries == "zones" else counted(len(parameters), "parameter")
            self.on_message(f"{stack.name}: {counted(len(cases), 'case')}, {what}.")
            present = {each.name: float(each.present or 0.0) for each in parameters}
            asked = self._asked(suite, stack)
            if found := differences(self._known() or asked, asked):
                raise other_settings(self.out, found)
            with SettingRuns(stack, present, self.out / RUNS, jobs=self.jobs) as runs:
                before = ParameterSearch(parameters, cases, runs, seed=self.seed).begin()
                if not any(run.violated for run in before.runs.values()):
                    raise InputError(
                        f"Nothing to tune: no case of {self.suite} violates in {counted(len(before.runs), 'run')} with "
                        f"{self.stack}. Attack it first: rvsg run --stack {shlex.quote(self.stack)}",
                        code="nothing-to-tune",
                    )
                write_whole(self.out / ASKED, json.dumps(asked, indent=1) + "\n")
                parts = split(cases, before.runs.values())
                settings: list[dict[str, float]] = []
                if self.tries == "zones":
                    zones = self._zones([each for each in cases if each.name in parts.tuned], before, runs)
                    parameters = zones.parameters()
                    runs.present, runs.zones = {each.name: each.present or 0.0 for each in parameters}, zones
                    settings = [each for each in zones.settings() if self._leaves_ways(each, cases, runs)]
                search = ParameterSearch(
                    parameters,
                    [each for each in cases if each.name in parts.tuned],
                    runs,
                    fixed=fixed,
                    seed=self.seed,
                    optimiser=self.optimiser,
                    more_time=self.more_time,
                )
                search.begin()
                search.spent = len(before.runs)  # those of held-out cases count, too
                end = None if self.budget_minutes is None else time.monotonic() + 60.0 * self.budget_minutes
                for _ in search.run_settings(settings, self.budget_runs) if zones else search.run(self.budget_runs):
                    self.on_search(search)
                    if end is not None and time.monotonic() > end:
                        break
                return ProposalChecks(self, suite, cases, stack, search, parts, runs).tuning(notes)

    def _asked(self, suite: Suite, stack: Spec) -> dict[str, Any]:
        """Return what a resumed tuning must have been begun with; budgets, checks and the choice may change."""
        return {
            **({"try": self.tries} if self.tries != "parameters" else {}),
            "suite": suite.head.title,
            "stack": stack.model_dump(mode="json"),
            "robot": self.robot,
            "seed": self.seed,
            "optimiser": self.optimiser,
        }

    def _known(self) -> dict[str, Any] | None:
        """Return what the folder was begun with; None of a new one."""
        file = self.out / ASKED
        if not file.exists():
            return None
        try:
            known = json.loads(read_text(file))
        except ValueError as error:
            raise FileError(file, f"this is no JSON: {error}.") from None
        if not isinstance(known, dict):
            raise FileError(file, "this does not hold what a tuning was begun with. Choose another --out.")
        return known

    def _case(self, suite: Suite, case: Case) -> SuiteCase:
        """Return a case with what runs it."""
        simulator, tested = as_found(case.simulator, None, self.stack), suite.tested(case.name)
        assert isinstance(simulator, Spec)
        if self.robot is not None:
            with closing(make_simulator(simulator)) as made:
                tested = tested.driven_by(as_robot(self.robot, made.robots))
        return tested.run_by(simulator)

    def source(self, stack: Spec) -> tuple[str | None, Path]:
        """Return the text of the parameter file, or of one made for a stack of Nav2 without options."""
        if self.stack.endswith((".yaml", ".yml")):
            return read_text(Path(self.stack)), Path(self.stack)
        return None if self.stack_options else skeleton(stack.name), Path("nav2_params.yaml")

    def _in_one_map(self, cases: Sequence[SuiteCase], stack: Spec) -> tuple[list[SuiteCase], tuple[str, ...]]:
        """Return the cases of the world that most are in, and what a user has to know.

        Raises:
            InputError: the stack has no parameter file that zones can be written into.
        """
        text = self.source(stack)[0]
        if text is None or has_filters(text) or self.narrowing:
            raise InputError(
                "--try zones adds keepout and speed filters of Nav2: give --stack a parameter file without such "
                f"filters, or one of {', '.join(SKELETONS)} without options, and no --parameters.",
                code="no-parameters",
            )
        worlds = Counter(each.scenario.mission.world for each in cases)
        world, count = worlds.most_common(1)[0]
        note = f"Zones are of one map: the {count} of {len(cases)} cases in {world} are taken; --only takes others."
        return [each for each in cases if each.scenario.mission.world == world], (note,) if len(worlds) > 1 else ()

    def _zones(self, cases: Sequence[SuiteCase], before: TunedSetting, runs: SettingRuns) -> Zones:
        """Return zones around where the robot is at the decisive moments of the violating runs of cases."""
        places, world = list[tuple[float, float]](), cases[0].world
        for case in cases:
            for made in (run for run in before.runs.values() if run.case == case.name and run.violated):
                requirement = case.evaluator().requirements[made.violations.index(True)]
                run = runs.whole(case, before.values, made.seed)
                measured = case.evaluator().measure(run, case.world)
                at = run_facts(run, measured, requirement, case.world, case.scenario).decisive_at
                places.append((at[0] - world.map_offset[0], at[1] - world.map_offset[1]))
        found, occupancy = zones_around(places), world.occupancy
        if not found:
            raise InputError(
                f"No zone to try: the decisive moments of {counted(len(places), 'violating run')} lie more than "
                f"{REACH_M:g} m from one another.",
                code="nothing-to-tune",
            )
        rows, columns = occupancy.cells.shape
        return Zones(zones=found, found=len(places), x=occupancy.origin.x, y=occupancy.origin.y, rows=rows,
                     columns=columns, resolution_m=occupancy.resolution)  # fmt: skip

    def _leaves_ways(self, setting: Values, cases: Sequence[SuiteCase], runs: SettingRuns) -> bool:
        """Return whether every route of the cases can still be planned with a setting of zones."""
        world, missions = cases[0].world, {each.scenario.mission.id: each.scenario.mission for each in cases}
        with closing(StackChoice.of(runs.stack_of(setting))) as choice:
            robots = ((each, each.robot_record or load_robot(DEFAULT_ROBOT)) for each in missions.values())
            return all(can_plan(world, each.route, choice.driver.adapt(robot)) for each, robot in robots)

    def _parameters(
        self, choice: StackChoice, cases: Sequence[SuiteCase]
    ) -> tuple[tuple[Parameter, ...], dict[str, float], tuple[str, ...]]:
        """Return what may change, what the user fixed, and what a user has to know of it."""
        robot = cases[0].scenario.mission.robot_record or load_robot(DEFAULT_ROBOT)
        options = {**choice.driver.default_options(), **choice.record.options}
        asked = Narrowing() if self.narrowing is None else read_document(self.narrowing, Narrowing)[0]
        declared = {each.name: each for each in choice.driver.tunable_parameters(robot)}
        own = {each.name: each for each in asked.parameters}
        for pattern in asked.only:
            if not fnmatch.filter([*declared, *own], pattern):
                raise UnknownName("parameter", pattern, declared, hint=f"{self.narrowing} names it under `only`.")
        for name, value in [*asked.fixed.items(), *((n, v) for n, each in own.items() for v in (each.low, each.high))]:
            self._check_read(name, value, choice)
        found = {}
        for name, each in (declared | own).items():
            if name in asked.fixed or (asked.only and not any(fnmatch.fnmatchcase(name, p) for p in asked.only)):
                continue
            known = each.present if name not in declared else declared[name].present
            present = value_at(options, name) if known is None else known
            found[name] = each.with_present(float(each.value(each.at(0.5)) if present is None else present))
        notes: list[str] = []
        if self.stack.endswith((".yaml", ".yml")):
            text, path = read_text(Path(self.stack)), Path(self.stack)
            tried = {name: each.value(each.at(0.37)) for name, each in found.items()} | asked.fixed
            if lost := [name for name, value in tried.items() if not has_place(text, path, name, value)]:
                notes.append(f"{path} has no place for {', '.join(lost)}, such as an inflation layer. They stay.")
            found = {name: each for name, each in found.items() if name not in lost}
        if not found:
            raise InputError(
                f"{self.stack}: there is no parameter to tune. A stack declares them by `tunable_parameters`; or name "
                "options and their ranges in a file: rvsg tune --parameters FILE.",
                code="no-parameters",
            )
        return tuple(found.values()), asked.fixed, tuple(notes)

    def _check_read(self, name: str, value: float, choice: StackChoice) -> None:
        """Refuse an option that the stack does not read."""
        try:
            StackChoice.of(Spec(choice.record.name, with_values(choice.record.options, {name: value}))).close()
        except InputError as error:
            raise InputError(
                f"{self.narrowing}: {choice.record.name} does not take {name} = {value:g}. {error}",
                code="nothing-reads",
            ) from None


@dataclass(frozen=True)
class ProposalChecks:
    """The checks and explanations of what a search found, and their files."""

    tuner: Tuner
    suite: Suite
    cases: Sequence[SuiteCase]
    stack: Spec
    search: ParameterSearch
    split: Split
    runs: SettingRuns

    @property
    def zones(self) -> Zones | None:
        """The zones that were tried."""
        return self.runs.zones

    @property
    def present(self) -> Values:
        """The setting before tuning."""
        return self.search.before.values

    def tuning(self, notes: tuple[str, ...]) -> Tuning:
        """Return the tuning after writing its files."""
        search, out, tell = self.search, self.tuner.out, self.tuner.on_message
        front, before = search.front(), search.before.score
        assert before is not None
        failed = [each for each in search.candidates if each.failures]
        found = Tuning(
            suite=self.suite.head.title,
            stack=self.stack,
            by=f"rvsg {rvsg.__version__}",
            seed=self.tuner.seed,
            runs=search.spent,
            settings=len(search.candidates),
            stopped=sum(each.lost_to is not None for each in search.candidates),
            failed=tuple(f"setting {each.number}: {each.refused or 'the stack failed'}" for each in failed),
            parameters=tuple(search.parameters.values()),
            split=self.split,
            before=before,
            front=self._choices(front),
            zones=self.zones,
            tried=self._choices(search.candidates[1:] if self.zones else ()),
            unsolved=tuple(unsolved(search)),
            importances=search.importances(),
            notes=notes,
        )
        replayed = None
        if (proposed := self._proposed(front)) is not None:
            whole = len(search.before.runs)
            most = 2 * len(search.parameters) * whole
            tell(f"Taking back the changes that do not matter: at most {counted(most, 'run')} beside the search.")
            setting = search.simplified(proposed)
            file, text, diff = self._file(setting.values)
            write_whole(out / file, text)
            parts = tuple(self._parts(setting.values))
            if not self.zones:
                most = (min(SWEPT, len(search.parameters)) * (SWEEP_POINTS + 1) + len(search.parameters)) * whole
                tell(f"Trying one parameter at a time around the proposal: at most {counted(most, 'run')}.")
            found = found.replace(
                proposal=proposed.number,
                score=setting.score,
                changes=tuple(self._changes(setting)),
                parts=parts,
                sweeps=() if self.zones else tuple(self._sweeps(setting, found.importances)),
                file=file,
                diff=diff,
            )
            if found.helps:
                found = found.replace(commands=tuple(self._commands(file, setting.values)))
            replayed = self._replayed(setting.values)
            held = found.part("held out", "tuned")
            note = TuningNote(
                stack=Path(self.tuner.stack).name if Path(self.tuner.stack).is_absolute() else self.tuner.stack,
                date=datetime.date.today().isoformat(),
                by=found.by,
                folder=os.path.relpath(out.resolve(), self.suite.folder.resolve()),
                result=part_text(held) if held else "",
            )
            self.suite.add_tuning(note)
            tell(f"{self.suite.folder / HEAD} now notes this tuning under `tunings`.")
        write_whole(out / RESULT, found.to_json())
        write_whole(out / PAGE, tuning_page(found, replayed))
        return found

    def _proposed(self, front: Sequence[TunedSetting]) -> TunedSetting | None:
        """Return the best setting of the front that is better than before, or the one that was asked for."""
        number = self.tuner.choose
        if number is not None:
            chosen = next((each for each in front if each.number == number), None)
            if chosen is None:
                listed = ", ".join(str(each.number) for each in front) or "none"
                raise InputError(f"--choose {number}: the front holds the settings {listed}.", code="not-on-front")
            return chosen
        return front[0] if front and self.search.gains(front[0]) else None

    def _choices(self, candidates: Iterable[TunedSetting]) -> tuple[Choice, ...]:
        return tuple(
            Choice(number=each.number, values=self._changed(each.values), score=each.score)
            for each in candidates
            if each.score is not None
        )

    def _changed(self, values: Values) -> dict[str, float]:
        return {name: value for name, value in values.items() if value != self.present.get(name)}

    def _file_of_stack(self, values: Values) -> tuple[str, str] | None:
        """Return name and text of the parameter file that the stack keeps itself, such as that of a launched Nav2."""
        with closing(StackChoice.of(self.runs.stack_of(values))) as choice:
            return choice.driver.parameter_file()

    def _file(self, values: Values) -> tuple[str, str, tuple[str, ...]]:
        """Return name and text of the file of the proposed stack, and what differs in it."""
        text, path = self.tuner.source(self.stack)
        if (own := self._file_of_stack(values)) is not None:
            (_, text), path, after = self._file_of_stack(self.present) or own, Path(own[0]), own[1]
        elif text is None:
            return "stack.json", self.runs.stack_of(values).to_json(), ()
        elif self.zones is not None:
            zones, changed = self.zones, self._changed(values)
            for kind, mask in zones.masks(changed).items():
                file = self.tuner.out / f"{kind.partition('_')[0]}_mask.yaml"
                write_mask(mask, file, zones.resolution_m, Pose(x=zones.x, y=zones.y))
            after = with_filters_in_file(text, self.tuner.out / path.name, zones.filters(changed))
        else:
            after = with_values_in_file(text, path, self._changed(values))
        lines = difflib.unified_diff(text.splitlines(), after.splitlines(), path.name, "proposed", n=1, lineterm="")
        return path.name, after, tuple(lines)

    def _changes(self, setting: TunedSetting) -> Iterator[ValueChange]:
        """Yield each changed value with the proposal without it."""
        text, path = (None, Path()) if self.zones else self.tuner.source(self.stack)
        places = {} if text is None else read_nav2_text(text, path).places
        for name, value in self._changed(setting.values).items():
            known = self.search.parameters.get(name)
            yield ValueChange(
                name=name,
                before=self.present.get(name),
                after=value,
                unit=known.unit if known else "",
                key=".".join(part for part in places.get(name, ()) if part != "ros__parameters"),
                without=self.search.try_out({**setting.values, name: self.present[name]}).score if known else None,
            )

    def _commands(self, file: str, values: Values) -> Iterator[str]:
        """Yield what to run next: the comparison on the suite, and a campaign against the proposal."""
        suite, stack, tuned = str(self.tuner.suite), self.tuner.stack, f"{self.tuner.out}/{file}"
        options: list[str] = []
        if file.endswith(".json") or self._file_of_stack(values) is not None:
            for key, value in self.runs.stack_of(values).options.items():
                if value == self.stack.options.get(key) and key not in self.tuner.stack_options:
                    continue
                text = yaml.safe_dump(value, default_flow_style=True, width=10_000).partition("\n")[0]
                options += ["--stack-option", f"{key}={text}"]
            tuned = stack
            yield shlex.join(["rvsg", "suite", "run", suite, "--stack", stack, *options])
        else:
            versions = [f"embedded:stack={each}" for each in (stack, tuned)]
            page = ["--html", f"{self.tuner.out}/compare.html"]
            yield shlex.join(["rvsg", "suite", "compare", *versions, "--suite", suite, *page])
        yield shlex.join(["rvsg", "run", "--stack", tuned, *options])

    def _seeds(self, count: int) -> list[int]:
        return [seed_for(self.tuner.seed, "tuning/check", k) for k in range(count)]

    def _parts(self, values: Values) -> Iterator[ProposalCheck]:
        """Yield every check of the proposal."""
        few, missions = min(FEW_SEEDS, self.tuner.check_runs), self._missions()
        empty = [self._other(f"empty-{k}", each, HumanConfiguration(humans=())) for k, each in enumerate(missions)]
        named: list[tuple[Check, list[SuiteCase], int]] = [
            ("tuned", [each for each in self.cases if each.name in self.split.tuned], self.tuner.check_runs),
            ("held out", [each for each in self.cases if each.name in self.split.held_out], self.tuner.check_runs),
            ("ordinary", list(self._ordinary(missions)), few),
            ("empty", empty, few),
        ]
        for name, cases, seeds in named:
            if cases:
                self.tuner.on_message(
                    f"Checking {name}: {counted(len(cases), 'case')}, {counted(seeds, 'seed')} each, before and after: "
                    f"{2 * len(cases) * seeds} runs."
                )
                yield ProposalCheck(name=name, comparison=self._compared(cases, values, self._seeds(seeds)))
        if self.tuner.attack_runs:
            yield self._attacked(missions[:ATTACKED], values)

    def _compared(self, cases: Sequence[SuiteCase], values: Values, seeds: Sequence[int]) -> Comparison:
        results = [
            results_of(
                label,
                self.suite.head.title,
                cases,
                self._made(setting, cases, seeds),
                self.runs.stack_of(setting),
            )
            for label, setting in (("before", self.present), ("proposal", values))
        ]
        return compare(results)

    def _made(self, values: Values, cases: Sequence[SuiteCase], seeds: Sequence[int]) -> list[SettingRun]:
        made: list[SettingRun] = []
        total = len(cases) * len(seeds)
        for run in self.runs.run((values, case, seed) for case in cases for seed in seeds):
            if isinstance(run, Failure):
                raise SimulationError(f"seed {run.seed}: {run.reason}")
            made.append(run)
            if total >= SHOWN_FROM and len(made) % (total // 4) == 0:
                self.tuner.on_message(f"  {len(made)} of {total} runs {'after' if self._changed(values) else 'before'}")
        return made

    def _missions(self) -> list[SuiteCase]:
        """Return a case of each mission, those that violate most often first."""
        violated = dict.fromkeys((each.name for each in self.cases), 0)
        for run in self.search.before.runs.values():
            violated[run.case] += run.violated
        found: dict[str, SuiteCase] = {}
        for each in sorted(self.cases, key=lambda each: (-violated[each.name], each.name)):
            found.setdefault(each.scenario.mission.id, each)
        return list(found.values())

    def _other(self, name: str, like: SuiteCase, people: HumanConfiguration) -> SuiteCase:
        """Return other people on the route of a case, judged as it is."""
        scenario = Scenario(mission=like.scenario.mission, people=people)
        case = like.case.replace(name=name, title=name, scenario=scenario)
        return replace(like, case=case)

    def _ordinary(self, missions: Sequence[SuiteCase]) -> Iterator[SuiteCase]:
        """Yield people on random errands on each route: nothing is aimed at the robot."""
        for k, each in enumerate(missions):
            for j in range(ORDINARY):
                seed = seed_for(self.tuner.seed, "tuning/ordinary", k, j)
                brief = Brief(mission=each.scenario.mission, requirement=None, seed=seed)
                proposed = RandomGenerator().propose(brief, each.world).scenario
                if proposed is not None:
                    yield self._other(f"ordinary-{k}-{j}", each, proposed.people)

    def _attacked(self, missions: Sequence[SuiteCase], values: Values) -> ProposalCheck:
        """Search for failures of the stack before and of the proposal, with the same budget and seeds."""
        results, failures = [], []
        for label, setting in (("before", self.present), ("proposal", values)):
            budget = max(10, self.tuner.attack_runs // len(missions))
            self.tuner.on_message(
                f"Attacking {counted(len(missions), 'route')}: {label}, {counted(budget, 'run')} each, then confirms."
            )
            cases, confirmed = [], 0
            for each in missions:
                campaign = self._campaign(each, setting, budget)
                deque(campaign.run(jobs=self.tuner.jobs), maxlen=0)
                with campaign.result() as result:
                    confirmed += sum(finding.violated for finding in result.findings)
                cases += [
                    result_of_attempt(attempt, campaign.requirement).replace(
                        case=f"{campaign.folder.name.lower()}-{attempt.index}"
                    )
                    for attempt in result.attempts
                    if attempt.purpose == "search"
                    and attempt.verdict is not None
                    and attempt.proposal.scenario is not None
                ]
            results.append(SuiteResult(suite="attack", version=label, simulator="embedded", cases=tuple(cases)))
            failures.append(confirmed)
        return ProposalCheck(name="attacked", comparison=compare(results), failures=(failures[0], failures[1]))

    def _campaign(self, each: SuiteCase, values: Values, budget: int) -> Campaign:
        """Return a campaign against a setting on the route of a case, judged as it is, in a folder of its own."""
        mission, requirement = each.scenario.mission, each.requirements[0]
        world, stack = folder_of(mission.world_id), self.runs.stack_of(values)
        name = content_id(mission.route.name, [mission.id, requirement.id, stack.id])
        folder = self.tuner.out / "attacks" / name
        robot, limits = (folder.with_name(f"{name}.{kind}.yaml") for kind in ("robot", "requirement"))
        if isinstance(mission.robot, Robot):
            write_whole(robot, yaml.safe_dump(mission.robot.model_dump(mode="json"), sort_keys=False))
        own = requirement.model_dump(mode="json", exclude={"name"}, exclude_none=True)
        write_whole(limits, yaml.safe_dump({requirement.name: own}, sort_keys=False))
        return Campaign.create(
            folder,
            world=str(world) if world is not None else mission.world,
            route=mission.route.name,
            requirement=str(limits),
            robot=str(robot) if isinstance(mission.robot, Robot) else mission.robot,
            doors=mission.doors,
            stack=stack,
            simulator=each.simulator,
            budget_runs=budget,
            confirmations=max(20, budget // 3),
            shrink_runs=0,
            search_anyway=True,
            **each.judging.model_dump(exclude={"max_runs"}),
            seed=self.tuner.seed,
            named=({"stack": self.tuner.stack}, stack.options),
        )

    def _sweeps(self, setting: TunedSetting, importances: Mapping[str, float]) -> Iterator[Sweep]:
        """Yield the proposal with each of the parameters that matter most at other values."""
        order = sorted(self.search.parameters.values(), key=lambda each: -importances.get(each.name, 0.0))
        for each in order[:SWEPT]:
            proposed = setting.values[each.name]
            values = sorted({proposed, *(each.value(each.at(k / (SWEEP_POINTS - 1))) for k in range(SWEEP_POINTS))})
            tried = [(value, self.search.try_out({**setting.values, each.name: value})) for value in values]
            points = tuple((value, made.score) for value, made in tried if made.score is not None and not made.failures)
            yield Sweep(parameter=each, proposed=proposed, points=points)

    def _replayed(self, values: Values) -> ReplayedChange | None:
        """Return the run that gets better the most, before and after; None where none does."""
        seeds = self._seeds(self.tuner.check_runs)
        before, after = (self._made(setting, self.cases, seeds) for setting in (self.present, values))
        gains = [old.cost - new.cost for old, new in zip(before, after, strict=True)]
        if max(gains) <= 0.0:
            return None
        best = before[gains.index(max(gains))]
        case = next(each for each in self.cases if each.name == best.case)
        world, scenario, evaluator = case.world, case.scenario, case.evaluator()
        requirement = evaluator.requirement
        runs = [self.runs.whole(case, setting, best.seed) for setting in (self.present, values)]
        measured = [evaluator.measure(run, world) for run in runs]
        first, second = (run_facts(*each, requirement, world, scenario) for each in zip(runs, measured, strict=True))
        title, change = case.case.title, Change.FIXED
        return ReplayedChange(
            change=CaseChange(case=case.name, title=title, requirement=requirement.name, change=change),
            seed=best.seed,
            scenario=scenario,
            requirement=requirement,
            world=world,
            runs=(first, second),
        )
