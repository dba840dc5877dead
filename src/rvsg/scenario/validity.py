"""The checker: everything that makes a configuration invalid."""

from __future__ import annotations

import cmath
import difflib
import math
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rvsg.robots.robot import Robot
from rvsg.scenario.placement import size_findings, spawn_findings, speed_range, staged_findings, start_gap_m
from rvsg.scenario.rules import MAX_HUMANS, START_CLEARANCE_M, Finding, near_place, spelled, task_ends
from rvsg.scenario.scenario import (
    LONGEST_PAUSE_S,
    Human,
    HumanConfiguration,
    Mission,
    Point,
    Task,
    goal_names,
    pauses_of,
)
from rvsg.scenario.variation import changes_that_matter
from rvsg.world.grid import Grid, GridSpec
from rvsg.world.lattice import closed_between
from rvsg.world.routes import fits_through
from rvsg.world.space import human_space, robot_space
from rvsg.world.world import World

WALK_AROUND = "Add points or waypoints around it: people walk straight from one to the next."


def check(people: HumanConfiguration, mission: Mission, world: World) -> tuple[Finding, ...]:
    """Return everything that makes a configuration invalid for this mission in this world; empty if it is valid.

    The world counts as the mission finds it: with its moved objects and the states of its doors.
    """
    world = mission.place(world)
    labels = _labels(mission, world)
    return (
        *_mission_findings(people, mission, world),
        *_crowd_findings(people),
        *(finding for human in people.humans for finding in _human_findings(human, world, labels)),
        *spawn_findings(people, mission, world),
    )


def warnings(people: HumanConfiguration, mission: Mission, world: World) -> tuple[Finding, ...]:
    """Return what is simulated but unlikely to be meant.

    That is a start close to the robot, areas that were renamed since, somebody who turns round without a stop, and a
    pause that outlasts the run.
    """
    world = mission.place(world)
    findings = []
    if not _labels(mission, world):
        for human in people.humans:
            for task in human.tasks:
                named = {"human": human.name, "task": task.name}
                findings += [finding.model_copy(update=named) for finding in _end_findings(task, world)]
    for human in people.humans:
        findings += _pacing_findings(human, mission, world)
        at = human.starts_at(world.grid)
        gap = start_gap_m(human.body_radius_m, at, mission) if at is not None else math.inf
        if 0.0 <= gap < START_CLEARANCE_M:
            reason = f"The start is only {gap:.2f} m from the robot, edge to edge."
            start = {"human": human.name, "task": human.tasks[0].name, "position": 0}
            findings.append(Finding.of("spawn-near-robot", reason, f"Keep {START_CLEARANCE_M:g} m.", **start))
    return tuple(findings)


ABOUT_TURN = math.radians(120.0)
"""Who turns farther turns round. Recorded people do so without a stop 0.00 to 0.11 times a minute of walking."""
MOST_TURNS = 3
TURN_S, TURN_LEAST_M = 1.2, 0.5
"""The way before and after a turn: what is walked in so many seconds, and at least so far."""


def about_turns(human: Human, grid: Grid) -> tuple[str, ...]:
    """Return the waypoints at which a person turns round without a stop, in the order of the way."""
    names = goal_names(human)
    stops = {leg % len(names) for leg, _, _ in pauses_of(human)}
    points = [human.position(name, grid) for name in names]
    if None in points or len(names) < 2:
        return ()  # the checker says what is wrong
    places, window = [complex(*point) for point in points if point], TURN_S * human.speed_m_s

    def reach(k: int, step: int) -> complex:
        """From goal `k` to where the person is `window` metres before or after, or at the stop in between."""
        at, left = k, window
        while left > 1e-9:
            after = at + step
            if not human.cyclic and not 0 <= after < len(places):
                break
            hop = places[after % len(places)] - places[at % len(places)]
            if abs(hop) >= left:
                return places[at % len(places)] + hop * (left / abs(hop)) - places[k]
            left, at = left - abs(hop), after
            if at % len(places) in stops or at % len(places) == k:
                break
        return places[at % len(places)] - places[k]

    found = []
    for k, name in enumerate(names):
        if k in stops:
            continue
        before, after = -reach(k, -1), reach(k, 1)
        if min(abs(before), abs(after)) >= TURN_LEAST_M and abs(cmath.phase(after / before)) > ABOUT_TURN:
            found.append(name)
    return tuple(found)


