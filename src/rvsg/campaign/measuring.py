"""From a run to a Measurement and from measurements to a Verdict, by one requirement."""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.campaign.attempt import Measurement
from rvsg.evaluation.judge import DEFAULT, judge, objective
from rvsg.evaluation.metrics import measure
from rvsg.evaluation.verdict import Verdict
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.run import Run
from rvsg.world.world import World


class Measuring:
    """Measures runs with every metric, and judges them by `requirement`; `world` is where the runs took place."""

    def __init__(self, requirement: Requirement, world: World | None = None) -> None:
        self.requirement = requirement
        self.world = world

    def measure(self, run: Run) -> Measurement:
        """Every metric of one run, and the requirement's objective."""
        return Measurement(
            run_id=run.id,
            seed=run.seed,
            outcome=run.outcome.value,
            values=measure(run, world=self.world),
            objective=objective(run, self.requirement, world=self.world),
        )

    def judge(self, measurements: Sequence[Measurement], *, budget: int | None = None) -> Verdict:
        """The verdict on the runs measured, of which there may be `budget` at most (None: the procedure's own)."""
        procedure = DEFAULT if budget is None else DEFAULT.replace(max_runs=budget)
        return judge(self.requirement, [measurement.objective for measurement in measurements], procedure=procedure)
