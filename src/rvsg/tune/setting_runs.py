"""Runs of the cases of a suite with settings of a stack, stored for good.

A run is stored by its content id as one line of a file, as soon as it is made. A tuning that is interrupted asks for
the same runs again, and those of the file are not simulated a second time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from pydantic import ValidationError

from rvsg.core.errors import FileError
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.runs.attempt import Failure, Measurement
from rvsg.runs.observation import mode_of
from rvsg.runs.runner import Evaluator, FinishedRun, Runner, RunRequest
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.simulators import with_stack
from rvsg.simulation.stacks.parameters import with_values
from rvsg.suites.suite import CaseResult, SuiteResult
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

    @property
    def measurements(self) -> tuple[Measurement, ...]:
        """What was measured for each requirement."""
        known = {"run_id": self.run_id, "seed": self.seed, "outcome": self.outcome}
        values = {"contacts": float(self.contact)}
        return tuple(Measurement(**known, values=values, objective=value) for value in self.objectives)


class SettingRuns:
    """Makes runs of settings, and stores each in a file. A context manager; leaving it ends the workers.

    Args:
        stack: the stack whose parameters are set.
        present: their values before tuning; the options of a stack hold those that differ.
        file: where the runs are stored.
        jobs: worker processes; the runs are the same.
    """

    def __init__(self, stack: Spec, present: Values, file: Path, *, jobs: int = 1) -> None:
        self.present: Values = dict(present)
        self.zones: Zones | None = None
        """Zones that the parameters are of, rather than of the options."""
        self._stack = stack
        self._file = file
        self._stored = {run.run_id: run for run in _stored(file)}
        self._runner = Runner(jobs=jobs)

    def __enter__(self) -> Self:
        self._file.parent.mkdir(parents=True, exist_ok=True)
        self._stream = self._file.open("a", encoding="utf-8")
        self._runner.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._stream.close()
        self._runner.__exit__(kind, error, at)

    def stack_of(self, values: Values) -> Spec:
        """Return the stack with a setting."""
        changed = {name: value for name, value in values.items() if value != self.present.get(name)}
        if self.zones is not None:
            filters = self.zones.filters(changed)
            return Spec(self._stack.name, {**self._stack.options, **({"costmap_filters": filters} if filters else {})})
        return Spec(self._stack.name, with_values(self._stack.options, changed))

    def whole(self, case: SuiteCase, values: Values, seed: int) -> Run:
        """Return one run with its arrays."""
        return self._runner.submit(self._job(case, case.evaluator(), values, seed)).finished(case.name).unpack()

    def run(self, wanted: Iterable[tuple[Values, SuiteCase, int]]) -> Iterator[SettingRun | Failure]:
        """Yield a run for each setting, case and seed, in this order; stored ones are not made again."""
        jobs = [(case, self._job(case, case.evaluator(), values, seed)) for values, case, seed in wanted]
        ids = [self._runner.id_of(job) for _, job in jobs]
        missing = {
            run_id: self._runner.submit(job)
            for run_id, (_, job) in zip(ids, jobs, strict=True)
            if run_id not in self._stored
        }
        for run_id, (case, job) in zip(ids, jobs, strict=True):
            if run_id not in self._stored:
                result = missing[run_id].result()
                if isinstance(result, Failure):
                    yield result
                    continue
                self._keep(_setting_run(run_id, case, job, result))
            yield self._stored[run_id]

    def _job(self, case: SuiteCase, measuring: Evaluator, values: Values, seed: int) -> RunRequest:
        simulator = with_stack(case.simulator, self.stack_of(values))
        return RunRequest(case.scenario, seed, world=case.world, simulator=simulator, measuring=measuring)

    def _keep(self, run: SettingRun) -> None:
        self._stored[run.run_id] = run
        self._stream.write(run.model_dump_json() + "\n")
        self._stream.flush()


def _setting_run(run_id: str, case: SuiteCase, job: RunRequest, finished: FinishedRun) -> SettingRun:
    assert job.measuring is not None
    measured = finished.measurement
    violations = tuple(
        None if each.objective is None else requirement.violated_by(each.objective)
        for each, requirement in zip(finished.measurements, job.measuring.requirements, strict=True)
    )
    mode = mode_of(finished.unpack(), case.scenario.mission.place(case.world)) if any(violations) else None
    return SettingRun(
        case=case.name,
        seed=job.seed,
        run_id=run_id,
        outcome=finished.outcome.value,
        objectives=tuple(each.objective for each in finished.measurements),
        violations=violations,
        contact=measured.touches,
        time_s=measured.values["trg"] or case.scenario.mission.route.time_limit_s,
        jerk=measured.values["jerk"] or 0.0,
        kind=mode.person if mode is not None else "",
    )


def _stored(file: Path) -> list[SettingRun]:
    """Return the runs of a file; what an interruption left of a last line is taken away.

    Raises:
        FileError: a line is no run.
    """
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        write_whole(file, whole)
    runs = []
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            runs.append(SettingRun.model_validate_json(line))
        except ValidationError as error:
            raise FileError(file, f"this is no run of a tuning: {error.errors()[0]['msg']}.", line=number) from None
    return runs


def results_of(
    label: str, suite: str, cases: Sequence[SuiteCase], runs: Sequence[SettingRun], stack: Spec
) -> SuiteResult:
    """Return the runs of a setting as results of a suite, which `rvsg.suites.suite.compare` takes."""
    results: list[CaseResult] = []
    for case in cases:
        mine = [run for run in runs if run.case == case.name]
        seconds, simulator = sum(run.time_s for run in mine), with_stack(case.simulator, stack)
        results += case.results(case.evaluator(), [run.measurements for run in mine], seconds, simulator=simulator)
    return SuiteResult(suite=suite, version=label, simulator=cases[0].simulator.name, cases=tuple(results))
