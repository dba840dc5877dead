"""Contact of the robot with people, seen from the base: people who walk give way, else the base is held back."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded.people.contact import TOUCH_M, note_overlap, note_touch, robot_gap
from rvsg.simulation.embedded.people.crowd import Crowd
from rvsg.simulation.embedded.people.motion import off_walls

Floats = NDArray[np.float64]

HALVINGS = 10
LEAST_M = 1e-4
"""Overlaps below this do not hold the base back."""


@inner(cached=True)
def touch_people(crowd: Crowd, t: float, body: Floats, x: float, y: float, yaw: float, bumper_s: float) -> float:
    """Resolve the contacts of the base after its step from the pose (x, y, yaw); return the change of its speed, m/s.

    A person who walks is moved out of the way unless walls or other people are there. Where a person stands or is
    pinned, the base makes only the part of its step that does not enter the body: less translation first, then less
    rotation. A touched body triggers the bumper, which stops the drive for `bumper_s`, whoever gives way.
    """
    crowd.free[0] -= math.sqrt((body[base.X] - x) ** 2 + (body[base.Y] - y) ** 2)
    if crowd.free[0] > 0.0:
        return 0.0
    free = math.inf
    touched = False
    for i in range(crowd.x.size):
        dx = crowd.x[i] - body[base.X]
        dy = crowd.y[i] - body[base.Y]
        least = math.sqrt(dx * dx + dy * dy) - (crowd.outline_reach + crowd.radius[i]) - TOUCH_M
        free = min(free, least)
        if least > 0.0:
            continue
        gap, ux, uy = robot_gap(crowd, i, body[base.X], body[base.Y], body[base.YAW])
        if gap > TOUCH_M:
            continue
        touched = True
        cos = math.cos(body[base.YAW])
        sin = math.sin(body[base.YAW])
        vx = body[base.V] * cos - body[base.SIDE] * sin
        vy = body[base.V] * sin + body[base.SIDE] * cos
        note_touch(crowd, i, t, body[base.X], body[base.Y], body[base.YAW], vx, vy, body[base.W])
        if gap <= LEAST_M and bumper_s > 0.0:
            body[base.STOPPED_T] = max(body[base.STOPPED_T], t + bumper_s)
        if gap < 0.0 and crowd.stands[i] == 0:
            was_x = crowd.x[i]
            was_y = crowd.y[i]
            _give_way(crowd, i, -gap * ux, -gap * uy)
            after, _, _ = robot_gap(crowd, i, body[base.X], body[base.Y], body[base.YAW])
            if after < gap:
                # Walls would push the person deeper into the robot: pinned between both.
                crowd.x[i] = was_x
                crowd.y[i] = was_y
    crowd.free[0] = free
    if not touched:
        return 0.0
    change = _hold_back(crowd, body, x, y, yaw)
    for i in range(crowd.x.size):
        note_overlap(crowd, i, body[base.X], body[base.Y], body[base.YAW])
    return change


@inner
def _give_way(crowd: Crowd, i: int, dx: float, dy: float) -> None:
    """Move a person by (dx, dy) as far as walls allow, and not at all into somebody else."""
    x, y = off_walls(crowd, crowd.x[i] + dx, crowd.y[i] + dy)
    for j in range(crowd.x.size):
        reach = crowd.radius[i] + crowd.radius[j]
        square = (crowd.x[j] - x) ** 2 + (crowd.y[j] - y) ** 2
        before = (crowd.x[j] - crowd.x[i]) ** 2 + (crowd.y[j] - crowd.y[i]) ** 2
        if j != i and square < reach * reach and square < before:
            return
    crowd.x[i] = x
    crowd.y[i] = y


@inner
def deepest(crowd: Crowd, x: float, y: float, yaw: float) -> float:
    """Return the largest overlap of a person with the robot at a pose; 0 where there is none."""
    found = 0.0
    for i in range(crowd.x.size):
        gap, _, _ = robot_gap(crowd, i, x, y, yaw)
        found = max(found, -gap)
    return found


@inner
def _hold_back(crowd: Crowd, body: Floats, x: float, y: float, yaw: float) -> float:
    """Shorten the base's last step so that no overlap grows; return the change of its speed, m/s."""
    allowed = max(LEAST_M, deepest(crowd, x, y, yaw))
    if deepest(crowd, body[base.X], body[base.Y], body[base.YAW]) <= allowed:
        return 0.0
    dx = body[base.X] - x
    dy = body[base.Y] - y
    turn = base.wrap(body[base.YAW] - yaw)
    moved = 0.0
    turned = 1.0
    if deepest(crowd, x, y, yaw + turn) <= allowed:
        blocked = 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (moved + blocked)
            if deepest(crowd, x + middle * dx, y + middle * dy, yaw + turn) <= allowed:
                moved = middle
            else:
                blocked = middle
    else:
        turned = 0.0
        blocked = 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (turned + blocked)
            if deepest(crowd, x, y, yaw + middle * turn) <= allowed:
                turned = middle
            else:
                blocked = middle
    body[base.X] = x + moved * dx
    body[base.Y] = y + moved * dy
    body[base.YAW] = base.wrap(yaw + turned * turn)
    change = (moved - 1.0) * body[base.V]
    body[base.V] *= moved
    body[base.SIDE] *= moved
    body[base.W] *= turned
    return change


def overlap_at_start(outline: Floats, people: Floats, radius: Floats, x: float, y: float, yaw: float) -> float:
    """Return how far the robot's outline and people (N, 2) of these radii (N,) overlap at most, metres."""
    far = np.hypot(outline[:, 0], outline[:, 1]).max() + radius
    near = ~(np.hypot(people[:, 0] - x, people[:, 1] - y) > far + 0.01)
    if not near.any():
        return 0.0
    from shapely import Point, Polygon

    cos, sin = math.cos(yaw), math.sin(yaw)
    polygon = Polygon(outline @ np.array([[cos, sin], [-sin, cos]]) + (x, y))
    gaps = [polygon.distance(Point(point)) - r for point, r in zip(people[near], radius[near], strict=True)]
    return max(0.0, -min(gaps, default=0.0))
