"""Tuning of a navigation stack on a suite: from its failures to a changed parameter file with the evidence for it."""

from __future__ import annotations

import fnmatch
import json
import shlex
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import Field

from rvsg.app.record import differences, other_settings
from rvsg.app.suites import Suite
from rvsg.core import permission
from rvsg.core.documents import read_document
from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.core.files import write_whole
from rvsg.core.inputs import read_text
from rvsg.core.plugins import Spec, ignore
from rvsg.core.records import Record
from rvsg.evaluation.verdict import counted
from rvsg.report.run_facts import run_facts
from rvsg.robots.robot import DEFAULT_ROBOT, load_robot
from rvsg.runs.runner import Evaluator
from rvsg.scenario.builder import as_robot
from rvsg.simulation.embedded.simulator import can_plan
from rvsg.simulation.simulators import as_found, make_simulator
from rvsg.simulation.stacks.parameter_file import (
    SKELETONS,
    has_filters,
    has_place,
    skeleton,
)
from rvsg.simulation.stacks.parameters import Parameter, value_at, with_values
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg.suites.suite import Case
from rvsg.tune.parameter_search import SEEDS, Candidate, Optimiser, ParameterSearch
from rvsg.tune.setting_runs import SettingRunMaker, SettingRuns, TuningCase, Values
from rvsg.tune.tuning import Tuning, split
from rvsg.tune.tuning_checks import ProposalChecks
from rvsg.tune.zones import REACH_M, Zones, zones_around

RUNS, ASKED = "runs.jsonl", "asked.json"


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
                    zones = self._zones([each for each in cases if each.name in parts.tuned], before, runs.maker)
                    parameters = zones.parameters()
                    runs.use(SettingRunMaker(stack, {each.name: each.present or 0.0 for each in parameters}, zones))
                    settings = [each for each in zones.settings() if self._leaves_ways(each, cases, runs.maker)]
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

    def _case(self, suite: Suite, case: Case) -> TuningCase:
        """Return a case with what runs it."""
        given, tested = as_found(case.simulator, None, self.stack), suite.tested(case.name)
        assert isinstance(given, Spec)
        if self.robot is not None:
            with closing(make_simulator(given)) as made:
                tested = tested.driven_by(as_robot(self.robot, made.robots))
        return TuningCase(tested, given, suite.head.judging)

    def source(self, stack: Spec) -> tuple[str | None, Path]:
        """Return the text of the parameter file, or of one made for a stack of Nav2 without options."""
        if self.stack.endswith((".yaml", ".yml")):
            return read_text(Path(self.stack)), Path(self.stack)
        return None if self.stack_options else skeleton(stack.name), Path("nav2_params.yaml")

    def _in_one_map(self, cases: Sequence[TuningCase], stack: Spec) -> tuple[list[TuningCase], tuple[str, ...]]:
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

    def _zones(self, cases: Sequence[TuningCase], before: Candidate, maker: SettingRunMaker) -> Zones:
        """Return zones around where the robot is at the decisive moments of the violating runs of cases."""
        places, world = list[tuple[float, float]](), cases[0].tested.world
        for case in cases:
            for made in (run for run in before.runs.values() if run.case == case.name and run.violated):
                requirement = case.requirements[made.violations.index(True)]
                run = maker.run(case, before.values, made.seed)
                measured = Evaluator(requirement, case.tested.world).measure(run)
                at = run_facts(run, measured, requirement, case.tested.world, case.scenario).decisive_at
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

    def _leaves_ways(self, setting: Values, cases: Sequence[TuningCase], maker: SettingRunMaker) -> bool:
        """Return whether every route of the cases can still be planned with a setting of zones."""
        world, missions = cases[0].tested.world, {each.scenario.mission.id: each.scenario.mission for each in cases}
        with closing(StackChoice.of(maker.stack_of(setting))) as choice:
            robots = ((each, each.robot_record or load_robot(DEFAULT_ROBOT)) for each in missions.values())
            return all(can_plan(world, each.route, choice.driver.adapt(robot)) for each, robot in robots)

    def _parameters(
        self, choice: StackChoice, cases: Sequence[TuningCase]
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
