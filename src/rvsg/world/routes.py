"""Routes across a building that a robot can drive: proposals, and fitting a route to another robot.

The routes of a world are written for one robot. A longer one touches the shelf in front of which that robot stops, or
stops before it because a safety scanner sees the shelf; a slower one needs more time.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Pose, Record
from rvsg.robots.polygons import padded, rectangle
from rvsg.robots.robot import DEFAULT_ROBOT, Robot, load_robot
from rvsg.world.grid import Grid
from rvsg.world.passages import length_m, line_of, narrowest_m, narrowest_passage
from rvsg.world.space import Space, robot_space
from rvsg.world.world import Route, World

STEP_M = 0.05
SAMPLE_M = 0.05
SPARE_M = 0.1
"""A goal that is moved leaves this much between the robot and what stands in front of it."""
CREEPING_M_S = 0.1
"""A safety zone that is watched at this speed stops the robot on its last metre."""
SPARE_BESIDE_M = 0.05
NEAR_M = 0.3
"""A robot whose start or goal is tight stands in the open part of the floor at most this far away."""
SLOWER_THAN_STRAIGHT = 1.2
START_AND_TURN_S = 5.0
"""The time limit is at least this much, and that many times the time at full speed along the route."""


def fitted(route: Route, robot: Robot, world: World) -> tuple[Route, tuple[str, ...]]:
    """Return the route for a robot, and what was changed, in words. Fitting a fitted route changes nothing."""
    notes = []
    back = setback_m(route.goal, robot, world)
    if back:
        goal = _moved(route.goal, back)
        notes.append(
            f"{route.name}: {robot.name} cannot stand at the goal ({route.goal.x:g}, {route.goal.y:g}); its goal is "
            f"{back:.2f} m before it, at ({goal.x:g}, {goal.y:g})."
        )
        route = route.model_copy(update={"goal": goal})
    if world.grid.valid:
        length = length_m(line_of(world, route))
    else:
        length = _length([(pose.x, pose.y) for pose in (route.start, *route.through, route.goal)])
    needed = math.ceil(SLOWER_THAN_STRAIGHT * length / robot.driving_speed_m_s + START_AND_TURN_S)
    if needed > route.time_limit_s:
        notes.append(
            f"{route.name}: {robot.name} drives at most {robot.driving_speed_m_s:g} m/s; its time limit for the "
            f"{length:.0f} m is {needed} s instead of {route.time_limit_s:g} s."
        )
        route = route.model_copy(update={"time_limit_s": float(needed)})
    return route, tuple(notes)


def setback_m(goal: Pose, robot: Robot, world: World) -> float | None:
    """Return how far before a goal, against its heading, the robot has to stop, m.

    0 where it reaches the goal within half of its tolerance; None where moving the goal does not help.
    """
    space = robot_space(world)
    corners = list(padded(robot.footprint, robot.padding_m))
    for zone in robot.safety_zones:
        if zone.speed_m_s == 0.0 and zone.from_speed_m_s <= CREEPING_M_S:
            corners += zone.polygon
    (rear, right), (front, left) = rectangle(corners)
    counts = (math.ceil((front - rear) / SAMPLE_M) + 1, math.ceil((left - right) / SAMPLE_M) + 1)
    allowed = 0.5 * robot.navigation.behaviours.goal_tolerance_m
    for step in range(int((front - rear) / STEP_M) + 1):
        back = step * STEP_M
        if _is_free(space, _moved(goal, back), ((rear, right), (front, left)), counts):
            return 0.0 if back <= allowed else round(back + SPARE_M, 2)
    return None


def clearance_m(robot: Robot) -> float:
    """Return how far a robot's base keeps from obstacles where it passes between them, m."""
    return round(0.5 * min(robot.width_m, robot.length_m) + SPARE_BESIDE_M, 3)


