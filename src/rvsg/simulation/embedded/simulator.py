"""The embedded simulator: a Nav2-like robot among HuNavSim-like people, deterministic, hundreds of times real time."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from rvsg.core.angles import wrap
from rvsg.core.errors import InputError, SimulationError
from rvsg.core.kernels import cache_folder, compilation_reported, is_cached, seal_cache
from rvsg.core.records import Pose
from rvsg.core.seeds import stream
from rvsg.robots.polygons import rectangle
from rvsg.robots.robot import DEFAULT_ROBOT, Robot, load_robot
from rvsg.scenario.scenario import HumanAgent, Scenario, Track, decode
from rvsg.simulation.costmap import LETHAL
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.behaviour_tree import navigation_events
from rvsg.simulation.embedded.driving import Driving, called_every
from rvsg.simulation.embedded.episode import Episode, Outside, go_on, new_recording
from rvsg.simulation.embedded.localisation import Localisation
from rvsg.simulation.embedded.moving_bodies import MovingBodies, placed
from rvsg.simulation.embedded.navfn import HIGH
from rvsg.simulation.embedded.people.contact import events_of
from rvsg.simulation.embedded.people.crowd import initial
from rvsg.simulation.embedded.people.recorded import RecordedPeople
from rvsg.simulation.embedded.profiles import (
    PROFILES,
    SimulatorOptions,
    body_radius_m,
    draw_intervals,
    draw_phases,
    draw_settings,
    new_localisation,
    people_options,
    profile,
)
from rvsg.simulation.embedded.profiles import profile as named_profile
from rvsg.simulation.embedded.robot_parameters import stack_of
from rvsg.simulation.embedded.rollouts import Rollouts, sample_table
from rvsg.simulation.embedded.rollouts import rollouts as new_rollouts
from rvsg.simulation.embedded.state import Scene, State, Surroundings, latest, new_state
from rvsg.simulation.embedded.walls import free_pose, is_stuck, obstacle_contacts
from rvsg.simulation.events import in_order
from rvsg.simulation.run import Outcome, Run, Trajectory
from rvsg.simulation.simulators import Simulator
from rvsg.simulation.stacks.nav2_stack import Nav2Dwb
from rvsg.simulation.stacks.protocol import NavigationStack, Task
from rvsg.simulation.stacks.stack_choice import StackChoice, StackLike, default_stack
from rvsg.world.grid import Grid
from rvsg.world.world import OccupancyMap, Route, World

Floats = NDArray[np.float64]


def empty_room() -> World:
    """A walled room of 6 x 6 m that is nothing but an occupancy map."""
    cells = np.zeros((120, 120), np.uint8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    return World(
        name="room",
        title="An empty room",
        objects=(),
        occupancy=OccupancyMap(cells=cells, resolution=0.05, origin=Pose(x=-3.0, y=-3.0)),
        lidar_height_m=0.2,
        grid=Grid(rows=(), columns=(), waypoints=(), hops=()),
        areas=(),
        routes=(),
    )


def rehearsal() -> tuple[World, Route, list[HumanAgent]]:
    """The room, a route of half a second through it, and one human."""
    route = Route(name="rehearsal", start=Pose(x=-1.0, y=0.0), goal=Pose(x=1.5, y=0.5), time_limit_s=0.5)
    human = HumanAgent(name="human", start=(0.5, 1.0), goals=((0.5, 1.0), (0.5, -1.0)), pauses_s=(0.0, 0.0))
    return empty_room(), route, [human]


KEPT_STARTS = 8
"""The runs of a campaign have few starts, and what is in the way there does not change."""
START_OVERLAP_M = 0.01
"""In the default profile a run does not start where the robot's body and a person overlap by more than this."""


