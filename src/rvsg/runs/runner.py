"""The runner: makes runs in this process, in worker processes or on a cluster, and measures them.

What is recorded does not depend on how many workers there are, where they are, or which of them is faster. A run
whose id is known is not simulated again. A run that cannot be made is a Failure; a run whose worker died is repeated by
the executor, and becomes a Failure if it keeps killing its worker.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, Protocol, Self

from rvsg.core.errors import SimulationError
from rvsg.evaluation.metrics import measure
from rvsg.evaluation.realism import is_left_out
from rvsg.evaluation.verdict import DEFAULT, Procedure, Verdict, judge, objective
from rvsg.runs.attempt import Failure, Measurement
from rvsg.runs.ledger import CachedLedger, Recent
from rvsg.runs.observation import RunObservation, observe
from rvsg.runs.worker_pool import Processes
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.archive import PackedRun, rounded
from rvsg.simulation.run import Outcome, Run, run_id
from rvsg.simulation.simulators import Simulator
from rvsg.world.world import World

RECENT = 1000
"""Results that are kept in memory, packed to some 5 kB each: strategies that race ask for the same runs again."""


class Evaluator:
    """Measures runs by every metric, and judges them by `requirement`.

    Args:
        world: where the runs took place; metrics that concern obstacles need it.
        procedure: the error rates and the budget of a verdict.
        time_limit_s: the time limit of the route, which bounds the intervals of times.
        least_realism: runs in which somebody does what fewer recorded people do (percent) have no objective.
    """

    def __init__(
        self,
        requirement: Requirement,
        world: World | None = None,
        *,
        procedure: Procedure = DEFAULT,
        time_limit_s: float | None = None,
        least_realism: float | None = None,
    ) -> None:
        self.least_realism = least_realism
        self.requirement = requirement
        self.time_limit_s = time_limit_s
        self.world = world
        self.procedure = procedure

    def measure(self, run: Run, place: World | None = None) -> Measurement:
        """Return every metric of one run, and the requirement's objective.

        Args:
            place: the world as the scenario of the run finds it, where that is not the world given.
        """
        world = self.world if place is None else place
        values, metric = measure(run, world=world), self.requirement.metric
        if is_left_out(values, self.least_realism):
            return Measurement(run_id=run.id, seed=run.seed, outcome=run.outcome.value, values=values)
        known = metric is not None and metric in values and run.outcome is not Outcome.STACK_FAILED
        return Measurement(
            run_id=run.id,
            seed=run.seed,
            outcome=run.outcome.value,
            values=values,
            objective=values[str(metric)] if known else objective(run, self.requirement, world=world),
        )

    def judged(self, run: Run, place: World | None = None) -> Measurement:
        """Return the requirement's objective of one run, without any other metric."""
        value = objective(run, self.requirement, world=self.world if place is None else place)
        return Measurement(run_id=run.id, seed=run.seed, outcome=run.outcome.value, values={}, objective=value)

    def judge(self, measurements: Sequence[Measurement], *, budget: int | None = None) -> Verdict:
        """Return the verdict on measured runs; `budget` is how many there may be at most (None: the procedure's)."""
        procedure = self.procedure if budget is None else self.procedure.replace(max_runs=budget)
        return judge(
            self.requirement,
            [measurement.objective for measurement in measurements],
            procedure=procedure,
            arrived=[measurement.outcome == Outcome.REACHED.value for measurement in measurements],
            time_limit_s=self.time_limit_s,
        )


@dataclass(frozen=True)
class FinishedRun:
    """A run as it comes back from where it was made: measured, and packed for the store."""

    seed: int
    outcome: Outcome
    measurement: Measurement
    packed: PackedRun
    observation: RunObservation | None = None
    """What the process that made it observed; None unless asked for."""

    @property
    def id(self) -> str:
        """The run's content id."""
        return self.packed.id

    def unpack(self) -> Run:
        """Return the run with its arrays."""
        return self.packed.unpack()


