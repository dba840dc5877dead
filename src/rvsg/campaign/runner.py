"""The runner: makes runs in this process, in worker processes or on a cluster, and measures them.

What is recorded does not depend on how many workers there are, where they are, or which of them is faster. A run
whose id is known is not simulated again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, Protocol, Self

from rvsg.campaign.attempt import Failure, Measurement
from rvsg.campaign.feedback import Look
from rvsg.campaign.worker_pool import Processes
from rvsg.core.errors import SimulationError
from rvsg.evaluation.judge import judge, objective
from rvsg.evaluation.metrics.registry import measure
from rvsg.evaluation.verdict import DEFAULT, Procedure, Verdict
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.archive import PackedRun, rounded
from rvsg.simulation.protocol import Simulator
from rvsg.simulation.run import Outcome, Run, run_id
from rvsg.world.world import World


@dataclass(frozen=True)
class Trial:
    """A run that is not stored: nobody asks for more than how it is judged."""

    seed: int
    outcome: Outcome
    measurement: Measurement


@dataclass(frozen=True)
class FinishedRun:
    """A run as it comes back from where it was made: measured, and packed for the store."""

    seed: int
    outcome: Outcome
    measurement: Measurement
    packed: PackedRun
    look: Look | None = None
    """What was seen of it where it was made."""

    @property
    def id(self) -> str:
        """The run's content id."""
        return self.packed.id

    def unpack(self) -> Run:
        """Return the run with its arrays."""
        return self.packed.unpack()


def unmeasured(run: Run, place: World | None = None) -> Measurement:
    """Return a measurement without any metric, for runs that nobody judges."""
    return Measurement(run_id=run.id, seed=run.seed, outcome=run.outcome.value, values={})


@dataclass(frozen=True)
class RunMaker:
    """Simulates, measures and packs one run at a time; the same in this process, a worker, or a cluster.

    A run is rounded before it is measured (see `rvsg.simulation.archive`), so that a run read from the store has
    exactly the metrics it had when it was made.
    """

    simulator: Simulator
    world: World
    measure: Callable[[Run, World], Measurement] = unmeasured
    judged: Callable[[Run, World], Measurement] | None = None
    """Measures only what a verdict takes, for trials; `measure` where None."""
    look: Callable[[Run, World], Look] | None = None
    """Looks at every run that is stored."""

    def __call__(
        self, scenario: Scenario, seed: int, *, trial: bool = False, made: Callable[[Run], None] | None = None
    ) -> FinishedRun | Trial | Failure:
        """Make one run; a Failure where the simulator cannot.

        Args:
            trial: Return a Trial, which nobody stores.
            made: Receives the run with its arrays, rounded, unless it is a trial.
        """
        place = scenario.mission.place(self.world)
        try:
            run = rounded(self.simulator.run(scenario, place, seed=seed))
        except SimulationError as error:
            return Failure(seed=seed, reason=str(error))
        if trial:
            return Trial(run.seed, run.outcome, (self.judged or self.measure)(run, place))
        finished = self._finished(run, place)
        if made is not None:
            made(run)
        return finished if self.look is None else replace(finished, look=self.look(run, self.world))

    def close(self) -> None:
        """Release what the simulator holds."""
        self.simulator.close()

    def finished(self, run: Run, scenario: Scenario) -> FinishedRun:
        """Round, measure and pack a run that was made of a scenario."""
        return self._finished(rounded(run), scenario.mission.place(self.world))

    def _finished(self, run: Run, place: World) -> FinishedRun:
        return FinishedRun(run.seed, run.outcome, self.measure(run, place), PackedRun.of(run))


class Measuring:
    """Measures runs by every metric, and judges them by `requirement`.

    Args:
        world: where the runs took place; metrics that concern obstacles need it.
        procedure: the error rates and the budget of a verdict.
        time_limit_s: the time limit of the route, which bounds the intervals of times.
    """

    def __init__(
        self,
        requirement: Requirement,
        world: World | None = None,
        *,
        procedure: Procedure = DEFAULT,
        time_limit_s: float | None = None,
    ) -> None:
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


