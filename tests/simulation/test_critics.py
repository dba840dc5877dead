"""What the critics of DWB say of each sample, worked out for a trace."""

from __future__ import annotations

import numpy as np
import pytest

import rvsg
from rvsg.simulation.embedded.trace import CRITICS, trace_run

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    "robot",
    ["tugger", *(pytest.param(name, marks=pytest.mark.exhaustive) for name in ("tiago_omni", "turtlebot3_waffle"))],
)
def test_the_scores_of_the_critics_add_up_to_the_total_of_the_planner(robot: str) -> None:
    world = rvsg.load_world("warehouse")
    scenario = rvsg.scenario(world, "route_1", [rvsg.walk("Anna", "E15", "H15")], robot=robot)
    answers = [frame.evaluation for frame in trace_run(scenario, world, seed=3).frames if frame.evaluation]
    assert len(answers) > 50
    said = dict.fromkeys(CRITICS, 0.0)
    for answer in answers:
        allowed = np.isfinite(answer.score)
        parts = answer.raw * answer.scales
        assert parts[allowed].sum(axis=1) == pytest.approx(answer.score[allowed], abs=1e-9)
        for name, most in zip(answer.critics, parts[allowed].max(axis=0, initial=0.0), strict=True):
            said[name] = max(said[name], most)
    rotates = said.pop("RotateToGoal") > 0.0
    assert rotates == (robot == "tiago_omni")  # the others arrive without being asked again near the goal
    assert min(said.values()) > 0.0
