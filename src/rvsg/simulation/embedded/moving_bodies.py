"""Moving bodies besides the robot and people on foot: automatic doors, trolleys that people push, and wheelchairs.

A run without them does not come here. The compiled loop stops after every tick of the people; here their trolleys and
the leaves are moved and written into the arrays that lidars, contact and people read.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, cast

import numpy as np
import shapely
from numpy.typing import NDArray

from rvsg.core.angles import wrap
from rvsg.scenario.scenario import WHEELCHAIR, Behaviour, HumanAgent
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded.people.crowd import PERIOD_S, Crowd
from rvsg.simulation.embedded.people.obstacles import RASTER_M, REACH_M
from rvsg.simulation.embedded.state import Scene
from rvsg.simulation.embedded.walls import AGAIN_S, FROM, PLACE_X, PLACE_Y, SPEED, UNTIL, Walls, edges_of
from rvsg.simulation.events import Contact, DoorMoved, RecordedEvent
from rvsg.world.world import Door

Floats = NDArray[np.float64]


SAFE_M = 0.3
"""A leaf does not close while a body is this near to where it moves."""
HELD_S = 1.5
"""A person who is in the way of a leaf for so long is pushed out of it; the robot never is."""
_FAR_M2 = (REACH_M + RASTER_M) ** 2


@dataclass(frozen=True)
class Body:
    """Somebody near a door: the robot or a person."""

    x: float
    y: float
    shape: Any
    is_robot: bool


@dataclass
class Leaf:
    """A leaf on its way."""

    door: Door
    row: int
    """Its first segment among those that people meet."""
    share: float = 0.0
    opens: bool = False
    seen_t: float = -math.inf
    window: tuple[slice, slice] = (slice(0), slice(0))
    sweep: Any = None
    shape: Any = None
    held_s: float = 0.0
    """For how long somebody has been in the way."""
    moves: list[DoorMoved] = field(default_factory=list)

    def step(self, t: float, bodies: Sequence[Body]) -> bool:
        """Open, wait or close for one tick; whether the leaf moved."""
        door, (x, y) = self.door, self.door.middle
        for body in bodies:
            welcome = ("robot" if body.is_robot else "people") in door.opens_for
            if welcome and math.hypot(body.x - x, body.y - y) <= door.range_m:
                self.seen_t = t
        kept = self.share > 0.0 and any(self.sweep.distance(body.shape) < SAFE_M for body in bodies)
        opens = t - self.seen_t <= door.hold_s or (kept and self.opens)
        if opens != self.opens:
            self._turn(t, opens)
        goal = 1.0 if self.opens else 0.0
        if self.share == goal or (kept and not self.opens):
            return False
        change = PERIOD_S / door.opening_s
        share = min(goal, self.share + change) if self.opens else max(goal, self.share - change)
        shape = shapely.Polygon(door.leaf(share))
        held = [body for body in bodies if _enters(shape, self.shape, body.shape)]
        self.held_s = self.held_s + PERIOD_S if held else 0.0
        if any(body.is_robot or self.held_s < HELD_S for body in held):
            return False
        self.share, self.shape = share, shape
        return True

    def _turn(self, t: float, opens: bool) -> None:
        self.opens = opens
        if self.moves and self.moves[-1].until_s > t:
            self.moves[-1] = self.moves[-1].model_copy(update={"until_s": round(t, 3)})
        left = (1.0 - self.share if opens else self.share) * self.door.opening_s
        x, y = self.door.middle
        self.moves.append(
            DoorMoved(
                time_s=round(t, 3), x=round(x, 3), y=round(y, 3), door=self.door.name, opens=opens,
                share=round(self.share, 3), until_s=round(t + left, 3),
            )
        )  # fmt: skip


def _enters(shape: Any, before: Any, body: Any) -> bool:
    """Return whether a leaf that moves on covers more of a body."""
    return bool(shape.intersects(body)) and shape.intersection(body).area > before.intersection(body).area + 1e-6


class Leaves:
    """All automatic doors of a world, and what people know of them in `crowd.segments` and `crowd.nearest`."""

    def __init__(self, doors: Iterable[Door], crowd: Crowd) -> None:
        rows, columns = crowd.nearest.shape
        self.leaves = [Leaf(door, len(crowd.segments) + 4 * number) for number, door in enumerate(doors)]
        added = [edges_of(leaf.door.leaf(0.0)) for leaf in self.leaves]
        self.crowd = crowd._replace(segments=np.concatenate([crowd.segments, *added]), nearest=crowd.nearest.copy())
        self._walls = crowd.nearest
        for leaf in self.leaves:
            corners = np.concatenate([leaf.door.leaf(share) for share in (0.0, 0.5, 1.0)])
            low, high = corners.min(axis=0) - REACH_M - RASTER_M, corners.max(axis=0) + REACH_M + RASTER_M
            (c0, r0), (c1, r1) = (
                np.floor((at - (crowd.raster_x, crowd.raster_y)) / RASTER_M).astype(int) for at in (low, high)
            )
            leaf.window = (
                slice(min(rows, max(0, r0)), min(rows, max(0, r1 + 1))),
                slice(min(columns, max(0, c0)), min(columns, max(0, c1 + 1))),
            )
            leaf.sweep = shapely.MultiPoint(corners).convex_hull
            leaf.shape = shapely.Polygon(leaf.door.leaf(0.0))
        for leaf in self.leaves:
            self._show(leaf)

    def step(self, t: float, bodies: Sequence[Body]) -> list[Leaf]:
        """Move the leaves for one tick; return those that moved."""
        moved = [leaf for leaf in self.leaves if leaf.step(t, bodies)]
        for leaf in moved:
            self.crowd.segments[leaf.row : leaf.row + 4] = edges_of(leaf.door.leaf(leaf.share))
            self._show(leaf)
        return moved

    def _show(self, changed: Leaf) -> None:
        """Write around a leaf which segment is nearest, among walls and all leaves."""
        rows, columns = changed.window
        near = self._walls[rows, columns].copy()
        if not near.size:
            return
        crowd = self.crowd
        x = crowd.raster_x + (np.arange(columns.start, columns.stop) + 0.5) * RASTER_M
        y = crowd.raster_y + (np.arange(rows.start, rows.stop) + 0.5) * RASTER_M
        x, y = np.meshgrid(x, y)
        best = np.where(near >= 0, _square(crowd.segments[near], x, y), _FAR_M2)
        for leaf in self.leaves:
            if leaf is not changed and not _meet(leaf.window, changed.window):
                continue
            for row in range(leaf.row, leaf.row + 4):
                square = _square(crowd.segments[row], x, y)
                nearer = square < best
                best[nearer], near[nearer] = square[nearer], row
        crowd.nearest[rows, columns] = near


def _meet(a: tuple[slice, slice], b: tuple[slice, slice]) -> bool:
    return all(p.start < q.stop and q.start < p.stop for p, q in zip(a, b, strict=True))


def _square(segment: Floats, x: Floats, y: Floats) -> Floats:
    """Return the squared distance of points from segments (..., 4), one for each or one for all."""
    ax, ay, bx, by = (segment[..., k] for k in range(4))
    dx, dy = bx - ax, by - ay
    length = np.maximum(dx * dx + dy * dy, 1e-12)
    share = np.clip(((x - ax) * dx + (y - ay) * dy) / length, 0.0, 1.0)
    square: Floats = (ax + share * dx - x) ** 2 + (ay + share * dy - y) ** 2
    return square


TOUCH_M = 0.01
ON_IT_M = 0.05
"""A contact of the base within this of a trolley is one with the trolley."""


class Touches:
    """The contacts of a run. `names`: each person with what they sit in or push."""

    def __init__(self, names: Sequence[tuple[str, str]], walls: Walls) -> None:
        self._names, self._walls = names, walls
        self._found: dict[int, list[Contact]] = {}

    def look(self, i: int, t: float, shape: Any, robot: Any, body: Floats, velocity: tuple[float, float]) -> None:
        """Note a contact where a shape touches the robot; `velocity` is the person's before they are held back."""
        if shape.distance(robot) > TOUCH_M:
            return
        px, py = shapely.get_coordinates(shapely.shortest_line(shape, robot))[0]
        cx, cy = shape.centroid.coords[0]
        nx, ny = cx - float(body[base.X]), cy - float(body[base.Y])
        length = max(1e-9, math.hypot(nx, ny))
        nx, ny = nx / length, ny / length
        yaw, v, side, w = (float(body[part]) for part in (base.YAW, base.V, base.SIDE, base.W))
        at_x, at_y = px - float(body[base.X]), py - float(body[base.Y])
        cos, sin = math.cos(yaw), math.sin(yaw)
        robot_part = (v * cos - side * sin - w * at_y) * nx + (v * sin + side * cos + w * at_x) * ny
        overlap = math.sqrt(shape.intersection(robot).area) if shape.intersects(robot) else 0.0
        self._note(i, t, (px, py), robot_part, -(velocity[0] * nx + velocity[1] * ny), body, overlap)

    def sort_out(self, t: float, placed: Mapping[int, Any]) -> None:
        """Take the contacts that are with a trolley out of those with walls; `placed`: where the trolleys were."""
        contacts, counts = self._walls.contacts, self._walls.counts
        kept = int(counts[0])
        while kept and contacts[kept - 1, UNTIL] > t - 0.15:
            row = contacts[kept - 1]
            place = shapely.Point(row[PLACE_X], row[PLACE_Y])
            whose = [i for i, shape in placed.items() if shape.distance(place) < ON_IT_M]
            if not whose or t - row[FROM] > AGAIN_S:
                break
            kept -= 1
            counts[0] = kept
            self._note(whose[0], float(row[FROM]), (float(row[PLACE_X]), float(row[PLACE_Y])), float(row[SPEED]), 0.0)

    def events(self) -> tuple[Contact, ...]:
        """Return the contacts of the run."""
        return tuple(contact for found in self._found.values() for contact in found)

    def _note(
        self, i: int, t: float, place: tuple[float, float], robot_part: float, person_part: float,
        body: Floats | None = None, overlap: float = 0.0,
    ) -> None:  # fmt: skip
        """Begin a contact, or let the last one of the person go on."""
        found = self._found.setdefault(i, [])
        if found and t - found[-1].until_s < AGAIN_S:
            last = found[-1]
            deepest = max(last.overlap_m, round(overlap, 3))
            found[-1] = last.model_copy(update={"until_s": max(last.until_s, round(t, 3)), "overlap_m": deepest})
            return
        bearing = 0.0
        if body is not None:
            bearing = float(wrap(math.atan2(place[1] - body[base.Y], place[0] - body[base.X]) - body[base.YAW]))
        name, part = self._names[i]
        found.append(
            Contact(
                time_s=round(t, 3), x=round(place[0], 3), y=round(place[1], 3), person=name, until_s=round(t, 3),
                closing_speed_m_s=round(max(0.0, robot_part + person_part), 3), robot_part_m_s=round(robot_part, 3),
                person_part_m_s=round(person_part, 3), bearing_rad=round(bearing, 3), overlap_m=round(overlap, 3),
                part=cast(Literal["trolley", "wheelchair"], part),
            )
        )  # fmt: skip


