"""The checker: everything that makes a configuration invalid."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rvsg.robots.robot import Robot
from rvsg.scenario.placement import size_findings, spawn_findings, speed_range, staged_findings, start_gap_m
from rvsg.scenario.rules import MAX_HUMANS, START_CLEARANCE_M, Finding, TaskEnd, near_place, spelled, task_ends
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Task
from rvsg.scenario.variation import changes_that_matter
from rvsg.world.grid import GridSpec
from rvsg.world.lattice import closed_between
from rvsg.world.routes import fits_through
from rvsg.world.space import human_space, robot_space
from rvsg.world.world import Door, World

MOST_SOUND = 5_000
"""Tasks that are remembered of one world."""
_sound: WeakKeyDictionary[World, set[tuple[object, ...]]] = WeakKeyDictionary()
"""Tasks of people without free points in which nothing is wrong: a search asks of the same ones again and again."""


def check(people: HumanConfiguration, mission: Mission, world: World) -> tuple[Finding, ...]:
    """Return everything that makes a configuration invalid for this mission in this world; empty if it is valid.

    The world counts as the mission finds it: with its moved objects and the states of its doors.
    """
    world = mission.place(world)
    return (
        *_mission_findings(people, mission, world),
        *_crowd_findings(people),
        *(
            finding
            for human in people.humans
            for finding in human_findings(human, world, labels=_labels(mission, world))
        ),
        *spawn_findings(people, mission, world),
    )


def warnings(people: HumanConfiguration, mission: Mission, world: World) -> tuple[Finding, ...]:
    """Return what is simulated but unlikely to be meant: a start close to the robot, areas that were renamed since."""
    world = mission.place(world)
    found = []
    if not _labels(mission, world):
        for human in people.humans:
            for task in human.tasks:
                named = {"human": human.name, "task": task.name}
                found += [each.model_copy(update=named) for each in _end_findings(task, world)]
    for human in people.humans:
        at = human.starts_at(world.grid)
        if at is None:
            continue
        gap = start_gap_m(human.radius_m, at, mission)
        if 0.0 <= gap < START_CLEARANCE_M:
            near = Finding(
                rule="spawn-near-robot",
                human=human.name,
                task=human.tasks[0].name,
                position=0,
                reason=f"The start is only {gap:.2f} m from the robot, edge to edge.",
                suggestion=f"Keep {START_CLEARANCE_M:g} m.",
            )
            found.append(near)
    return tuple(found)


def _labels(mission: Mission, world: World) -> bool:
    """Return whether the areas a scenario names have to exist: not after its world was relabelled."""
    return mission.world_id == world.id


def human_findings(human: Human, world: World, *, labels: bool = True) -> Iterator[Finding]:
    """Yield what is wrong with one person, apart from where the others and the robot are.

    Args:
        labels: Also check the areas that tasks name.
    """
    sound = _sound.setdefault(world, set())
    for task in human.tasks:
        key = (task.path, task.start_area, task.end_area, labels, task.pauses)
        if not human.points and key in sound:
            continue
        ends_found = _end_findings(task, world) if labels else ()
        wrong = (*_path_findings(human, task, world), *ends_found, *_pause_findings(task))
        for found in wrong:
            yield found.model_copy(update={"human": human.name, "task": task.name})
        if not human.points and not wrong and len(sound) < MOST_SOUND:
            sound.add(key)
    yield from _point_findings(human, world)
    yield from _chain_findings(human)
    yield from _walk_findings(human)
    yield from size_findings(human, world)


def waypoint_findings(name: str, world: World) -> Finding | None:
    """Return what is wrong with the name of a waypoint, or None."""
    grid = world.grid
    if name in grid.valid:
        return None
    if name in grid.by_name:
        at = grid.position(name)
        near = grid.nearest(*at)
        closed = closed_between(world, at, at, (world.grid_spec or GridSpec()).human_clearance_m)
        why = f": the door {closed.name} is closed there" if closed is not None else ""
        return Finding(
            rule="invalid-waypoint",
            reason=f"{name} is not a place where a person can stand{why}.",
            suggestion=f"The nearest one that is: {near}.",
        )
    meant = spelled(name, world) or next(iter(difflib.get_close_matches(name, sorted(grid.valid), n=1)), None)
    return Finding(
        rule="unknown-waypoint",
        reason=f'There is no waypoint "{name}".',
        suggestion=f'Did you mean "{meant}"?' if meant else _grid_extent(world),
    )


def _grid_extent(world: World) -> str:
    rows, columns = world.grid.rows, world.grid.columns
    extent = f"a row {rows[0]} to {rows[-1]} and a column {columns[0]} to {columns[-1]}"
    return f"Waypoints are {extent}, as in {min(world.grid.valid)}."


def hop_finding(a: str, b: str, world: World) -> Finding | None:
    """Return what is wrong with walking straight from one valid waypoint to another, or None."""
    grid = world.grid
    if b in grid.neighbours[a]:
        return None if is_walkable(a, b, world) else _too_narrow(a, b)
    if a == b:
        return Finding(
            rule="repeated-waypoint", reason=f"{a} is named twice in a row.", suggestion="Use a pause for a stop."
        )
    first, second = grid.by_name[a], grid.by_name[b]
    beside = abs(first.row - second.row) <= 1 and abs(first.column - second.column) <= 1
    path = grid.shortest_path(a, b)
    way = f"Walk {' '.join(path)}." if path else "There is no way from one to the other."
    if beside:
        closed = closed_between(world, (first.x, first.y), (second.x, second.y))
        if closed is not None:
            return _door_closed(closed, a, b, f"{way} Or open the door.")
        return Finding(rule="leg-through-obstacle", reason=f"An obstacle lies between {a} and {b}.", suggestion=way)
    return Finding(rule="not-neighbours", reason=f"{a} and {b} are not neighbours.", suggestion=way)


def _door_closed(door: Door, a: str, b: str, suggestion: str) -> Finding:
    reason = f"The door {door.name} is closed between {a} and {b}."
    return Finding(rule="door-closed", reason=reason, suggestion=suggestion)


def _too_narrow(a: str, b: str) -> Finding:
    return Finding(
        rule="too-narrow",
        reason=f"Nobody fits through between {a} and {b}: less than {2 * BODY_HALF_WIDTH_M:g} m is free.",
        suggestion="Choose another way, or lay the grid with a larger hop_clearance_m.",
    )


def _path_findings(human: Human, task: Task, world: World) -> Iterator[Finding]:
    if not task.path:
        yield Finding(rule="empty-path", reason="The path is empty.", suggestion="Name the waypoints in order.")
    if len(task.path) == 1 and not task.pauses:
        yield Finding(
            rule="short-path",
            reason=f"The path holds only {task.path[0]}.",
            suggestion="Walk to another waypoint, or pause there.",
        )
    for position, name in enumerate(task.path):
        if name not in human.points and (wrong := waypoint_findings(name, world)):
            yield wrong.model_copy(update={"position": position})
    for position, (a, b) in enumerate(pairwise(task.path), start=1):
        if a in human.points or b in human.points:
            wrong = _leg_finding(human, a, b, world)
        else:
            known = a in world.grid.valid and b in world.grid.valid
            wrong = hop_finding(a, b, world) if known else None
        if wrong:
            yield wrong.model_copy(update={"position": position})


def _leg_finding(human: Human, a: str, b: str, world: World) -> Finding | None:
    """Return what is wrong with a straight walk that starts or ends at a free point."""
    start, end = human.position(a, world.grid), human.position(b, world.grid)
    if a == b:
        return Finding(
            rule="repeated-waypoint", reason=f"{a} is named twice in a row.", suggestion="Say a stop as a pause."
        )
    if start is None or end is None or human_space(world).segment_free(start, end):
        return None
    closed = closed_between(world, start, end)
    if closed is not None:
        return _door_closed(closed, a, b, "Open the door, or walk another way.")
    return Finding(
        rule="leg-through-obstacle",
        reason=f"An obstacle lies between {a} and {b}.",
        suggestion="Add points or waypoints around it: people walk straight from one to the next.",
    )


def _point_findings(human: Human, world: World) -> Iterator[Finding]:
    """Return the free points of a person that lie in an obstacle, hide a waypoint, or cannot be walked to."""
    space = human_space(world)
    for name, point in human.points.items():
        if name in world.grid.by_name:
            yield Finding(
                rule="point-hides-waypoint",
                human=human.name,
                reason=f"The free point {name} has the name of a waypoint.",
                suggestion="Give the point another name.",
            )
        if not space.is_free(*point):
            yield Finding(
                rule="point-in-obstacle",
                human=human.name,
                reason=f"The free point {name} ({point[0]:g}, {point[1]:g}) lies in an obstacle or outside the map.",
                suggestion="Move it to where it is free.",
            )
    first = human.tasks[0].path
    to = human.position(first[0], world.grid) if first else None
    if human.start is not None and to is not None and not space.segment_free(human.start, to):
        yield Finding(
            rule="leg-through-obstacle",
            human=human.name,
            task=human.tasks[0].name,
            position=0,
            reason=f"An obstacle lies between the start and {first[0]}.",
            suggestion="Add points or waypoints around it: people walk straight from one to the next.",
        )


def _end_findings(task: Task, world: World) -> Iterator[Finding]:
    ends = (
        (end, word, place) for end, word, place in zip(task_ends(task, world), ("start", "end"), (0, -1), strict=True)
    )
    for end, word, place in ends:
        if not end.known:
            near = near_place(end.text, world)
            known = ", ".join(area.name for area in world.areas)
            yield Finding(
                rule="unknown-area",
                reason=f'The task\'s {word}, "{end.text}", is not a labelled area.',
                suggestion=f'Did you mean "{near}"?' if near else f"Areas: {known}.",
            )
        elif task.path and (at := task.path[place]) in world.grid.valid and not end.allows(at):
            yield _wrong_area(end, word, at, place % len(task.path))


def _wrong_area(end: TaskEnd, word: str, at: str, position: int) -> Finding:
    own = sorted(end.waypoints or ())
    listed = ", ".join(own) if own else "none where a person can stand"
    verb = "starts" if word == "start" else "ends"
    return Finding(
        rule="wrong-area",
        position=position,
        reason=f"The task {verb} at {at}, which is not a waypoint of {end.text}.",
        suggestion=f"Waypoints of {end.text}: {listed}.",
    )


def _pause_findings(task: Task) -> Iterator[Finding]:
    for pause in task.pauses:
        if pause.at not in task.path:
            yield Finding(
                rule="pause-off-path",
                reason=f"The pause at {pause.at} is not on the path.",
                suggestion=f"Pause at one of {', '.join(task.path)}." if task.path else "Give the task a path.",
            )


def _chain_findings(human: Human) -> Iterator[Finding]:
    for before, after in pairwise(human.tasks):
        if before.path and after.path and before.path[-1] != after.path[0]:
            yield Finding(
                rule="broken-chain",
                human=human.name,
                task=after.name,
                position=0,
                reason=f'The task starts at {after.path[0]}, but "{before.name}" ended at {before.path[-1]}.',
                suggestion=f"Start at {before.path[-1]}.",
            )
    first, last = human.tasks[0], human.tasks[-1]
    if human.cyclic and first.path and last.path and first.path[0] != last.path[-1]:
        yield Finding(
            rule="open-loop",
            human=human.name,
            task=last.name,
            position=len(last.path) - 1,
            reason=f"The last task ends at {last.path[-1]}, but the first one starts at {first.path[0]}.",
            suggestion=f"Come back to {first.path[0]}.",
        )


def _walk_findings(human: Human) -> Iterator[Finding]:
    visited = {name for task in human.tasks for name in task.path}
    if human.cyclic and len(visited) == 1:
        yield Finding(
            rule="never-moves",
            human=human.name,
            reason=f"All tasks are at {next(iter(visited))}.",
            suggestion="Give the person somewhere to walk to.",
        )
    low, high = speed_range(human)
    if not low <= human.speed_m_s <= high:
        yield Finding(
            rule="speed-out-of-range",
            human=human.name,
            reason=f"A walking speed of {human.speed_m_s:g} m/s is outside {low:g} to {high:g} m/s.",
            suggestion=f"Take {min(max(human.speed_m_s, low), high):g} m/s.",
        )


def _crowd_findings(people: HumanConfiguration) -> Iterator[Finding]:
    if len(people.humans) > MAX_HUMANS:
        yield Finding(
            rule="too-many-humans",
            reason=f"There are {len(people.humans)} people; at most {MAX_HUMANS} are simulated.",
            suggestion=f"Leave {len(people.humans) - MAX_HUMANS} out.",
        )
    for name, count in Counter(human.name for human in people.humans).items():
        if count > 1:
            yield Finding(
                rule="same-name",
                human=name,
                reason=f"{count} people have this name.",
                suggestion="Give each person a different name.",
            )
    sizes = Counter(human.group for human in people.humans if human.group is not None)
    for human in people.humans:
        if human.group is not None and sizes[human.group] == 1:
            yield Finding(
                rule="group-of-one",
                human=human.name,
                reason=f"Nobody else is in group {human.group}.",
                suggestion="Put somebody else into the group, or leave it out.",
            )


def _mission_findings(people: HumanConfiguration, mission: Mission, world: World) -> Iterator[Finding]:
    for change in changes_that_matter(people, mission, world):
        yield Finding(
            rule="wrong-world",
            reason=change,
            suggestion="Give the world the scenario was made for, or adapt it with `rvsg scenario migrate`.",
        )
    yield from staged_findings(mission, world)
    start = mission.route.start
    if not robot_space(world).is_free(start.x, start.y):
        yield Finding(
            rule="robot-start-blocked",
            reason=f"The robot's start ({start.x:g}, {start.y:g}) of {mission.route.name} is not free in {world.name}.",
            suggestion="Move the route's start into free space.",
        )
    elif isinstance(mission.robot, Robot) and not fits_through(mission.robot, mission.route, world):
        yield Finding(
            rule="robot-too-wide",
            reason=f"{mission.robot.name} is {mission.robot.width_m:.2f} m wide; no way from the start to the goal of "
            f"{mission.route.name} is.",
            suggestion="Choose another route or another robot; `rvsg world check --robot` checks all routes.",
        )


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
    known = _known.setdefault(world, {})
    key = (a, b) if a < b else (b, a)
    if key not in known:
        known[key] = _leads_through(np.array(world.grid.position(a)), np.array(world.grid.position(b)), world)
    return known[key]


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
