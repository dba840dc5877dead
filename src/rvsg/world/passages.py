"""Free widths of passages: lines through a point of the way, from the obstacle on its left to that on its right."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Pose, Record
from rvsg.robots.robot import DEFAULT_ROBOT, Robot, load_robot
from rvsg.world.grid import Grid
from rvsg.world.space import Space, human_space
from rvsg.world.world import Area, Route, World

Floats = NDArray[np.float64]

PERSON_M = 0.8
"""Diameter of a person."""
SWERVE_RAD = math.radians(20.0)
"""Turn with which a robot that cannot move sideways gets past a person."""
WIDEST_M = 20.0  # a chord is not followed farther than this to either side
FAN_RAD = math.radians(30.0)  # a chord may lean this far from the perpendicular; more would cut corners
FAN_STEPS = 13  # chords tried in that fan
SAMPLE_M = 0.1  # distance between two points of a line at which its width is measured
TOUCHING_M = 0.4  # an area this close to the end of a chord is the thing that bounds the passage
SEPARATE_M = 1.0  # two narrow places closer together than this on the way are one


def passing_m(robot: Robot | None = None) -> float:
    """Return the width below which a robot and a person who meet often cannot pass each other.

    It is the width of both side by side, for a robot that cannot move sideways turned by `SWERVE_RAD`.
    """
    robot = robot or load_robot(DEFAULT_ROBOT)
    taken = robot.width_m
    if robot.drive.kind != "omnidirectional":
        taken = taken * math.cos(SWERVE_RAD) + robot.length_m * math.sin(SWERVE_RAD)
    return round(taken + PERSON_M, 2)


class Passage(Record):
    """A place on a way and its free width.

    `along_m` is the distance from the start of the way, `yaw` the direction of travel (radians, world frame),
    `waypoint` the nearest waypoint, `left` and `right` the areas that bound the passage as seen in the direction of
    travel (None: a wall or something without a label).
    """

    x: float
    y: float
    yaw: float
    along_m: float
    width_m: float
    waypoint: str
    left: str | None = None
    right: str | None = None


def free_width_m(world: World, x: float, y: float, yaw: float | None = None) -> float:
    """Return the free width in metres at a point of the floor; 0 inside an obstacle.

    It is measured across the direction of travel `yaw` (radians), or without one along the shortest line.
    """
    at = np.array([[x, y]])
    widths = free_widths_m(world, at) if yaw is None else widths_m(human_space(world), at, np.array([yaw]))
    return float(widths[0])


def free_widths_m(world: World, points: Floats) -> Floats:
    """Return the shortest straight lines (N,) from obstacle to obstacle through points (N, 2), in metres."""
    angles = np.linspace(0.0, math.pi, 36, endpoint=False)
    return np.asarray(_chords(human_space(world), points, angles[None, :]).sum(axis=-1).min(axis=1))


def widths_m(space: Space, points: Floats, yaws: Floats) -> Floats:
    """Return the free width in metres across each direction of travel: points (N, 2), yaws (N,) to widths (N,).

    It is the shortest line within 30 degrees of the perpendicular: crossing an aisle askew does not widen it.
    """
    return np.asarray(_widths(space, points, yaws)[0])


def narrow_passages(
    world: World, line: Floats, *, robot: Robot | None = None, most: int | None = None
) -> tuple[Passage, ...]:
    """Return the narrow places along a line (N, 2) in metres, in the order of travel, one per stretch.

    Places where this robot (None: the default one) and a person can pass are left out; `most` keeps the narrowest.
    """
    points, yaws, along = _along(line)
    widths = widths_m(human_space(world), points, yaws)
    narrow = np.flatnonzero((widths > 0.0) & (widths < passing_m(robot)))
    stretches = np.split(narrow, np.flatnonzero(np.diff(along[narrow]) > SEPARATE_M) + 1) if len(narrow) else []
    narrowest = [int(stretch[widths[stretch].argmin()]) for stretch in stretches]
    if most is not None:
        narrowest = sorted(sorted(narrowest, key=lambda i: float(widths[i]))[:most])
    return tuple(_passage(world, points[i], float(yaws[i]), float(along[i])) for i in narrowest)


def narrowest_passage(world: World, line: Floats) -> Passage | None:
    """Return the narrowest place on a line (N, 2); None if the whole line lies in obstacles."""
    points, yaws, along = _along(line)
    widths = widths_m(human_space(world), points, yaws)
    i = int(np.where(widths > 0.0, widths, np.inf).argmin())
    return _passage(world, points[i], float(yaws[i]), float(along[i])) if widths[i] > 0.0 else None


def doorway(world: World, one: str, other: str) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return the ends, in metres, of the narrowest place between two waypoints; None where they see no free floor."""
    points, yaws, _ = _along(np.array([world.grid.position(one), world.grid.position(other)]))
    widths, left, right = _widths(human_space(world), points, yaws)
    i = int(np.where(widths > 0.0, widths, np.inf).argmin())
    ends = [(round(float(x), 2), round(float(y), 2)) for x, y in (left[i], right[i])]
    return (ends[0], ends[1]) if widths[i] > 0.0 else None