def is_blocked(around: Surroundings, scene: Scene, start: Pose, offset: tuple[float, float]) -> bool:
    """Whether the robot's footprint at the start lies on an occupied cell, off the map, or in what a lidar sees.

    So it is where a lidar is inside something solid, from where it would see through walls.
    """
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    (rear, right), (front, left) = rectangle(around.robot.footprint)
    resolution, static = scene.resolution, scene.static
    n = max(3, int((front - rear) / (0.5 * resolution)))
    ahead, aside = np.meshgrid(np.linspace(rear, front, n), np.linspace(right, left, n))
    x = start.x + ahead * cos - aside * sin
    y = start.y + ahead * sin + aside * cos
    columns = np.floor((x - offset[0] - scene.origin_x) / resolution).astype(int)
    rows = np.floor((y - offset[1] - scene.origin_y) / resolution).astype(int)
    if rows.min() < 0 or columns.min() < 0 or rows.max() >= static.shape[0] or columns.max() >= static.shape[1]:
        return True
    return bool((static[rows, columns] == LETHAL).any()) or _is_in_solid(around, start)


@lru_cache(maxsize=KEPT_STARTS)
def _is_in_solid(around: Surroundings, start: Pose) -> bool:
    """Whether the robot's footprint or a lidar is in what the lidar plane cuts.

    A lidar on a mast that stands out of the footprint may be.
    """
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    lidars = [(start.x + cos * q.x - sin * q.y, start.y + sin * q.x + cos * q.y) for q in around.robot.lidars]
    if any(around.is_inside_solid(x, y) for x, y in ((start.x, start.y), *lidars)):
        return True
    (rear, right), (front, left) = rectangle(around.robot.footprint)
    corners = np.array([(rear, right), (front, right), (front, left), (rear, left)])
    edges = shapely.linestrings(around.edges.reshape(-1, 2, 2))
    return bool(shapely.intersects(placed(corners, start.x, start.y, start.yaw), edges).any())


NAME = "embedded"
VERSION = 10
"""Raise it when equal options and seeds give other runs than before."""
_KEPT = 8
_KEPT_ROLLOUTS = 3
_SURROUNDINGS: OrderedDict[tuple[str, str], Surroundings] = OrderedDict()
_ROLLOUTS: OrderedDict[str, Rollouts] = OrderedDict()


