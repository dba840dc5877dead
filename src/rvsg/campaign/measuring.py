"""Make, measure and pack a run where it is made, and judge measurements by one requirement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from rvsg.campaign.attempt import Failure, Measurement
from rvsg.campaign.glance import Look
from rvsg.core.errors import SimulationError
from rvsg.evaluation.judge import judge, objective
from rvsg.evaluation.metrics.registry import measure
from rvsg.evaluation.verdict import DEFAULT, Procedure, Verdict
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.archive import PackedRun, rounded
from rvsg.simulation.protocol import Simulator
from rvsg.simulation.run import Outcome, Run
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

    A run is rounded before it is measured (see `rvsg.simulation.quantised`), so that a run read from the store has
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