def narrowest_m(world: World, lines: Sequence[Floats]) -> list[float]:
    """Return the free width in metres at the narrowest place of each line (N, 2); 0 where all of it is in obstacles."""
    sampled = [_along(line) for line in lines]
    points, yaws = (np.concatenate(column) for column in list(zip(*sampled, strict=True))[:2])
    widths = widths_m(human_space(world), points, yaws)
    parts = np.split(widths, np.cumsum([len(piece[0]) for piece in sampled])[:-1])
    return [round(float(part[part > 0.0].min()), 3) if part.any() else 0.0 for part in parts]


def least_widths_m(world: World, driven: Floats, starts: Sequence[int]) -> list[float]:
    """Return the least free width in metres of each part of a driven way (N, 2), as `describe_route` measures it.

    Args:
        starts: Where the parts begin: rising indices of `driven`.
    """
    points, yaws, along = _along(simplified(driven))
    widths = widths_m(human_space(world), points, yaws)
    driven_m = np.append(0.0, np.cumsum(np.hypot(*np.diff(driven, axis=0).T)))
    begins = driven_m[list(starts)] / max(driven_m[-1], 1e-9) * along[-1]
    first = np.minimum(np.searchsorted(along, begins - 1e-9), len(along) - 1)
    least = np.minimum.reduceat(np.where(widths > 0.0, widths, np.inf), first)
    return [round(width, 1) if math.isfinite(width) else 0.0 for width in least.tolist()]


def _passage(world: World, at: Floats, yaw: float, along_m: float) -> Passage:
    """Measure the passage at a point (2,) of a way."""
    (width,), (left,), (right,) = _widths(human_space(world), at[None, :], np.array([yaw]))
    x, y = at.tolist()
    return Passage(
        x=round(x, 3),
        y=round(y, 3),
        yaw=round(yaw, 4),
        along_m=round(along_m, 3),
        width_m=round(float(width), 3),
        waypoint=world.grid.nearest(x, y),
        left=_bounding_area(world, left),
        right=_bounding_area(world, right),
    )


def _bounding_area(world: World, end: Floats) -> str | None:
    """Return the labelled thing that the end of a chord touches; open floor bounds nothing."""
    from shapely import Point, Polygon

    from rvsg.world.lattice import open_share

    point = Point(*end)
    near = []
    for area in world.areas:
        shape = Polygon(area.outline)
        away = float(shape.distance(point))
        if away <= TOUCHING_M and open_share(area.outline, human_space(world)) <= 0.5:
            near.append((away, float(shape.area), area.name))
    return min(near)[2] if near else None


def _along(line: Floats) -> tuple[Floats, Floats, Floats]:
    """Return samples of a line: points (N, 2), directions (N,) and distances from its start (N,)."""
    line = np.asarray(line, float)
    legs = np.diff(line, axis=0)
    lengths = np.hypot(*legs.T)
    line, legs, lengths = line[np.append(True, lengths > 0.0)], legs[lengths > 0.0], lengths[lengths > 0.0]
    if not len(lengths):
        return line[:1], np.zeros(1), np.zeros(1)
    starts = np.append(0.0, np.cumsum(lengths))
    counts = np.maximum(1, np.ceil(lengths / SAMPLE_M)).astype(int)
    leg = np.repeat(np.arange(len(legs)), counts)
    shares = np.concatenate([np.arange(count) / count for count in counts])
    yaws = np.array([math.atan2(dy, dx) for dx, dy in legs.tolist()])
    points = np.vstack([line[leg] + legs[leg] * shares[:, None], line[-1:]])
    return points, np.append(yaws[leg], yaws[-1]), np.append(starts[leg] + shares * lengths[leg], starts[-1])