def _pacing_findings(human: Human, mission: Mission, world: World) -> Iterator[Finding]:
    """Yield where a person turns round without a stop, and pauses that are longer than a run."""
    turns = about_turns(human, world.grid) if human.track is None else ()
    if turns:
        listed = ", ".join(turns[:MOST_TURNS]) + (", ..." if len(turns) > MOST_TURNS else "")
        reason = f"Turns round without a stop at {listed}, which recorded people do not do."
        better = 'Say what is done there, and how long: a pause such as {"at", "duration_s", "doing"}.'
        yield Finding.of("turns-without-stop", reason, better, human=human.name)
    limit = mission.route.time_limit_s
    for task in human.tasks:
        for pause in task.pauses:
            if limit < pause.duration_s < LONGEST_PAUSE_S:
                reason = f"The pause of {pause.duration_s:g} s at {pause.at} is longer than the run ({limit:g} s)."
                better = "Choose a shorter one, or who stays: a pause of 600 s."
                yield Finding.of("pause-longer-than-run", reason, better, human=human.name, task=task.name)


def _labels(mission: Mission, world: World) -> bool:
    """Return whether the areas a scenario names have to exist: not after its world was relabelled."""
    return mission.world_id == world.id


def _human_findings(human: Human, world: World, labels: bool) -> Iterator[Finding]:
    """Yield what is wrong with one person, apart from where the others and the robot are."""
    for task in human.tasks:
        wrong = [*_path_findings(human, task, world), *(_end_findings(task, world) if labels else ())]
        for pause in task.pauses:
            if pause.at not in task.path:
                better = f"Pause at one of {', '.join(task.path)}." if task.path else "Give the task a path."
                wrong.append(Finding.of("pause-off-path", f"The pause at {pause.at} is not on the path.", better))
        for finding in wrong:
            yield finding.model_copy(update={"human": human.name, "task": task.name})
    yield from _point_findings(human, world)
    yield from _chain_findings(human)
    yield from _walk_findings(human)
    yield from size_findings(human, world)


def _path_findings(human: Human, task: Task, world: World) -> Iterator[Finding]:
    valid = world.grid.valid
    if not task.path:
        yield Finding.of("empty-path", "The path is empty.", "Name the waypoints in order.")
    if len(task.path) == 1 and not task.pauses:
        only = f"The path holds only {task.path[0]}."
        yield Finding.of("short-path", only, "Walk to another waypoint, or pause there.")
    for position, name in enumerate(task.path):
        if name not in human.points and name not in valid:
            yield _waypoint_finding(name, position, world)
    for position, (a, b) in enumerate(pairwise(task.path), start=1):
        if a in human.points or b in human.points:
            wrong = _leg_finding(human, a, b, world)
        else:
            wrong = _hop_finding(a, b, world) if a in valid and b in valid else None
        if wrong:
            yield wrong.model_copy(update={"position": position})


def _waypoint_finding(name: str, position: int, world: World) -> Finding:
    """Return what is wrong with the name of a waypoint that is not valid."""
    grid = world.grid
    if name in grid.by_name:
        at = grid.position(name)
        closed = closed_between(world, at, at, (world.grid_spec or GridSpec()).human_clearance_m)
        why = f": the door {closed.name} is closed there" if closed is not None else ""
        reason = f"{name} is not a place where a person can stand{why}."
        near = f"The nearest one that is: {grid.nearest(*at)}."
        return Finding.of("invalid-waypoint", reason, near, position=position)
    if meant := spelled(name, world) or next(iter(difflib.get_close_matches(name, sorted(grid.valid), n=1)), None):
        better = f'Did you mean "{meant}"?'
    else:
        extent = f"a row {grid.rows[0]} to {grid.rows[-1]} and a column {grid.columns[0]} to {grid.columns[-1]}"
        better = f"Waypoints are {extent}, as in {min(grid.valid)}."
    return Finding.of("unknown-waypoint", f'There is no waypoint "{name}".', better, position=position)


def _hop_finding(a: str, b: str, world: World) -> Finding | None:
    """Return what is wrong with walking straight from one valid waypoint to another, or None."""
    grid = world.grid
    if b in grid.neighbours[a]:
        if is_walkable(a, b, world):
            return None
        reason = f"Nobody fits through between {a} and {b}: less than {2 * BODY_HALF_WIDTH_M:g} m is free."
        return Finding.of("too-narrow", reason, "Lead the path over other waypoints.")
    if a == b:
        return Finding.of("repeated-waypoint", f"{a} is named twice in a row.", "Use a pause for a stop.")
    path = grid.shortest_path(a, b)
    way = f"Walk {' '.join(path)}." if path else "There is no way from one to the other."
    first, second = grid.by_name[a], grid.by_name[b]
    if abs(first.row - second.row) <= 1 and abs(first.column - second.column) <= 1:
        return _barred(a, b, (first.x, first.y), (second.x, second.y), world, f"{way} Or open the door.", way)
    return Finding.of("not-neighbours", f"{a} and {b} are not neighbours.", way)