TURN_RAD_S = 1.8
"""A trolley or a wheelchair turns no faster."""
STEPS = ((1.0, 0.0), (0.5, 1.0), (0.5, 0.0), (0.0, 1.0), (0.0, 0.5), (0.0, 0.0))
"""What is tried of a step that is blocked: shares of the way and of the turn."""
LEAST_AHEAD = 0.2
MOVES_M = 0.01
FACING_M, FACED_S, RETREAT_S, BACK_M = 0.15, 2.0, 2.5, 0.04
"""Who has had the robot this near for `FACED_S` steps back for `RETREAT_S`, by `BACK_M` in a tick."""
SPARE_M = 0.3
"""Bodies this far from a trolley are looked at."""
BODY_SHARE = 0.8
"""A trolley is stopped by this share of the radius of another person: who gives way turns sideways."""
PUSH_SIGMA_M = 0.2
PUSH_REACH_M = 1.0
MOST_PUSH_M_S = 0.4
"""Bodies keep apart by HuNavSim's force of obstacles: factor times exp(-gap / 0.2 m), up to this change in a tick.

People who anticipate only learn where the nearest one is: see `gap_to_cart`."""
PATIENCE_S = 1.5
"""A pusher who is blocked by walls or people for so long gets past them, as people lift and squeeze; never the robot.
A person who turns sideways does so after 5 s."""
DEEPER_M2 = 1e-4
PUSHED_M_S2, BRAKED_M_S2, HARD_M_S2 = 1.6, 1.0, 2.5
"""What people who anticipate push and sit in accelerates by no more than the first, but before what it would run into,
and brakes for that by the second, by the third for what comes suddenly, and at once where nothing else helps."""
PROBES_M = np.array([0.05, 0.1, 0.2, 0.35, 0.55, 0.8, 1.0])
"""How far ahead they look whether the way is free."""
KEPT_M = 0.05
"""They keep this far from the robot and from bodies."""