def _widths(space: Space, points: Floats, yaws: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the widths (N,) and the two ends (N, 2) of the shortest chord, left and right of the travel direction."""
    angles = yaws[:, None] + math.pi / 2 + np.linspace(-FAN_RAD, FAN_RAD, FAN_STEPS)[None, :]
    reach = _chords(space, points, angles)
    best = reach.sum(axis=-1).argmin(axis=1)
    row = np.arange(len(points))
    chosen, angle = reach[row, best], angles[row, best]
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    return chosen.sum(axis=1), points + chosen[:, :1] * direction, points - chosen[:, 1:] * direction


def _chords(space: Space, points: Floats, angles: Floats) -> Floats:
    """Return how far it is to the obstacle ahead and behind: points (N, 2), angles (N or 1, K) to (N, K, 2) metres."""
    forward = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    rays = np.stack([forward, -forward], axis=2)
    rays = np.broadcast_to(rays, (len(points), *rays.shape[1:]))
    reach = np.zeros(rays.shape[:-1])
    starts = np.broadcast_to(points[:, None, None, :], rays.shape).reshape(-1, 2)
    directions, far = rays.reshape(-1, 2), reach.reshape(-1)
    least = space.frame.resolution / 4
    moving = np.arange(len(far))
    while len(moving):
        clear = space.clearances(starts[moving] + directions[moving] * far[moving, None])
        free = clear > 0.0
        moving = moving[free]
        far[moving] += np.maximum(clear[free], least)
        moving = moving[far[moving] < WIDEST_M]
    return np.minimum(reach, WIDEST_M)


TURN_RAD = math.radians(40)
WIGGLE_M = 0.1
SHORTCUT_M = 0.6  # bends smaller than this are not worth a word
MOST_NARROW = 3
NEAR_M = 1.5
MOST_NAMED = 14


def route_paragraph(world: World, route: Route, driven: Floats | None = None, *, robot: Robot | None = None) -> str:
    """Return the user's own description of the route if it has one, else the generated paragraph."""
    return route.description or describe_route(world, route, driven, robot=robot)


def describe_route(world: World, route: Route, driven: Floats | None = None, *, robot: Robot | None = None) -> str:
    """Describe a route in one paragraph: start, goal, waypoints on the way, turns and narrow places, as on the picture.

    Args:
        driven: Points (N, 2) of the way that the robot drives without people; with it, no waypoints are named.
        robot: The robot that drives, which tells where people cannot pass it; None: the default one.
    """
    way, purpose = waypoints_of(world, route) if driven is None else (), known_purpose(world, route)
    line = line_of(world, route) if driven is None else simplified(driven)
    start, goal = _place(world, route.start), _place(world, route.goal)
    sentences = [
        f"The robot starts at {start}, facing {_facing(world.grid, route.start.yaw)} on the picture, and must reach "
        f"{goal}, about {length_m(line):.0f} m away along the route, within {route.time_limit_s:g} s"
        + (f" ({purpose})." if purpose else ".")
    ]
    if len(way) > 1:
        step = math.ceil(len(way) / MOST_NAMED)
        named = ", ".join(way if step == 1 else [*way[:-1:step], way[-1]])
        every = {1: "", 2: " (every second one named)", 3: " (every third one named)"}
        sentences.append(f"It roughly passes the waypoints {named}{every.get(step, f' (every {step}th one named)')}.")
    for number, pose in enumerate(route.through, start=1):
        sentences.append(f"{'It must first pass' if number == 1 else 'Then'} {_place(world, pose)}.")
    passed = _areas_passed(world, line, (route.start, route.goal))
    if passed:
        sentences.append(f"On its way it passes {_joined(passed)}.")
    sentences += _turns(world.grid, line)
    sentences += _narrow_places(world, line, robot)
    sentences.append(f"At the goal it faces {_facing(world.grid, route.goal.yaw)}.")
    return " ".join(sentences)


def known_purpose(world: World, route: Route) -> str:
    """Return the purpose of a route; empty where it names a numbered label that the world no longer has."""
    names = {area.name for area in world.areas}
    unknown = set(re.findall(r"\b[A-Z]\w* \d+\b", route.purpose)) - names
    return route.purpose if not unknown else ""


def waypoints_of(world: World, route: Route) -> tuple[str, ...]:
    """Return the waypoints a route roughly passes: its `via`, or the shortest walk through its poses."""
    if route.via:
        return route.via
    stops = [world.grid.nearest(pose.x, pose.y) for pose in (route.start, *route.through, route.goal)]
    way: list[str] = [stops[0]]
    for a, b in pairwise(stops):
        found = world.grid.shortest_path(a, b) or (a, b)
        way += found[1:]
    return tuple(way)


def line_of(world: World, route: Route) -> Floats:
    """Return the rough way from start to goal as points (N, 2) in metres."""
    names = waypoints_of(world, route)
    points = [world.grid.position(name) for name in names if name in world.grid.by_name]
    start, goal = (route.start.x, route.start.y), (route.goal.x, route.goal.y)
    inner = [p for p in points if math.dist(p, start) > 0.3 and math.dist(p, goal) > 0.3]
    return np.array([start, *inner, goal], np.float64)


def simplified(driven: Floats) -> Floats:
    """Return a driven way (N, 2) without its small wiggles and stops."""
    from shapely import LineString, get_coordinates

    return np.asarray(get_coordinates(LineString(driven).simplify(WIGGLE_M)), np.float64)


def length_m(line: Floats) -> float:
    """Return the length of a line (N, 2) in metres."""
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _joined(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def _place(world: World, pose: Pose) -> str:
    """Name a place: "waypoint G12 in Area 3", "waypoint E21 beside Shelf 6"."""
    name = world.grid.nearest(pose.x, pose.y)
    x, y = world.grid.position(name)
    at = f"waypoint {name}" if math.hypot(x - pose.x, y - pose.y) < 0.3 else f"a place near waypoint {name}"
    area, away = nearest_area(world.areas, pose.x, pose.y)
    if area is None or away > NEAR_M:
        return at
    return f"{at} in {area.name}" if away == 0.0 else f"{at} beside {area.name}"


def nearest_area(areas: Sequence[Area], x: float, y: float) -> tuple[Area | None, float]:
    """Return the area nearest to a point and its distance (metres, 0 inside); of several the smallest."""
    from shapely import Point, Polygon

    shapes = [(area, Polygon(area.outline)) for area in areas]
    ranked = {(round(shape.distance(Point(x, y)), 3), shape.area, area.name): area for area, shape in shapes}
    nearest = min(ranked, default=None)
    return (None, math.inf) if nearest is None else (ranked[nearest], nearest[0])


def _facing(grid: Grid, yaw: float) -> str:
    """Return a heading (radians) as a direction on the picture."""
    dx, dy = math.cos(yaw), math.sin(yaw)
    right, up = (dx, dy) if grid.up == "y" else (-dy, dx)
    words = ("right", "up and right", "up", "up and left", "left", "down and left", "down", "down and right")
    return words[round(math.atan2(up, right) / (math.pi / 4)) % 8]


def _areas_passed(world: World, line: Floats, ends: Sequence[Pose]) -> list[str]:
    """Return the areas within 1 m of the way in the order of travel, without those at its ends."""
    from shapely import LineString, Point, Polygon

    path = LineString(line)
    at_ends = {nearest_area(world.areas, pose.x, pose.y)[0] for pose in ends}
    met = []
    for area in world.areas:
        shape = Polygon(area.outline)
        if area not in at_ends and path.distance(shape) <= 1.0:
            inside = path.intersection(shape)
            crosses = inside.geom_type == "LineString" and not inside.is_empty
            at = Point(inside.coords[0]) if crosses else shape.centroid
            met.append((path.project(at), area.name))
    return [name for _, name in sorted(met)][:6]


def _turns(grid: Grid, line: Floats) -> list[str]:
    """Return the direction of travel and its changes, in directions of the picture; small bends are left out."""
    from shapely import LineString, get_coordinates

    corners = get_coordinates(LineString(line).simplify(SHORTCUT_M))
    legs = np.diff(corners, axis=0)
    headings = [math.atan2(leg[1], leg[0]) for leg in legs]
    turns = []
    for at, before, after in zip(corners[1:], headings, headings[1:], strict=False):
        if abs(math.remainder(after - before, math.tau)) >= TURN_RAD:
            turns.append(f"{_facing(grid, after)} from {grid.nearest(float(at[0]), float(at[1]))}")
    first = _facing(grid, headings[0])
    if not turns:
        return [f"On the picture it drives {first} without a marked turn."]
    return [f"On the picture it drives {first} first, then {_joined(turns)}."]


def _narrow_places(world: World, line: Floats, robot: Robot | None) -> list[str]:
    """Return where the robot and a person often cannot pass each other, by the free width across the way."""
    words = []
    for passage in narrow_passages(world, line, robot=robot, most=MOST_NARROW):
        between = list(dict.fromkeys(name for name in (passage.left, passage.right) if name))
        where = f", between {_joined(between)}" if len(between) > 1 else f", beside {between[0]}" if between else ""
        words.append(f"near {passage.waypoint}{where} (free width {passage.width_m:.1f} m)")
    if not words:
        return []
    return [f"The robot and a person often cannot pass each other {_joined(words)}."]
