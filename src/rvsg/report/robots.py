"""The outline of the robot of a mission, seen from above, as pages and films draw it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rvsg.scenario.scenario import ROBOT
from rvsg.simulation.run import Run

TIAGO_OMNI_M = (0.35, 0.24)
"""Half of the length and of the width of the navigation footprint of TIAGo OMNI, without Nav2's padding."""
EDGES = 24


def footprint_of(run: Run, robot: str) -> Sequence[tuple[float, float]]:
    """Return the robot's outline in its own frame: metres, x ahead, y to the left.

    A robot of unknown shape is the disc with which the run measures gaps.
    """
    if robot == ROBOT:
        ahead, left = TIAGO_OMNI_M
        return ((ahead, left), (-ahead, left), (-ahead, -left), (ahead, -left))
    angles = [2 * math.pi * k / EDGES for k in range(EDGES)]
    return tuple((run.robot_radius_m * math.cos(a), run.robot_radius_m * math.sin(a)) for a in angles)
