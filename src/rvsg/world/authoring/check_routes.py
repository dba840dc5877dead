"""What is wrong or suspicious in the routes of a world, as they are written and as the robot drives them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rvsg.core.records import Pose
from rvsg.world.authoring.fixes import (
    Fix,
    allow_time,
    in_radians,
    move_pose,
)
from rvsg.world.authoring.remarks import Subject
from rvsg.world.authoring.routes import robot_stands
from rvsg.world.authoring.trial import Trial
from rvsg.world.fitting import clearance_m, fitted
from rvsg.world.io.load import places_in, route_names, routes_in, told_apart
from rvsg.world.passages import narrow_passages, passing_m
from rvsg.world.route_words import length_m, line_of
from rvsg.world.world import Route

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
