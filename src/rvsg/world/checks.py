"""Checks of a world folder: all errors and warnings at once, each with its file and line."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
from rvsg.world.grid import GridSpec
from rvsg.world.lattice import open_share
from rvsg.world.passages import free_widths_m, length_m, line_of, narrow_passages, nearest_area, passing_m
from rvsg.world.rooms import areas_of_rooms
from rvsg.world.routes import Trial, clearance_m, fitted, robot_stands, time_limit_s
from rvsg.world.space import Frame, Space, coarser, frame_of, human_space, main_floor, outermost, robot_space, world_map
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


def _fix(label: str, what: str, name: str, /, **values: Any) -> Fix:
    return Fix(label=label, change={"what": what, "name": name} | ({"values": values} if values else {}))


def _pose_fix(label: str, route: str, key: Sequence[str | int], pose: list[float]) -> Fix:
    """Return the fix that changes a pose of a route: ("start",), ("goal",) or ("through", number)."""
    values = {"through": {"index": key[1], "pose": pose}} if key[0] == "through" else {str(key[0]): pose}
    return _fix(label, "change route", route, **values)


def _time_fix(route: str, limit_s: float) -> Fix:
    return _fix(f"Set the time limit to {limit_s:g} s", "change route", route, time_limit_s=limit_s)


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
        return f"{'error' if self.serious else 'warning'} [{self.code}]: {self.problem}"


class Subject:
    """A world that could be read, with its documents and spaces, and the remarks on it so far."""

    def __init__(self, folder: Path, world: World, trial: Trial | None, robot: Robot | None) -> None:
        from shapely import Polygon

        self.world, self.trial, self.driver = world, trial, robot
        self.head = read_yaml(folder / "world.yaml")
        self.labels = read_yaml(folder / str(self.head.value.get("labels", "labels.yaml")))
        self.routes = read_yaml(folder / str(self.head.value.get("routes", "routes.yaml")))
        self.spec = world.grid_spec or GridSpec()
        self.human, self.robot = human_space(world), robot_space(world)
        self.radius = self.spec.robot_clearance_m if robot is None else clearance_m(robot)
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
BARE = 0.05
"""A room is unlabelled where no area covers a larger share of it, or lies in it by more than half."""
FORBIDDING = ("keepout", "nogo", "forbidden", "restricted", "prohibited")


def check_areas(s: Subject) -> None:
    """Judge the labelled areas: their names, outlines and waypoints."""
    from shapely import Polygon

    if not s.world.areas:
        s.say(s.labels, "areas-none", "there are no labelled areas: tasks can only name waypoints", "areas")
    inside_map = Polygon(frame_of(world_map(s.world)).corners)
    x0, y0, x1, y1 = inside_map.bounds
    seen: dict[str, str] = {}
    for index, area in enumerate(s.world.areas):
        name, shape, key = area.name, s.shapes[area.name], ("areas", index)
        alike = seen.setdefault(name.strip().casefold(), name)
        if alike != name:
            message = f'"{name}" is easily taken for "{alike}"; give it another name'
            s.say(s.labels, "area-alike", message, *key, fix=_renaming(s, name, name.strip()))
        if re.sub(r"[^a-z]", "", area.kind.casefold()) in FORBIDDING:
            message = f'the kind "{area.kind}" of "{name}" keeps nobody out; a kind only says what people see there. '
            message += "A robot keeps out by a keepout filter of its Nav2 file, people by a solid object"
            s.say(s.labels, "area-keepout", message, *key)
        if name != name.strip():
            message = f'the name "{name}" begins or ends with a space'
            s.say(s.labels, "area-spaces", message, *key, fix=_renaming(s, name, name.strip()))
        if name.strip() in s.world.grid.by_name:
            message = f'"{name}" is also the name of a waypoint; give it another name'
            fix = _renaming(s, name, f"{area.kind} {name.strip()}")
            s.say(s.labels, "area-waypoint-name", message, *key, fix=fix)
        left = shape.intersection(inside_map)
        outside = 1.0 - float(left.area) / float(shape.area)
        if outside > 0.999:
            message = f'"{name}" lies outside the map, which spans x {x0:g} to {x1:g} and y {y0:g} to {y1:g}'
            fix = _fix(f'Remove "{name}"', "remove area", name)
            s.say(s.labels, "area-outside", message, *key, serious=True, fix=fix)
            continue
        if outside > 0.05:
            whole = left.geom_type == "Polygon"  # cut into several parts it is no area
            outline = [[round(x, 2), round(y, 2)] for x, y in left.exterior.coords[:-1]] if whole else None
            cut = _fix("Cut it at the edge of the map", "change area", name, outline=outline) if outline else None
            s.say(s.labels, "area-partly-outside", f'{outside:.0%} of "{name}" lies outside the map', *key, fix=cut)
        _check_area_waypoints(s, index, area)
    for a, b in combinations(s.world.areas, 2):
        first, second = s.shapes[a.name], s.shapes[b.name]
        shared = float(first.intersection(second).area) / min(float(first.area), float(second.area))
        if shared > 0.9 and a.kind == b.kind:
            message = f'"{b.name}" and "{a.name}" cover the same place'
            fix = _fix(f'Remove "{b.name}"', "remove area", b.name)
            s.say(s.labels, "area-twice", message, "areas", s.world.areas.index(b), fix=fix)
    for room in areas_of_rooms(s.human, main_floor(s.human)) if s.world.areas else ():
        shape = Polygon(room.outline)
        if room.kind != "corridor" and all(
            shape.intersection(other).area < min(BARE * shape.area, other.area / 2) for other in s.shapes.values()
        ):
            at = shape.representative_point()
            message = f"the {room.kind} of {shape.area:.0f} m2 at ({at.x:.1f}, {at.y:.1f}) holds no labelled area"
            s.say(s.labels, "room-unlabelled", message, "areas")


def _renaming(s: Subject, name: str, wanted: str) -> Fix:
    """Return the fix that gives an area another name, numbered where that is taken."""
    taken = {area.name.strip().casefold() for area in s.world.areas if area.name != name}
    free = [wanted, *(f"{wanted} {k}" for k in range(2, len(taken) + 3))]
    new = next(candidate for candidate in free if candidate.casefold() not in taken)
    return _fix(f'Rename it to "{new}"', "change area", name, name=new)


def _check_area_waypoints(s: Subject, index: int, area: Area) -> None:
    from shapely import Point

    if not area.waypoints:
        message = (
            f'no waypoint reaches "{area.name}": none lies within {FAR_M:g} m of it. Move it, choose a finer grid, '
            "or name its waypoints"
        )
        s.say(s.labels, "area-no-waypoint", message, "areas", index, serious=True)
        return
    shape = s.shapes[area.name]
    far = [name for name in area.waypoints if shape.distance(Point(*s.world.grid.position(name))) > FAR_M]
    if far:
        message = f'{listed_names(far)} of "{area.name}" lie{"s" * (len(far) == 1)} more than {FAR_M:g} m away from it'
        fix = _fix("Find its waypoints again", "renew waypoints", area.name)
        s.say(s.labels, "area-far-waypoints", message, "areas", index, "waypoints", fix=fix)
    if s.world.grid.parts and not s.world.grid.parts[0] & set(area.waypoints):
        message = f'"{area.name}" lies in a part of the map that people cannot walk to from the rest'
        s.say(s.labels, "area-isolated", message, "areas", index, serious=True)


def check_activities(s: Subject) -> None:
    """Judge the activities: the areas they name."""
    activities = s.world.activities
    if not activities:
        message = "no activities are given (who does what between which areas): generators will guess"
        s.say(s.head, "activities-none", message)
    names = [area.name.strip() for area in s.world.areas]
    for index, activity in enumerate(activities):
        for name in unknown_areas(activity, names):
            near = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
            asked = f'; did you mean "{near[0]}"?' if near else ""
            message = f'the activity "{activity}" names "{name}", which is no labelled area{asked}'
            fix = None
            if near:
                values = [*activities[:index], activity.replace(name, near[0]), *activities[index + 1 :]]
                fix = Fix(label=f'Write "{near[0]}"', change={"what": "set activities", "values": values})
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


def check_parts(s: Subject) -> None:
    """Say which waypoints cannot be walked to from the others."""
    parts = s.world.grid.parts
    for part in parts[1 : 1 + MOST_OF_A_KIND]:
        message = (
            f"waypoint{'s' * (len(part) > 1)} {listed_names(sorted(part))} cannot be walked to from the other "
            f"{len(parts[0])}: an isolated part of the map, or the grid is too coarse for the way there"
        )
        s.say(s.head, "grid-isolated", message, "grid")
    if len(parts) > 1 + MOST_OF_A_KIND:
        message = f"and {len(parts) - 1 - MOST_OF_A_KIND} more isolated groups of waypoints"
        s.say(s.head, "grid-isolated", message, "grid")


def check_isolated_floor(s: Subject) -> None:
    """Say which floor nobody can walk to from the main part."""
    parts = s.human.parts(min(s.spec.human_clearance_m, s.spec.hop_radius_m))
    for x, y, size in _places(parts, range(2, parts.max() + 1), s.human.frame)[:MOST_OF_A_KIND]:
        message = (
            f"{size:.0f} m² of floor about ({x:.1f}, {y:.1f}) are cut off from the rest: people cannot "
            "walk there" + (", and it holds no waypoint" if not s.spec.isolated_parts else "")
        )
        s.say(s.head, "floor-isolated", message, "map")


def _places(parts: NDArray[np.int32], numbers: Iterable[int], frame: Frame) -> list[tuple[float, float, float]]:
    """Return a point (x, y) on each part of the floor that is large enough, and its size in m²."""
    sizes = np.bincount(parts.ravel()) * frame.resolution**2
    places = []
    for number in numbers:
        if sizes[number] >= PART_M2:
            rows, columns = np.nonzero(parts == number)
            middle = len(rows) // 2
            x, y = frame.to_metres(np.array([columns[middle] + 0.5, rows[middle] + 0.5])).tolist()
            places.append((x, y, float(sizes[number])))
    return places


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

    things = [a.name for a in s.world.areas if open_share(a.outline, s.human) <= 0.5]
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
        # From wall to wall in the middle of the aisle: labels may end before walls
        clear = s.human.clearances(samples)
        middle = samples[clear >= np.quantile(clear, 0.8)]
        chosen = middle[:: max(1, len(middle) // AISLE_SAMPLES)]
        width = float(np.median(free_widths_m(s.world, chosen)))
        if not 2 * s.spec.human_clearance_m <= width <= AISLE_WIDEST_M:
            continue
        if not len(valid) or not (strip.buffer(0.05).contains(points(valid))).any():
            yield first, second, width


def _unreached_floor(s: Subject) -> list[tuple[float, float, float]]:
    """Middle (x, y) and size in m² of open floor farther from every waypoint than the grid is wide."""
    from scipy.ndimage import binary_opening, distance_transform_edt, label

    # Cells of at least 0.1 m and at most a million of them, each as clear as its clearest cell
    step = max(1, round(0.1 / s.human.frame.resolution), math.ceil(math.sqrt(s.human.field.size / 1e6)))
    field, frame = coarser(s.human.field, s.human.frame, step, np.max)
    none = np.ones(frame.shape, np.bool_)
    points = np.array([[w.x, w.y] for w in s.world.grid.waypoints if w.human])
    columns, rows = np.floor(frame.to_cells(points)).astype(int).clip(0, np.array(frame.shape)[::-1] - 1).T
    none[rows, columns] = False
    away = np.asarray(distance_transform_edt(none)) * frame.resolution
    walkable = main_floor(Space(frame, field), s.spec.human_clearance_m)
    missed = binary_opening(walkable & (away > 1.2 * max(s.world.grid.spacing_m, 0.5)), np.ones((3, 3)))
    parts, count = label(missed)
    return sorted(_places(parts, range(1, count + 1), frame), key=lambda part: -part[2])[:MOST_OF_A_KIND]


def check_extent(s: Subject) -> None:
    """Say so if much of the map around the floor is unknown, or there are more waypoints than a picture shows."""
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
    count = len(s.world.grid.valid)
    if count > MANY_WAYPOINTS:
        message = f"the grid has {count} valid waypoints; a VLM reads a picture of some hundred. Use a coarser one"
        s.say(s.head, "grid-large", message, "grid")


FASTEST_M_S = 1.5  # a way that asks for more within its time limit cannot be meant
TIGHT = 0.6  # with less than this share of the clearance the robot surely touches


def check_routes(s: Subject) -> None:
    """Judge the routes as they are written: poses, ways and time limits."""
    from scipy.ndimage import label

    if not routes_in(s.routes):
        message = "there are no routes: write one before you run a campaign"
        s.say(s.routes, "routes-none", message, "routes", serious=True)
        return
    parts, _ = label((s.robot.field >= s.radius) & (s.robot.field > 0))
    sound = {route.name: route for route in s.world.routes}
    for index, name in enumerate(told_apart(s.routes, "routes", route_names(s.routes))):
        key: tuple[str | int, ...] = ("routes", index)
        route = sound.get(name)
        if route is None:  # its mistakes are reported already; check its poses, too
            for place_key, place in places_in(routes_in(s.routes)[index]):
                if isinstance(place, Pose):
                    _check_pose(s, name, place, (*key, *place_key), parts)
            continue
        before = len(s.remarks)
        if s.driver is not None:
            route, notes = fitted(route, s.driver, s.world)
            for note in notes:
                s.say(s.routes, "route-fitted", note, *key)
        stops = [(("start",), route.start), *((("through", i), pose) for i, pose in enumerate(route.through))]
        places = {_check_pose(s, name, pose, (*key, *what), parts) for what, pose in (*stops, (("goal",), route.goal))}
        serious = any(remark.serious for remark in s.remarks[before:])
        if not serious and (0 in places or len(places) > 1):
            message = (
                f"the robot cannot drive {name}: on its map no way {2 * s.radius:g} m wide leads from the start to the "
                "goal"
            )
            s.say(s.routes, "route-no-way", message, *key, serious=True)
        _check_way(s, index, route)


def _check_pose(s: Subject, route: str, pose: Pose, key: tuple[str | int, ...], parts: Any) -> int:
    """Judge one pose; the number of the part of the robot's floor it lies on, 0 for none."""
    what, radius = key[2], s.radius
    at = f"the {'pose to pass' if what == 'through' else what} of {route} ({pose.x:g}, {pose.y:g})"
    clear = s.robot.clearance(pose.x, pose.y)
    if abs(pose.yaw) > 2 * math.pi:
        yaw = round(math.radians(pose.yaw), 4)
        message = f"{at}: a yaw of {pose.yaw:g} radians is more than a turn; if degrees are meant, write {yaw:.4f}"
        fix = _pose_fix(f"Write {yaw:g} radians", route, key[2:], [pose.x, pose.y, yaw])
        s.say(s.routes, "pose-degrees", message, *key, fix=fix)
    column, row = (math.floor(v) for v in s.robot.frame.to_cells(np.array([pose.x, pose.y])))
    rows, columns = parts.shape
    part = 0
    if not (0 <= row < rows and 0 <= column < columns):
        code, said, serious = "pose-outside", " lies outside the map", True
    elif clear == 0.0:
        code, said, serious = "pose-in-obstacle", " lies in an obstacle or in unknown space", True
    elif clear < radius:
        said = f" is only {clear:.2f} m clear of obstacles; the robot needs {radius:g} m"
        code, serious = "pose-tight", clear < TIGHT * radius
        reach = math.ceil(radius / s.robot.frame.resolution)
        near = parts[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
        part = int(near.max(initial=0))
    else:
        part = int(parts[row, column])
        if robot_stands(s.robot, pose, s.driver):
            return part
        said = f": turned as it is there (yaw {pose.yaw:g}), the robot touches an obstacle"
        code, serious = "pose-touches", what == "start"
    s.say(s.routes, code, at + said, *key, serious=serious, fix=_moved(s, route, pose, key[2:]))
    return part


def _moved(s: Subject, route: str, pose: Pose, key: Sequence[str | int]) -> Fix | None:
    """Return the fix that moves a pose to the nearest waypoint on which the robot stands as it is turned."""
    near = sorted(s.world.grid.waypoints, key=lambda w: math.dist((w.x, w.y), (pose.x, pose.y)))
    for waypoint in [w for w in near if w.robot][:TRIED]:
        there = Pose(x=waypoint.x, y=waypoint.y, yaw=pose.yaw)
        if math.dist((there.x, there.y), (pose.x, pose.y)) > FARTHEST_M:
            return None
        if s.robot.clearance(there.x, there.y) >= s.radius and robot_stands(s.robot, there, s.driver):
            return _pose_fix(f"Move it to {waypoint.name}", route, key, [there.x, there.y, pose.yaw])
    return None


def _check_way(s: Subject, index: int, route: Route) -> None:
    """Judge the length of a route, and where the chosen robot and a person cannot pass: only the narrowest place."""
    line = line_of(s.world, route)
    length = length_m(line)
    if length / route.time_limit_s > FASTEST_M_S:
        message = (
            f"{route.name} is about {length:.0f} m long; its time limit of {route.time_limit_s:g} s asks for "
            f"{length / route.time_limit_s:.1f} m/s on average"
        )
        fix = _time_fix(route.name, time_limit_s(length))
        s.say(s.routes, "route-hurried", message, "routes", index, "time_limit_s", fix=fix)
    if math.dist((route.start.x, route.start.y), (route.goal.x, route.goal.y)) < 0.5 and not route.through:
        s.say(s.routes, "route-goes-nowhere", f"{route.name} ends where it starts", "routes", index, "goal")
    if s.driver is None:
        return
    for place in narrow_passages(s.world, line, robot=s.driver, most=1):
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
        turns = "" if s.driver is None else s.driver.turning_note
        if s.driver is not None:
            route, _ = fitted(route, s.driver, s.world)
        drive = trial.drive(s.world, route)
        at = f"({drive.x:.1f}, {drive.y:.1f}), near {s.world.grid.nearest(drive.x, drive.y)}"
        if not drive.arrived:
            message = (
                f"the robot alone does not arrive on {route.name}: {drive.outcome}, after {drive.time_s:.0f} s at "
                f"{at}. {turns}Move the poses, or choose another route"
            )
            s.say(s.routes, "route-not-driven", message, *key, serious=True)
        elif drive.time_s > route.time_limit_s:
            message = (
                f"the robot alone takes {drive.time_s:.0f} s for {route.name}, longer than its time limit of "
                f"{route.time_limit_s:g} s: every run would end without arriving"
            )
            fix = _time_fix(route.name, max(time_limit_s(0.0), math.ceil(SPARE * drive.time_s / STEP_S) * STEP_S))
            s.say(s.routes, "route-late", message, *key, "time_limit_s", serious=True, fix=fix)
        if drive.touched_s:
            times = ", ".join(f"{time:.1f} s" for time in drive.touched_s[:3])
            s.say(s.routes, "route-touches", f"the robot alone touches an obstacle on {route.name} (at {times})", *key)


def check_world(folder: str | Path, *, trial: Trial | None = None, robot: Robot | None = None) -> tuple[Remark, ...]:
    """Return all findings on a world folder; with a trial every route is also driven and every hop walked.

    With a robot the routes are checked as they are fitted to it.
    """
    folder = world_folder(folder)
    problems: list[Problem] = []
    try:
        world = read_world(folder, problems)
    except DocumentError as error:
        return tuple(Remark(problem=p, serious=True) for p in (*error.problems, *problems))
    except FileError as error:
        return (Remark(problem=Problem.of(error), serious=True),)
    s = Subject(folder, world, trial, robot)
    for check in (check_areas, check_routes, check_parts, check_isolated_floor, check_aisles, check_extent):
        check(s)
    check_activities(s)
    if trial is not None:
        drive_routes(s, trial)
        walk_hops(s, trial)
    return (*(Remark(problem=p, serious=True) for p in problems), *s.remarks)
