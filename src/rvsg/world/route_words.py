"""A route in words, written from the route itself: where it starts and ends, what it passes, turns, narrow places."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Pose
from rvsg.world.grid import Grid
from rvsg.world.space import human_space
from rvsg.world.world import Area, Route, World

Floats = NDArray[np.float64]

TURN_RAD = math.radians(40)
SHARP_RAD = math.radians(110)
SHORTCUT_M = 0.6  # bends smaller than this are not worth a word
NARROW_M = 1.6
MOST_NARROW = 3
NEAR_M = 1.5
MOST_NAMED = 14


def route_paragraph(world: World, route: Route) -> str:
    """What is told of the route: the user's own description where there is one, else the generated paragraph."""
    return route.description or describe_route(world, route)


def describe_route(world: World, route: Route) -> str:
    """One paragraph: start and end with their areas and headings, the waypoints passed, turns and narrow places.

    Directions are those of the pictures. Deterministic: the same world and route give the same words.
    """
    way = waypoints_of(world, route)
    line = line_of(world, route)
    start, goal = _place(world, route.start), _place(world, route.goal)
    sentences = [
        f"The robot starts at {start}, facing {_facing(world.grid, route.start.yaw)} on the picture, and has to reach "
        f"{goal}, about {length_m(line):.0f} m along its way, within {route.time_limit_s:g} s"
        + (f" ({route.purpose})." if route.purpose else ".")
    ]
    if len(way) > 1:
        sentences.append(f"It roughly passes the waypoints {_listed(way)}.")
    for number, pose in enumerate(route.through, start=1):
        first = "It must first pass" if number == 1 else "then"
        sentences.append(f"{first[0].upper() + first[1:]} {_place(world, pose)}.")
    passed = _areas_passed(world, line, (route.start, route.goal))
    if passed:
        sentences.append(f"On its way it comes by {_joined(passed)}.")
    sentences += _turns(world.grid, line)
    sentences += _narrow_places(world, line)
    sentences.append(f"At the goal it faces {_facing(world.grid, route.goal.yaw)}.")
    return " ".join(sentences)


def waypoints_of(world: World, route: Route) -> tuple[str, ...]:
    """The waypoints a route roughly passes: its own `via`, or the shortest walk by start, poses to pass and goal."""
    if route.via:
        return route.via
    stops = [world.grid.nearest(pose.x, pose.y) for pose in (route.start, *route.through, route.goal)]
    way: list[str] = [stops[0]]
    for a, b in pairwise(stops):
        found = world.grid.shortest_path(a, b) or (a, b)
        way += found[1:]
    return tuple(way)


def line_of(world: World, route: Route) -> Floats:
    """The rough way as points (N, 2) in metres, from start to goal."""
    names = waypoints_of(world, route)
    points = [world.grid.position(name) for name in names if name in world.grid.by_name]
    start, goal = (route.start.x, route.start.y), (route.goal.x, route.goal.y)
    inner = [p for p in points if math.dist(p, start) > 0.3 and math.dist(p, goal) > 0.3]
    return np.array([start, *inner, goal], np.float64)


def length_m(line: Floats) -> float:
    """The length of a line (N, 2) in metres."""
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
    """ "waypoint G12 in Area 3", "waypoint E21 beside Shelf 6"."""
    name = world.grid.nearest(pose.x, pose.y)
    x, y = world.grid.position(name)
    at = f"waypoint {name}" if math.hypot(x - pose.x, y - pose.y) < 0.3 else f"a place near waypoint {name}"
    area, away = nearest_area(world.areas, pose.x, pose.y)
    if area is None or away > NEAR_M:
        return at
    return f"{at} in {area.name}" if away == 0.0 else f"{at} beside {area.name}"


def nearest_area(areas: Sequence[Area], x: float, y: float) -> tuple[Area | None, float]:
    """The area nearest to a point and how far it is (metres, 0 inside); of several the smallest."""
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
    """A heading in words of the picture."""
    dx, dy = math.cos(yaw), math.sin(yaw)
    right, up = (dx, dy) if grid.up == "y" else (-dy, dx)
    words = ("right", "up and right", "up", "up and left", "left", "down and left", "down", "down and right")
    return words[round(math.atan2(up, right) / (math.pi / 4)) % 8]


def _areas_passed(world: World, line: Floats, ends: Sequence[Pose]) -> list[str]:
    """Areas within arm's length of the way, in the order they are met, without those it starts and ends at."""
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
    """The turns of the way, small bends left out."""
    from shapely import LineString, get_coordinates

    corners = get_coordinates(LineString(line).simplify(SHORTCUT_M))
    turns = []
    for before, at, after in zip(corners, corners[1:], corners[2:], strict=False):
        a, b = at - before, after - at
        angle = math.atan2(a[0] * b[1] - a[1] * b[0], float(a @ b))
        if abs(angle) >= TURN_RAD:
            sharply = "sharply " if abs(angle) >= SHARP_RAD else ""
            side = "left" if angle > 0 else "right"
            turns.append(f"{sharply}{side} at {grid.nearest(float(at[0]), float(at[1]))}")
    heading = _facing(grid, math.atan2(*(corners[1] - corners[0])[::-1]))
    if not turns:
        return [f"It drives {heading} without a marked turn."]
    return [f"It drives {heading} first and turns {_joined(turns)}."]


def _narrow_places(world: World, line: Floats) -> list[str]:
    """Where the way leads between obstacles less than NARROW_M apart."""
    space = human_space(world)
    samples = sampled(line, 0.1)
    wide = 2.0 * space.clearances(samples)
    narrow = (wide > 0.0) & (wide < NARROW_M)
    runs: list[tuple[float, int]] = []
    first = None
    for i, inside in enumerate([*narrow.tolist(), False]):
        if inside and first is None:
            first = i
        elif not inside and first is not None:
            if i - first >= 3:
                least = first + int(wide[first:i].argmin())
                runs.append((float(wide[least]), least))
            first = None
    chosen = sorted(sorted(runs)[:MOST_NARROW], key=lambda run: run[1])
    words = []
    for width, index in chosen:
        x, y = (float(v) for v in samples[index])
        between = _between(world, x, y)
        words.append(f"near {world.grid.nearest(x, y)}{between} (about {width:.1f} m wide)")
    return [f"The way is narrow {_joined(words)}."] if words else []


def _between(world: World, x: float, y: float) -> str:
    from shapely import Point, Polygon

    near = sorted((float(Polygon(a.outline).distance(Point(x, y))), a.name) for a in world.areas)
    names = [name for away, name in near if 0.0 < away < NARROW_M][:2]
    if len(names) == 2:
        return f", between {names[0]} and {names[1]}"
    return f", beside {names[0]}" if names else ""


def sampled(line: Floats, step_m: float) -> Floats:
    """Points along the line every `step_m` metres or less, its corners included."""
    parts = []
    for a, b in pairwise(line):
        count = max(1, math.ceil(float(np.hypot(*(b - a))) / step_m))
        parts.append(a + (b - a) * (np.arange(count) / count)[:, None])
    return np.concatenate([*parts, line[-1:]])
