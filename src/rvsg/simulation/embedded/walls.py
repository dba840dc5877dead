"""Contact of the robot's body with walls and objects: the base slides or is held back, and the contact is recorded.

Solid is what the lidar plane cuts, or the occupied cells of a world without objects: the outlines that the robot can
see. The overlap of a pose is the length of these outlines inside the body. A step of the base may not raise it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.core.angles import wrap
from rvsg.core.kernels import inner, kernel
from rvsg.core.records import Pose
from rvsg.core.references import refer
from rvsg.robots.polygons import reach, rectangle
from rvsg.robots.robot import Robot
from rvsg.simulation.embedded import base
from rvsg.simulation.events import ObstacleContact

Floats = NDArray[np.float64]


@inner
def is_inside(outline: Floats, x: float, y: float) -> bool:
    """Whether a point lies inside an outline (K, 2)."""
    found = False
    j = outline.shape[0] - 1
    for i in range(outline.shape[0]):
        ay = outline[i, 1]
        by = outline[j, 1]
        if (ay > y) != (by > y) and x < outline[i, 0] + (y - ay) / (by - ay) * (outline[j, 0] - outline[i, 0]):
            found = not found
        j = i
    return found


@inner
def contact_with(
    outline: Floats, ax: float, ay: float, bx: float, by: float
) -> tuple[float, float, float, float, float]:
    """Return where an edge a-b that overlaps the body presses on it: depth (m), place, direction for the body.

    An end of the edge inside the body presses on the nearest side. An edge that cuts through presses on the corner
    that lies farthest beyond it.
    """
    depth, px, py, nx, ny = _end_inside(outline, ax, ay)
    other, qx, qy, mx, my = _end_inside(outline, bx, by)
    if depth > 0.0 or other > 0.0:
        return (depth, px, py, nx, ny) if depth >= other else (other, qx, qy, mx, my)
    dx = bx - ax
    dy = by - ay
    length = math.sqrt(dx * dx + dy * dy)
    here = dy * ax - dx * ay
    sign = 1.0 if here >= 0.0 else -1.0
    for k in range(outline.shape[0]):
        beyond = -sign * (dx * (outline[k, 1] - ay) - dy * (outline[k, 0] - ax)) / length
        if beyond > depth:
            depth = beyond
            px = outline[k, 0]
            py = outline[k, 1]
    return depth, px, py, -sign * dy / length, sign * dx / length


@inner
def _end_inside(outline: Floats, x: float, y: float) -> tuple[float, float, float, float, float]:
    """Return depth, place and direction for the body of a point that may lie inside it; depth 0 where it does not."""
    if not is_inside(outline, x, y):
        return 0.0, x, y, 0.0, 0.0
    best = math.inf
    nx = 0.0
    ny = 0.0
    corners = outline.shape[0]
    for k in range(corners):
        px, py = outline[k, 0], outline[k, 1]
        ex, ey = outline[(k + 1) % corners, 0] - px, outline[(k + 1) % corners, 1] - py
        share = min(1.0, max(0.0, ((x - px) * ex + (y - py) * ey) / (ex * ex + ey * ey)))
        dx = x - px - share * ex
        dy = y - py - share * ey
        away = math.sqrt(dx * dx + dy * dy)
        if 1e-12 < away < best:
            best = away
            nx = dx / away
            ny = dy / away
    return best, x, y, nx, ny


SLACK_M = 1e-3
"""Less outline than this inside the body is no overlap."""
HALVINGS = 10
ROUNDS = 12
SPARE_M = 2e-4
"""A base that slides keeps this far from what it touches."""
LEAST_EASE = 0.05
"""A base that gives way to a push less than this is held back: 1 is a base that moves as it is pushed."""
FARTHEST_M = 0.005
"""Contact moves the base at most this much farther than its own step."""
AGAIN_S = 0.5
"""Contacts less than this apart count as one."""
MOST_CONTACTS = 256
# Columns of a contact: begin and end (s), place of the first touch (m), speed at the first touch (m/s), and where the
# base was at the last touch (m).
FROM, UNTIL, PLACE_X, PLACE_Y, SPEED, LAST_X, LAST_Y = range(7)
AHEAD_M = 0.5
"""How far beyond the body outlines are looked for: the base goes at most so far between two checks."""
STUCK_M = 0.5
"""A robot that came no farther than this from its last contact is stuck in it: the progress checker's distance."""
FREE_WITHIN_M = 0.1
"""How far a start is moved at most so that the body touches nothing."""


