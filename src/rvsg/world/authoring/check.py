"""Everything that is wrong or suspicious in a world folder, all at once, each with its file and line."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.documents import Document, DocumentError, Problem, read_yaml
from rvsg.core.errors import FileError
from rvsg.core.records import Pose
from rvsg.robots import Robot
from rvsg.world.authoring.fixes import (
    Fix,
    allow_time,
    cut_area,
    in_radians,
    move_pose,
    remove_area,
    rename_area,
    rename_in_activity,
    renew_waypoints,
)
from rvsg.world.authoring.named_areas import unknown_areas
from rvsg.world.authoring.routes import robot_stands
from rvsg.world.authoring.trial import Trial
from rvsg.world.fitting import clearance_m, fitted
from rvsg.world.grid import GridSpec
from rvsg.world.io.load import places_in, read_world, route_names, routes_in, told_apart, world_folder
from rvsg.world.passages import free_width_m
from rvsg.world.raster import outermost
from rvsg.world.route_words import length_m, line_of, nearest_area
from rvsg.world.space import Space, frame_of, human_space, main_floor, robot_space, world_map
from rvsg.world.world import Area, Route, World

Bools = NDArray[np.bool_]

FASTEST_M_S = 1.5  # a way that asks for more within its time limit cannot be meant
FAR_M = 3.0
TIGHT = 0.6  # with less than this share of the clearance the robot surely touches
AISLE_WIDEST_M = 3.0
AISLE_LENGTH_M = 1.5
AISLE_SAMPLES = 9  # points at which an aisle's width is measured
PART_M2 = 2.0
MANY_WAYPOINTS = 1000
MOST_OF_A_KIND = 12


@dataclass(frozen=True, kw_only=True)
class Remark:
    """A finding: `serious` ones stop a campaign or make its results wrong, the others are suspicious."""

    problem: Problem
    serious: bool
    key: tuple[str | int, ...] = ()
    """What of the file it is about, e.g. ("routes", 0, "goal")."""
    fix: Fix | None = None
    """What would mend it; None where only a person can tell."""

    def __str__(self) -> str:
        return f"{'error' if self.serious else 'warning'}: {self.problem}"


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
        return (Remark(problem=Problem(error.path, error.line, error.reason), serious=True),)
    found = [Remark(problem=p, serious=True) for p in problems]
    return (*found, *_Checker(folder, world, trial, robot).all())


class _Checker:
    """The judgement of a world that could be read."""

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

    def all(self) -> list[Remark]:
        parts = self._reachable_parts()
        self._check_areas(parts)
        self._check_routes()
        self._check_parts(parts)
        self._check_isolated_floor()
        self._check_aisles()
        self._check_unknown()
        self._check_size()
        self._check_activities()
        if self.trial is not None:
            self._drive_routes(self.trial)
            self._walk_hops(self.trial)
        return self.remarks

    def _say(
        self, document: Document, message: str, *key: str | int, serious: bool = False, fix: Fix | None = None
    ) -> None:
        self.remarks.append(Remark(problem=document.problem(message, *key), serious=serious, key=key, fix=fix))

    # --- areas ---

    def _check_areas(self, parts: list[set[str]]) -> None:
        from shapely import Polygon

        if not self.world.areas:
            self._say(self.labels, "there are no labelled areas: tasks can only name waypoints", "areas")
        corners = frame_of(world_map(self.world)).corners
        inside_map = Polygon(corners)
        main = parts[0] if parts else set()
        seen: dict[str, str] = {}
        names = [area.name for area in self.world.areas]
        for index, area in enumerate(self.world.areas):
            shape = self.shapes[area.name]
            key = ("areas", index)
            alike = seen.setdefault(area.name.strip().casefold(), area.name)
            if alike != area.name:
                other = rename_area(area.name, area.name.strip(), names)
                message = f'"{area.name}" is easily taken for "{alike}"; give it another name'
                self._say(self.labels, message, *key, fix=other)
            if area.name != area.name.strip():
                other = rename_area(area.name, area.name.strip(), names)
                self._say(self.labels, f'the name "{area.name}" begins or ends with a space', *key, fix=other)
            if area.name.strip() in self.world.grid.by_name:
                other = rename_area(area.name, f"{area.kind} {area.name.strip()}", names)
                message = f'"{area.name}" is also the name of a waypoint; give it another name'
                self._say(self.labels, message, *key, fix=other)
            outside = 1.0 - float(shape.intersection(inside_map).area) / float(shape.area)
            if outside > 0.999:
                x0, y0, x1, y1 = inside_map.bounds
                message = f'"{area.name}" lies outside the map, which spans x {x0:g} to {x1:g} and y {y0:g} to {y1:g}'
                self._say(self.labels, message, *key, serious=True, fix=remove_area(area.name))
                continue
            if outside > 0.05:
                fix = cut_area(area.name, shape, inside_map)
                self._say(self.labels, f'{outside:.0%} of "{area.name}" lies outside the map', *key, fix=fix)
            self._check_area_waypoints(index, area, main)
        for a, b in combinations(self.world.areas, 2):
            first, second = self.shapes[a.name], self.shapes[b.name]
            shared = float(first.intersection(second).area) / min(float(first.area), float(second.area))
            if shared > 0.9 and a.kind == b.kind:
                index = self.world.areas.index(b)
                message = f'"{b.name}" and "{a.name}" cover the same place'
                self._say(self.labels, message, "areas", index, fix=remove_area(b.name))

    def _check_area_waypoints(self, index: int, area: Area, main: set[str]) -> None:
        from shapely import Point

        if not area.waypoints:
            message = (
                f'no waypoint reaches "{area.name}": none lies within {FAR_M:g} m of it. Move it, choose a finer grid, '
                "or name its waypoints"
            )
            self._say(self.labels, message, "areas", index, serious=True)
            return
        shape = self.shapes[area.name]
        away = {n: float(shape.distance(Point(*self.world.grid.position(n)))) for n in area.waypoints}
        far = [name for name, distance in away.items() if distance > FAR_M]
        if far:
            message = f'{_names(far)} of "{area.name}" lie{"s" * (len(far) == 1)} more than {FAR_M:g} m away from it'
            self._say(self.labels, message, "areas", index, "waypoints", fix=renew_waypoints(area.name))
        if main and not main & set(area.waypoints):
            message = f'"{area.name}" lies in a part of the map that people cannot walk to from the rest'
            self._say(self.labels, message, "areas", index, serious=True)

    # --- routes ---

    def _check_routes(self) -> None:
        from scipy.ndimage import label

        if not routes_in(self.routes):
            message = "there are no routes: write one before you run a campaign"
            self._say(self.routes, message, "routes", serious=True)
            return
        radius = self.spec.robot_clearance_m if self.driver is None else clearance_m(self.driver)
        parts, _ = label((self.robot.field >= radius) & (self.robot.field > 0))
        sound = {route.name: route for route in self.world.routes}
        for index, name in enumerate(told_apart(self.routes, "routes", route_names(self.routes))):
            route = sound.get(name)
            if route is None:  # its mistakes are reported already; check its poses, too
                for place_key, place in places_in(routes_in(self.routes)[index]):
                    if isinstance(place, Pose):
                        self._check_pose(name, str(place_key[0]), place, ("routes", index, *place_key), radius, parts)
                continue
            before = len(self.remarks)
            route = self._fitted(index, route)
            stops = [("start", route.start), *(("through", p) for p in route.through), ("goal", route.goal)]
            counts: dict[str, int] = {}
            places = []
            for what, pose in stops:
                key: tuple[str | int, ...] = ("routes", index, what)
                if what == "through":
                    key = (*key, counts.get(what, 0))
                counts[what] = counts.get(what, 0) + 1
                places.append(self._check_pose(route.name, what, pose, key, radius, parts))
            serious = any(remark.serious for remark in self.remarks[before:])
            if not serious and (0 in places or len(set(places)) > 1):
                message = (
                    f"the robot cannot drive {route.name}: on its map no way {2 * radius:g} m wide leads from the "
                    "start to the goal"
                )
                self._say(self.routes, message, "routes", index, serious=True)
            self._check_time(index, route)

    def _fitted(self, index: int, route: Route) -> Route:
        """Return the route as the robot drives it, and report what has to be fitted."""
        if self.driver is None:
            return route
        fit = fitted(route, self.driver, self.world)
        for note in fit.notes:
            self._say(self.routes, note, "routes", index)
        return fit.route

    def _check_pose(
        self, route: str, what: str, pose: Pose, key: Sequence[str | int], radius: float, parts: Any
    ) -> int:
        """Judge one pose; the number of the part of the robot's floor it lies on, 0 for none."""
        at = f"the {'pose to pass' if what == 'through' else what} of {route} ({pose.x:g}, {pose.y:g})"
        clear = self.robot.clearance(pose.x, pose.y)
        if abs(pose.yaw) > 2 * math.pi:
            message = f"{at}: a yaw of {pose.yaw:g} radians is more than a turn; if degrees are meant, write "
            turned = in_radians(route, key[2:], pose)
            self._say(self.routes, f"{message}{math.radians(pose.yaw):.4f}", *key, fix=turned)
        column, row = (math.floor(v) for v in self.robot.frame.to_cells(np.array([pose.x, pose.y])))
        rows, columns = parts.shape
        if not (0 <= row < rows and 0 <= column < columns):
            self._say(self.routes, f"{at} lies outside the map", *key, serious=True, fix=self._moved(route, pose, key))
        elif clear == 0.0:
            message, fix = f"{at} lies in an obstacle or in unknown space", self._moved(route, pose, key)
            self._say(self.routes, message, *key, serious=True, fix=fix)
        elif clear < radius:
            message = f"{at} is only {clear:.2f} m clear of obstacles; the robot needs {radius:g} m"
            fix = self._moved(route, pose, key)
            self._say(self.routes, message, *key, serious=clear < TIGHT * radius, fix=fix)
            reach = math.ceil(radius / self.robot.frame.resolution)
            near = parts[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
            return int(near.max(initial=0))
        else:
            if not robot_stands(self.robot, pose, self.driver):
                message = f"{at}: turned as it is there (yaw {pose.yaw:g}), the robot touches an obstacle"
                self._say(self.routes, message, *key, serious=what == "start", fix=self._moved(route, pose, key))
            return int(parts[row, column])
        return 0

    def _moved(self, route: str, pose: Pose, key: Sequence[str | int]) -> Fix | None:
        """Return the fix that moves a pose to where the robot stands."""
        radius = self.spec.robot_clearance_m if self.driver is None else clearance_m(self.driver)

        def stands(there: Pose) -> bool:
            clear = self.robot.clearance(there.x, there.y) >= radius
            return clear and robot_stands(self.robot, there, self.driver)

        return move_pose(route, key[2:], pose, self.world.grid, stands)

    def _check_time(self, index: int, route: Route) -> None:
        length = length_m(line_of(self.world, route))
        if length / route.time_limit_s > FASTEST_M_S:
            message = (
                f"{route.name} is about {length:.0f} m long; its time limit of {route.time_limit_s:g} s asks for "
                f"{length / route.time_limit_s:.1f} m/s on average"
            )
            fix = allow_time(route.name, length_m=length)
            self._say(self.routes, message, "routes", index, "time_limit_s", fix=fix)
        if math.dist((route.start.x, route.start.y), (route.goal.x, route.goal.y)) < 0.5 and not route.through:
            self._say(self.routes, f"{route.name} ends where it starts", "routes", index, "goal")

    def _drive_routes(self, trial: Trial) -> None:
        names = told_apart(self.routes, "routes", route_names(self.routes))
        for route in self.world.routes:
            key = ("routes", names.index(route.name))
            if any(remark.serious and remark.key[:2] == key for remark in self.remarks):
                continue
            if self.driver is not None:
                route = fitted(route, self.driver, self.world).route
            drive = trial.drive(self.world, route)
            at = f"({drive.x:.1f}, {drive.y:.1f}), near {self.world.grid.nearest(drive.x, drive.y)}"
            if not drive.arrived:
                message = (
                    f"the robot alone does not arrive on {route.name}: {drive.outcome}, after {drive.time_s:.0f} s at "
                    f"{at}. {self._turns()}Move the poses, or choose another route"
                )
                self._say(self.routes, message, *key, serious=True)
            elif drive.time_s > route.time_limit_s:
                message = (
                    f"the robot alone takes {drive.time_s:.0f} s for {route.name}, longer than its time limit of "
                    f"{route.time_limit_s:g} s: every run would end without arriving"
                )
                fix = allow_time(route.name, needed_s=drive.time_s)
                self._say(self.routes, message, *key, "time_limit_s", serious=True, fix=fix)
            if drive.touched_s:
                times = ", ".join(f"{time:.1f} s" for time in drive.touched_s[:3])
                self._say(self.routes, f"the robot alone touches an obstacle on {route.name} (at {times})", *key)

    def _turns(self) -> str:
        """Say what of the robot's steering a route must allow for; nothing of a robot that turns on the spot."""
        if self.driver is None or math.isinf(self.driver.drive.max_curvature):
            return ""
        return (
            f"{self.driver.name} turns in circles of at least {1.0 / self.driver.drive.max_curvature:.1f} m radius, "
            "which its global planner does not allow for: a way with tighter turns does not fit it. "
        )

    def _walk_hops(self, trial: Trial) -> None:
        hops = self.world.grid.hops
        blocked = trial.not_walked(self.world, [*hops, *((b, a) for a, b in hops)])
        pairs = sorted({(min(hop), max(hop)) for hop in blocked})
        if pairs:
            listed = ", ".join(f"{a} to {b}" for a, b in pairs[:MOST_OF_A_KIND])
            more = f" and {len(pairs) - MOST_OF_A_KIND} more" if len(pairs) > MOST_OF_A_KIND else ""
            message = (
                f"a person who walks alone does not get from {listed}{more} in time, although the line between the "
                "waypoints is free. A larger human_clearance_m leaves such a hop out"
            )
            self._say(self.head, message, "grid")

    # --- the grid ---

    def _reachable_parts(self) -> list[set[str]]:
        """Return the waypoints in groups between which people can walk, the largest first."""
        neighbours = self.world.grid.neighbours
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

    def _check_parts(self, parts: list[set[str]]) -> None:
        for part in parts[1 : 1 + MOST_OF_A_KIND]:
            message = (
                f"waypoint{'s' * (len(part) > 1)} {_names(sorted(part))} cannot be walked to from the other "
                f"{len(parts[0])}: an isolated part of the map, or the grid is too coarse for the way there"
            )
            self._say(self.head, message, "grid")
        if len(parts) > 1 + MOST_OF_A_KIND:
            self._say(self.head, f"and {len(parts) - 1 - MOST_OF_A_KIND} more isolated groups of waypoints", "grid")

    def _check_isolated_floor(self) -> None:
        """Floor that nobody can walk to from the main part."""
        parts = self.human.parts(min(self.spec.human_clearance_m, self.spec.hop_radius_m))
        sizes = np.bincount(parts.ravel()) * self.human.frame.resolution**2
        for number in [n for n in range(2, len(sizes)) if sizes[n] >= PART_M2][:MOST_OF_A_KIND]:
            rows, columns = np.nonzero(parts == number)
            middle = len(rows) // 2
            x, y = self.human.frame.to_metres(np.array([columns[middle] + 0.5, rows[middle] + 0.5]))
            message = (
                f"{sizes[number]:.0f} m² of floor about ({x:.1f}, {y:.1f}) are cut off from the rest: people cannot "
                "walk there" + (", and it holds no waypoint" if not self.spec.isolated_parts else "")
            )
            self._say(self.head, message, "map")

    def _check_aisles(self) -> None:
        from shapely import Point

        named = list(self._narrow_aisles())
        for first, second, width in named:
            message = (
                f"no waypoint lies in the aisle between {first} and {second} ({width:.1f} m wide): the grid is too "
                f"coarse for it. A spacing of {max(0.3, math.floor(width * 5) / 10):g} m, another origin, or rows and "
                "columns of your own would reach it"
            )
            self._say(self.head, message, "grid")
        covered = [self._strip(first, second) for first, second, _ in named]
        for x, y, size in self._unreached_floor():
            if any(strip.distance(Point(x, y)) < 0.5 for strip in covered):
                continue
            area, away = nearest_area(self.world.areas, x, y)
            near = f" near {area.name}" if area is not None and away < 5.0 else ""
            message = f"{size:.0f} m² of open floor about ({x:.1f}, {y:.1f}){near} hold no waypoint"
            self._say(self.head, message, "grid")

    def _strip(self, first: str, second: str) -> Any:
        """Return the floor between two areas."""
        both = self.shapes[first].union(self.shapes[second])
        return both.convex_hull.difference(both)

    def _narrow_aisles(self) -> Iterator[tuple[str, str, float]]:
        from shapely import contains_xy, points

        things = [a.name for a in self.world.areas if not self._is_floor(a)]
        valid = np.array([[w.x, w.y] for w in self.world.grid.waypoints if w.human]).reshape(-1, 2)
        for first, second in combinations(things, 2):
            a, b = self.shapes[first], self.shapes[second]
            width = float(a.distance(b))
            if not 2 * self.spec.human_clearance_m <= width <= AISLE_WIDEST_M:
                continue
            strip = self._strip(first, second)
            length = float(strip.area) / width
            if length < AISLE_LENGTH_M or any(
                strip.intersection(self.shapes[other]).area > 0.1 * strip.area
                for other in things
                if other not in (first, second)
            ):
                continue
            x0, y0, x1, y1 = strip.bounds
            samples = np.stack(np.meshgrid(np.arange(x0, x1, 0.1), np.arange(y0, y1, 0.1)), -1).reshape(-1, 2)
            samples = samples[contains_xy(strip, samples[:, 0], samples[:, 1])]
            if len(samples) == 0 or (self.human.clearances(samples) > 0).mean() < 0.7:
                continue
            width = self._free_width_m(samples)
            if not 2 * self.spec.human_clearance_m <= width <= AISLE_WIDEST_M:
                continue
            if not len(valid) or not (strip.buffer(0.05).contains(points(valid))).any():
                yield first, second, width

    def _free_width_m(self, samples: NDArray[np.float64]) -> float:
        """Return the width from wall to wall of an aisle given by points in it (N, 2); labels may end before walls."""
        clear = self.human.clearances(samples)
        middle = samples[clear >= np.quantile(clear, 0.8)]
        chosen = middle[:: max(1, len(middle) // AISLE_SAMPLES)]
        return float(np.median([free_width_m(self.world, float(x), float(y)) for x, y in chosen]))

    def _is_floor(self, area: Area) -> bool:
        from rvsg.world.lattice import open_share

        return open_share(area.outline, self.human) > 0.5

    def _unreached_floor(self) -> list[tuple[float, float, float]]:
        """Middle (x, y) and size in m² of open floor farther from every waypoint than the grid is wide."""
        from scipy.ndimage import binary_opening, label

        space = _coarser(self.human)
        walkable = main_floor(space, self.spec.human_clearance_m)
        away = self._distance_to_waypoints(space)
        missed = walkable & (away > 1.2 * max(self.world.grid.spacing_m, 0.5))
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

    def _distance_to_waypoints(self, space: Space) -> NDArray[np.float64]:
        from scipy.ndimage import distance_transform_edt

        rows, columns = space.frame.shape
        none = np.ones((rows, columns), np.bool_)
        points = np.array([[w.x, w.y] for w in self.world.grid.waypoints if w.human])
        at = np.floor(space.frame.to_cells(points)).astype(int)
        none[np.clip(at[:, 1], 0, rows - 1), np.clip(at[:, 0], 0, columns - 1)] = False
        return np.asarray(distance_transform_edt(none)) * space.frame.resolution

    # --- the map ---

    def _check_unknown(self) -> None:
        cells = world_map(self.world).cells
        free = outermost(cells == 0)
        (left, low), (right, high) = free.min(axis=0), free.max(axis=0) + 1
        within = cells[low:high, left:right]
        unknown = float((within == 255).mean())
        if unknown > 0.3:
            message = (
                f"{unknown:.0%} of the map around the free space is unknown; unknown space counts as closed for people "
                "and robot"
            )
            self._say(self.head, message, "map")

    def _check_size(self) -> None:
        count = len(self.world.grid.valid)
        if count > MANY_WAYPOINTS:
            message = f"the grid has {count} valid waypoints; a VLM reads a picture of some hundred. Use a coarser one"
            self._say(self.head, message, "grid")

    # --- the work ---

    def _check_activities(self) -> None:
        if not self.world.activities:
            self._say(self.head, "no activities are given (who does what between which areas): generators will guess")
        known = [area.name.strip() for area in self.world.areas]
        for index, activity in enumerate(self.world.activities):
            for name in unknown_areas(activity, known):
                near = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
                asked = f'; did you mean "{near[0]}"?' if near else ""
                message = f'the activity "{activity}" names "{name}", which is no labelled area{asked}'
                fix = rename_in_activity(self.world.activities, index, name, near[0]) if near else None
                self._say(self.head, message, "activities", index, fix=fix)


def _coarser(space: Space) -> Space:
    """Return the space in cells of at least 0.1 m and at most a million of them, each as clear as its clearest cell."""
    from rvsg.world.raster import Frame

    rows, columns = space.field.shape
    step = max(1, round(0.1 / space.frame.resolution), math.ceil(math.sqrt(rows * columns / 1e6)))
    high, wide = rows // step, columns // step
    if step == 1 or not (high and wide):
        return space
    field = space.field[: high * step, : wide * step].reshape(high, step, wide, step).max(axis=(1, 3))
    return Space(Frame(space.frame.origin, space.frame.resolution * step, (high, wide)), field)


def _names(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