def _leg_finding(human: Human, a: str, b: str, world: World) -> Finding | None:
    """Return what is wrong with a straight walk that starts or ends at a free point."""
    start, end = human.position(a, world.grid), human.position(b, world.grid)
    if a == b:
        return Finding.of("repeated-waypoint", f"{a} is named twice in a row.", "Say a stop as a pause.")
    if start is None or end is None or human_space(world).segment_free(start, end):
        return None
    return _barred(a, b, start, end, world, "Open the door, or walk another way.", WALK_AROUND)


def _barred(a: str, b: str, start: Point, end: Point, world: World, opened: str, around: str) -> Finding:
    """Return what bars the straight way: a closed door, which may be `opened`, or an obstacle."""
    if (closed := closed_between(world, start, end)) is not None:
        return Finding.of("door-closed", f"The door {closed.name} is closed between {a} and {b}.", opened)
    return Finding.of("leg-through-obstacle", f"An obstacle lies between {a} and {b}.", around)


def _point_findings(human: Human, world: World) -> Iterator[Finding]:
    """Yield the free points of a person that lie in an obstacle, hide a waypoint, or cannot be walked to."""
    space = human_space(world)
    for name, point in human.points.items():
        if name in world.grid.by_name:
            reason = f"The free point {name} has the name of a waypoint."
            yield Finding.of("point-hides-waypoint", reason, "Give the point another name.", human=human.name)
        if not space.is_free(*point):
            reason = f"The free point {name} ({point[0]:g}, {point[1]:g}) lies in an obstacle or outside the map."
            yield Finding.of("point-in-obstacle", reason, "Move it to where it is free.", human=human.name)
    first = human.tasks[0].path
    to = human.position(first[0], world.grid) if first else None
    if human.start is not None and to is not None and not space.segment_free(human.start, to):
        at = {"human": human.name, "task": human.tasks[0].name, "position": 0}
        reason = f"An obstacle lies between the start and {first[0]}."
        yield Finding.of("leg-through-obstacle", reason, WALK_AROUND, **at)


def _end_findings(task: Task, world: World) -> Iterator[Finding]:
    for end, word, place in zip(task_ends(task, world), ("start", "end"), (0, -1), strict=True):
        if not end.known:
            near = near_place(end.text, world)
            areas = ", ".join(area.name for area in world.areas)
            reason = f'The task\'s {word}, "{end.text}", is not a labelled area.'
            yield Finding.of("unknown-area", reason, f'Did you mean "{near}"?' if near else f"Areas: {areas}.")
        elif task.path and (at := task.path[place]) in world.grid.valid and not end.allows(at):
            own = ", ".join(sorted(end.waypoints or ())) or "none where a person can stand"
            reason = f"The task {word}s at {at}, which is not a waypoint of {end.text}."
            yield Finding.of("wrong-area", reason, f"Waypoints of {end.text}: {own}.", position=place % len(task.path))


def _chain_findings(human: Human) -> Iterator[Finding]:
    for before, after in pairwise(human.tasks):
        if before.path and after.path and before.path[-1] != after.path[0]:
            at = {"human": human.name, "task": after.name, "position": 0}
            reason = f'The task starts at {after.path[0]}, but "{before.name}" ended at {before.path[-1]}.'
            yield Finding.of("broken-chain", reason, f"Start at {before.path[-1]}.", **at)
    first, last = human.tasks[0], human.tasks[-1]
    if human.cyclic and first.path and last.path and first.path[0] != last.path[-1]:
        at = {"human": human.name, "task": last.name, "position": len(last.path) - 1}
        reason = f"The last task ends at {last.path[-1]}, but the first one starts at {first.path[0]}."
        yield Finding.of("open-loop", reason, f"Come back to {first.path[0]}.", **at)


def _walk_findings(human: Human) -> Iterator[Finding]:
    visited = {name for task in human.tasks for name in task.path}
    if human.cyclic and len(visited) == 1:
        reason = f"All tasks are at {next(iter(visited))}."
        yield Finding.of("never-moves", reason, "Give the person somewhere to walk to.", human=human.name)
    low, high = speed_range(human)
    if not low <= human.speed_m_s <= high:
        reason = f"A walking speed of {human.speed_m_s:g} m/s is outside {low:g} to {high:g} m/s."
        better = f"Take {min(max(human.speed_m_s, low), high):g} m/s."
        yield Finding.of("speed-out-of-range", reason, better, human=human.name)


