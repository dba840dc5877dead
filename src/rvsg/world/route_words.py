"""A route in words: where it starts and ends, what it passes, where it turns and where the way is narrow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Pose
from rvsg.robots.robot import Robot
from rvsg.world.grid import Grid
from rvsg.world.passages import narrow_passages
from rvsg.world.world import Area, Route, World

Floats = NDArray[np.float64]

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
    """Describe a route in one paragraph: start, goal, waypoints on the way, turns and narrow places.

    All directions are those of the picture. The same world and route give the same words.

    Args:
        driven: Points (N, 2) of the way that the robot drives without people. A robot plans its own way, which may be
            another one than the route's `via`; with it, no waypoints are named.
        robot: The robot that drives, which tells where people cannot pass it; None: the default one.
    """
    way = waypoints_of(world, route) if driven is None else ()
    line = line_of(world, route) if driven is None else simplified(driven)
    start, goal = _place(world, route.start), _place(world, route.goal)
    sentences = [
        f"The robot starts at {start}, facing {_facing(world.grid, route.start.yaw)} on the picture, and must reach "
        f"{goal}, about {length_m(line):.0f} m away along the route, within {route.time_limit_s:g} s"
        + (f" ({route.purpose})." if route.purpose else ".")
    ]
    if len(way) > 1:
        sentences.append(f"It roughly passes the waypoints {_listed(way)}.")
    for number, pose in enumerate(route.through, start=1):
        first = "It must first pass" if number == 1 else "then"
        sentences.append(f"{first[0].upper() + first[1:]} {_place(world, pose)}.")
    passed = _areas_passed(world, line, (route.start, route.goal))
    if passed:
        sentences.append(f"On its way it passes {_joined(passed)}.")
    sentences += _turns(world.grid, line)
    sentences += _narrow_places(world, line, robot)
    sentences.append(f"At the goal it faces {_facing(world.grid, route.goal.yaw)}.")
    return " ".join(sentences)


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


def _listed(names: Sequence[str]) -> str:
    if len(names) <= MOST_NAMED:
        return ", ".join(names)
    step = math.ceil(len(names) / MOST_NAMED)
    shown = [*names[:-1:step], names[-1]]
    return ", ".join(shown) + f" (every {_ordinal(step)} one named)"


def _ordinal(number: int) -> str:
    return {2: "second", 3: "third"}.get(number, f"{number}th")


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

    point = Point(x, y)
    best: tuple[float, float, str] | None = None
    found: Area | None = None
    for area in areas:
        shape = Polygon(area.outline)
        key = (round(float(shape.distance(point)), 3), float(shape.area), area.name)
        if best is None or key < best:
            best, found = key, area
    return (found, best[0]) if best is not None else (None, math.inf)


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
            where = path.project(
                Point(
                    inside.coords[0]
                    if inside.geom_type == "LineString" and not inside.is_empty
                    else shape.centroid.coords[0]
                )
            )
            met.append((where, area.name))
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
        between = passage.between
        where = f", between {_joined(between)}" if len(between) > 1 else f", beside {between[0]}" if between else ""
        words.append(f"near {passage.waypoint}{where} (free width {passage.width_m:.1f} m)")
    if not words:
        return []
    return [f"The robot and a person often cannot pass each other {_joined(words)}."]


def sampled(line: Floats, step_m: float) -> Floats:
    """Return points along the line every `step_m` metres or less, including its corners."""
    parts = []
    for a, b in pairwise(line):
        count = max(1, math.ceil(float(np.hypot(*(b - a))) / step_m))
        parts.append(a + (b - a) * (np.arange(count) / count)[:, None])
    return np.concatenate([*parts, line[-1:]])
