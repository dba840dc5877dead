"""Checks of a world folder: all errors and warnings at once, each with its file and line."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.documents import Document, DocumentError, Problem, read_yaml
from rvsg.core.errors import FileError
from rvsg.core.records import Pose
from rvsg.robots.robot import Robot
from rvsg.world.areas import unknown_areas
from rvsg.world.grid import Grid, GridSpec
from rvsg.world.passages import free_widths_m, length_m, line_of, narrow_passages, nearest_area, passing_m
from rvsg.world.routes import Trial, clearance_m, fitted, robot_stands, time_limit_s
from rvsg.world.space import Space, frame_of, human_space, main_floor, outermost, robot_space, world_map
from rvsg.world.world import Area, Route, World
from rvsg.world.world_folder import places_in, read_world, route_names, routes_in, told_apart, world_folder

FARTHEST_M = 10.0
"""A pose is not moved farther than this."""
TRIED = 60
"""The nearest waypoints that are tried as the new place of a pose."""
SPARE = 1.5
"""A time limit is this many times what the robot needs alone."""
STEP_S = 5.0
"""Time limits are multiples of this."""


@dataclass(frozen=True, kw_only=True)
class Fix:
    """What would mend a finding: in words, and as a change that `edit_world` makes."""

    label: str
    change: Mapping[str, Any]


def rename_area(name: str, wanted: str, taken: Collection[str]) -> Fix:
    """Return the fix that gives an area another name, numbered where that is taken."""
    known = {each.strip().casefold() for each in taken if each != name}
    free = [wanted, *(f"{wanted} {k}" for k in range(2, len(known) + 3))]
    new = next(each for each in free if each.casefold() not in known)
    return Fix(label=f'Rename it to "{new}"', change=_area(name, name=new))


def remove_area(name: str) -> Fix:
    """Return the fix that removes an area."""
    return Fix(label=f'Remove "{name}"', change={"what": "remove area", "name": name})


def renew_waypoints(name: str) -> Fix:
    """Return the fix that derives the waypoints of an area from the grid again."""
    return Fix(label="Find its waypoints again", change={"what": "renew waypoints", "name": name})


def cut_area(name: str, shape: Any, within: Any) -> Fix | None:
    """Return the fix that cuts an area at the edge of the map; None where that leaves several parts."""
    left = shape.intersection(within)
    if left.geom_type != "Polygon" or left.is_empty:
        return None
    outline = [[round(x, 2), round(y, 2)] for x, y in left.exterior.coords[:-1]]
    return Fix(label="Cut it at the edge of the map", change=_area(name, outline=outline))


def move_pose(
    route: str, key: Sequence[str | int], pose: Pose, grid: Grid, stands: Callable[[Pose], bool]
) -> Fix | None:
    """Return the fix that moves a pose of a route to the nearest waypoint on which the robot stands as it is turned.

    Args:
        key: what of the route it is: ("start",), ("goal",) or ("through", number).
    """
    near = sorted(grid.waypoints, key=lambda w: math.dist((w.x, w.y), (pose.x, pose.y)))
    for waypoint in [w for w in near if w.robot][:TRIED]:
        if math.dist((waypoint.x, waypoint.y), (pose.x, pose.y)) > FARTHEST_M:
            return None
        if stands(Pose(x=waypoint.x, y=waypoint.y, yaw=pose.yaw)):
            return _pose(f"Move it to {waypoint.name}", route, key, [waypoint.x, waypoint.y, pose.yaw])
    return None


def in_radians(route: str, key: Sequence[str | int], pose: Pose) -> Fix:
    """Return the fix that reads the yaw of a pose as degrees."""
    yaw = round(math.radians(pose.yaw), 4)
    return _pose(f"Write {yaw:g} radians", route, key, [pose.x, pose.y, yaw])


def allow_time(route: str, *, length_m: float = 0.0, needed_s: float = 0.0) -> Fix:
    """Return the fix that sets the time limit of a route for its length and what the robot needs alone."""
    limit = max(time_limit_s(length_m), math.ceil(SPARE * needed_s / STEP_S) * STEP_S)
    change = {"what": "change route", "name": route, "values": {"time_limit_s": limit}}
    return Fix(label=f"Set the time limit to {limit:g} s", change=change)


def rename_in_activity(activities: Sequence[str], index: int, wrong: str, right: str) -> Fix:
    """Return the fix that corrects the name of an area in an activity."""
    values = list(activities)
    values[index] = values[index].replace(wrong, right)
    return Fix(label=f'Write "{right}"', change={"what": "set activities", "values": values})


def _area(area: str, **values: Any) -> dict[str, Any]:
    return {"what": "change area", "name": area, "values": values}


def _pose(label: str, route: str, key: Sequence[str | int], pose: list[float]) -> Fix:
    values = {"through": {"index": key[1], "pose": pose}} if key[0] == "through" else {str(key[0]): pose}
    return Fix(label=label, change={"what": "change route", "name": route, "values": values})


@dataclass(frozen=True, kw_only=True)
class Remark:
    """A finding: `serious` ones stop a campaign or make its results wrong, the others are suspicious."""

    problem: Problem
    serious: bool
    key: tuple[str | int, ...] = ()
    """What of the file it is about, e.g. ("routes", 0, "goal")."""
    fix: Fix | None = None
    """What would mend it; None where only a person can tell."""

    @property
    def code(self) -> str:
        """What is wrong, as a stable word such as `pose-outside`."""
        return self.problem.code

    def __str__(self) -> str:
        return f"{'error' if self.serious else 'warning'}: {self.problem}"


class Subject:
    """A world that could be read, with its documents and spaces, and the remarks on it so far."""

    def __init__(self, folder: Path, world: World, trial: Trial | None, robot: Robot | None) -> None:
        from shapely import Polygon

        self.world = world
        self.trial = trial
        self.driver = robot
        self.head = read_yaml(folder / "world.yaml")
        self.labels = read_yaml(folder / str(self.head.value.get("labels", "labels.yaml")))
        self.routes = read_yaml(folder / str(self.head.value.get("routes", "routes.yaml")))
        self.spec = world.grid_spec or GridSpec()
        self.human = human_space(world)
        self.robot = robot_space(world)
        self.shapes = {area.name: Polygon(area.outline) for area in world.areas}
        self.remarks: list[Remark] = []

    def say(
        self, document: Document, code: str, message: str, *key: str | int, serious: bool = False,
        fix: Fix | None = None,
    ) -> None:  # fmt: skip
        """Add a remark on the part of a document that the keys lead to."""
        problem = document.problem(message, *key, code=code)
        self.remarks.append(Remark(problem=problem, serious=serious, key=key, fix=fix))


def listed_names(names: Sequence[str]) -> str:
    """Return the first names of a list, and how many more there are."""
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")


FAR_M = 3.0


def check_areas(s: Subject, parts: list[set[str]]) -> None:
    """Judge the labelled areas: their names, outlines and waypoints."""
    from shapely import Polygon

    if not s.world.areas:
        s.say(s.labels, "areas-none", "there are no labelled areas: tasks can only name waypoints", "areas")
    corners = frame_of(world_map(s.world)).corners
    inside_map = Polygon(corners)
    main = parts[0] if parts else set()
    seen: dict[str, str] = {}
    names = [area.name for area in s.world.areas]
    for index, area in enumerate(s.world.areas):
        shape = s.shapes[area.name]
        key = ("areas", index)
        alike = seen.setdefault(area.name.strip().casefold(), area.name)
        if alike != area.name:
            other = rename_area(area.name, area.name.strip(), names)
            message = f'"{area.name}" is easily taken for "{alike}"; give it another name'
            s.say(s.labels, "area-alike", message, *key, fix=other)
        if area.name != area.name.strip():
            other = rename_area(area.name, area.name.strip(), names)
            s.say(s.labels, "area-spaces", f'the name "{area.name}" begins or ends with a space', *key, fix=other)
        if area.name.strip() in s.world.grid.by_name:
            other = rename_area(area.name, f"{area.kind} {area.name.strip()}", names)
            message = f'"{area.name}" is also the name of a waypoint; give it another name'
            s.say(s.labels, "area-waypoint-name", message, *key, fix=other)
        outside = 1.0 - float(shape.intersection(inside_map).area) / float(shape.area)
        if outside > 0.999:
            x0, y0, x1, y1 = inside_map.bounds
            message = f'"{area.name}" lies outside the map, which spans x {x0:g} to {x1:g} and y {y0:g} to {y1:g}'
            s.say(s.labels, "area-outside", message, *key, serious=True, fix=remove_area(area.name))
            continue
        if outside > 0.05:
            fix = cut_area(area.name, shape, inside_map)
            s.say(
                s.labels, "area-partly-outside", f'{outside:.0%} of "{area.name}" lies outside the map', *key, fix=fix
            )
        _check_area_waypoints(s, index, area, main)
    for a, b in combinations(s.world.areas, 2):
        first, second = s.shapes[a.name], s.shapes[b.name]
        shared = float(first.intersection(second).area) / min(float(first.area), float(second.area))
        if shared > 0.9 and a.kind == b.kind:
            index = s.world.areas.index(b)
            message = f'"{b.name}" and "{a.name}" cover the same place'
            s.say(s.labels, "area-twice", message, "areas", index, fix=remove_area(b.name))


def _check_area_waypoints(s: Subject, index: int, area: Area, main: set[str]) -> None:
    from shapely import Point

    if not area.waypoints:
        message = (
            f'no waypoint reaches "{area.name}": none lies within {FAR_M:g} m of it. Move it, choose a finer grid, '
            "or name its waypoints"
        )
        s.say(s.labels, "area-no-waypoint", message, "areas", index, serious=True)
        return
    shape = s.shapes[area.name]
    away = {n: float(shape.distance(Point(*s.world.grid.position(n)))) for n in area.waypoints}
    far = [name for name, distance in away.items() if distance > FAR_M]
    if far:
        message = f'{listed_names(far)} of "{area.name}" lie{"s" * (len(far) == 1)} more than {FAR_M:g} m away from it'
        s.say(s.labels, "area-far-waypoints", message, "areas", index, "waypoints", fix=renew_waypoints(area.name))
    if main and not main & set(area.waypoints):
        message = f'"{area.name}" lies in a part of the map that people cannot walk to from the rest'
        s.say(s.labels, "area-isolated", message, "areas", index, serious=True)


def check_activities(s: Subject) -> None:
    """Judge the activities: the areas they name."""
    if not s.world.activities:
        s.say(
            s.head,
            "activities-none",
            "no activities are given (who does what between which areas): generators will guess",
        )
    known = [area.name.strip() for area in s.world.areas]
    for index, activity in enumerate(s.world.activities):
        for name in unknown_areas(activity, known):
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
            asked = f'; did you mean "{near[0]}"?' if near else ""
            message = f'the activity "{activity}" names "{name}", which is no labelled area{asked}'
            fix = rename_in_activity(s.world.activities, index, name, near[0]) if near else None
            s.say(s.head, "activity-unknown-area", message, "activities", index, fix=fix)


AISLE_WIDEST_M = 3.0
AISLE_LENGTH_M = 1.5
AISLE_SAMPLES = 9  # points at which an aisle's width is measured
PART_M2 = 2.0
MANY_WAYPOINTS = 1000
MOST_OF_A_KIND = 12


def walk_hops(s: Subject, trial: Trial) -> None:
    """Walk every hop, and say on which a person does not arrive in time."""
    hops = s.world.grid.hops
    blocked = trial.not_walked(s.world, [*hops, *((b, a) for a, b in hops)])
    pairs = sorted({(min(hop), max(hop)) for hop in blocked})
    if pairs:
        listed = ", ".join(f"{a} to {b}" for a, b in pairs[:MOST_OF_A_KIND])
        more = f" and {len(pairs) - MOST_OF_A_KIND} more" if len(pairs) > MOST_OF_A_KIND else ""
        message = (
            f"a person who walks alone does not get from {listed}{more} in time, although the line between the "
            "waypoints is free. A larger human_clearance_m leaves such a hop out"
        )
        s.say(s.head, "grid-hop-blocked", message, "grid")


def reachable_parts(s: Subject) -> list[set[str]]:
    """Return the waypoints in groups between which people can walk, the largest first."""
    neighbours = s.world.grid.neighbours
    left = set(neighbours)
    parts = []
    for name in neighbours:
        if name not in left:
            continue
        part, stack = {name}, [name]
        while stack:
            for other in neighbours[stack.pop()]:
                if other not in part:
                    part.add(other)
                    stack.append(other)
        left -= part
        parts.append(part)
    return sorted(parts, key=lambda part: (-len(part), min(part)))


def check_parts(s: Subject, parts: list[set[str]]) -> None:
    """Say which waypoints cannot be walked to from the others."""
    for part in parts[1 : 1 + MOST_OF_A_KIND]:
        message = (
            f"waypoint{'s' * (len(part) > 1)} {listed_names(sorted(part))} cannot be walked to from the other "
            f"{len(parts[0])}: an isolated part of the map, or the grid is too coarse for the way there"
        )
        s.say(s.head, "grid-isolated", message, "grid")
    if len(parts) > 1 + MOST_OF_A_KIND:
        s.say(
            s.head, "grid-isolated", f"and {len(parts) - 1 - MOST_OF_A_KIND} more isolated groups of waypoints", "grid"
        )


def check_isolated_floor(s: Subject) -> None:
    """Floor that nobody can walk to from the main part."""
    parts = s.human.parts(min(s.spec.human_clearance_m, s.spec.hop_radius_m))
    sizes = np.bincount(parts.ravel()) * s.human.frame.resolution**2
    for number in [n for n in range(2, len(sizes)) if sizes[n] >= PART_M2][:MOST_OF_A_KIND]:
        rows, columns = np.nonzero(parts == number)
        middle = len(rows) // 2
        x, y = s.human.frame.to_metres(np.array([columns[middle] + 0.5, rows[middle] + 0.5]))
        message = (
            f"{sizes[number]:.0f} m² of floor about ({x:.1f}, {y:.1f}) are cut off from the rest: people cannot "
            "walk there" + (", and it holds no waypoint" if not s.spec.isolated_parts else "")
        )
        s.say(s.head, "floor-isolated", message, "map")


def check_aisles(s: Subject) -> None:
    """Say which aisles and which open floor the grid misses."""
    from shapely import Point

    named = list(_narrow_aisles(s))
    for first, second, width in named:
        message = (
            f"no waypoint lies in the aisle between {first} and {second} ({width:.1f} m wide): the grid is too "
            f"coarse for it. A spacing of {max(0.3, math.floor(width * 5) / 10):g} m, another origin, or rows and "
            "columns of your own would reach it"
        )
        s.say(s.head, "aisle-missed", message, "grid")
    covered = [_strip(s, first, second) for first, second, _ in named]
    for x, y, size in _unreached_floor(s):
        if any(strip.distance(Point(x, y)) < 0.5 for strip in covered):
            continue
        area, away = nearest_area(s.world.areas, x, y)
        near = f" near {area.name}" if area is not None and away < 5.0 else ""
        message = f"{size:.0f} m² of open floor about ({x:.1f}, {y:.1f}){near} hold no waypoint"
        s.say(s.head, "floor-missed", message, "grid")


def _strip(s: Subject, first: str, second: str) -> Any:
    """Return the floor between two areas."""
    both = s.shapes[first].union(s.shapes[second])
    return both.convex_hull.difference(both)


def _narrow_aisles(s: Subject) -> Iterator[tuple[str, str, float]]:
    from shapely import contains_xy, points

    things = [a.name for a in s.world.areas if not _is_floor(s, a)]
    valid = np.array([[w.x, w.y] for w in s.world.grid.waypoints if w.human]).reshape(-1, 2)
    for first, second in combinations(things, 2):
        a, b = s.shapes[first], s.shapes[second]
        width = float(a.distance(b))
        if not 2 * s.spec.human_clearance_m <= width <= AISLE_WIDEST_M:
            continue
        strip = _strip(s, first, second)
        length = float(strip.area) / width
        if length < AISLE_LENGTH_M or any(
            strip.intersection(s.shapes[other]).area > 0.1 * strip.area
            for other in things
            if other not in (first, second)
        ):
            continue
        x0, y0, x1, y1 = strip.bounds
        samples = np.stack(np.meshgrid(np.arange(x0, x1, 0.1), np.arange(y0, y1, 0.1)), -1).reshape(-1, 2)
        samples = samples[contains_xy(strip, samples[:, 0], samples[:, 1])]
        if len(samples) == 0 or (s.human.clearances(samples) > 0).mean() < 0.7:
            continue
        width = _free_width_m(s, samples)
        if not 2 * s.spec.human_clearance_m <= width <= AISLE_WIDEST_M:
            continue
        if not len(valid) or not (strip.buffer(0.05).contains(points(valid))).any():
            yield first, second, width


def _free_width_m(s: Subject, samples: NDArray[np.float64]) -> float:
    """Return the width from wall to wall of an aisle given by points in it (N, 2); labels may end before walls."""
    clear = s.human.clearances(samples)
    middle = samples[clear >= np.quantile(clear, 0.8)]
    chosen = middle[:: max(1, len(middle) // AISLE_SAMPLES)]
    return float(np.median(free_widths_m(s.world, chosen)))


def _is_floor(s: Subject, area: Area) -> bool:
    from rvsg.world.lattice import open_share

    return open_share(area.outline, s.human) > 0.5


def _unreached_floor(s: Subject) -> list[tuple[float, float, float]]:
    """Middle (x, y) and size in m² of open floor farther from every waypoint than the grid is wide."""
    from scipy.ndimage import binary_opening, label

    space = _coarser(s.human)
    walkable = main_floor(space, s.spec.human_clearance_m)
    away = _distance_to_waypoints(s, space)
    missed = walkable & (away > 1.2 * max(s.world.grid.spacing_m, 0.5))
    missed = binary_opening(missed, np.ones((3, 3)))
    parts, count = label(missed)
    found = []
    for number in range(1, count + 1):
        rows, columns = np.nonzero(parts == number)
        size = len(rows) * space.frame.resolution**2
        if size >= PART_M2:
            middle = len(rows) // 2
            x, y = space.frame.to_metres(np.array([columns[middle] + 0.5, rows[middle] + 0.5]))
            found.append((float(x), float(y), size))
    return sorted(found, key=lambda part: -part[2])[:MOST_OF_A_KIND]


def _distance_to_waypoints(s: Subject, space: Space) -> NDArray[np.float64]:
    from scipy.ndimage import distance_transform_edt

    rows, columns = space.frame.shape
    none = np.ones((rows, columns), np.bool_)
    points = np.array([[w.x, w.y] for w in s.world.grid.waypoints if w.human])
    at = np.floor(space.frame.to_cells(points)).astype(int)
    none[np.clip(at[:, 1], 0, rows - 1), np.clip(at[:, 0], 0, columns - 1)] = False
    return np.asarray(distance_transform_edt(none)) * space.frame.resolution


def check_unknown(s: Subject) -> None:
    """Say so if much of the map around the floor is unknown."""
    cells = world_map(s.world).cells
    free = outermost(cells == 0)
    (left, low), (right, high) = free.min(axis=0), free.max(axis=0) + 1
    within = cells[low:high, left:right]
    unknown = float((within == 255).mean())
    if unknown > 0.3:
        message = (
            f"{unknown:.0%} of the map around the free space is unknown; unknown space counts as closed for people "
            "and robot"
        )
        s.say(s.head, "map-unknown", message, "map")


def check_size(s: Subject) -> None:
    """Say so if there are more waypoints than a picture shows."""
    count = len(s.world.grid.valid)
    if count > MANY_WAYPOINTS:
        message = f"the grid has {count} valid waypoints; a VLM reads a picture of some hundred. Use a coarser one"
        s.say(s.head, "grid-large", message, "grid")


def _coarser(space: Space) -> Space:
    """Return the space in cells of at least 0.1 m and at most a million of them, each as clear as its clearest cell."""
    from rvsg.world.space import Frame

    rows, columns = space.field.shape
    step = max(1, round(0.1 / space.frame.resolution), math.ceil(math.sqrt(rows * columns / 1e6)))
    high, wide = rows // step, columns // step
    if step == 1 or not (high and wide):
        return space
    field = space.field[: high * step, : wide * step].reshape(high, step, wide, step).max(axis=(1, 3))
    return Space(Frame(space.frame.origin, space.frame.resolution * step, (high, wide)), field)


FASTEST_M_S = 1.5  # a way that asks for more within its time limit cannot be meant
TIGHT = 0.6  # with less than this share of the clearance the robot surely touches


def check_routes(s: Subject) -> None:
    """Judge the routes as they are written: poses, ways and time limits."""
    from scipy.ndimage import label

    if not routes_in(s.routes):
        message = "there are no routes: write one before you run a campaign"
        s.say(s.routes, "routes-none", message, "routes", serious=True)
        return
    radius = s.spec.robot_clearance_m if s.driver is None else clearance_m(s.driver)
    parts, _ = label((s.robot.field >= radius) & (s.robot.field > 0))
    sound = {route.name: route for route in s.world.routes}
    for index, name in enumerate(told_apart(s.routes, "routes", route_names(s.routes))):
        route = sound.get(name)
        if route is None:  # its mistakes are reported already; check its poses, too
            for place_key, place in places_in(routes_in(s.routes)[index]):
                if isinstance(place, Pose):
                    _check_pose(s, name, str(place_key[0]), place, ("routes", index, *place_key), radius, parts)
            continue
        before = len(s.remarks)
        route = _fitted(s, index, route)
        stops = [("start", route.start), *(("through", p) for p in route.through), ("goal", route.goal)]
        counts: dict[str, int] = {}
        places = []
        for what, pose in stops:
            key: tuple[str | int, ...] = ("routes", index, what)
            if what == "through":
                key = (*key, counts.get(what, 0))
            counts[what] = counts.get(what, 0) + 1
            places.append(_check_pose(s, route.name, what, pose, key, radius, parts))
        serious = any(remark.serious for remark in s.remarks[before:])
        if not serious and (0 in places or len(set(places)) > 1):
            message = (
                f"the robot cannot drive {route.name}: on its map no way {2 * radius:g} m wide leads from the "
                "start to the goal"
            )
            s.say(s.routes, "route-no-way", message, "routes", index, serious=True)
        _check_time(s, index, route)
        _check_passing(s, index, route)


def _fitted(s: Subject, index: int, route: Route) -> Route:
    """Return the route as the robot drives it, and report what has to be fitted."""
    if s.driver is None:
        return route
    fit = fitted(route, s.driver, s.world)
    for note in fit.notes:
        s.say(s.routes, "route-fitted", note, "routes", index)
    return fit.route


def _check_pose(
    s: Subject, route: str, what: str, pose: Pose, key: Sequence[str | int], radius: float, parts: Any
) -> int:
    """Judge one pose; the number of the part of the robot's floor it lies on, 0 for none."""
    at = f"the {'pose to pass' if what == 'through' else what} of {route} ({pose.x:g}, {pose.y:g})"
    clear = s.robot.clearance(pose.x, pose.y)
    if abs(pose.yaw) > 2 * math.pi:
        message = f"{at}: a yaw of {pose.yaw:g} radians is more than a turn; if degrees are meant, write "
        turned = in_radians(route, key[2:], pose)
        s.say(s.routes, "pose-degrees", f"{message}{math.radians(pose.yaw):.4f}", *key, fix=turned)
    column, row = (math.floor(v) for v in s.robot.frame.to_cells(np.array([pose.x, pose.y])))
    rows, columns = parts.shape
    if not (0 <= row < rows and 0 <= column < columns):
        s.say(
            s.routes, "pose-outside", f"{at} lies outside the map", *key, serious=True, fix=_moved(s, route, pose, key)
        )
    elif clear == 0.0:
        message, fix = f"{at} lies in an obstacle or in unknown space", _moved(s, route, pose, key)
        s.say(s.routes, "pose-in-obstacle", message, *key, serious=True, fix=fix)
    elif clear < radius:
        message = f"{at} is only {clear:.2f} m clear of obstacles; the robot needs {radius:g} m"
        fix = _moved(s, route, pose, key)
        s.say(s.routes, "pose-tight", message, *key, serious=clear < TIGHT * radius, fix=fix)
        reach = math.ceil(radius / s.robot.frame.resolution)
        near = parts[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
        return int(near.max(initial=0))
    else:
        if not robot_stands(s.robot, pose, s.driver):
            message = f"{at}: turned as it is there (yaw {pose.yaw:g}), the robot touches an obstacle"
            s.say(s.routes, "pose-touches", message, *key, serious=what == "start", fix=_moved(s, route, pose, key))
        return int(parts[row, column])
    return 0


def _moved(s: Subject, route: str, pose: Pose, key: Sequence[str | int]) -> Fix | None:
    """Return the fix that moves a pose to where the robot stands."""
    radius = s.spec.robot_clearance_m if s.driver is None else clearance_m(s.driver)

    def stands(there: Pose) -> bool:
        clear = s.robot.clearance(there.x, there.y) >= radius
        return clear and robot_stands(s.robot, there, s.driver)

    return move_pose(route, key[2:], pose, s.world.grid, stands)


def _check_time(s: Subject, index: int, route: Route) -> None:
    length = length_m(line_of(s.world, route))
    if length / route.time_limit_s > FASTEST_M_S:
        message = (
            f"{route.name} is about {length:.0f} m long; its time limit of {route.time_limit_s:g} s asks for "
            f"{length / route.time_limit_s:.1f} m/s on average"
        )
        fix = allow_time(route.name, length_m=length)
        s.say(s.routes, "route-hurried", message, "routes", index, "time_limit_s", fix=fix)
    if math.dist((route.start.x, route.start.y), (route.goal.x, route.goal.y)) < 0.5 and not route.through:
        s.say(s.routes, "route-goes-nowhere", f"{route.name} ends where it starts", "routes", index, "goal")


def _check_passing(s: Subject, index: int, route: Route) -> None:
    """Say where on a route the chosen robot and a person cannot pass each other; only the narrowest place."""
    if s.driver is None:
        return
    for place in narrow_passages(s.world, line_of(s.world, route), robot=s.driver, most=1):
        message = (
            f"on {route.name}, {s.driver.name} and a person cannot pass each other at ({place.x:.1f}, {place.y:.1f}), "
            f"near {place.waypoint}: the way is {place.width_m:.2f} m wide, they need {passing_m(s.driver):.2f} m. "
            "One of them has to wait"
        )
        s.say(s.routes, "route-no-passing", message, "routes", index)


def drive_routes(s: Subject, trial: Trial) -> None:
    """Drive every route that looks sound, and say where the robot does not arrive in time or touches something."""
    names = told_apart(s.routes, "routes", route_names(s.routes))
    for route in s.world.routes:
        key = ("routes", names.index(route.name))
        if any(remark.serious and remark.key[:2] == key for remark in s.remarks):
            continue
        if s.driver is not None:
            route = fitted(route, s.driver, s.world).route
        drive = trial.drive(s.world, route)
        at = f"({drive.x:.1f}, {drive.y:.1f}), near {s.world.grid.nearest(drive.x, drive.y)}"
        if not drive.arrived:
            message = (
                f"the robot alone does not arrive on {route.name}: {drive.outcome}, after {drive.time_s:.0f} s at "
                f"{at}. {_turns(s)}Move the poses, or choose another route"
            )
            s.say(s.routes, "route-not-driven", message, *key, serious=True)
        elif drive.time_s > route.time_limit_s:
            message = (
                f"the robot alone takes {drive.time_s:.0f} s for {route.name}, longer than its time limit of "
                f"{route.time_limit_s:g} s: every run would end without arriving"
            )
            fix = allow_time(route.name, needed_s=drive.time_s)
            s.say(s.routes, "route-late", message, *key, "time_limit_s", serious=True, fix=fix)
        if drive.touched_s:
            times = ", ".join(f"{time:.1f} s" for time in drive.touched_s[:3])
            s.say(s.routes, "route-touches", f"the robot alone touches an obstacle on {route.name} (at {times})", *key)


def _turns(s: Subject) -> str:
    """Say what of the robot's steering a route must allow for; nothing of a robot that turns on the spot."""
    if s.driver is None or math.isinf(s.driver.drive.max_curvature):
        return ""
    return (
        f"{s.driver.name} turns in circles of at least {1.0 / s.driver.drive.max_curvature:.1f} m radius, "
        "which its global planner does not allow for: a way with tighter turns does not fit it. "
    )


def check_world(folder: str | Path, *, trial: Trial | None = None, robot: Robot | None = None) -> tuple[Remark, ...]:
    """Return all findings on a world folder: unreadable files first, then whatever can be judged of the rest.

    With a trial, every route is also driven and every hop walked in a simulator. With a robot the routes are checked as
    they are fitted to it.
    """
    folder = world_folder(folder)
    problems: list[Problem] = []
    try:
        world = read_world(folder, problems)
    except DocumentError as error:
        return tuple(Remark(problem=p, serious=True) for p in (*error.problems, *problems))
    except FileError as error:
        return (Remark(problem=Problem.of(error), serious=True),)
    found = [Remark(problem=p, serious=True) for p in problems]
    return (*found, *_judged(Subject(folder, world, trial, robot)))


def _judged(s: Subject) -> list[Remark]:
    parts = reachable_parts(s)
    check_areas(s, parts)
    check_routes(s)
    check_parts(s, parts)
    check_isolated_floor(s)
    check_aisles(s)
    check_unknown(s)
    check_size(s)
    check_activities(s)
    if s.trial is not None:
        drive_routes(s, s.trial)
        walk_hops(s, s.trial)
    return s.remarks
