"""The runner: makes runs in this process, in worker processes or on a cluster, and measures them.

What is recorded does not depend on how many workers there are, where they are, or which of them is faster. A run
whose id is known is not simulated again. A run that cannot be made is a Failure; a run whose worker died is repeated by
the executor, and becomes a Failure if it keeps killing its worker.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Any, Protocol, Self

from rvsg.core.errors import InputError, SimulationError
from rvsg.core.plugins import Spec, ignore
from rvsg.evaluation.metrics import measure
from rvsg.evaluation.realism import is_left_out
from rvsg.evaluation.verdict import DEFAULT, Procedure, Verdict, judge, next_repeats, objective
from rvsg.runs.attempt import Failure, Measurement
from rvsg.runs.ledger import CachedLedger, Recent
from rvsg.runs.observation import RunObservation, observe
from rvsg.runs.worker_pool import Processes
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.archive import PackedRun, rounded
from rvsg.simulation.run import Outcome, Run, run_id
from rvsg.simulation.simulators import Simulator, make_simulator
from rvsg.world.world import World

RECENT = 1000
"""Results that are kept in memory, packed to some 5 kB each: strategies that race ask for the same runs again."""


class Evaluator:
    """Measures runs by every metric, and judges them by one or more requirements.

    Args:
        world: where the runs took place; metrics that concern obstacles need it.
        procedure: the error rates and the budget of a verdict.
        time_limit_s: the time limit of the route, which bounds the intervals of times.
        least_realism: runs in which somebody does what fewer recorded people do (percent) have no objective.
    """

    def __init__(
        self,
        requirements: Requirement | Sequence[Requirement],
        world: World | None = None,
        *,
        procedure: Procedure = DEFAULT,
        time_limit_s: float | None = None,
        least_realism: float | None = None,
    ) -> None:
        self.least_realism = least_realism
        self.requirements = (requirements,) if isinstance(requirements, Requirement) else tuple(requirements)
        self.time_limit_s = time_limit_s
        self.world = world
        self.procedure = procedure

    @property
    def requirement(self) -> Requirement:
        """The first requirement, by which a campaign searches."""
        return self.requirements[0]

    def measure(self, run: Run, place: World | None = None) -> Measurement:
        """Return every metric of one run, and the first requirement's objective; see `measure_all`."""
        return self.measure_all(run, place)[0]

    def measure_all(self, run: Run, place: World | None = None) -> tuple[Measurement, ...]:
        """Return every metric of one run with the objective of each requirement.

        Args:
            place: the world as the scenario of the run finds it, where that is not the world given.
        """
        world = self.world if place is None else place
        values = measure(run, world=world)
        measured = Measurement(run_id=run.id, seed=run.seed, outcome=run.outcome.value, values=values)
        if is_left_out(values, self.least_realism):
            return (measured,) * len(self.requirements)

        def value(requirement: Requirement) -> float | None:
            if requirement.metric in values and run.outcome is not Outcome.STACK_FAILED:
                return values[str(requirement.metric)]
            return objective(run, requirement, world=world)

        return tuple(measured.model_copy(update={"objective": value(each)}) for each in self.requirements)

    def judged(self, run: Run, place: World | None = None) -> Measurement:
        """Return the first requirement's objective of one run, without any other metric."""
        value = objective(run, self.requirement, world=self.world if place is None else place)
        return Measurement(run_id=run.id, seed=run.seed, outcome=run.outcome.value, values={}, objective=value)

    def judge(
        self,
        measurements: Sequence[Measurement],
        requirement: Requirement | None = None,
        *,
        budget: int | None = None,
    ) -> Verdict:
        """Return the verdict on measured runs; `budget` is how many there may be at most (None: the procedure's).

        Args:
            requirement: the one that the measurements are of; the first by default.
        """
        procedure = self.procedure if budget is None else self.procedure.replace(max_runs=budget)
        return judge(
            requirement or self.requirement,
            [measurement.objective for measurement in measurements],
            procedure=procedure,
            arrived=[measurement.outcome == Outcome.REACHED.value for measurement in measurements],
            time_limit_s=self.time_limit_s,
        )

    def runs_wanted(self, measured: Sequence[tuple[Measurement, ...]]) -> int:
        """Return the most further runs that any requirement asks for; all of the budget where there is no limit."""
        return max(
            self.procedure.max_runs - len(measured)
            if requirement.threshold is None
            else next_repeats(requirement, [of[k].objective for of in measured], procedure=self.procedure)
            for k, requirement in enumerate(self.requirements)
        )