class EmbeddedSimulator(Simulator):
    """The in-process simulator behind the `Simulator` protocol.

    `profile` is `default` (how things should be), `hunavsim` (the same with HuNavSim's people) or `published-study`
    (with the defects of the published runs); further options are those of `SimulatorOptions`, e.g.
    `noise={"lidar": 0}`. `stack`: what drives the robot, by default `default_stack` of the profile.
    """

    name = NAME
    any_robot = True
    code_options = ()  # the stack is checked where it is made

    def __init__(self, profile: str = "default", *, stack: StackLike | None = None, **options: Any) -> None:
        self._options = named_profile(profile, **options)
        self._stack = StackChoice.of(default_stack(profile) if stack is None else stack)

    @property
    def options(self) -> dict[str, object]:
        """The effective options, as they are stored with every run."""
        return stored_options(self._options, self._stack)

    def notes(self, robot: Robot) -> tuple[str, ...]:
        """Tell where the stack leaves lateral motion unused."""
        if self._stack.driver.sideways or robot.limits.lateral_m_s == 0.0:
            return ()
        name = self._stack.record.name
        return (f"{robot.name} can move sideways, but {name} never does; nav2-dwb and stacks of your own may.",)

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Compile or load the kernels before the first run; `tell` hears of it only where they must be compiled."""
        warm_up(tell)
        for text in self._stack.messages:
            tell(text)
        self._stack.driver.prepare(tell)

    def close(self) -> None:
        """Close the stack under test, unless it was given as an instance."""
        self._stack.close()

    def run(self, scenario: Scenario, world: World, *, seed: int, outside: Outside | None = None) -> Run:
        """Simulate one episode; raises InputError where world or scenario cannot be simulated at all.

        `outside`: what else is computed by the caller, such as a recorder.
        """
        mission, agents = scenario.mission, decode(scenario.people, world.grid, body_radius_m(self._options))
        return simulate_agents(
            world, mission.route, agents, options=self._options, seed=seed, scenario_id=scenario.id,
            robot=mission.robot_record, stack=self._stack, outside=outside, driven=mission.driven,
        )  # fmt: skip


def stored_options(options: SimulatorOptions, stack: StackChoice) -> dict[str, object]:
    """Return options as plain data, with the version of the simulator's rules and the content of the default robot.

    The stack is among them with its version, but for that of the published study: runs without one are of it.
    """
    stored = {"version": VERSION, "default_robot": load_robot(DEFAULT_ROBOT).id, **options.model_dump(mode="json")}
    return stored if stack.is_study else {**stored, "stack": stack.record.model_dump(mode="json")}


def simulate_agents(
    world: World,
    route: Route,
    agents: Sequence[HumanAgent],
    *,
    options: SimulatorOptions | None = None,
    seed: int = 0,
    scenario_id: str = "",
    robot: Robot | None = None,
    stack: StackChoice | None = None,
    outside: Outside | None = None,
    driven: Track | None = None,
) -> Run:
    """Simulate one episode of a route among humans given in coordinates; `robot` is the TIAGo OMNI base by default.

    A robot that starts in an obstacle or off the map is an Outcome. `stack`: what drives, by default `default_stack`
    of the profile. `outside`: what else is computed by the caller, not by the compiled loop.
    `driven`: where the robot of a recording was, whose people follow their tracks.

    Raises:
        InputError: a number is not finite, the time limit is not positive or the map is turned.
    """
    options = options or profile()
    route = _settled(route, options.settling_m)
    _check(route, seed)
    stack = stack or StackChoice.of(default_stack(options.profile))
    robot = stack.driver.adapt(robot or load_robot(DEFAULT_ROBOT))
    wanted = {"rays": options.lidar_rays, "max_range_m": options.lidar_range_m, "noise_m": options.lidar_noise_m}
    if changes := {name: value for name, value in wanted.items() if value is not None}:
        robot = robot.replace(lidars=tuple(lidar.replace(**changes) for lidar in robot.lidars))
    around = surroundings(world, robot)
    walls = around.walls()
    start = free_pose(walls, route.start) if options.solid_walls else route.start
    if start is not None:
        route = route.model_copy(update={"start": start})
    settings, scene, offset = draw_settings(world, route, options, around, seed)
    goals = np.array([[p.x, p.y, p.yaw] for p in (*route.through, route.goal)], np.float64)
    if not options.goals_in_map_frame:
        goals[:, :2] -= offset
    crowd = initial(
        agents, world, options=people_options(options), seed=seed, robot=robot,
        time_limit_s=route.time_limit_s * settings.clock,
    )  # fmt: skip
    moving = None
    bodies = bool(world.moving_doors) or any(agent.outline for agent in agents)
    tracks = any(agent.track for agent in agents)
    if options.human_defects and (bodies or tracks):
        raise InputError(
            "the profile published-study knows no automatic doors, trolleys, wheelchairs and recorded tracks; take the "
            "default profile"
        )
    if bodies:
        moving = MovingBodies(world.moving_doors, agents, scene, walls, crowd)
        scene, walls, crowd = moving.scene, moving.walls, moving.crowd
    recorded = RecordedPeople(agents, driven, crowd) if tracks else None
    record = new_recording(route.time_limit_s, settings.clock, len(agents))
    blocked = start is None or is_blocked(around, scene, route.start, offset)
    if not options.human_defects:
        begin = route.start
        body = placed(crowd.outline, begin.x, begin.y, begin.yaw)
        apart = shapely.distance(body, shapely.points(crowd.x, crowd.y))
        blocked |= bool((crowd.radius - apart > START_OVERLAP_M).any())
        blocked |= moving is not None and moving.on_robot(begin.x, begin.y, begin.yaw)
    own = new_localisation(world, route, options, around, offset, seed)
    rest = around.rest_of_way(scene, goals)
    state = new_state(scene, goals, len(agents), robot, walls, own, rollouts(robot), rest)
    details: dict[str, object] = {}
    state.body[base.X : base.YAW + 1] = (route.start.x, route.start.y, wrap(route.start.yaw))
    if blocked:
        for rows, humans in ((record.track, record.track_humans), (record.log, record.log_humans)):
            rows[0, 1:4] = (route.start.x, route.start.y, route.start.yaw)
            humans[0, :, :3] = np.column_stack([crowd.x, crowd.y, crowd.yaw])
        record.counts[:] = (1, 1, 0)
        outcome = Outcome.BLOCKED_START
    else:
        stream(seed, "lidar").standard_normal(out=state.noise)
        if any(lidar.dropout > 0.0 for lidar in robot.lidars):
            stream(seed, "lidar/dropouts").random(out=state.dropouts)
        phases, intervals = draw_phases(options, seed), draw_intervals(options, seed, route)
        driving = None
        if not isinstance(stack.driver, Nav2Dwb):
            driving = Driving(stack.driver, _task(stack.driver, robot, world, route, goals, own, seed))
            outside = driving.outside(outside)
        steps = [each.step for each in (recorded, moving) if each is not None]

        def step(t: float, body: Floats) -> None:
            for one in steps:
                one(t, body)

        Episode(scene, state, settings, crowd, phases, intervals, record, outside, step if steps else None).run()
        if moving is not None:
            moving.finish(float(record.track[int(record.counts[0]) - 1, 0]))
        outcome = _outcome(state)
        if driving is not None:
            told = driving.details()
            details["stack"] = told
            state.nav[st.RECOVERIES] = told.get("recoveries", state.nav[st.RECOVERIES])
            outcome = outcome if driving.fault is None else Outcome.STACK_FAILED
    sideways = robot.limits.lateral_m_s > 0.0
    end = goals[-1] + (offset[0], offset[1], 0.0)
    if recorded is not None:
        details["absent_at"] = recorded.absent_at
    if recorded is not None and recorded.left_s:
        details["left_tracks_s"] = recorded.left_s
    details["map_from_world"] = [float(number) for number in own.frame[:3]]
    return Run(
        scenario_id=scenario_id,
        simulator=NAME,
        options=stored_options(options, stack),
        seed=seed,
        outcome=outcome,
        trajectory=_trajectory(record.track, record.track_humans, int(record.counts[0]), sideways),
        log=_trajectory(record.log, record.log_humans, int(record.counts[1]), sideways),
        imu=_finite(record.imu[: int(record.counts[2])].copy()),
        clock_ratio=settings.clock,
        robot_radius_m=robot.radius_m,
        robot_outline=() if options.human_defects else robot.outline,
        robot_latency_s=robot.latency_s,
        robot_deceleration_m_s2=robot.limits.deceleration_m_s2,
        human_names=tuple(agent.name for agent in agents),
        human_radius_m=tuple(agent.radius_m for agent in agents),
        human_groups=tuple(agent.group for agent in agents),
        human_outlines=tuple(agent.outline for agent in agents) if any(agent.outline for agent in agents) else (),
        goal=(float(end[0]), float(end[1]), float(end[2])),
        time_limit_s=route.time_limit_s,
        recoveries=int(state.nav[st.RECOVERIES]),
        events=in_order(
            [
                *events_of(crowd, [agent.name for agent in agents], [agent.behaviour for agent in agents]),
                *obstacle_contacts(walls),
                *navigation_events(state),
                *(() if moving is None else moving.events()),
            ]
        ),
        details=details,
    )


def _task(
    driver: NavigationStack, robot: Robot, world: World, route: Route, goals: Floats, own: Localisation, seed: int
) -> Task:
    """What a stack under test is told before a run."""
    x, y, turn = own.present
    cos, sin = math.cos(turn), math.sin(turn)
    begin = route.start
    return Task(
        robot=robot,
        world=world,
        start=Pose(x=cos * begin.x - sin * begin.y + x, y=sin * begin.x + cos * begin.y + y, yaw=begin.yaw + turn),
        goals=tuple(Pose(x=float(gx), y=float(gy), yaw=float(yaw)) for gx, gy, yaw in goals),
        time_limit_s=route.time_limit_s,
        seed=seed,
        period_s=called_every(driver, robot),
    )


def _settled(route: Route, by: tuple[float, float]) -> Route:
    """The route from where the robot stands after it has settled by (forward, left) metres."""
    if by == (0.0, 0.0):
        return route
    start = route.start
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    moved = Pose(x=start.x + by[0] * cos - by[1] * sin, y=start.y + by[0] * sin + by[1] * cos, yaw=start.yaw)
    return route.model_copy(update={"start": moved})


def surroundings(world: World, robot: Robot) -> Surroundings:
    """Return the arrays of a world for a robot, computed once per process and kept for the last few pairs."""
    return latest(_SURROUNDINGS, (world.place_id, robot.id), _KEPT, lambda: Surroundings(world, robot))


def rollouts(robot: Robot) -> Rollouts:
    """Return the process's memory of a robot's rollouts: pure, so runs may share it one after another."""
    return latest(_ROLLOUTS, robot.id, _KEPT_ROLLOUTS, lambda: new_rollouts(len(sample_table(stack_of(robot)))))


def can_plan(world: World, route: Route, robot: Robot) -> bool:
    """Return whether NavFn finds a way from the start of a route to its goal, where nothing but the map is in it."""
    around, scene = surroundings(world, robot), surroundings(world, robot).open_scene
    left, low = world.map_offset[0] + scene.origin_x, world.map_offset[1] + scene.origin_y
    for begin, end in pairwise([route.start, *route.through, route.goal]):
        rest = around.rest_of_way(scene, np.array([[end.x, end.y]]) - world.map_offset)
        row, column = int((begin.y - low) / scene.resolution), int((begin.x - left) / scene.resolution)
        if rest is None or rest[row * scene.static.shape[1] + column] >= HIGH:
            return False
    return True


def _check(route: Route, seed: int) -> None:
    numbers = [route.time_limit_s]
    for pose in (route.start, *route.through, route.goal):
        numbers += [pose.x, pose.y, pose.yaw]
    if not all(math.isfinite(number) for number in numbers):
        raise InputError(
            f"route {route.name}: every pose and the time limit must be finite numbers, got {numbers}",
            code="route-not-finite",
        )
    if not 0.0 < route.time_limit_s <= 3600.0:
        raise InputError(
            f"route {route.name}: the time limit must be over 0 and at most 3600 s, not {route.time_limit_s}",
            code="time-limit",
        )
    if seed < 0:
        raise InputError(f"the seed must be 0 or more, not {seed}")


def _outcome(state: State) -> Outcome:
    nav = state.nav
    if nav[st.RESULT] == st.REACHED:
        return Outcome.REACHED
    if is_stuck(state.walls, float(state.body[base.X]), float(state.body[base.Y])):
        return Outcome.STUCK
    if nav[st.PLANNED] == 0:
        return Outcome.NO_PATH
    return Outcome.ABORTED if nav[st.RESULT] == st.ABORTED else Outcome.TIMED_OUT


def _finite(values: Floats) -> Floats:
    if not np.isfinite(values).all():
        raise SimulationError("the simulation left the finite numbers; please report the scenario and the seed")
    return values


def _trajectory(rows: Floats, humans: Floats, count: int, sideways: bool) -> Trajectory:
    t, x, y, yaw, v, omega, acceleration, lateral = _finite(rows[:count].T.copy())
    human_x, human_y, human_yaw, human_speed = _finite(np.moveaxis(humans[:count], 2, 0).copy())
    return Trajectory(
        t=t, x=x, y=y, yaw=yaw, v=v, omega=omega, acceleration=acceleration,
        lateral=lateral if sideways else np.empty(0), human_x=human_x, human_y=human_y, human_yaw=human_yaw,
        human_speed=human_speed,
    )  # fmt: skip


FUNCTIONS = 72
"""Kernels of a run, of all profiles of people together; a stack other than DWB compiles its own besides."""


def warm_up(report: Callable[[str], None] | None = None) -> float:
    """Load or compile every kernel; says so through `report` only if there is something to compile. Seconds taken."""
    started = time.perf_counter()
    fresh = not is_cached(go_on)
    if fresh and report is not None:
        report("compiling the simulator for this machine, once; on two idle cores this takes a minute")
    world, route, humans = rehearsal()
    with compilation_reported(FUNCTIONS, report) if fresh and report is not None else nullcontext():
        for name in PROFILES:
            simulate_agents(world, route, humans, options=profile(name))
    taken = time.perf_counter() - started
    if fresh:
        seal_cache()
    if fresh and report is not None:
        report(f"compiled in {taken:.0f} s, kept in {cache_folder()}")
    return taken