def fits_through(robot: Robot, route: Route, world: World) -> bool:
    """Return whether some way from the start over the poses to pass to the goal is as wide as the robot."""
    space = robot_space(world)
    slack = space.frame.resolution * math.sqrt(0.5)
    parts = space.parts(max(0.0, 0.5 * min(robot.width_m, robot.length_m) - slack))
    reach = max(1, math.ceil(NEAR_M / space.frame.resolution))
    reached: set[int] | None = None
    for pose in (route.start, *route.through, route.goal):
        column, row = (math.floor(v) for v in space.frame.to_cells(np.array([pose.x, pose.y])))
        near = parts[max(0, row - reach) : max(0, row + reach + 1), max(0, column - reach) : max(0, column + reach + 1)]
        numbers = {int(number) for number in np.unique(near)} - {0}
        reached = numbers if reached is None else reached & numbers
    return bool(reached)


def _is_free(
    space: Space, pose: Pose, box: tuple[tuple[float, float], tuple[float, float]], counts: tuple[int, int]
) -> bool:
    """Return whether a rectangle in the frame of a pose is clear of obstacles, at so many points along and across."""
    (rear, right), (front, left) = box
    along, across = np.meshgrid(np.linspace(rear, front, counts[0]), np.linspace(right, left, counts[1]))
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    points = np.stack([pose.x + cos * along - sin * across, pose.y + sin * along + cos * across], axis=-1)
    return bool((space.clearances(points) > 0.0).all())


def _moved(pose: Pose, back: float) -> Pose:
    x, y = pose.x - back * math.cos(pose.yaw), pose.y - back * math.sin(pose.yaw)
    return Pose(x=round(x, 3), y=round(y, 3), yaw=pose.yaw)


Hop = tuple[str, str]


class Drive(Record):
    """How the robot drives a route with nobody about."""

    arrived: bool
    outcome: str
    """How the run ended, in words."""
    time_s: float
    """When the run ended: on arrival, or at the time limit of the trial."""
    x: float
    """Where the robot is at the end, metres, world frame."""
    y: float
    """Where the robot is at the end, metres, world frame."""
    touched_s: tuple[float, ...] = ()
    """When the robot's body touches an obstacle."""
    way: tuple[tuple[float, float], ...] = ()
    """Points of the way it drove, metres, world frame; empty where it is not known."""


class Trial(Protocol):
    """Tries a world out in a simulator. The world folders do not import the simulator; the caller passes it in."""

    def drive(self, world: World, route: Route) -> Drive:
        """Drive a route once, with nobody about. A bad start or an unreachable goal is an outcome."""
        ...

    def not_walked(self, world: World, hops: Sequence[Hop]) -> tuple[Hop, ...]:
        """Return the hops, each as (from, to), on which a person who walks alone does not arrive in time."""
        ...


ROUTES = 3
LONGEST_ROUTE_M = 60.0
SHORTEST_ROUTE_M = 3.0
SECONDS_PER_M = 2.5  # the study gives its robot 2 to 2.5 s for a metre
SHORTEST_LIMIT_S = 15.0
SPARE_TIME = 1.25  # the time limit is at least this many times what the robot takes alone
CROSSING = 0.5  # a way that crosses the building is at least this share of the longest one
PASSED = 0.5  # a way passes a waypoint that is nearer than this share of the spacing
MOST_DRIVES = 6  # ways tried for one proposal
WIDE_M = 5.0  # a narrowest place wider than this is not worth a word
TURNING_M = 0.45  # room in which a robot of 0.7 x 0.5 m turns on the spot


class _Walk(NamedTuple):
    """A way between two areas that may become a route."""

    length_m: float
    path: tuple[str, ...]
    start: str
    goal: str

    @property
    def hops(self) -> list[Hop]:
        """The hops of the way, whichever way they are walked."""
        return [(a, b) if a < b else (b, a) for a, b in pairwise(self.path)]