class Walls(NamedTuple):
    """What the robot's body cannot enter.

    `edges` (E, 4) outlines in the world frame; tile t of the raster of 1 m from (x, y) holds
    `near[start[t] : start[t + 1]]`, the numbers of all edges within the body's reach. `outline` (K, 2) corners of the
    body. `free` (1,): how far the base can go before it can touch; `reach` (m) how far outlines are looked for.
    `sideways` (0 or 1) and `turning` (1/m²): how easily the base moves sideways and round where it is pushed, against
    moving ahead. `cuts` scratch space; `contacts` (N, 7) the contacts so far and `counts` (1,) their number.
    """

    edges: Floats
    start: NDArray[np.int64]
    near: NDArray[np.int32]
    x: float
    y: float
    columns: int
    rows: int
    outline: Floats
    radius: float
    reach: float
    sideways: float
    turning: float
    free: Floats
    cuts: Floats
    contacts: Floats
    counts: NDArray[np.int64]


def reach_of(outline: Sequence[tuple[float, float]]) -> float:
    """Return how far from the base frame an edge can matter, m."""
    return reach(outline) + AHEAD_M


def new_walls(
    edges: Floats, start: NDArray[np.int64], near: NDArray[np.int32], corner: tuple[float, float],
    shape: tuple[int, int], robot: Robot,
) -> Walls:  # fmt: skip
    """Return the walls of a run. `corner` and `shape` (rows, columns) of the raster of tiles."""
    outline = robot.outline
    (left, low), (right, high) = rectangle(outline)
    # A rectangle of even mass resists turning like its mass at this squared distance.
    inertia = ((right - left) ** 2 + (high - low) ** 2) / 12.0
    return Walls(
        edges=edges,
        start=start,
        near=near,
        x=corner[0],
        y=corner[1],
        columns=shape[1],
        rows=shape[0],
        outline=np.array(outline, np.float64),
        radius=reach(outline),
        reach=reach_of(outline),
        sideways=1.0 if robot.drive.kind == "omnidirectional" else 0.0,
        turning=0.0 if robot.drive.kind == "ackermann" else 1.0 / inertia,
        free=np.zeros(1),
        cuts=np.zeros(len(outline) + 2),
        contacts=np.zeros((MOST_CONTACTS, 7)),
        counts=np.zeros(1, np.int64),
    )