@dataclass(frozen=True)
class RunRequest:
    """A run that is asked for, with what differs from the other runs of its Runner."""

    scenario: Scenario
    seed: int
    trial: bool = False
    """Whether only how it is judged is of interest; nobody stores it."""
    world: World | None = None
    simulator: Spec | None = None
    """A variant of the system under test."""
    measuring: Evaluator | None = None


@dataclass(frozen=True)
class FinishedRun:
    """A run as it comes back from where it was made: measured, and packed for the store."""

    seed: int
    outcome: Outcome
    measurements: tuple[Measurement, ...]
    """One for each requirement."""
    packed: PackedRun
    observation: RunObservation | None = None
    """What the process that made it observed; None unless asked for."""

    @property
    def id(self) -> str:
        """The run's content id."""
        return self.packed.id

    @property
    def measurement(self) -> Measurement:
        """What was measured for the first requirement."""
        return self.measurements[0]

    def unpack(self) -> Run:
        """Return the run with its arrays."""
        return self.packed.unpack()


VARIANTS = 4
"""Variants whose simulators a process keeps: a batch of settings of a tuning."""


@dataclass(frozen=True)
class RunMaker:
    """Simulates, measures and packs one run at a time; the same in this process, a worker, or a cluster.

    A run is rounded before it is measured (see `rvsg.simulation.archive.rounded`), so that a run read from the store
    has exactly the metrics it had when it was made.
    """

    simulator: Simulator | None
    """None where every job names its own."""
    world: World | None = None
    measuring: Evaluator | None = None
    """Measures every run; None: nobody judges them."""
    observes: bool = False
    """Whether every run that is stored is observed."""
    _variants: dict[str, Simulator] = field(default_factory=dict)

    def __call__(
        self, job: RunRequest, *, on_run: Callable[[Run], None] | None = None
    ) -> FinishedRun | Measurement | Failure:
        """Make one run, of a trial only its Measurement; a Failure where the simulator cannot, or refuses the variant.

        Args:
            on_run: Receives the run with its arrays, rounded, unless it is a trial.
        """
        place = self.place(job)
        try:
            run = rounded(self._simulator(job).run(job.scenario, place, seed=job.seed))
        except SimulationError as error:
            return Failure(seed=job.seed, reason=str(error))
        except InputError as error:
            if job.simulator is None:
                raise
            return Failure(seed=job.seed, reason=str(error))
        if job.trial and self.measuring is not None:
            return self.measuring.judged(run, place)
        if on_run is not None:
            on_run(run)
        return self.finished(job, run, observation=observe(run, self.world) if self.observes and self.world else None)

    def close(self) -> None:
        """Release what the simulators hold."""
        while self._variants:
            self._variants.popitem()[1].close()
        if self.simulator is not None:
            self.simulator.close()

    def place(self, job: RunRequest) -> World:
        """Return the world of a job as its scenario finds it."""
        world = job.world or self.world
        assert world is not None, "a runner without a world makes jobs that name theirs"
        return job.scenario.mission.place(world)

    def finished(self, job: RunRequest, run: Run, *, observation: RunObservation | None = None) -> FinishedRun:
        """Measure and pack a rounded run."""
        measuring = job.measuring or self.measuring
        if measuring is None:
            nothing = Measurement(run_id=run.id, seed=run.seed, outcome=run.outcome.value, values={})
            measured: tuple[Measurement, ...] = (nothing,)
        else:
            measured = measuring.measure_all(run, self.place(job))
        return FinishedRun(run.seed, run.outcome, measured, PackedRun.of(run), observation)

    def _simulator(self, job: RunRequest) -> Simulator:
        """Return the simulator of a job; InputError where the variant is refused."""
        if job.simulator is None:
            assert self.simulator is not None, "a runner without a simulator makes jobs that name theirs"
            return self.simulator
        if job.simulator.id not in self._variants:
            while len(self._variants) >= VARIANTS:
                self._variants.pop(next(iter(self._variants))).close()
            simulator = make_simulator(job.simulator)
            simulator.prepare(ignore)
            self._variants[job.simulator.id] = simulator
        return self._variants[job.simulator.id]