def _crowd_findings(people: HumanConfiguration) -> Iterator[Finding]:
    more = len(people.humans) - MAX_HUMANS
    if more > 0:
        reason = f"There are {len(people.humans)} people; at most {MAX_HUMANS} are simulated."
        yield Finding.of("too-many-humans", reason, f"Leave {more} out.")
    for name, count in Counter(human.name for human in people.humans).items():
        if count > 1:
            reason = f"{count} people have this name."
            yield Finding.of("same-name", reason, "Give each person a different name.", human=name)
    sizes = Counter(human.group for human in people.humans if human.group is not None)
    for human in people.humans:
        if human.group is not None and sizes[human.group] == 1:
            reason = f"Nobody else is in group {human.group}."
            better = "Put somebody else into the group, or leave it out."
            yield Finding.of("group-of-one", reason, better, human=human.name)


def _mission_findings(people: HumanConfiguration, mission: Mission, world: World) -> Iterator[Finding]:
    for change in changes_that_matter(people, mission, world):
        better = "Give the world the scenario was made for, or adapt it with `rvsg scenario migrate`."
        yield Finding.of("wrong-world", change, better)
    yield from staged_findings(mission, world)
    for human in people.humans:
        if human.track is not None and human.track.until_m is not None and mission.driven is None:
            reason = "The track is followed until the robot differs from a recording, and the mission holds none."
            better = "Give the mission `driven`, or leave `until_m` out."
            yield Finding.of("track-without-robot", reason, better, human=human.name)
    route, robot, start = mission.route, mission.robot, mission.route.start
    if not robot_space(world).is_free(start.x, start.y):
        reason = f"The robot's start ({start.x:g}, {start.y:g}) of {route.name} is not free in {world.name}."
        yield Finding.of("robot-start-blocked", reason, "Move the route's start into free space.")
    elif isinstance(robot, Robot) and not fits_through(robot, route, world):
        reason = f"{robot.name} is {robot.width_m:.2f} m wide; no way from the start to the goal of {route.name} is."
        better = "Choose another route or another robot; `rvsg world check --robot` checks all routes."
        yield Finding.of("robot-too-wide", reason, better)


BODY_HALF_WIDTH_M = 0.125
"""A person who turns sideways gets through where this much is free on either side."""
SIDE_M = 0.5
"""How far a person may leave the straight line to get past a corner."""
REACHED_M = 0.3
"""A waypoint is reached from this far."""

_known: WeakKeyDictionary[World, dict[tuple[str, str], bool]] = WeakKeyDictionary()


def is_walkable(a: str, b: str, world: World) -> bool:
    """Return whether a person fits through between two valid waypoints; kept for each world.

    They do if the straight line is free and a way leads from one to the other that stays within `SIDE_M` of it and
    keeps `BODY_HALF_WIDTH_M` from obstacles. The clearances of the world's raster are exact to half
    a cell.
    """
    of_world = _known.setdefault(world, {})
    key = (a, b) if a < b else (b, a)
    if key not in of_world:
        of_world[key] = _leads_through(np.array(world.grid.position(a)), np.array(world.grid.position(b)), world)
    return of_world[key]


def _leads_through(start: NDArray[np.float64], end: NDArray[np.float64], world: World) -> bool:
    from scipy.ndimage import label

    space = human_space(world)
    if not space.segments_free(start[None], end[None])[0]:
        return False
    step = space.frame.resolution
    if space.segments_free(start[None], end[None], BODY_HALF_WIDTH_M + 2 * step)[0]:
        return True  # nothing is near, as on most hops
    low, high = np.minimum(start, end) - SIDE_M, np.maximum(start, end) + SIDE_M
    x, y = (np.arange(first, last + step, step) for first, last in zip(low, high, strict=True))
    points = np.stack(np.meshgrid(x, y), axis=-1)
    along = end - start
    share = np.clip(((points - start) @ along) / max(float(along @ along), 1e-12), 0.0, 1.0)
    beside = np.linalg.norm(points - (start + share[..., None] * along), axis=-1)
    fits = (space.clearances(points) >= BODY_HALF_WIDTH_M - step / 2) & (beside <= SIDE_M)
    parts, _ = label(fits, np.ones((3, 3)))
    near_start, near_end = (
        set(parts[np.linalg.norm(points - point, axis=-1) <= REACHED_M].tolist()) - {0} for point in (start, end)
    )
    return bool(near_start & near_end)
