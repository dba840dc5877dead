"""What is measured of a run, and how it is judged."""

from __future__ import annotations

from tests.campaign.parts import REQUIREMENT
from tests.evaluation.runs import run_of, trajectory

from rvsg.campaign.runner import Measuring
from rvsg.simulation.run import Outcome


def test_a_run_in_which_the_stack_failed_is_measured_and_not_judged() -> None:
    path = trajectory([0, 1], 0, humans=[(2, 0)])
    failed, made = run_of(path, outcome=Outcome.STACK_FAILED), run_of(path)
    measuring = Measuring(REQUIREMENT)
    assert measuring.measure(failed).values["dto"] == measuring.measure(made).values["dto"] == 2.0
    assert measuring.measure(failed).objective is None and measuring.judged(failed).objective is None
    assert measuring.measure(made).objective == measuring.judged(made).objective == 2.0