def propose_routes(
    world: World,
    trial: Trial | None = None,
    robot: Robot | None = None,
    notes: list[str] | None = None,
) -> tuple[Route, ...]:
    """Return routes that cross the building: the longest way, the busiest, and the one through the narrowest place.

    With a trial each is driven once in a simulator: a way the robot does not drive alone is no proposal, and one on
    which it touches something only where there is no other. `robot`: the one to propose for. `notes` receives the
    ways that were driven and left out, where there are fewer than three others.
    """
    walks = _walks(world, robot)
    late: dict[_Walk, None] = {}
    chosen: list[_Walk] = []
    routes: list[Route] = []
    grazed: dict[_Walk, tuple[int, Route]] = {}
    for ranked in itertools.islice(itertools.cycle(_rankings(world, walks)), ROUTES):
        used = {name for walk in chosen for name in (walk.start, walk.goal)}
        fresh = [walk for walk in ranked if walk not in chosen]
        for walk in sorted(fresh, key=lambda w: bool(used & {w.start, w.goal}))[:MOST_DRIVES]:
            asked = _route(world, f"route_{len(routes) + 1}", walk)
            driven = _driven(world, asked if robot is None else fitted(asked, robot, world)[0], trial)
            if driven is not None and not driven[0]:
                chosen.append(walk)
                routes.append(driven[1])
                break
            if driven is not None:
                grazed[walk] = driven
            else:
                late[walk] = None
    if routes and len(routes) < ROUTES and notes is not None:
        for why, left in (("touches something", grazed), ("does not arrive", late)):
            ways = "; ".join(f"{walk.start} to {walk.goal}" for walk in left)
            notes += [f"not proposed, because the robot alone {why} on the way: {ways}."] if left else []
    if not routes:
        least = sorted(grazed.values(), key=lambda driven: driven[0])[:ROUTES]
        routes = [route.model_copy(update={"name": f"route_{n}"}) for n, (_, route) in enumerate(least, start=1)]
    return tuple(routes)


def _walks(world: World, robot: Robot | None) -> list[_Walk]:
    """Return the shortest ways between all areas that are long enough and at whose ends the robot stands free."""
    ends, space = _ends(world, robot), robot_space(world)
    fits = {w.name for w in world.grid.waypoints if w.human and w.robot}
    waypoints = tuple(w if w.name in fits else w.model_copy(update={"human": False}) for w in world.grid.waypoints)
    hops = tuple(hop for hop in world.grid.hops if fits.issuperset(hop))
    drivable = world.grid.model_copy(update={"waypoints": waypoints, "hops": hops})
    walks = []
    for (start, area_a), (goal, area_b) in itertools.combinations(ends, 2):
        path = drivable.shortest_path(start, goal)
        if path is not None and all(robot_stands(space, pose, robot) for pose in _end_poses(world, path)):
            length = _length([world.grid.position(name) for name in path])
            if length >= SHORTEST_ROUTE_M:
                walks.append(_Walk(length, path, area_a, area_b))
    return walks


def _length(points: Sequence[tuple[float, float]]) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(points))


def _end_poses(world: World, path: Sequence[str]) -> tuple[Pose, Pose]:
    """Return the first and the last pose on a path, looking along it."""
    points = [world.grid.position(name) for name in path]
    ends = ((points[0], points[0], points[1]), (points[-1], points[-2], points[-1]))
    first, last = (Pose(x=x, y=y, yaw=round(math.atan2(b[1] - a[1], b[0] - a[0]), 2)) for (x, y), a, b in ends)
    return first, last


def _rankings(world: World, walks: Sequence[_Walk]) -> list[list[_Walk]]:
    """Return the walks by length, by how many others share their hops, and by their narrowest place."""
    if not walks:
        return []
    longest = min(max(walk.length_m for walk in walks), LONGEST_ROUTE_M)
    users = Counter(hop for walk in walks for hop in walk.hops)
    lines = [np.array([world.grid.position(name) for name in hop]) for hop in users]
    widths = dict(zip(users, narrowest_m(world, lines), strict=True))
    shared = {walk: sum(users[hop] for hop in walk.hops) / len(walk.path) for walk in walks}
    narrowest = {walk: round(min(widths[hop] for hop in walk.hops), 2) for walk in walks}
    crossing = [walk for walk in walks if CROSSING * longest <= walk.length_m <= LONGEST_ROUTE_M] or list(walks)
    return [
        sorted(walks, key=lambda walk: (abs(walk.length_m - longest), walk.path)),
        sorted(crossing, key=lambda walk: (-shared[walk], -walk.length_m, walk.path)),
        sorted(crossing, key=lambda walk: (narrowest[walk], -walk.length_m, walk.path)),
    ]


