"""The outline of the robot of a mission, seen from above, as pages and films draw it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rvsg.robots.robot import Robot
from rvsg.simulation.run import Run

EDGES = 24


def footprint_of(run: Run, robot: Robot | None) -> Sequence[tuple[float, float]]:
    """Return the robot's outline in its own frame: metres, x ahead, y to the left.

    A robot that is not given is drawn with the outline that the run keeps, and without that as the disc with which the
    run measures gaps.
    """
    if robot is not None:
        return robot.footprint
    if run.robot_outline:
        return run.robot_outline
    angles = [2 * math.pi * k / EDGES for k in range(EDGES)]
    return tuple((run.robot_radius_m * math.cos(a), run.robot_radius_m * math.sin(a)) for a in angles)
