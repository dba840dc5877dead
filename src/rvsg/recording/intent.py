"""A scenario of a recording: the mission of its robot among its people, as recorded, with their intent, or blended."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely

from rvsg.core.errors import FileError, UnknownName
from rvsg.core.records import Pose
from rvsg.evaluation.sampled import stretches
from rvsg.recording.inspection import misfits
from rvsg.recording.recorded_run import ARRIVES_M, speed_of
from rvsg.recording.tracks import GAP_S, PERIOD_S, Floats, Note, PersonTrack, Recording, clean
from rvsg.robots.robot import DEFAULT_ROBOT, Robot, load_robot
from rvsg.scenario.builder import check_valid, mission_of
from rvsg.scenario.rules import MAX_HUMANS, SPEED_RANGE_M_S
from rvsg.scenario.scenario import (
    BODY_RADIUS_M,
    ROBOT,
    Human,
    HumanConfiguration,
    Pause,
    Point,
    Scenario,
    Task,
    Track,
)
from rvsg.scenario.validity import check
from rvsg.simulation.embedded.people.crowd import Anticipation
from rvsg.world.space import Space, human_space, robot_space
from rvsg.world.world import Route, World

STANDS_M_S, STANDS_S = 0.2, 1.5
"""Who is slower than this for so long pauses."""
BENDS_M = (0.3, 0.15, 0.05)
"""How far the goals of a person may leave the track: the first of these with which every way is free."""
ONTO_M = 0.4
"""A goal becomes the waypoint that is nearer than this."""
DETOUR = 1.1
"""Two waypoints that are no neighbours are joined over the grid where that is no longer than so many times as far."""
AHEAD_M = 5.0
"""Who walks when last seen is taken to walk on for this far, up to the next obstacle."""
NEAR_START_M = 0.3
FASTER = 1.1
"""A recorded robot that is faster than the assumed one by this is another one."""
OTHER_ROUTE_M = 2.0
"""Who neither starts nor comes this near to the ends of a route drove another one."""


class People(str, Enum):
    """How the people of a recording move in a scenario."""

    AS_RECORDED = "as-recorded"
    INTENT = "intent"
    BLENDED = "blended"


@dataclass(frozen=True, kw_only=True)
class RecordedScenario:
    """A scenario, the cleaned recording it was made of, and notes on both."""

    scenario: Scenario
    recording: Recording
    notes: tuple[Note, ...]


def recorded_scenario(
    recording: Recording,
    world: World,
    *,
    people: People | str = People.BLENDED,
    route: Route | None = None,
    robot: Robot | str | Path | None = None,
    limit_m: float = 0.5,
) -> RecordedScenario:
    """Return the scenario of a recording, checked.

    Args:
        people: positions replayed without regard to the robot; start, goals, pauses and speed moved by the people
            model; or recorded until the robot is more than `limit_m` from where it was, and then with intent.
        route: the route the robot drove; by default from its first pose to its goal.

    Raises:
        FileError: nobody or no robot was recorded, or it does not start on the map.
        UnknownName: there is no such form of people.
        InvalidScenario: the scenario breaks a rule, such as a start of the robot outside of the map.
    """
    forms = [form.value for form in People]
    if people not in forms:
        raise UnknownName("form of people", str(people), forms)
    form = People(people)
    named = [replace(person, name=f"Person {k}") for k, person in enumerate(recording.people, start=1)]
    names = {person.name: other.name for person, other in zip(recording.people, named, strict=True)}
    contacts = [contact.replace(person=names[contact.person]) for contact in recording.contacts]
    mended = clean(replace(recording, people=tuple(named), contacts=tuple(contacts)))
    notes = list(mended.notes)
    notes += misfits(mended, world)
    if robot is None:
        notes.append(_assumed(mended))
    mission, said = mission_of(world, _route(mended, world, route, notes), ROBOT if robot is None else robot)
    notes += [Note(kind="route", text=text) for text in said]
    nearest = sorted(mended.people, key=lambda person: _nearest_m(mended, person))
    if (left_out := len(nearest) - MAX_HUMANS) > 0:
        text = f"{left_out} of {len(nearest)} people are left out, those farthest from the robot: {MAX_HUMANS} fit."
        notes.append(Note(kind="many", text=text, count=left_out))
        nearest = nearest[:MAX_HUMANS]
    mended = replace(mended, people=tuple(person for person in mended.people if person in nearest))
    end_s = float(mended.robot[-1, 0]) - GAP_S
    until_m = limit_m if form is People.BLENDED else None
    humans = []
    for person in mended.people:
        track = _track(person.rows, leaves=person.end_s < end_s, until_m=until_m)
        humans.append(_human(person, track, form, world, notes))
    if form is People.BLENDED:
        mission = mission.replace(driven=_track(mended.robot[:, :3], leaves=True))
    text = f"Recorded: {Path(recording.source).name}, people {form.value}."
    scenario = Scenario(mission=mission, people=HumanConfiguration(humans=tuple(humans)), description=text)
    humans = [_valid(human, scenario, world) for human in humans]
    scenario = scenario.replace(people=HumanConfiguration(humans=tuple(humans)))
    check_valid(scenario, world)
    return RecordedScenario(scenario=scenario, recording=mended, notes=tuple(notes))


def _assumed(recording: Recording) -> Note:
    """Return the note on the robot that is assumed; FileError where the recording contradicts it."""
    limit = load_robot(DEFAULT_ROBOT).limits.speed_m_s
    fast = float(np.quantile(speed_of(recording.robot), 0.95)) if len(recording.robot) > 1 else 0.0
    if fast > FASTER * limit:
        raise FileError(
            Path(recording.source),
            f"the robot drives {fast:.2f} m/s, and {DEFAULT_ROBOT}, which is assumed, at most {limit:g}. Name the "
            "robot: --robot FILE (`rvsg robots` lists those that ship).",
            code="robot-not-named",
        )
    return Note(kind="robot", text=f"The robot is assumed to be {DEFAULT_ROBOT}; --robot names another one.")


def _valid(human: Human, scenario: Scenario, world: World) -> Human:
    """Return a person who can walk in the world: over the grid where the recorded way leads through an obstacle."""
    wrong = {finding.rule for finding in check(scenario.people, scenario.mission, world) if finding.human == human.name}
    if "spawn-on-human" in wrong and human.start is not None:
        human = human.replace(track=Track(points=(human.start,), leaves=False))
    if {"leg-through-obstacle", "point-in-obstacle", "too-narrow", "door-closed"} & wrong:
        grid = world.grid
        path, points = human.tasks[0].path, human.points
        begin, end = (grid.nearest(*(points.get(name) or grid.position(name))) for name in (path[0], path[-1]))
        way = grid.shortest_path(begin, end) or (begin,)
        pauses = (Pause(at=way[0], duration_s=600.0),) if len(way) == 1 else ()
        human = human.replace(tasks=(Task(name="the recorded way", path=way, pauses=pauses),), points={})
    return human


def _nearest_m(recording: Recording, person: PersonTrack) -> float:
    places = person.at(recording.robot[:, 0])
    away = np.hypot(*(places - recording.robot[:, 1:3]).T)
    return float(np.nanmin(away)) if np.isfinite(away).any() else math.inf


def _route(recording: Recording, world: World, route: Route | None, notes: list[Note]) -> Route:
    """Return the route: from where the robot was when the drive began to the goal."""
    robot = recording.robot
    if len(robot) < 2:
        said = (
            "the recording holds no robot, whose drive a scenario needs. Record its odometry or its frames; in a table"
        )
        raise FileError(Path(recording.source), f"{said} its id is `robot`.")
    x, y, yaw = (round(float(value), 3) for value in robot[0, 1:4])
    start = Pose(x=x, y=y, yaw=yaw)
    if not robot_space(world).is_free(x, y):
        said = f"the robot starts at ({x:g}, {y:g}), which is not free in {world.name}."
        raise FileError(Path(recording.source), f"{said} Name the world whose map the robot drove with: --world.")
    if route is not None:
        away = math.dist((x, y), (route.start.x, route.start.y))
        short = float(np.hypot(*(robot[:, 1:3] - (route.goal.x, route.goal.y)).T).min())
        if min(away, short) > OTHER_ROUTE_M:
            nearest = min(world.routes, key=lambda other: math.dist((x, y), (other.start.x, other.start.y)))
            said = (
                f"the robot starts {away:.1f} m from the start of {route.name} and comes no nearer than {short:.1f} m "
                f"to its goal. Name the route that it drove, or none; {nearest.name} starts nearest."
            )
            raise FileError(Path(recording.source), said)
        if away > NEAR_START_M:
            notes.append(Note(kind="route", text=f"The robot starts {away:.2f} m from the start of {route.name}."))
        if short > ARRIVES_M:
            notes.append(
                Note(kind="route", text=f"The robot comes no nearer than {short:.2f} m to the goal of {route.name}.")
            )
        return route.model_copy(update={"start": start})
    goal = recording.goal
    if goal is None:
        notes.append(Note(kind="goal", text="The recording holds no goal; it is where the robot stops."))
        goal = (float(robot[-1, 1]), float(robot[-1, 2]), float(robot[-1, 3]))
    gx, gy, gyaw = (round(value, 3) for value in goal)
    limit_s = recording.header.time_limit_s if recording.header is not None else 2.0 * float(robot[-1, 0]) + 10.0
    return Route(name="as recorded", start=start, goal=Pose(x=gx, y=gy, yaw=gyaw), time_limit_s=round(limit_s, 1))


def _track(rows: Floats, *, leaves: bool, until_m: float | None = None) -> Track:
    """Return rows of time, x and y as a track: every 0.2 s, in millimetres."""
    times = np.arange(rows[0, 0], rows[-1, 0] + 1e-6, PERIOD_S)
    x, y = (np.interp(times, rows[:, 0], rows[:, k]) for k in (1, 2))
    points = tuple((round(float(a), 3), round(float(b), 3)) for a, b in zip(x, y, strict=True))
    start_s = max(0.0, round(float(times[0]), 3))
    return Track(start_s=start_s, period_s=PERIOD_S, points=points, leaves=leaves, until_m=until_m)


def _human(person: PersonTrack, whole: Track, form: People, world: World, notes: list[Note]) -> Human:
    """Return a person with intent, and with the track that the form asks for."""
    late = whole.start_s > PERIOD_S
    walks = person.rows[person.rows[:, 4] > 2.0 * STANDS_M_S, 4]
    low, high = SPEED_RANGE_M_S
    wanted = float(np.median(walks)) / Anticipation().speed_share if len(walks) else 1.0
    speed = round(min(max(wanted, low), high), 2)
    if abs(speed - wanted) > 0.01:
        text = f"{person.name} walks at {wanted:.1f} m/s, and with intent at {speed:g} m/s."
        notes.append(Note(kind="speed", text=text, person=person.name))
    path, pauses, points = _on_grid(_goals(person, whole.points[0], world), world)
    radius_m = person.radius_m if person.radius_m not in (None, BODY_RADIUS_M) else None
    return Human(
        name=person.name,
        tasks=(Task(name="the recorded way", path=path, pauses=pauses),),
        speed_m_s=speed,
        radius_m=radius_m,
        points=points,
        start=whole.points[0],
        cyclic=False,
        track=whole if form is not People.INTENT else _appearance(whole) if late else None,
    )


def _appearance(track: Track) -> Track:
    """Return the track of somebody who appears where this one begins, and then walks by intent."""
    return Track(start_s=track.start_s, points=track.points[:1], leaves=False)


Goal = tuple[Point, float]
"""A place and the pause there, s."""


def _goals(person: PersonTrack, start: Point, world: World) -> list[Goal]:
    """Return the places between which a person walks straight, and their pauses."""
    rows, space = person.rows, human_space(world)
    stops = [
        (first, last)
        for first, last in stretches(rows[:, 4] < STANDS_M_S)
        if rows[last, 0] - rows[first, 0] >= STANDS_S
    ]
    goals: list[Goal] = []
    for bend_m in BENDS_M:
        goals, begin = [(start, 0.0)], 0
        for first, last in [*stops, (len(rows) - 1, len(rows) - 1)]:
            way = rows[begin : first + 1, 1:3]
            if len(way) > 1:
                simple = shapely.get_coordinates(shapely.LineString(way).simplify(bend_m))[1:]
                goals += [((round(float(x), 3), round(float(y), 3)), 0.0) for x, y in simple]
            goals[-1] = (goals[-1][0], goals[-1][1] + float(rows[last, 0] - rows[first, 0]))
            begin = last
        goals = [(_freed(at, space), pause) for at, pause in goals]
        ways = np.array([at for at, _ in goals])
        if space.segments_free(ways[:-1], ways[1:]).all():
            break
    if not stops or stops[-1][1] < len(rows) - 1:
        goals[-1] = (_ahead(rows, goals[-1][0], space), goals[-1][1])
    return goals


def _freed(at: Point, space: Space) -> Point:
    """Return the nearest place where a person can stand, within a metre."""
    angles = np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False)
    for away in np.arange(0.0, 1.0, 0.05):
        for x, y in np.array(at) + away * np.column_stack([np.cos(angles), np.sin(angles)]):
            if space.is_free(x, y):
                return round(float(x), 3), round(float(y), 3)
    return at


def _ahead(rows: Floats, last: Point, space: Space) -> Point:
    """Return where somebody goes who walks when last seen: straight on, up to the next obstacle."""
    before = rows[rows[:, 0] >= rows[-1, 0] - 1.0]
    move = before[-1, 1:3] - before[0, 1:3]
    length = float(np.hypot(*move))
    farthest = last
    for away in np.arange(0.25, AHEAD_M if length > STANDS_M_S else 0.0, 0.25):
        x, y = np.array(last) + away * move / length
        if not space.segment_free(last, (x, y), BODY_RADIUS_M):
            break
        farthest = (round(float(x), 3), round(float(y), 3))
    return farthest


def _on_grid(goals: list[Goal], world: World) -> tuple[tuple[str, ...], tuple[Pause, ...], dict[str, Point]]:
    """Return path, pauses and free points: waypoints where they are near and neighbours, else coordinates."""
    grid, space = world.grid, human_space(world)
    path: list[str] = []
    pauses: list[Pause] = []
    points: dict[str, Point] = {}
    here = goals[0][0]
    for k, (at, pause) in enumerate(goals):
        name = grid.nearest(*at) if k > 0 and grid.valid else ""
        way: tuple[str, ...] | None = (name,)
        if name and path and path[-1] not in points and name not in (path[-1], *grid.neighbours[path[-1]]):
            way = grid.shortest_path(path[-1], name)
            way = way[1:] if way is not None and _length(way, world) <= DETOUR * math.dist(here, at) else None
        place = grid.position(name) if name else at
        if not name or way is None or math.dist(place, at) > ONTO_M or not space.segment_free(here, place):
            name, place = f"point {k + 1}", at
            way, points[name] = (name,), at
        path += [step for step in way if not path or step != path[-1]]
        here = place
        if pause > 0.0:
            pauses.append(Pause(at=name, duration_s=min(600.0, round(pause, 1))))
    if len(path) == 1 and not pauses:
        pauses.append(Pause(at=path[0], duration_s=600.0))
    return tuple(path), tuple(pauses), points


def _length(way: tuple[str, ...], world: World) -> float:
    return sum(math.dist(world.grid.position(a), world.grid.position(b)) for a, b in pairwise(way))