class MovingBodies:
    """Doors and trolleys of one run; `scene`, `walls` and `crowd` are copies of the given ones that hold them."""

    def __init__(
        self, doors: Sequence[Door], agents: Sequence[HumanAgent], scene: Scene, walls: Walls, crowd: Crowd
    ) -> None:
        self._still = crowd.segments
        self.leaves = Leaves(doors, crowd)
        self.crowd = self.leaves.crowd
        self._outlines = {i: np.array(agent.outline) for i, agent in enumerate(agents) if agent.outline}
        self._heedless = {i for i, agent in enumerate(agents) if agent.behaviour is Behaviour.IMPASSIVE}
        self._pose = {i: (float(crowd.x[i]), float(crowd.y[i]), float(crowd.yaw[i])) for i in self._outlines}
        self.placed = {i: placed(outline, *self._pose[i]) for i, outline in self._outlines.items()}
        self._reach = {i: float(np.hypot(*outline.T).max()) for i, outline in self._outlines.items()}
        self._blocked_s = dict.fromkeys(self._outlines, 0.0)
        self._by_robot_s = dict.fromkeys(self._outlines, 0.0)
        self._went = dict.fromkeys(self._outlines, (0.0, 0.0))
        names = [(agent.name, "wheelchair" if agent.outline == WHEELCHAIR else "trolley") for agent in agents]
        self._tree: Any = None
        self._first = len(scene.edges)
        added = [edges_of(leaf.door.leaf(0.0)) for leaf in self.leaves.leaves]
        added += [edges_of(_corners(shape)) for shape in self.placed.values()]
        edges = np.concatenate([scene.edges, *added])
        new = np.arange(self._first, len(edges), dtype=np.int32)
        start, near = _in_every_tile(scene.tile_start, scene.tile_edges, new)
        self.scene = scene._replace(edges=edges, tile_start=start, tile_edges=near)
        start, near = _in_every_tile(walls.start, walls.near, new)
        self.walls = walls._replace(edges=edges, start=start, near=near)
        self.touches = Touches(names, self.walls)

    def on_robot(self, x: float, y: float, yaw: float) -> bool:
        """Return whether a trolley stands on the robot."""
        robot = placed(self.crowd.outline, x, y, yaw)
        return any(shape.intersects(robot) for shape in self.placed.values())

    def step(self, t: float, body: Floats) -> None:
        """Move trolleys and leaves after a tick of the people; `body` is the robot's."""
        crowd, edges = self.crowd, self.scene.edges
        x, y, yaw = float(body[base.X]), float(body[base.Y]), float(body[base.YAW])
        robot = placed(self.crowd.outline, x, y, yaw)
        self.touches.sort_out(t, self.placed)
        crowd.cart[:] = 0.0
        for i in self._outlines:
            self._push(i, t, robot, body)
        first = self._first + 4 * len(self.leaves.leaves)
        for number, shape in enumerate(self.placed.values()):
            edges[first + 4 * number : first + 4 * number + 4] = edges_of(_corners(shape))
        if self.leaves.leaves:
            bodies = [Body(x, y, robot, True)]
            for i in range(crowd.x.size):
                px, py = float(crowd.x[i]), float(crowd.y[i])
                disc = shapely.Point(px, py).buffer(float(crowd.radius[i]))
                bodies.append(Body(px, py, disc.union(self.placed[i]) if i in self.placed else disc, False))
            for leaf in self.leaves.step(t, bodies):
                at = self._first + 4 * self.leaves.leaves.index(leaf)
                edges[at : at + 4] = edges_of(leaf.door.leaf(leaf.share))
        # How far the robot can go before it touches was known for bodies where they were before.
        self.walls.free[0] = 0.0
        crowd.free[0] = 0.0

    def finish(self, t: float) -> None:
        """Tell the last contacts apart, before the outcome of the run is read from those with walls."""
        self.touches.sort_out(t, self.placed)

    def events(self) -> tuple[RecordedEvent, ...]:
        """Return the contacts of the robot with trolleys and wheelchairs, and the movements of doors."""
        return (*self.touches.events(), *(move for leaf in self.leaves.leaves for move in leaf.moves))

    def _push(self, i: int, t: float, robot: Any, body: Floats) -> None:
        """Take as much of a person's step as what they push can make too."""
        crowd = self.crowd
        x, y, yaw = self._pose[i]
        dx, dy = float(crowd.x[i]) - x, float(crowd.y[i]) - y
        most, way = TURN_RAD_S * PERIOD_S, math.hypot(dx, dy)
        wanted = math.atan2(dy, dx) if way > MOVES_M else float(crowd.yaw[i])
        aside = float(wrap(wanted - yaw))
        turn = max(-most, min(most, aside))
        others = self._others(i)
        if crowd.anticipates:
            self._go(i, t, (dx, dy), wanted, robot, body, others)
            return
        past = self._blocked_s[i] > PATIENCE_S
        blockers = [robot] if past else [robot, *others]
        # Nobody pushes a trolley sideways: who turns walks on as it comes round.
        ahead = max(LEAST_AHEAD, math.cos(aside))
        for go, swing in ((ahead, 1.0), *STEPS):
            pose = (x + go * dx, y + go * dy, float(wrap(yaw + swing * turn)))
            shape = placed(self._outlines[i], *pose)
            if not any(_deeper(shape, self.placed[i], other) for other in blockers):
                break
        if self._retreats(i, robot):
            go, pose = 0.0, (x - BACK_M * math.cos(yaw), y - BACK_M * math.sin(yaw), yaw)
            shape = placed(self._outlines[i], *pose)
            if any(_deeper(shape, self.placed[i], other) for other in blockers):
                pose, shape = self._pose[i], self.placed[i]
        velocity = (dx / PERIOD_S, dy / PERIOD_S)
        if way > MOVES_M and go == 0.0:
            self._blocked_s[i] += PERIOD_S
        elif not past or not any(shape.intersects(other) for other in others):
            self._blocked_s[i] = 0.0
        self._place(i, t, pose, shape, robot, body, velocity, (go * velocity[0], go * velocity[1]))

    def _go(
        self, i: int, t: float, step: tuple[float, float], wanted: float, robot: Any, body: Floats, others: list[Any]
    ) -> None:
        """Take a person's step with what they push within its acceleration, and brake before what is in the way."""
        crowd = self.crowd
        x, y, yaw = self._pose[i]
        here, outline = self.placed[i], self._outlines[i]
        aside, most = float(wrap(wanted - yaw)), TURN_RAD_S * PERIOD_S
        turn = max(-most, min(most, aside))
        blockers = [robot.buffer(KEPT_M) if crowd.horizon[i] > 0.0 else robot, *others]
        go = np.array(step) * max(LEAST_AHEAD, math.cos(aside))
        if self._retreats(i, robot):
            go = np.array([-BACK_M * math.cos(yaw), -BACK_M * math.sin(yaw)])
        length = float(np.hypot(*go))
        if length > 0.0:
            probes = np.array([placed(outline, x + p * go[0] / length, y + p * go[1] / length, yaw) for p in PROBES_M])
            new = [each for each in blockers if not each.intersects(here)]
            hits = shapely.intersects(probes[:, None], np.array(new, object)).any(axis=1) if new else np.zeros(1, bool)
            if hits.any():
                free = float(np.append(0.0, PROBES_M)[int(hits.argmax())])
                go *= min(1.0, math.sqrt(2.0 * BRAKED_M_S2 * free) * PERIOD_S / length)
        change = go - self._went[i]
        least = PUSHED_M_S2 * PERIOD_S**2 / max(float(np.hypot(*change)), 1e-9)
        smooth = self._went[i] + change * min(1.0, least)
        hard = np.array(self._went[i]) * max(0.0, 1.0 - HARD_M_S2 * PERIOD_S**2 / max(math.hypot(*self._went[i]), 1e-9))
        for way, swing in ((smooth, 1.0), (smooth, 0.5), (smooth, 0.0), (hard, 0.0), (0.0 * go, 1.0), (0.0 * go, 0.0)):
            pose = (float(x + way[0]), float(y + way[1]), float(wrap(yaw + swing * turn)))
            shape = placed(outline, *pose)
            if not any(_deeper(shape, here, other) for other in blockers):
                break
        else:
            pose, shape, way = self._pose[i], here, 0.0 * go
        moved = float(np.hypot(*way)) > MOVES_M / 2 or pose[2] != yaw
        self._blocked_s[i] = 0.0 if moved or math.hypot(*step) < MOVES_M else self._blocked_s[i] + PERIOD_S
        if self._blocked_s[i] > PATIENCE_S:
            self._by_robot_s[i], self._blocked_s[i] = -RETREAT_S, 0.0
        self._went[i] = (float(way[0]), float(way[1]))
        pace = (self._went[i][0] / PERIOD_S, self._went[i][1] / PERIOD_S)
        self._place(i, t, pose, shape, robot, body, (step[0] / PERIOD_S, step[1] / PERIOD_S), pace)

    def _place(
        self, i: int, t: float, pose: tuple[float, float, float], shape: Any, robot: Any, body: Floats,
        velocity: tuple[float, float], pace: tuple[float, float],
    ) -> None:  # fmt: skip
        """Put a person and what they push at a pose; tell others and the person what is near."""
        crowd = self.crowd
        self.touches.look(i, t, shape, robot, body, velocity)
        self._pose[i], self.placed[i] = pose, shape
        crowd.x[i], crowd.y[i], crowd.yaw[i] = pose
        crowd.vx[i], crowd.vy[i] = pace
        # The pusher keeps away from the robot, and others from what is pushed.
        if crowd.anticipates or i not in self._heedless:
            v, side, heading = (float(body[part]) for part in (base.V, base.SIDE, base.YAW))
            cos, sin = math.cos(heading), math.sin(heading)
            shown = 0.0 if i in self._heedless else 1.0  # to somebody impassive the robot is as a wall
            self._keep_apart(i, shape, robot, 0.0, (shown * (v * cos - side * sin), shown * (v * sin + side * cos)))
        for j in range(crowd.x.size):
            if j != i and self._apart(i, j) < self._reach[i] + PUSH_REACH_M:
                self._keep_apart(j, shapely.Point(crowd.x[j], crowd.y[j]), shape, float(crowd.radius[j]), pace)

    def _retreats(self, i: int, robot: Any) -> bool:
        """Return whether a person who stands in front of the robot with what they push steps back, for a while."""
        if self._by_robot_s[i] < 0.0:
            self._by_robot_s[i] = min(0.0, self._by_robot_s[i] + PERIOD_S)
            return True
        near = i not in self._heedless and self.placed[i].distance(robot) < FACING_M and not self.crowd.stands[i]
        self._by_robot_s[i] = self._by_robot_s[i] + PERIOD_S if near else 0.0
        if self._by_robot_s[i] >= FACED_S:
            self._by_robot_s[i] = -RETREAT_S
        return False

    def _others(self, i: int) -> list[Any]:
        """Return the walls, leaves, people and trolleys near a trolley."""
        crowd, shape = self.crowd, self.placed[i]
        if self._tree is None:
            lines = shapely.linestrings(self._still.reshape(-1, 2, 2)) if len(self._still) else []
            self._tree = shapely.STRtree(lines)
        low_x, low_y, high_x, high_y = shape.bounds
        here = shapely.box(low_x - SPARE_M, low_y - SPARE_M, high_x + SPARE_M, high_y + SPARE_M)
        found = list(self._tree.geometries[self._tree.query(here)])
        found += [leaf.shape for leaf in self.leaves.leaves if leaf.shape.intersects(here)]
        found += [other for j, other in self.placed.items() if j != i and other.intersects(here)]
        for j in range(crowd.x.size):
            if j != i and self._apart(i, j) < self._reach[i] + SPARE_M:
                share = 1.0 if crowd.anticipates else BODY_SHARE
                found.append(shapely.Point(crowd.x[j], crowd.y[j]).buffer(share * float(crowd.radius[j]), 4))
        return found

    def _apart(self, i: int, j: int) -> float:
        """Return the distance of a person's body from another's middle."""
        crowd = self.crowd
        return math.hypot(crowd.x[j] - crowd.x[i], crowd.y[j] - crowd.y[i]) - float(crowd.radius[j])

    def _keep_apart(self, j: int, shape: Any, other: Any, radius: float, pace: tuple[float, float]) -> None:
        """Push a person off a body near `shape`, theirs, or note where it is; it acts in the next tick."""
        crowd = self.crowd
        gap = float(shape.distance(other)) - radius
        if gap >= PUSH_REACH_M or crowd.stands[j]:
            return
        if gap + radius <= 0.0:
            (ax, ay), (bx, by) = shape.centroid.coords[0], other.centroid.coords[0]
        else:
            a, b = shapely.get_coordinates(shapely.shortest_line(shape, other))
            (ax, ay), (bx, by) = a, b
        length = math.hypot(ax - bx, ay - by)
        if length < 1e-9:
            return
        if crowd.anticipates:
            share = max(gap, MOVES_M) / length
            if not crowd.cart[j].any() or share * length < math.hypot(crowd.cart[j, 0], crowd.cart[j, 1]):
                crowd.cart[j] = share * (ax - bx), share * (ay - by), *pace
            return
        push = min(MOST_PUSH_M_S, float(crowd.factor_obstacle[j]) * math.exp(-max(0.0, gap) / PUSH_SIGMA_M) * PERIOD_S)
        crowd.vx[j] += push * (ax - bx) / length
        crowd.vy[j] += push * (ay - by) / length


def placed(corners: Floats, x: float, y: float, yaw: float) -> Any:
    """Return an outline of a body's frame in the world."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return shapely.polygons(corners @ np.array([[cos, sin], [-sin, cos]]) + (x, y))


def _corners(shape: Any) -> Floats:
    corners: Floats = shapely.get_coordinates(shape)[:-1]
    return corners


def _deeper(shape: Any, before: Any, other: Any) -> bool:
    """Return whether a shape is deeper in another body or a wall than it was before."""
    return bool(shape.intersects(other)) and _overlap(shape, other) > _overlap(before, other) + DEEPER_M2


def _overlap(shape: Any, other: Any) -> float:
    """Return how much of another body, or how long a part of a wall, lies within a shape (m² or m)."""
    shared = shape.intersection(other)
    return float(shared.area or shared.length)


def _in_every_tile(
    start: NDArray[np.int64], near: NDArray[np.int32], new: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the tiles with the numbers of new edges in each: they move about."""
    tiles = len(start) - 1
    return (
        start + len(new) * np.arange(tiles + 1),
        np.insert(near, np.repeat(start[1:], len(new)), np.tile(new, tiles)).astype(np.int32),
    )