@dataclass(frozen=True)
class RunMaker:
    """Simulates, measures and packs one run at a time; the same in this process, a worker, or a cluster.

    A run is rounded before it is measured (see `rvsg.simulation.archive.rounded`), so that a run read from the store
    has exactly the metrics it had when it was made.
    """

    simulator: Simulator
    world: World
    measuring: Evaluator | None = None
    """Measures every run; None: nobody judges them."""
    observes: bool = False
    """Whether every run that is stored is observed."""

    def __call__(
        self, scenario: Scenario, seed: int, *, trial: bool = False, made: Callable[[Run], None] | None = None
    ) -> FinishedRun | Measurement | Failure:
        """Make one run; a Failure where the simulator cannot.

        Args:
            trial: Return only how the run is judged. Nobody stores it.
            made: Receives the run with its arrays, rounded, unless it is a trial.
        """
        place = scenario.mission.place(self.world)
        try:
            run = rounded(self.simulator.run(scenario, place, seed=seed))
        except SimulationError as error:
            return Failure(seed=seed, reason=str(error))
        if trial and self.measuring is not None:
            return self.measuring.judged(run, place)
        if made is not None:
            made(run)
        return self.finished(run, place, observation=observe(run, self.world) if self.observes else None)

    def close(self) -> None:
        """Release what the simulator holds."""
        self.simulator.close()

    def finished(self, run: Run, place: World, *, observation: RunObservation | None = None) -> FinishedRun:
        """Measure and pack a rounded run; `place` is the world as its scenario finds it."""
        if self.measuring is None:
            measured = Measurement(run_id=run.id, seed=run.seed, outcome=run.outcome.value, values={})
        else:
            measured = self.measuring.measure(run, place)
        return FinishedRun(run.seed, run.outcome, measured, PackedRun.of(run), observation)


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
        """Get ready to call `maker` with scenarios and seeds; `notify` receives messages for the user.

        Raises:
            InputError: The executor cannot be used.
        """
        ...

    def submit(self, scenario: Scenario, seed: int, *, trial: bool = False) -> Any:
        """Start a run and return at once what `result` takes; `trial` is for the `maker`."""
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

    def __init__(self, runner: Runner, scenario: Scenario, seed: int, *, trial: bool = False) -> None:
        self.scenario = scenario
        self.seed = seed
        self.trial = trial
        self.run_id = run_id(scenario.id, runner.simulator.name, runner.options, seed)
        self._runner = runner
        self._found: FinishedRun | Measurement | Failure | None = None
        self._submitted: Any = None

    def result(self) -> FinishedRun | Failure:
        """Return the run, or why the simulator could not make it."""
        found = self._wait()
        assert not isinstance(found, Measurement), "a trial has a measurement and no result"
        return found

    def finished(self, label: str = "") -> FinishedRun:
        """Return the run.

        Args:
            label: What a message about it names besides its seed.

        Raises:
            SimulationError: The simulator could not make it.
        """
        found = self.result()
        if isinstance(found, Failure):
            raise SimulationError(f"{label}{', ' if label else ''}seed {found.seed}: {found.reason}")
        return found

    def measurement(self) -> Measurement | None:
        """Return what was measured of the run; None where the simulator could not make it."""
        found = self._wait()
        return found.measurement if isinstance(found, FinishedRun) else None if isinstance(found, Failure) else found

    def _wait(self) -> FinishedRun | Measurement | Failure:
        if self._found is None:
            self._found = self._runner._collect(self)
        return self._found


