"""Facts and pictures for prompts: plain values under the names that templates declare, and the maps models see."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from rvsg.generation.generator import Rehearsal
from rvsg.generation.replies import LONGEST_DELAY_S, MOST_MOVED
from rvsg.generation.result_facts import FEWER_ROWS, MOST_ROWS, feedback_facts, passes_of
from rvsg.generation.vlm.model import Picture
from rvsg.scenario.brief import Brief, Feedback, Remembered, mechanism_of
from rvsg.scenario.placement import start_gap_m
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.rules import SPEED_RANGE_M_S, START_CLEARANCE_M
from rvsg.scenario.scenario import (
    BODY_RADIUS_M,
    LIMITS,
    TROLLEY_LENGTHS_M,
    TROLLEY_SPEEDS_M_S,
    TROLLEY_WIDTHS_M,
    WHEELCHAIR,
    Attention,
    Behaviour,
    Human,
    Mission,
    PersonKind,
)
from rvsg.scenario.validity import is_walkable
from rvsg.world.grid import Grid
from rvsg.world.lattice import open_share
from rvsg.world.passages import known_purpose, least_widths_m, route_paragraph
from rvsg.world.space import human_space
from rvsg.world.world import Area, Description, Route, World

NEAREST_STARTS = 4

MEANINGS = {
    Behaviour.REGULAR: "makes room for the robot as for another person; who waits or pauses steps aside when its body "
    "comes within 0.5 m of theirs, and then comes back, which costs it a second or two, not the drive",
    Behaviour.IMPASSIVE: "walks round the robot as round a wall, without making room; who waits or pauses stays until "
    "its body is within 0.4 m of theirs, then steps aside and comes back",
    Behaviour.SURPRISED: "stops and looks at the robot, for up to 30 s while it is within 4 m and in view; does not "
    "step aside then, and steps back only when it touches",
    Behaviour.SCARED: "walks on at 0.6 m/s at most and is pushed away from the robot, for up to 40 s while it is "
    "within 3 m and in view",
    Behaviour.CURIOUS: "comes up to the robot, slower the nearer, for up to 40 s while it is within 10 m and in view; "
    "stops at 1.5 m, does not step aside then, and steps back only when it touches",
    Behaviour.THREATENING: "hurries to a point 1.4 m in front of the robot and blocks it, for up to 40 s while it is "
    "within 4.5 m and in view; does not make room for it then",
}
"""What HuNavSim's behaviours do, with the default distances and durations of `rvsg.scenario.scenario`."""
ATTENTIONS = {
    Attention.ATTENTIVE: "looks ahead and keeps clear of others and of the robot in time",
    Attention.DISTRACTED: "looks at a phone or over a load, so notices others and the robot late, "
    "about a second before",
    Attention.UNSEEING: "walks backwards or behind a tall load and sees nobody; only contact stops them",
}
PROVOKING = frozenset({Behaviour.THREATENING})
"""Behaviours against the robot: offered only where the generator's option `provoking` allows them."""


def offered(provoking: bool) -> tuple[Behaviour, ...]:
    """Return the behaviours that may be chosen."""
    return tuple(b for b in Behaviour if provoking or b not in PROVOKING)


def human_names(count: int) -> tuple[str, ...]:
    """The names humans go by in every prompt: Human 1, Human 2, ..."""
    return tuple(f"Human {number}" for number in range(1, count + 1))


def world_facts(world: World, description: Description | None = None) -> dict[str, Any]:
    """Areas, grid and description of a world."""
    described, grid = description or world.description, world.grid
    xs, ys = zip(*WHEELCHAIR, strict=True)
    return {
        "world_title": world.title,
        "provoking": False,
        "activities": list(world.activities),
        "actors": list(world.actors),
        "actor_limits": {
            "child": LIMITS[PersonKind.CHILD].speeds_m_s,
            "wheelchair": LIMITS[PersonKind.WHEELCHAIR].speeds_m_s,
            "wheelchair_m": (max(xs) - min(xs), max(ys) - min(ys)),
            "trolley": TROLLEY_SPEEDS_M_S,
            "trolley_length_m": TROLLEY_LENGTHS_M,
            "trolley_width_m": TROLLEY_WIDTHS_M,
            "moved": MOST_MOVED,
        },
        "layout": described.layout if described else "",
        "grid": described.grid if described else "",
        "areas": [
            {
                "name": area.name,
                "kind": area.kind,
                "region": area.region,
                "note": area.note,
                "size": _size(area, world),
                "waypoints": _in_rows([name for name in area.waypoints if name in grid.valid], grid),
            }
            for area in world.areas
        ],
        "rows": [{"name": name, "at": at} for name, at in grid.row_positions.items()],
        "columns": [{"name": name, "at": at} for name, at in grid.column_positions.items()],
        "row_axis": grid.up,
        "column_axis": grid.across,
        "neighbours": [
            {"name": name, "to": [other for other in others if is_walkable(name, other, world)]}
            for name, others in grid.neighbours.items()
        ],
        **neighbour_rule(grid, [(a, b) for a, b in grid.hops if is_walkable(a, b, world)]),
        "invalid": _invalid(grid),
    }


