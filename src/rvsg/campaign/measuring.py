"""Measure runs and judge the measurements by one requirement."""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.campaign.attempt import Measurement
from rvsg.evaluation.judge import DEFAULT, Procedure, judge, objective
from rvsg.evaluation.metrics import measure
from rvsg.evaluation.verdict import Verdict
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.run import Run
from rvsg.world.world import World


class Measuring:
    """Measures runs by every metric, and judges them by `requirement`.

    Args:
        world: where the runs took place; metrics that concern obstacles need it.
        procedure: the error rates and the budget of a verdict.
    """

    def __init__(self, requirement: Requirement, world: World | None = None, *, procedure: Procedure = DEFAULT) -> None:
        self.requirement = requirement
        self.world = world
        self.procedure = procedure

    def measure(self, run: Run) -> Measurement:
        """Return every metric of one run, and the requirement's objective."""
        return Measurement(
            run_id=run.id,
            seed=run.seed,
            outcome=run.outcome.value,
            values=measure(run, world=self.world),
            objective=objective(run, self.requirement, world=self.world),
        )

    def judge(self, measurements: Sequence[Measurement], *, budget: int | None = None) -> Verdict:
        """Return the verdict on measured runs; `budget` is how many there may be at most (None: the procedure's)."""
        procedure = self.procedure if budget is None else self.procedure.replace(max_runs=budget)
        return judge(self.requirement, [measurement.objective for measurement in measurements], procedure=procedure)
