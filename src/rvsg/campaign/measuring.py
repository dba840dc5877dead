"""From a run to a Measurement and from measurements to a Verdict, by one requirement."""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.campaign.attempt import Measurement
from rvsg.evaluation.judge import judge, objective
from rvsg.evaluation.metrics import measure
from rvsg.evaluation.verdict import Verdict
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.run import Run


class Measuring:
    """Measures runs with every metric, and judges them by `requirement`."""

    def __init__(self, requirement: Requirement) -> None:
        self.requirement = requirement

    def measure(self, run: Run) -> Measurement:
        """Every metric of one run, and the requirement's objective."""
        return Measurement(
            run_id=run.id,
            seed=run.seed,
            outcome=run.outcome.value,
            values=measure(run),
            objective=objective(run, self.requirement),
        )

    def judge(self, measurements: Sequence[Measurement]) -> Verdict:
        """The verdict on the runs measured."""
        return judge(self.requirement, [measurement.objective for measurement in measurements])