RECENT = 1000
"""Runs that are kept in memory, packed to some 5 kB each: strategies that race ask for the same runs again."""


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

    def result(self, submitted: Any) -> FinishedRun | Trial | Failure:
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

    def __init__(self, simulations: Simulations, scenario: Scenario, seed: int, *, trial: bool = False) -> None:
        self.scenario = scenario
        self.seed = seed
        self.trial = trial
        self.run_id = run_id(scenario.id, simulations.simulator.name, simulations.options, seed)
        self._simulations = simulations
        self._found: FinishedRun | Trial | Failure | None = None
        self._submitted: Any = None

    def result(self) -> FinishedRun | Failure:
        """Return the run, or why the simulator could not make it."""
        found = self._wait()
        assert not isinstance(found, Trial)
        return found

    def measurement(self) -> Measurement | None:
        """Return what was measured of the run; None where the simulator could not make it."""
        found = self._wait()
        return None if isinstance(found, Failure) else found.measurement

    def _wait(self) -> FinishedRun | Trial | Failure:
        if self._found is None:
            self._found = self._simulations._collect(self)
        return self._found


class Simulations:
    """Makes and measures the runs of one simulator in one world. A context manager; leaving it ends the workers.

    Args:
        simulator: What makes the runs.
        world: Where they take place.
        measure: What measures each run, in the process that made it.
        judged: What measures a trial there, which is not stored; by default the same.
        jobs: Worker processes; with 1 everything happens in this process.
        known: Returns the stored run of an id, or None.
        executor: Where runs are made instead of in `jobs` processes.
        notify: Receives messages for the user, such as that a machine is gone.
        made: Receives the runs that are made in this process, with their arrays.
        look: Looks at every run in the process that made it.
        looked: Receives what `look` saw.
        closes: Close the simulator at the end; its next run makes again what it needs.
    """

    def __init__(
        self,
        simulator: Simulator,
        world: World,
        *,
        measure: Callable[[Run, World], Measurement] = unmeasured,
        judged: Callable[[Run, World], Measurement] | None = None,
        jobs: int = 1,
        known: Callable[[str], Run | None] | None = None,
        executor: Executor | None = None,
        notify: Callable[[str], None] = lambda _: None,
        made: Callable[[Run], None] | None = None,
        look: Callable[[Run, World], Look] | None = None,
        looked: Callable[[Look], None] = lambda _: None,
        closes: bool = False,
    ) -> None:
        self.closes = closes
        self.simulator = simulator
        self.world = world
        self.options = dict(simulator.options)
        self._maker = RunMaker(simulator, world, measure, judged, look)
        self._executor: Executor | None = executor or (Processes(jobs) if jobs > 1 else None)
        self._known = known or (lambda _: None)
        self._notify = notify
        self._made = made
        self._looked = looked
        self._open: dict[tuple[str, bool], PendingRun] = {}
        self._recent: dict[tuple[str, bool], FinishedRun | Trial] = {}
        self._started = False

    @property
    def lookahead(self) -> int:
        """Return how many attempts to submit before the first is collected: 0 in one process."""
        return self._ready().size if self._executor else 0

    def submit(self, scenario: Scenario, seed: int, *, trial: bool = False) -> PendingRun:
        """Ask for a run; it starts at once where there are workers, else when its result is wanted.

        Args:
            trial: Nobody stores the run: it has a `measurement`, and no `result`.
        """
        pending = PendingRun(self, scenario, seed, trial=trial)
        key = (pending.run_id, trial)
        if key in self._open:
            return self._open[key]
        if key in self._recent:
            pending._found = self._recent[key]
            return pending
        stored = None if trial else self._known(pending.run_id)
        if stored is not None:
            pending._found = self._maker.finished(stored, scenario)
            self._remember(key, pending._found)
            return pending
        self._open[key] = pending
        if self._executor:
            pending._submitted = self._ready().submit(scenario, seed, **{"trial": True} if trial else {})
        return pending

    def _collect(self, pending: PendingRun) -> FinishedRun | Trial | Failure:
        """Wait for a submitted run. KeyboardInterrupt passes through; what was not collected is lost."""
        if self._executor is None:
            found = self._maker(pending.scenario, pending.seed, trial=pending.trial, made=self._made)
        else:
            found = self._executor.result(pending._submitted)
        if isinstance(found, FinishedRun) and found.look is not None:
            self._looked(found.look)
            found = replace(found, look=None)
        key = (pending.run_id, pending.trial)
        self._open.pop(key, None)
        if not isinstance(found, Failure):
            self._remember(key, found)
        return found

    def _remember(self, key: tuple[str, bool], run: FinishedRun | Trial) -> None:
        """Keep a run in memory until `RECENT` newer ones are kept."""
        self._recent[key] = run
        if len(self._recent) > RECENT:
            del self._recent[next(iter(self._recent))]

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