def _size(area: Area, world: World) -> str:
    """Return the size of a thing of a bare map, which has no objects to know it by; empty for open floor."""
    if world.objects or open_share(area.outline, human_space(world)) > 0.5:
        return ""
    xs, ys = zip(*area.outline, strict=True)
    return f"{max(xs) - min(xs):.1f} x {max(ys) - min(ys):.1f} m"


def _in_rows(names: Sequence[str], grid: Grid) -> list[str]:
    """Return names of waypoints with three or more neighbours of one row in a row as in `G11-G14`."""
    found: list[list[str]] = []
    for name in names:
        before = grid.by_name[found[-1][-1]] if found else None
        here = grid.by_name[name]
        if before is not None and (here.row, here.column) == (before.row, before.column + 1):
            found[-1].append(name)
        else:
            found.append([name])
    return [word for run in found for word in ([f"{run[0]}-{run[-1]}"] if len(run) > 2 else run)]


def _invalid(grid: Grid) -> list[str]:
    """Where nobody can stand: rows with the same columns together, as in `rows A B: 2-8,10`."""
    taken: dict[str, list[int]] = {}
    for waypoint in grid.waypoints:
        if not waypoint.human:
            taken.setdefault(grid.rows[waypoint.row], []).append(waypoint.column)
    alike: dict[tuple[int, ...], list[str]] = {}
    for row, columns in taken.items():
        alike.setdefault(tuple(sorted(columns)), []).append(row)
    found = []
    for numbers, rows in alike.items():
        words: list[str] = []
        for _, group in itertools.groupby(enumerate(numbers), key=lambda pair: pair[1] - pair[0]):
            run = [grid.columns[number] for _, number in group]
            words += [f"{run[0]}-{run[-1]}"] if len(run) > 2 else run
        found.append(f"row{'s' if len(rows) > 1 else ''} {' '.join(rows)}: {','.join(words)}")
    return found


def brief_facts(
    brief: Brief, world: World, *, provoking: bool = False, undisturbed: Rehearsal | None = None
) -> dict[str, Any]:
    """Return route, requirement, humans, memory and feedback of a brief."""
    requirement, mission, grid = brief.requirement, brief.mission, world.grid
    fields = Human.model_fields
    radius = BODY_RADIUS_M
    # Where nobody may start because of the robot, and the nearest waypoints where people may.
    start = mission.route.start
    free = [waypoint for waypoint in grid.waypoints if waypoint.human]
    taken = [w.name for w in free if start_gap_m(radius, (w.x, w.y), mission) < START_CLEARANCE_M]
    rest = sorted(free, key=lambda w: (math.dist((w.x, w.y), (start.x, start.y)), w.name))
    starts = {
        "taken": taken or [grid.nearest(start.x, start.y)],
        "nearest_starts": [w.name for w in rest if w.name not in taken][:NEAREST_STARTS],
        "apart_m": 2 * radius,
    }
    drive = None
    if undisturbed is not None and undisturbed.robot:
        pairs = zip(undisturbed.robot, _widths_m(undisturbed, mission.place(world)), strict=True)
        line = [{"time_s": time, "at": at, "width_m": width} for (time, at), width in pairs]
        able = undisturbed.abilities
        drive = {"line": line, "arrival_s": undisturbed.arrival_s, "abilities": able.model_dump() if able else None}
    return {
        "route": route_facts(mission, world, undisturbed) | starts,
        "drive": drive,
        "requirement": requirement_facts(requirement) | {"moved_by": brief.moved_by} if requirement else None,
        "robot": _robot_facts(mission),
        "humans": brief.humans,
        "names": list(human_names(brief.humans)),
        "behaviours": [{"name": b.value, "meaning": MEANINGS[b]} for b in offered(provoking)],
        "attentions": [{"name": a.value, "meaning": meaning} for a, meaning in ATTENTIONS.items()],
        "provoking": provoking,
        "speed_range": list(SPEED_RANGE_M_S),
        "longest_delay_s": LONGEST_DELAY_S,
        "person_radius_m": radius,
        "goal_radius_m": fields["goal_radius_m"].default,
        "walking_speed_m_s": fields["speed_m_s"].default,
        "tunes": brief.tunes,
        **told_facts(brief, world, undisturbed),
    }