class Runner:
    """Makes and measures the runs of one simulator in one world. A context manager; leaving it ends the workers.

    Everything that simulates goes through it: campaigns, single scenarios, suites, comparisons, explorations. Several
    variants of the system under test (robot, stack, version, parameters) are several simulators, one runner each.

    Args:
        simulator: What makes the runs.
        world: Where they take place.
        measuring: What measures each run, in the process that made it; None where nobody judges them.
        jobs: Worker processes; with 1 everything happens in this process.
        executor: Where runs are made instead of in `jobs` processes.
        ledger: Where runs may be stored already; it keeps in memory what is observed of each new one.
        notify: Receives messages for the user, such as that a machine is gone.
        closes: Close the simulator at the end; its next run makes again what it needs.
    """

    def __init__(
        self,
        simulator: Simulator,
        world: World,
        *,
        measuring: Evaluator | None = None,
        jobs: int = 1,
        executor: Executor | None = None,
        ledger: CachedLedger | None = None,
        notify: Callable[[str], None] = lambda _: None,
        closes: bool = False,
    ) -> None:
        self.simulator = simulator
        self.world = world
        self.options = dict(simulator.options)
        self.closes = closes
        self._maker = RunMaker(simulator, world, measuring, observes=ledger is not None)
        self._executor: Executor | None = executor or (Processes(jobs) if jobs > 1 else None)
        self._ledger = ledger
        self._notify = notify
        self._open: dict[tuple[str, bool], PendingRun] = {}
        self._recent: Recent[tuple[str, bool], FinishedRun | Measurement] = Recent(RECENT)
        self._started = False

    @property
    def lookahead(self) -> int:
        """Return how many attempts to submit before the first is collected: 0 in one process."""
        return self._ready().size if self._executor else 0

    def run(self, scenario: Scenario, seeds: Iterable[int], *, label: str = "") -> Iterator[FinishedRun]:
        """Make one run of a scenario for each seed and yield them in this order.

        Args:
            label: What a message about a run names besides its seed.

        Raises:
            SimulationError: A run could not be made.
        """
        for pending in [self.submit(scenario, seed) for seed in seeds]:
            yield pending.finished(label)

    def submit(self, scenario: Scenario, seed: int, *, trial: bool = False) -> PendingRun:
        """Ask for a run; it starts at once where there are workers, else when its result is wanted.

        Args:
            trial: Nobody stores the run: it has a `measurement`, and no `result`.
        """
        pending = PendingRun(self, scenario, seed, trial=trial)
        key = (pending.run_id, trial)
        if key in self._open:
            return self._open[key]
        pending._found = self._recent.get(key) or self._stored(pending)
        if pending._found is None:
            self._open[key] = pending
            if self._executor:
                pending._submitted = self._ready().submit(scenario, seed, trial=trial)
        return pending

    def measured(self, scenario: Scenario, seeds: Iterable[int]) -> list[Measurement]:
        """Return what trials of a scenario measure, one for each seed; those that could not be made are left out."""
        found = [pending.measurement() for pending in [self.submit(scenario, seed, trial=True) for seed in seeds]]
        return [each for each in found if each is not None]

    def _stored(self, pending: PendingRun) -> FinishedRun | None:
        """Return a run that the ledger holds; None if it has to be made."""
        run = None if pending.trial or self._ledger is None else self._ledger.find(pending.run_id)
        if run is None:
            return None
        finished = self._maker.finished(rounded(run), pending.scenario.mission.place(self.world))
        self._recent.add((pending.run_id, False), finished)
        return finished

    def _collect(self, pending: PendingRun) -> FinishedRun | Measurement | Failure:
        """Wait for a submitted run. KeyboardInterrupt passes through; what was not collected is lost."""
        if self._executor is None:
            made = self._ledger.keep_in_memory if self._ledger is not None else None
            found = self._maker(pending.scenario, pending.seed, trial=pending.trial, made=made)
        else:
            found = self._executor.result(pending._submitted)
        if isinstance(found, FinishedRun) and found.observation is not None and self._ledger is not None:
            self._ledger.note(found.observation)
            found = replace(found, observation=None)
        key = (pending.run_id, pending.trial)
        self._open.pop(key, None)
        if not isinstance(found, Failure):
            self._recent.add(key, found)
        return found

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        try:
            if self._executor and self._started:
                self._started = False
                self._executor.stop(kill=kind is not None)
        finally:
            if self.closes:
                self.simulator.close()

    def _ready(self) -> Executor:
        assert self._executor is not None
        if not self._started:
            self._executor.start(self._maker, self._notify)
            self._started = True
        return self._executor
