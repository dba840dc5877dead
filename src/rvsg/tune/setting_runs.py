"""Runs of the cases of a suite with settings of a stack: made in this process or in workers, and stored for good.

A run is stored by its content id as one line of a file, as soon as it is made. A tuning that is interrupted asks for
the same runs again, and those of the file are not simulated a second time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from pydantic import ValidationError

from rvsg.core.errors import FileError, InputError, SimulationError
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec, ignore
from rvsg.core.records import Record
from rvsg.evaluation.metrics import measure
from rvsg.evaluation.verdict import DEFAULT, Procedure, judge, objective
from rvsg.runs.attempt import Failure
from rvsg.runs.observation import mode_of
from rvsg.runs.worker_pool import Processes
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.archive import rounded
from rvsg.simulation.run import Outcome, Run, run_id
from rvsg.simulation.simulators import Simulator, make_simulator
from rvsg.simulation.stacks.parameters import with_values
from rvsg.suites.suite import CaseResult, SuiteResult, state_of
from rvsg.suites.suite_folder import SuiteCase
from rvsg.tune.zones import Zones

Values = Mapping[str, float]
"""A setting: values of parameters by name; others are as the stack has them."""
VIOLATION, CONTACT, STACK_FAILED = 1.0, 2.0, 10.0
"""How much a run costs that violates a requirement, touches a person, or in which the stack itself fails."""


class SettingRun(Record):
    """What a run of a case with a setting says."""

    case: str
    seed: int
    run_id: str
    outcome: str
    objectives: tuple[float | None, ...]
    """The value of each requirement of the case."""
    violations: tuple[bool | None, ...]
    """For each requirement whether the run violates it; None without a value."""
    contact: bool
    """Whether the robot touches a person."""
    time_s: float
    """Time to the goal; at least the time limit where it is not reached."""
    jerk: float
    """Mean jerk, m/s³."""
    kind: str = ""
    """What the nearest person does, in a run that violates a requirement."""

    @property
    def violated(self) -> bool:
        """Whether any requirement is violated."""
        return any(self.violations)

    @property
    def failed(self) -> bool:
        """Whether the stack itself failed."""
        return self.outcome == Outcome.STACK_FAILED.value

    @property
    def cost(self) -> float:
        """How severe the run is; 0 where nothing is violated and nobody is touched."""
        return VIOLATION * self.violated + CONTACT * self.contact + STACK_FAILED * self.failed


@dataclass(frozen=True)
class TuningCase:
    """A case, the simulator that it runs with, without the stack, and the error rates of its suite."""

    tested: SuiteCase
    simulator: Spec
    judging: Procedure = DEFAULT

    @property
    def name(self) -> str:
        """The name of the case."""
        return self.tested.case.name

    @property
    def scenario(self) -> Scenario:
        """Its scenario."""
        return self.tested.case.scenario

    @property
    def requirements(self) -> tuple[Requirement, ...]:
        """Its requirements, with limits worked out for the route."""
        limit_s = self.scenario.mission.route.time_limit_s
        return tuple(each.for_time_limit(limit_s) for each in self.tested.requirements)


Job = tuple[TuningCase, tuple[tuple[str, float], ...]]


@dataclass
class SettingRunMaker:
    """Makes one run at a time; keeps the simulators of the last settings. The same in this process and in workers."""

    stack: Spec
    present: Values
    """The values of the parameters before tuning; the options of a stack hold those that differ."""
    zones: Zones | None = None
    """Zones that the parameters are of, rather than of the options."""
    _simulators: dict[str, Simulator] = field(default_factory=dict)

    def simulator(self, case: TuningCase, values: Values) -> Simulator:
        """Return the simulator of a case with a setting.

        Raises:
            InputError: the stack refuses these values.
        """
        return make_simulator(case.simulator, self.stack_of(values))

    def stack_of(self, values: Values) -> Spec:
        """Return the stack with a setting."""
        changed = {name: value for name, value in values.items() if value != self.present.get(name)}
        if self.zones is not None:
            filters = self.zones.filters(changed)
            return Spec(self.stack.name, {**self.stack.options, **({"costmap_filters": filters} if filters else {})})
        return Spec(self.stack.name, with_values(self.stack.options, changed))

    def run(self, case: TuningCase, values: Values, seed: int) -> Run:
        """Return one run with its arrays."""
        key = repr((case.simulator, sorted(values.items())))
        if key not in self._simulators:
            while len(self._simulators) >= KEPT:
                self._simulators.pop(next(iter(self._simulators))).close()
            made = self.simulator(case, values)
            made.prepare(ignore)
            self._simulators[key] = made
        place = case.scenario.mission.place(case.tested.world)
        return rounded(self._simulators[key].run(case.scenario, place, seed=seed))

    def __call__(self, job: Job, seed: int, *, trial: bool = False) -> SettingRun | Failure:
        """Make and measure one run; a Failure where the simulator cannot, or the stack refuses the values."""
        case, values = job[0], dict(job[1])
        try:
            run = self.run(case, values, seed)
        except (SimulationError, InputError) as error:
            return Failure(seed=seed, reason=str(error))
        place = case.scenario.mission.place(case.tested.world)
        measured = measure(run, ("contacts", "trg", "jerk"), world=place)
        found = [objective(run, each, world=place) for each in case.requirements]
        flags = [
            None if value is None else requirement.violated_by(value)
            for value, requirement in zip(found, case.requirements, strict=True)
        ]
        mode = mode_of(run, place) if any(flags) else None
        return SettingRun(
            case=case.name,
            seed=seed,
            run_id=run.id,
            outcome=run.outcome.value,
            objectives=tuple(found),
            violations=tuple(flags),
            contact=(measured["contacts"] or 0.0) > 0.0,
            time_s=measured["trg"] or run.time_limit_s,
            jerk=measured["jerk"] or 0.0,
            kind=mode.person if mode is not None else "",
        )

    def close(self) -> None:
        """Release what the simulators hold."""
        while self._simulators:
            self._simulators.popitem()[1].close()


KEPT = 4
"""Simulators that a process keeps: a batch of settings."""


class SettingRuns:
    """Makes runs of settings, and stores each in a file. A context manager; leaving it ends the workers.

    Args:
        stack: the stack whose parameters are set.
        present: their values before tuning.
        file: where the runs are stored.
        jobs: worker processes; the runs are the same.
    """

    def __init__(self, stack: Spec, present: Values, file: Path, *, jobs: int = 1) -> None:
        self.maker = SettingRunMaker(stack, dict(present))
        self.made = 0
        """Runs that were simulated, not read."""
        self.asked = 0
        self._file = file
        self._known = {each.run_id: each for each in _stored(file)}
        self._workers = Processes(jobs) if jobs > 1 else None
        self._variant: tuple[Any, tuple[str, dict[str, Any]]] = (None, ("", {}))

    def __enter__(self) -> Self:
        self._file.parent.mkdir(parents=True, exist_ok=True)
        self._stream = self._file.open("a", encoding="utf-8")
        if self._workers is not None:
            self._workers.start(self.maker, ignore)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._stream.close()
        if self._workers is not None:
            self._workers.stop(kill=kind is not None)
        self.maker.close()

    def use(self, maker: SettingRunMaker) -> None:
        """Make the runs from now on by another maker."""
        self.maker.close()
        self.maker, self._variant = maker, (None, ("", {}))
        if self._workers is not None:
            self._workers.stop(kill=False)
            self._workers.start(maker, ignore)

    def run(self, wanted: Iterable[tuple[Values, TuningCase, int]]) -> Iterator[SettingRun | Failure]:
        """Yield a run for each setting, case and seed, in this order; stored ones are not made again."""
        wanted = list(wanted)
        jobs = [(case, tuple(sorted(values.items()))) for values, case, _ in wanted]
        ids = [self._id(job, seed) for job, (_, _, seed) in zip(jobs, wanted, strict=True)]
        missing = dict.fromkeys(each for each in ids if each not in self._known)
        if self._workers is not None:
            first = {each: k for k, each in reversed(list(enumerate(ids)))}
            submitted = {each: self._workers.submit(jobs[first[each]], wanted[first[each]][2]) for each in missing}
        for each, job, (_, _, seed) in zip(ids, jobs, wanted, strict=True):
            self.asked += 1
            if each not in self._known:
                made: Any = self.maker(job, seed) if self._workers is None else self._workers.result(submitted[each])
                if isinstance(made, Failure):
                    yield made
                    continue
                self._keep(made.model_copy(update={"run_id": each}))
            yield self._known[each]

    def _id(self, job: Job, seed: int) -> str:
        """Return the id of a run; of one that the stack refuses, an id that no run has."""
        case, values = job
        key = (case.simulator.id, values)
        if self._variant[0] != key:
            try:
                with closing(self.maker.simulator(case, dict(values))) as made:
                    self._variant = key, (made.name, dict(made.options))
            except InputError:
                self._variant = key, ("refused", {"values": values})
        name, options = self._variant[1]
        return run_id(case.scenario.id, name, options, seed)

    def _keep(self, made: SettingRun) -> None:
        self.made += 1
        self._known[made.run_id] = made
        self._stream.write(made.model_dump_json() + "\n")
        self._stream.flush()


def _stored(file: Path) -> list[SettingRun]:
    """Return the runs of a file; what an interruption left of a last line is taken away.

    Raises:
        FileError: a line is no run.
    """
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        write_whole(file, whole)
    found = []
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            found.append(SettingRun.model_validate_json(line))
        except ValidationError as error:
            raise FileError(file, f"this is no run of a tuning: {error.errors()[0]['msg']}.", line=number) from None
    return found


def results_of(
    label: str, suite: str, cases: Sequence[TuningCase], runs: Sequence[SettingRun], stack: Spec
) -> SuiteResult:
    """Return the runs of a setting as results of a suite, which `rvsg.suites.suite.compare` takes."""
    results = []
    for case in cases:
        mine = [run for run in runs if run.case == case.name]
        for k, (requirement, expectation) in enumerate(
            zip(case.requirements, case.tested.case.expectations, strict=True)
        ):
            verdict = judge(
                requirement,
                [run.objectives[k] for run in mine],
                procedure=case.judging,
                arrived=[run.outcome == Outcome.REACHED.value for run in mine],
                time_limit_s=case.scenario.mission.route.time_limit_s,
            )
            results.append(
                CaseResult(
                    case=case.name,
                    title=case.tested.case.title,
                    requirement=expectation.requirement,
                    expected=expectation.expected,
                    state=state_of(expectation.expected, verdict),
                    verdict=verdict,
                    seeds=tuple(run.seed for run in mine),
                    violations=tuple(run.violations[k] for run in mine),
                    contacts=sum(run.contact for run in mine),
                    arrived=sum(run.outcome == Outcome.REACHED.value for run in mine),
                    failed=sum(run.failed for run in mine),
                    seconds=sum(run.time_s for run in mine),
                    simulator=Spec(
                        case.simulator.name, {**case.simulator.options, "stack": stack.model_dump(mode="json")}
                    ),
                )
            )
    return SuiteResult(suite=suite, version=label, simulator=cases[0].simulator.name, cases=tuple(results))