def _widths_m(undisturbed: Rehearsal, place: World) -> list[float] | list[None]:
    """Return the least free width across the robot's way from each entry of its time line to the next.

    None where the way is not known.
    """
    if len(undisturbed.way) < 2:
        return [None] * len(undisturbed.robot)
    times, x, y = np.array(undisturbed.way).T
    starts = np.minimum(np.searchsorted(times, [time for time, _ in undisturbed.robot]), len(times) - 1)
    return least_widths_m(place, np.column_stack([x, y]), starts.tolist())


def told_facts(brief: Brief, world: World, undisturbed: Rehearsal | None, most_rows: int = MOST_ROWS) -> dict[str, Any]:
    """Return what a brief tells of runs, with at most so many lines in a table."""
    requirement, passes, met = brief.requirement, passes_of(undisturbed, world.grid), ""
    if brief.feedback is not None and brief.feedback.encounter is not None:
        met = mechanism_of(brief.feedback.encounter)
    memory = [
        _remembered(e) | {"same": e.mechanism == met != "", "same_as": _same_as(e, brief.memory)} for e in brief.memory
    ]
    fewer = min(FEWER_ROWS, most_rows)

    def told_of(feedback: Feedback | None, rows: int) -> dict[str, Any] | None:
        if feedback is None:
            return None
        return feedback_facts(feedback, requirement, passes, rows, mission=brief.mission)

    return {
        "memory": memory,
        "lessons": list(brief.lessons),
        "feedback": told_of(brief.feedback, most_rows),
        "untold": told_of(brief.untold, fewer),
    }


def route_facts(mission: Mission, world: World, undisturbed: Rehearsal | None = None) -> dict[str, Any]:
    """Return a route as prompts tell it; `start` and `goal` are the nearest waypoints, `length_m` follows `via`.

    `description` is the user's own, else a paragraph written from the `undisturbed` drive, or from the route.
    """
    route, grid = mission.route, world.grid
    inner = [grid.position(name) for name in route.via if name in grid.by_name]
    points = [(route.start.x, route.start.y), *inner, (route.goal.x, route.goal.y)]
    driven = None
    if undisturbed is not None and undisturbed.arrival_s is not None and len(undisturbed.way) > 1:
        driven = np.array([(x, y) for _, x, y in undisturbed.way])
    return {
        "name": route.name,
        "purpose": known_purpose(world, route),
        "start": grid.nearest(route.start.x, route.start.y),
        "goal": grid.nearest(route.goal.x, route.goal.y),
        "via": list(route.via),
        "description": route_paragraph(mission.place(world), route, driven, robot=mission.robot_record),
        "described_by_user": bool(route.description),
        "time_limit_s": route.time_limit_s,
        "length_m": sum(math.dist(a, b) for a, b in itertools.pairwise(points)),
    }


def _robot_facts(mission: Mission) -> dict[str, Any] | None:
    """Speed, size and goal tolerance of the robot; None for a robot that only another simulator knows."""
    robot = mission.robot_record
    if robot is None:
        return None
    xs, ys = zip(*robot.footprint, strict=True)
    return {
        "speed_m_s": min(robot.limits.speed_m_s, robot.navigation.smoother.max_speed_m_s or math.inf),
        "length_m": max(xs) - min(xs),
        "width_m": max(ys) - min(ys),
        "goal_tolerance_m": robot.navigation.behaviours.goal_tolerance_m,
    }


def requirement_facts(requirement: Requirement) -> dict[str, Any]:
    """A requirement as prompts tell it."""
    rule = f"how far the drive is from breaking the rule: {requirement.formula} (below 0 it is broken)"
    return {
        "title": requirement.title,
        "text": requirement.text,
        "measure": requirement.measured_as or (rule if requirement.formula is not None else str(requirement.metric)),
        "unit": requirement.unit,
        "worse": requirement.worse,
        "limit": requirement.threshold,
        "of_contact": (requirement.metric or "").startswith("contact"),
    }