def _driven(world: World, route: Route, trial: Trial | None) -> tuple[int, Route] | None:
    """Return the touches on a route and the route as driven in the trial; None where the robot does not arrive."""
    if trial is None:
        return 0, route
    drive = trial.drive(world, route)
    if not drive.arrived:
        return None
    touches = len(drive.touched_s)
    needed = 5.0 * math.ceil(SPARE_TIME * drive.time_s / 5.0)
    way = np.array(drive.way)
    if len(way) < 2:
        return touches, route.model_copy(update={"time_limit_s": max(route.time_limit_s, needed)})
    limit = max(time_limit_s(length_m(way)), needed)
    return touches, route.model_copy(update={"via": passed(world.grid, way), "time_limit_s": limit})


def passed(grid: Grid, way: NDArray[np.float64]) -> tuple[str, ...]:
    """Return the waypoints that a driven way (N, 2) passes, in order: the nearest one within half of the spacing."""
    valid = [w for w in grid.waypoints if w.human]
    points = np.array([(w.x, w.y) for w in valid])
    names: list[str] = []
    for at in way:
        away = np.hypot(*(points - at).T)
        nearest = int(away.argmin())
        if away[nearest] <= PASSED * grid.spacing_m and (not names or names[-1] != valid[nearest].name):
            names.append(valid[nearest].name)
    return tuple(names)


def route_notes(world: World, trial: Trial | None) -> tuple[str, ...]:
    """Return a sentence on each route: its length, how long the robot takes alone, and its narrowest place."""
    notes = []
    for route in world.routes:
        line = line_of(world, route)
        said = f"{route.name} leads {route.purpose or 'through the world'}, {length_m(line):.0f} m"
        if trial is not None:
            drive = trial.drive(world, route)
            said += f"; the robot alone takes {drive.time_s:.0f} s"
            if drive.touched_s:
                said += f" and touches something {len(drive.touched_s)} times on the way"
        narrow = narrowest_passage(world, line)
        if narrow is not None and narrow.width_m < WIDE_M:
            said += f"; its narrowest place is {narrow.width_m:.1f} m wide, near {narrow.waypoint}"
        notes.append(f"{said}.")
    return tuple(notes)


def _ends(world: World, robot: Robot | None) -> list[tuple[str, str]]:
    """Return for every area the waypoint where the robot can best turn, then the most central; at most twenty."""
    space = robot_space(world)
    turning = TURNING_M if robot is None else robot.turning_radius_m
    ends: dict[str, str] = {}
    for area in world.areas:
        middle = np.mean(np.array(area.outline), axis=0)
        fit = [waypoint for name in area.waypoints if (waypoint := world.grid.by_name[name]).robot]
        if fit:
            tight = {w.name: space.clearance(w.x, w.y) < turning for w in fit}
            best = min(fit, key=lambda w: (tight[w.name], math.dist((w.x, w.y), middle), w.name))
            ends.setdefault(best.name, area.name)
    return list(ends.items())[:: max(1, math.ceil(len(ends) / 20))]


def _route(world: World, name: str, walk: _Walk) -> Route:
    start, goal = _end_poses(world, walk.path)
    return Route(
        name=name,
        start=start,
        goal=goal,
        time_limit_s=time_limit_s(walk.length_m),
        via=walk.path,
        purpose=f"from {walk.start} to {walk.goal}",
    )


def robot_stands(space: Space, pose: Pose, robot: Robot | None = None) -> bool:
    """Return whether the robot's padded footprint at this pose (metres, radians) is clear of obstacles."""
    robot = robot or load_robot(DEFAULT_ROBOT)
    return _is_free(space, pose, rectangle(padded(robot.footprint, robot.padding_m)), (15, 11))


def time_limit_s(length_m: float) -> float:
    """Return a sensible time limit for a way of this length, in steps of 5 s."""
    return max(SHORTEST_LIMIT_S, 5.0 * math.ceil(SECONDS_PER_M * length_m / 5.0))