@inner
def tile_at(walls: Walls, x: float, y: float) -> int:
    """Return the number of the tile that holds a point; -1 off the raster."""
    column = int((x - walls.x) // 1.0)
    row = int((y - walls.y) // 1.0)
    return row * walls.columns + column if 0 <= column < walls.columns and 0 <= row < walls.rows else -1


@kernel
def overlap(walls: Walls, x: float, y: float, yaw: float) -> float:
    """Return the length of outlines inside the body at a pose, m."""
    tile = tile_at(walls, x, y)
    if tile < 0:
        return 0.0
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    found = 0.0
    for k in range(walls.start[tile], walls.start[tile + 1]):
        ax, ay, bx, by = base.into_frame(walls.edges[walls.near[k]], x, y, cos, sin)
        found += _length_inside(walls, ax, ay, bx, by)
    return found


@kernel
def clearance(walls: Walls, x: float, y: float) -> float:
    """Return the distance of a point from the nearest outline, at most `reach`, m."""
    tile = tile_at(walls, x, y)
    if tile < 0:
        return 0.0
    best = walls.reach * walls.reach
    for k in range(walls.start[tile], walls.start[tile + 1]):
        edge = walls.edges[walls.near[k]]
        ax = edge[0] - x
        ay = edge[1] - y
        dx = edge[2] - edge[0]
        dy = edge[3] - edge[1]
        square = dx * dx + dy * dy
        share = min(1.0, max(0.0, -(ax * dx + ay * dy) / square)) if square > 0.0 else 0.0
        best = min(best, (ax + share * dx) ** 2 + (ay + share * dy) ** 2)
    return math.sqrt(best)


@inner
def _length_inside(walls: Walls, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the length of a segment inside the body; points in the base frame."""
    dx = bx - ax
    dy = by - ay
    square = dx * dx + dy * dy
    if square == 0.0:
        return 0.0
    share = min(1.0, max(0.0, -(ax * dx + ay * dy) / square))
    if (ax + share * dx) ** 2 + (ay + share * dy) ** 2 > walls.radius * walls.radius:
        return 0.0
    cuts = walls.cuts
    count = 1
    cuts[0] = 0.0
    corners = walls.outline.shape[0]
    for k in range(corners):
        px, py = walls.outline[k, 0], walls.outline[k, 1]
        qx, qy = walls.outline[(k + 1) % corners, 0], walls.outline[(k + 1) % corners, 1]
        across = dx * (qy - py) - dy * (qx - px)
        if across == 0.0:
            continue
        along = ((px - ax) * (qy - py) - (py - ay) * (qx - px)) / across
        on_side = ((px - ax) * dy - (py - ay) * dx) / across
        if 0.0 < along < 1.0 and 0.0 <= on_side < 1.0:
            at = count
            while at > 1 and cuts[at - 1] > along:
                cuts[at] = cuts[at - 1]
                at -= 1
            cuts[at] = along
            count += 1
    cuts[count] = 1.0
    found = 0.0
    for k in range(count):
        middle = 0.5 * (cuts[k] + cuts[k + 1])
        if is_inside(walls.outline, ax + middle * dx, ay + middle * dy):
            found += cuts[k + 1] - cuts[k]
    return found * math.sqrt(square)


@inner
def _deepest(walls: Walls, x: float, y: float, yaw: float) -> tuple[float, float, float, float, float]:
    """Return the deepest contact at a pose: depth (m), place and direction for the body in the base frame."""
    tile = tile_at(walls, x, y)
    found = (0.0, 0.0, 0.0, 0.0, 0.0)
    if tile < 0:
        return found
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    for k in range(walls.start[tile], walls.start[tile + 1]):
        ax, ay, bx, by = base.into_frame(walls.edges[walls.near[k]], x, y, cos, sin)
        if _length_inside(walls, ax, ay, bx, by) > 0.0:
            pressing = contact_with(walls.outline, ax, ay, bx, by)
            if pressing[0] > found[0]:
                found = pressing
    return found


@inner
def push_out(walls: Walls, x: float, y: float, yaw: float) -> tuple[float, float, float]:
    """Return the pose to which contact pushes the base out of walls, as far as its wheels let it move.

    Every contact moves the base ahead, sideways and round in the shares in which a body of even mass yields to a push
    there. A differential base does not move sideways; one with steered wheels neither sideways nor round.
    """
    for _ in range(ROUNDS):
        depth, px, py, nx, ny = _deepest(walls, x, y, yaw)
        lever = px * ny - py * nx
        ease = nx * nx + walls.sideways * ny * ny + walls.turning * lever * lever
        if depth <= 0.0 or ease < LEAST_EASE:
            break
        push = (depth + SPARE_M) / ease
        cos = math.cos(yaw)
        sin = math.sin(yaw)
        ahead = push * nx
        aside = push * walls.sideways * ny
        x += cos * ahead - sin * aside
        y += sin * ahead + cos * aside
        yaw += push * walls.turning * lever
    return x, y, yaw


@inner(cached=True)
def touch_walls(walls: Walls, t: float, body: Floats, x: float, y: float, yaw: float) -> float:
    """Let the base slide or hold it back after its step from the pose (x, y, yaw); return the change of its speed, m/s.

    Where sliding does not free it, it makes as much of its step as does not enter anything: less translation first,
    then less rotation.
    """
    dx = body[base.X] - x
    dy = body[base.Y] - y
    walls.free[0] -= math.sqrt(dx * dx + dy * dy)
    if walls.free[0] > 0.0:
        return 0.0
    walls.free[0] = clearance(walls, body[base.X], body[base.Y]) - walls.radius
    if walls.free[0] > 0.0:
        return 0.0
    now = overlap(walls, body[base.X], body[base.Y], body[base.YAW])
    if now <= SLACK_M:
        return 0.0
    allowed = max(SLACK_M, overlap(walls, x, y, yaw))
    if now <= allowed:
        return 0.0
    _note(walls, t, body)
    if _slide(walls, body, x, y, yaw, math.sqrt(dx * dx + dy * dy), allowed):
        speed = (math.cos(yaw) * (body[base.X] - x) + math.sin(yaw) * (body[base.Y] - y)) / base.STEP_S
        change = speed - body[base.V]
        body[base.V] = speed
        if body[base.SIDE] != 0.0:
            aside = math.cos(yaw) * (body[base.Y] - y) - math.sin(yaw) * (body[base.X] - x)
            body[base.SIDE] = aside / base.STEP_S
        body[base.W] = wrap(body[base.YAW] - yaw) / base.STEP_S
        body[base.ACCELERATION] = 0.0
        body[base.SIDE_ACCELERATION] = 0.0
        return change
    turn = wrap(body[base.YAW] - yaw)
    moved = 0.0
    turned = 1.0
    if overlap(walls, x, y, yaw + turn) > allowed:
        turned = 0.0
        blocked = 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (turned + blocked)
            if overlap(walls, x, y, yaw + middle * turn) <= allowed:
                turned = middle
            else:
                blocked = middle
    blocked = 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (moved + blocked)
        if overlap(walls, x + middle * dx, y + middle * dy, yaw + turned * turn) <= allowed:
            moved = middle
        else:
            blocked = middle
    body[base.X] = x + moved * dx
    body[base.Y] = y + moved * dy
    body[base.YAW] = wrap(yaw + turned * turn)
    change = (moved - 1.0) * body[base.V]
    body[base.V] *= moved
    body[base.SIDE] *= moved
    body[base.W] *= turned
    body[base.ACCELERATION] = 0.0
    body[base.SIDE_ACCELERATION] = 0.0
    return change


@inner
def _slide(walls: Walls, body: Floats, x: float, y: float, yaw: float, step: float, allowed: float) -> bool:
    """Push the base out of what its step of this length (m) enters; whether that frees it. The step is kept if not."""
    slid_x, slid_y, slid_yaw = push_out(walls, body[base.X], body[base.Y], body[base.YAW])
    if math.sqrt((slid_x - x) ** 2 + (slid_y - y) ** 2) > step + FARTHEST_M:
        return False
    if abs(wrap(slid_yaw - yaw)) * walls.radius > step + walls.radius * abs(body[base.W]) * base.STEP_S + FARTHEST_M:
        return False
    if overlap(walls, slid_x, slid_y, slid_yaw) > allowed:
        return False
    body[base.X] = slid_x
    body[base.Y] = slid_y
    body[base.YAW] = wrap(slid_yaw)
    return True


@inner
def _note(walls: Walls, t: float, body: Floats) -> None:
    """Begin a contact, or let the last one go on."""
    n = walls.counts[0]
    if n > 0 and t - walls.contacts[n - 1, UNTIL] < AGAIN_S:
        walls.contacts[n - 1, UNTIL] = t
        walls.contacts[n - 1, LAST_X] = body[base.X]
        walls.contacts[n - 1, LAST_Y] = body[base.Y]
        return
    if n >= walls.contacts.shape[0]:
        return
    row = walls.contacts[n]
    row[FROM] = t
    row[UNTIL] = t
    row[PLACE_X], row[PLACE_Y] = _place(walls, body[base.X], body[base.Y], body[base.YAW])
    row[SPEED] = math.hypot(body[base.V], body[base.SIDE]) if body[base.SIDE] != 0.0 else abs(body[base.V])
    row[LAST_X] = body[base.X]
    row[LAST_Y] = body[base.Y]
    walls.counts[0] = n + 1


@inner
def _place(walls: Walls, x: float, y: float, yaw: float) -> tuple[float, float]:
    """Return where the outline that is deepest inside the body at a pose comes nearest to the base frame."""
    tile = int((y - walls.y) // 1.0) * walls.columns + int((x - walls.x) // 1.0)
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    best = 0.0
    px = x
    py = y
    for k in range(walls.start[tile], walls.start[tile + 1]):
        edge = walls.edges[walls.near[k]]
        ax = edge[0] - x
        ay = edge[1] - y
        bx = edge[2] - x
        by = edge[3] - y
        found = _length_inside(walls, *base.into_frame(edge, x, y, cos, sin))
        if found > best:
            best = found
            square = (bx - ax) ** 2 + (by - ay) ** 2
            share = min(1.0, max(0.0, -(ax * (bx - ax) + ay * (by - ay)) / square))
            px = x + ax + share * (bx - ax)
            py = y + ay + share * (by - ay)
    return px, py


def obstacle_contacts(walls: Walls) -> tuple[ObstacleContact, ...]:
    """Return the contacts of a run in order of time."""
    rows = walls.contacts[: int(walls.counts[0])]
    return tuple(
        ObstacleContact(
            time_s=round(float(row[FROM]), 3),
            until_s=round(float(row[UNTIL]), 3),
            x=round(float(row[PLACE_X]), 3),
            y=round(float(row[PLACE_Y]), 3),
            speed_m_s=round(float(row[SPEED]), 3),
        )
        for row in rows
    )


def is_stuck(walls: Walls, x: float, y: float) -> bool:
    """Whether a robot that ends at (x, y) has not come away from its last contact."""
    n = int(walls.counts[0])
    if n == 0:
        return False
    last = walls.contacts[n - 1]
    return math.hypot(x - float(last[LAST_X]), y - float(last[LAST_Y])) < STUCK_M


def edges_of(corners: Any) -> Floats:
    """Return the closed outline of corners (K, 2) as segments (K, 4)."""
    points = np.asarray(corners, np.float64)
    return np.hstack([points, np.roll(points, -1, axis=0)])


def cell_borders(occupied: NDArray[np.bool_], resolution: float, x: float, y: float) -> Floats:
    """Return the borders between occupied and other cells as segments (S, 4), straight runs joined."""
    found = []
    for grid, turned in ((occupied, False), (occupied.T, True)):
        padded = np.pad(grid.astype(np.int8), 1)
        border = (padded[1:, 1:-1] != padded[:-1, 1:-1]).astype(np.int8)
        change = np.diff(np.pad(border, ((0, 0), (1, 1))), axis=1)
        line, first = np.nonzero(change == 1)
        _, last = np.nonzero(change == -1)
        a = np.column_stack([first, line]) * resolution
        b = np.column_stack([last, line]) * resolution
        if turned:
            a, b = a[:, ::-1], b[:, ::-1]
        found.append(np.hstack([a + np.array([x, y]), b + np.array([x, y])]))
    return np.ascontiguousarray(np.concatenate(found))


def free_pose(walls: Walls, start: Pose) -> Pose | None:
    """Return the pose nearest to `start`, with its yaw, at which the body overlaps nothing; None where there is none.

    It is looked for in steps of 1 cm within 10 cm.
    """
    held = refer(walls)
    if overlap(held, start.x, start.y, start.yaw) <= SLACK_M:
        return start
    steps = np.arange(-10, 11) * 0.01
    offsets = [(float(dx), float(dy)) for dx in steps for dy in steps if math.hypot(dx, dy) <= FREE_WITHIN_M]
    for dx, dy in sorted(offsets, key=lambda offset: (math.hypot(*offset), offset)):
        if overlap(held, start.x + dx, start.y + dy, start.yaw) <= SLACK_M:
            return Pose(x=start.x + dx, y=start.y + dy, yaw=start.yaw)
    return None