class Executor(Protocol):
    """Where runs are made outside this process; a plug-in of the kind `executor`, created with its options.

    An executor survives the death of its workers by itself: it repeats what was lost, and returns a Failure for a
    run that keeps killing its worker.
    """

    @property
    def size(self) -> int:
        """Return how many runs it makes at a time."""
        ...

    def start(self, maker: RunMaker, notify: Callable[[str], None]) -> None:
        """Get ready to call `maker` with jobs; `notify` receives messages for the user.

        Raises:
            InputError: The executor cannot be used.
        """
        ...

    def submit(self, job: RunRequest) -> Any:
        """Start a run and return at once what `result` takes."""
        ...

    def result(self, submitted: Any) -> FinishedRun | Measurement | Failure:
        """Wait for a run.

        Raises:
            SimulationError: No worker is left and none can be started.
        """
        ...

    def stop(self, *, kill: bool) -> None:
        """End the workers; with `kill` without waiting for what is under way. `start` may follow."""
        ...


class PendingRun:
    """A run that was submitted; `result` waits for it."""

    def __init__(self, runner: Runner, job: RunRequest) -> None:
        self.job = job
        self.run_id = runner.id_of(job)
        self._runner = runner
        self._result: FinishedRun | Measurement | Failure | None = None
        self._submitted: Any = None

    def result(self) -> FinishedRun | Failure:
        """Return the run, or why the simulator could not make it."""
        result = self._wait()
        assert not isinstance(result, Measurement), "a trial has a measurement and no result"
        return result

    def finished(self, label: str = "") -> FinishedRun:
        """Return the run.

        Args:
            label: What a message about it names besides its seed.

        Raises:
            SimulationError: The simulator could not make it.
        """
        result = self.result()
        if isinstance(result, Failure):
            raise SimulationError(f"{label}{', ' if label else ''}seed {result.seed}: {result.reason}")
        return result

    def measurement(self) -> Measurement | None:
        """Return what was measured of the run; None where the simulator could not make it."""
        result = self._wait()
        if isinstance(result, FinishedRun):
            return result.measurement
        return None if isinstance(result, Failure) else result

    def _wait(self) -> FinishedRun | Measurement | Failure:
        if self._result is None:
            self._result = self._runner._collect(self)
        return self._result