def _same_as(one: Remembered, memory: Sequence[Remembered]) -> int | None:
    """Return the number, from 1, of the first earlier scenario that meets the robot in the same way and place."""
    number = next(k for k, each in enumerate(memory, start=1) if each is one or each.mechanism == one.mechanism != "")
    return number if memory[number - 1] is not one else None


def _remembered(earlier: Remembered) -> dict[str, Any]:
    how = {}
    for human in earlier.scenario.people.humans:
        waits = f", sets off after {human.start_delay_s:g} s" if human.start_delay_s else ""
        looks = "" if human.attention is Attention.ATTENTIVE else f", {human.attention.value}"
        how[human.name] = f"{human.behaviour.value}{looks}, {human.speed_m_s:g} m/s{waits}"
    return {
        "description": earlier.description,
        "tasks": [{"name": name, "how": how.get(name, ""), "tasks": list(t)} for name, t in earlier.tasks.items()],
        "capped": earlier.capped,
        "runs": earlier.runs,
        "mean": earlier.mean,
        "lesson": earlier.lesson,
        "mechanism": earlier.mechanism,
    }


def neighbour_rule(grid: Grid, hops: Iterable[tuple[str, str]]) -> dict[str, Any]:
    """Return the neighbour list as a rule and its exceptions, of the hops that a person fits through.

    `diagonal` says whether the rule joins diagonal waypoints; `not_joined` are pairs that the rule joins and the map
    does not, by their first waypoint, `also_joined` pairs that the map joins and the rule does not.
    """
    valid = [waypoint for waypoint in grid.waypoints if waypoint.human]
    at = {(waypoint.row, waypoint.column): waypoint.name for waypoint in valid}
    free = {frozenset(hop) for hop in hops}
    straight, diagonal = set[frozenset[str]](), set[frozenset[str]]()
    for (row, column), name in at.items():
        for (down, right), pairs in (((0, 1), straight), ((1, 0), straight), ((1, 1), diagonal), ((1, -1), diagonal)):
            if other := at.get((row + down, column + right)):
                pairs.add(frozenset((name, other)))
    with_diagonals = len(diagonal - free) <= len(diagonal & free)
    ruled = straight | diagonal if with_diagonals else straight
    order = {waypoint.name: i for i, waypoint in enumerate(grid.waypoints)}

    def listed(pairs: Iterable[frozenset[str]]) -> list[dict[str, Any]]:
        found: dict[str, list[str]] = {}
        for first, second in sorted(sorted(pair, key=order.__getitem__) for pair in pairs):
            found.setdefault(first, []).append(second)
        return [{"name": name, "to": sorted(to, key=order.__getitem__)} for name, to in found.items()]

    return {"diagonal": with_diagonals, "not_joined": listed(ruled - free), "also_joined": listed(free - ruled)}


Way = tuple[tuple[float, float, float], ...]
PICTURE_WIDTH_PX = 1600
MAP_WIDTH_PX = 1024
"""Services cut pictures into tiles of 512 x 512 and charge for each."""


def pictures_of(world: World, route: Route | None = None, way: Way = ()) -> tuple[Picture, Picture]:
    """Return the labelled map and the grid picture; the map shows the drive without people (seconds, x, y)."""
    return _labelled_map(world, route, way), _grid_picture(world)


@lru_cache(maxsize=16)
def _labelled_map(world: World, route: Route | None, way: Way) -> Picture:
    from rvsg.world.drawing import labelled_map, png_bytes

    moves = len({(x, y) for _, x, y in way}) > 1
    drawn = labelled_map(world, width_px=MAP_WIDTH_PX, route=route, way=way if moves else None)
    return Picture(name="labelled map", png=png_bytes(drawn))


@lru_cache(maxsize=4)
def _grid_picture(world: World) -> Picture:
    from rvsg.world.drawing import grid_picture, png_bytes

    return Picture(name="grid of waypoints", png=png_bytes(grid_picture(world, width_px=PICTURE_WIDTH_PX)))


@lru_cache(maxsize=4)
def birdseye_of(world: World) -> Picture | None:
    """Return the world seen slantingly from above; None for a bare map, which does not know its heights.

    Only the description of a world is shown it: tall things hide what is behind them.
    """
    if not world.objects:
        return None
    from rvsg.world.drawing import png_bytes
    from rvsg.world.drawing.birdseye import birdseye

    return Picture(name="bird's-eye view", png=png_bytes(birdseye(world, width_px=PICTURE_WIDTH_PX)))