class Runner:
    """Makes and measures runs: scenarios x seeds x variants x requirements. Leaving it ends the workers.

    Everything that simulates goes through it: campaigns, single scenarios, suites, comparisons, tuning, explorations.

    Args:
        simulator: What makes the runs; None where every run names its variant of the system under test.
        world: Where they take place; None where every run names its world.
        measuring: What measures each run, in the process that made it; None where nobody judges them.
        jobs: Worker processes; with 1 everything happens in this process.
        executor: Where runs are made instead of in `jobs` processes.
        ledger: Where runs may be stored already; it keeps in memory what is observed of each new one.
        notify: Receives messages for the user, such as that a machine is gone.
        closes: Close the simulator at the end; its next run makes again what it needs.
    """

    def __init__(
        self,
        simulator: Simulator | None = None,
        world: World | None = None,
        *,
        measuring: Evaluator | None = None,
        jobs: int = 1,
        executor: Executor | None = None,
        ledger: CachedLedger | None = None,
        notify: Callable[[str], None] = lambda _: None,
        closes: bool = False,
    ) -> None:
        self.closes = closes
        self._options = {} if simulator is None else dict(simulator.options)
        self._variants: dict[str, tuple[str, dict[str, Any]]] = {}
        self._maker = RunMaker(simulator, world, measuring, observes=ledger is not None)
        self._executor: Executor | None = executor or (Processes(jobs) if jobs > 1 else None)
        self._ledger = ledger
        self._notify = notify
        self._open: dict[tuple[str, bool], PendingRun] = {}
        self._recent: Recent[tuple[str, bool], FinishedRun | Measurement] = Recent(RECENT)
        self._started = False

    @property
    def simulator(self) -> Simulator:
        """The simulator of every run that names no variant."""
        assert self._maker.simulator is not None, "every run of this runner names its variant"
        return self._maker.simulator

    @property
    def world(self) -> World:
        """Where the runs take place that name no world."""
        assert self._maker.world is not None, "every run of this runner names its world"
        return self._maker.world

    @property
    def lookahead(self) -> int:
        """Return how many attempts to submit before the first is collected: 0 in one process."""
        return self._ready().size if self._executor else 0

    def id_of(self, job: RunRequest) -> str:
        """Return the id that a run will have; of one whose variant is refused, an id that no run has."""
        return run_id(job.scenario.id, *self._variant(job), job.seed)

    def _variant(self, job: RunRequest) -> tuple[str, dict[str, Any]]:
        """Return name and options of what makes a run."""
        if job.simulator is None:
            return self.simulator.name, self._options
        key = job.simulator.id
        if key not in self._variants:
            try:
                with closing(make_simulator(job.simulator)) as simulator:
                    self._variants[key] = simulator.name, dict(simulator.options)
            except InputError:
                self._variants[key] = "refused", {"variant": key}
        return self._variants[key]

    def run(
        self, scenario: Scenario, seeds: Iterable[int], *, label: str = "", measuring: Evaluator | None = None
    ) -> Iterator[FinishedRun]:
        """Make one run of a scenario for each seed and yield them in this order.

        Args:
            label: What a message about a run names besides its seed.
            measuring: Measures these runs instead of what measures the others.

        Raises:
            SimulationError: A run could not be made.
        """
        for pending in [self.submit(RunRequest(scenario, seed, measuring=measuring)) for seed in seeds]:
            yield pending.finished(label)

    def submit(self, job: RunRequest) -> PendingRun:
        """Ask for a run; it starts at once where there are workers, else when its result is wanted."""
        pending = PendingRun(self, job)
        key = (pending.run_id, job.trial)
        if key in self._open:
            return self._open[key]
        pending._result = self._recent.get(key) or self._stored(pending)
        if pending._result is None:
            self._open[key] = pending
            if self._executor:
                pending._submitted = self._ready().submit(job)
        return pending

    def measured(self, scenario: Scenario, seeds: Iterable[int]) -> list[Measurement]:
        """Return what trials of a scenario measure, one for each seed; those that could not be made are left out."""
        trials = [self.submit(RunRequest(scenario, seed, trial=True)) for seed in seeds]
        return [measured for trial in trials if (measured := trial.measurement()) is not None]

    def _stored(self, pending: PendingRun) -> FinishedRun | None:
        """Return a run that the ledger holds; None if it has to be made."""
        run = None if pending.job.trial or self._ledger is None else self._ledger.find(pending.run_id)
        if run is None:
            return None
        finished = self._maker.finished(pending.job, rounded(run))
        self._recent.add((pending.run_id, False), finished)
        return finished

    def _collect(self, pending: PendingRun) -> FinishedRun | Measurement | Failure:
        """Wait for a submitted run. KeyboardInterrupt passes through; what was not collected is lost."""
        if self._executor is None:
            keep = self._ledger.keep_in_memory if self._ledger is not None else None
            result = self._maker(pending.job, on_run=keep)
        else:
            result = self._executor.result(pending._submitted)
        if isinstance(result, FinishedRun) and result.observation is not None and self._ledger is not None:
            self._ledger.note(result.observation)
            result = replace(result, observation=None)
        key = (pending.run_id, pending.job.trial)
        self._open.pop(key, None)
        if not isinstance(result, Failure):
            self._recent.add(key, result)
        return result

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        try:
            if self._executor and self._started:
                self._started = False
                self._executor.stop(kill=kind is not None)
        finally:
            if self.closes or self._maker.simulator is None:
                self._maker.close()

    def _ready(self) -> Executor:
        assert self._executor is not None
        if not self._started:
            self._executor.start(self._maker, self._notify)
            self._started = True
        return self._executor
