"""The simulator `ros2-world`: the world is somebody else's (Gazebo with HuNavSim, Isaac, a real site), over DDS.

RVSG writes the people as a HuNavSim agents file, starts the user's launch command, sends the goal to the navigation
that runs there, and records the robot's pose and the people as a Run. Runs are not repeatable bit for bit.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from rvsg.core.errors import InputError, SimulationError
from rvsg.core.files import write_whole
from rvsg.core.plugins import ignore
from rvsg.recording.recorded_run import SIDEWAYS_M_S
from rvsg.scenario.scenario import HUNAVSIM_RADIUS_M, HumanAgent, PersonKind, Scenario, decode
from rvsg.simulation.run import Outcome, Run, Trajectory
from rvsg.simulation.simulators import Simulator
from rvsg.world.world import Route, World
from rvsg_exchange.bag import definitions
from rvsg_exchange.hunav_agents import Dialect, agents_yaml
from rvsg_ros2.dds import SUCCEEDED, ActionClient, Bus, Subscription
from rvsg_ros2.options import Ros2Options, checked
from rvsg_ros2.run_record import Pose2D, composed
from rvsg_ros2.session import Session

ROW_S = 0.05
LOG_S = 0.5
AGENTS, PEOPLE = "hunav_msgs/msg/Agents", "people_msgs/msg/People"
QUEUE = 1000
"""Messages kept until they are read: a recorder that gets no processor for seconds loses none."""
ROBOT = 2
"""The type of a robot in hunav_msgs/Agent."""


class Recorder:
    """Collects poses with their times. Times are those of the world's clock, or wall time where it has none."""

    def __init__(self, bus: Bus, options: WorldOptions, world: World, names: tuple[str, ...]) -> None:
        self._options, self._names = options, names
        self._offset = world.map_offset
        self._bus = bus
        self._clock = bus.subscribe("/clock", "rosgraph_msgs/msg/Clock", reliable=False, depth=1)
        self._has_clock = False
        self._tf = bus.subscribe("/tf", "tf2_msgs/msg/TFMessage", reliable=True, depth=QUEUE)
        self._static = bus.subscribe("/tf_static", "tf2_msgs/msg/TFMessage", reliable=True, latched=True)
        self._robot = bus.subscribe(options.robot or options.odom, "nav_msgs/msg/Odometry", depth=QUEUE)
        self._people: Subscription | None = None
        self._people_kind = ""
        self._links: dict[str, tuple[str, Pose2D]] = {}
        self._now = 0.0
        self._velocity = (0.0, 0.0, 0.0)
        self._rows: list[tuple[float, ...]] = []
        self._humans: dict[str, list[tuple[float, float, float, float, float]]] = {name: [] for name in names}
        self._others: set[str] = set()
        self._begin: float | None = None
        self._heard = time.monotonic()
        self.recoveries = 0

    @property
    def t(self) -> float:
        """Time of the world since the goal was accepted, s."""
        return 0.0 if self._begin is None else self._now - self._begin

    @property
    def silent_s(self) -> float:
        """Wall time since the robot's pose was heard last."""
        return time.monotonic() - self._heard

    def missing(self) -> list[str]:
        """Return what was not heard yet."""
        options = self._options
        source = options.robot or f"transform from {options.map_frame} to {options.base_frame}"
        lacks = [] if self._rows else [f"no pose of the robot ({source})"]
        silent = [name for name, rows in self._humans.items() if not rows]
        if silent:
            heard = f"; heard {', '.join(sorted(self._others))}" if self._others else ""
            lacks.append(f"no {', '.join(silent)} on {options.people}{heard}")
        return lacks

    def begin(self) -> None:
        """Let the run begin now: what was recorded before is left out, except for the last pose."""
        self._begin = self._rows[-1][0]
        self._rows = self._rows[-1:]
        self._heard = time.monotonic()

    def listen(self) -> None:
        """Take over what arrived."""
        options = self._options
        for message in self._clock.take():
            self._now, self._has_clock = _seconds(message.clock), True
        if not self._has_clock:
            self._now = time.time()
        for message in (*self._static.take(), *self._tf.take()):
            for each in message.transforms:
                at, child = each.transform.translation, each.child_frame_id.strip("/")
                pose = (at.x, at.y, _yaw(each.transform.rotation))
                self._links[child] = (each.header.frame_id.strip("/"), pose)
                if options.robot is None and child in (options.base_frame, options.footprint_frame):
                    self._from_transforms(_seconds(each.header.stamp))
        for message in self._robot.take():
            twist = message.twist.twist
            self._velocity = (twist.linear.x, twist.angular.z, twist.linear.y)
            if options.robot is not None:
                place = message.pose.pose
                pose = (place.position.x, place.position.y, _yaw(place.orientation))
                self._row(_seconds(message.header.stamp), pose, options.robot_frame == "map")
        if self._people is None:  # subscribe as soon as somebody publishes them
            kinds = {writer.type_name for writer in self._bus.graph().publishers(options.people)}
            wanted = {"hunav": (AGENTS,), "people": (PEOPLE,)}.get(options.people_type, (AGENTS, PEOPLE))
            kind = next((name for name in wanted if name in kinds), None)
            if kind is None:
                return
            self._people_kind = kind
            self._people = self._bus.subscribe(options.people, kind, depth=QUEUE)
        for message in self._people.take():
            self._hear_people(message)

    def _from_transforms(self, stamp: float) -> None:
        frame, pose = self._options.base_frame, (0.0, 0.0, 0.0)
        for _ in range(10):
            if frame not in self._links:
                return
            frame, link = self._links[frame]
            pose = composed(link, pose)
            if frame == self._options.map_frame:
                self._row(stamp, pose, True)
                return

    def _row(self, stamp: float, pose: Pose2D, in_map: bool) -> None:
        self._heard = time.monotonic()
        if self._rows and stamp < self._rows[-1][0] + 0.9 * ROW_S:
            return
        dx, dy = self._offset if in_map else (0.0, 0.0)
        self._rows.append((stamp, pose[0] + dx, pose[1] + dy, pose[2], *self._velocity))

    def _hear_people(self, message: Any) -> None:
        stamp = _seconds(message.header.stamp) or self._now
        dx, dy = self._offset if self._options.people_frame == "map" else (0.0, 0.0)
        for each in message.agents if self._people_kind == AGENTS else message.people:
            if self._people_kind == AGENTS:
                if each.type == ROBOT:
                    continue
                place, yaw, speed = each.position.position, each.yaw, each.linear_vel
            else:
                place, vx, vy = each.position, each.velocity.x, each.velocity.y
                yaw, speed = math.atan2(vy, vx), math.hypot(vx, vy)
            rows = self._humans.get(each.name)
            if rows is None:
                self._others.add(each.name)
            elif not rows or stamp > rows[-1][0]:
                rows.append((stamp, place.x + dx, place.y + dy, float(yaw), float(speed)))

    def trajectories(self, route: Route) -> tuple[Trajectory, Trajectory]:
        """Return the trajectory and its rows every 0.5 s; times since the goal was accepted, to the time limit."""
        assert self._begin is not None
        rows = np.array(self._rows, np.float64)
        rows[:, 0] -= self._begin
        rows = rows[rows[:, 0] <= route.time_limit_s + 1.0]
        if not np.isfinite(rows).all():
            raise SimulationError("The world reports a pose of the robot that is not finite.")
        t, x, y, yaw, v, w, lateral = (column.copy() for column in rows.T)
        change = np.gradient(v, t) if len(t) > 1 else np.zeros(len(t))
        humans = np.zeros((4, len(t), len(self._names)))
        for k, name in enumerate(self._names):  # interpolated between messages
            at, px, py, turned, speed = np.array(self._humans[name], np.float64).T
            at -= self._begin
            heading = np.interp(t, at, np.unwrap(turned))
            humans[0, :, k], humans[1, :, k] = np.interp(t, at, px), np.interp(t, at, py)
            humans[2, :, k] = np.arctan2(np.sin(heading), np.cos(heading))
            humans[3, :, k] = np.abs(np.interp(t, at, speed))
        path = Trajectory(
            t=t, x=x, y=y, yaw=yaw, v=v, omega=w, acceleration=np.hypot(change, v * w),
            human_x=humans[0], human_y=humans[1], human_yaw=humans[2], human_speed=humans[3],
            lateral=lateral if np.abs(lateral).max() > SIDEWAYS_M_S else np.empty(0),
        )  # fmt: skip
        marks = np.unique(np.append(np.searchsorted(t, np.arange(0.0, t[-1], LOG_S)), len(t) - 1))
        return path, path.at(marks)


def _yaw(turn: Any) -> float:
    return math.atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2))


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + stamp.nanosec / 1e9)


NAME = "ros2-world"
VERSION = 1
HUNAV_TYPES = definitions("hunav_msgs")
FLAT_HUNAV_TYPES = {
    **HUNAV_TYPES,
    "hunav_msgs/msg/Agent": HUNAV_TYPES["hunav_msgs/msg/Agent"]
    .replace("std_msgs/Header header\n", "")
    .replace("string name\n", "uint8 behavior\nstring name\nuint8 behavior_state\n")
    .replace("hunav_msgs/AgentBehavior behavior\n", ""),
}
"""The messages of the first releases of HuNavSim, which go with the `flat` dialect of agents files."""
TURN_LIMIT_S = 3600.0
_STEP_S = 0.003


class WorldOptions(Ros2Options):
    """Options of `ros2-world`: those of the stack `ros2` that concern names and start, and where people are read."""

    agents_file: str | None = None
    """Where the agents file is written; None: a temporary file, which `{agents}` in `launch` stands for."""
    dialect: Dialect = "block"
    """Of the agents file and of hunav_msgs."""
    people: str = "/human_states"
    people_type: Literal["auto", "hunav", "people"] = "auto"
    """hunav_msgs/Agents or people_msgs/People; `auto`: as it is published."""
    people_frame: Literal["world", "map"] = "world"
    """HuNavSim gives coordinates of the simulator's world."""
    robot: str | None = None
    """An Odometry topic with the robot's true pose; None: the transform from map to base."""
    robot_frame: Literal["world", "map"] = "world"
    """The frame of `robot`."""
    speed: Annotated[float, Field(ge=1.0, le=1.0)] = 1.0
    """The world keeps its own time."""


class Ros2World(Simulator):
    """Runs scenarios in a world that speaks ROS 2. The seed is a run number."""

    name = NAME
    code_options = ("launch",)

    def __init__(self, **options: Any) -> None:
        self._options = checked(options, WorldOptions, f"simulator {NAME}")
        self._tell: Callable[[str], None] = ignore

    @property
    def any_robot(self) -> bool:
        """Return whether it simulates every robot: the robot is whichever runs there."""
        return True

    @property
    def options(self) -> dict[str, object]:
        """The effective options."""
        return {"version": VERSION, "repeatable": False, **self._options.model_dump(mode="json")}

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Check what can be checked without a run."""
        self._tell = tell
        if self._options.launch is None and self._options.agents_file is None:
            raise InputError(
                f"simulator {NAME}: give launch with {{agents}} in it, or agents_file, which your running world reads.",
                code="ros2-no-agents-file",
            )

    def __getstate__(self) -> dict[str, Any]:
        """Leave out who listens."""
        return {"_options": self._options}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._options, self._tell = state["_options"], ignore

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        """Make one run.

        Raises:
            SimulationError: the world cannot be started, does not report what is needed, or is asked for what a file
                of agents cannot say: trolleys, wheelchairs, children, doors that move, objects that were moved.
        """
        _refuse_bodies(scenario, world)
        agents = decode(scenario.people, world.grid, HUNAVSIM_RADIUS_M)
        with tempfile.TemporaryDirectory(prefix="rvsg-world-") as folder:
            session = self._start(agents, world, Path(folder))
            try:
                return self._made(session, scenario, world, agents, seed)
            finally:
                session.close()

    def _start(self, agents: tuple[HumanAgent, ...], world: World, folder: Path) -> Session:
        options = self._options
        path = Path(options.agents_file) if options.agents_file is not None else folder / "agents.yaml"
        text, notes = agents_yaml(agents, map_name=world.name, dialect=options.dialect)
        write_whole(path, text)
        for note in notes:
            self._tell(note)
        if options.launch is not None:
            options = options.model_copy(update={"launch": options.launch.replace("{agents}", str(path))})
        return Session(options, 1.0, self._tell)

    def _made(
        self, session: Session, scenario: Scenario, world: World, agents: tuple[HumanAgent, ...], seed: int
    ) -> Run:
        options, route = self._options, scenario.mission.route
        if session.launched is None:
            session.turn.take(TURN_LIMIT_S)
        until = time.monotonic() + options.start_limit_s
        session.find(_wait)
        types = HUNAV_TYPES if options.dialect != "flat" else FLAT_HUNAV_TYPES
        session.bus.types.register(types)
        recorder = Recorder(session.bus, options, world, tuple(f"agent{k + 1}" for k in range(len(agents))))
        self._wait_until_active(session, recorder, until)
        through = options.goal == "through_poses" or (options.goal == "auto" and bool(route.through))
        client = session.action(through)
        outcome, fault = self._drive(session, recorder, client, scenario, world)
        details: dict[str, object] = {"stack": {"repeatable": False, "release": session.bus.types.release, **fault}}
        path, log = recorder.trajectories(route)
        return Run(
            scenario_id=scenario.id,
            simulator=NAME,
            options=self.options,
            seed=seed,
            outcome=outcome,
            trajectory=path,
            log=log,
            human_names=tuple(agent.name for agent in agents),
            human_radius_m=tuple(agent.radius_m for agent in agents),
            human_groups=tuple(agent.group for agent in agents),
            goal=(route.goal.x, route.goal.y, route.goal.yaw),
            time_limit_s=route.time_limit_s,
            recoveries=recorder.recoveries,
            details=details,
        )

    def _wait_until_active(self, session: Session, recorder: Recorder, until: float) -> None:
        while True:
            session.lifecycle.poll()
            recorder.listen()
            waiting = [*session.lifecycle.waiting_for(), *recorder.missing()]
            if not waiting:
                return
            session.check()
            if time.monotonic() > until:
                raise SimulationError(
                    f"The world is not ready after {self._options.start_limit_s:g} s: {'; '.join(waiting)}."
                )
            _wait()

    def _drive(
        self, session: Session, recorder: Recorder, client: ActionClient, scenario: Scenario, world: World
    ) -> tuple[Outcome, dict[str, Any]]:
        """Send the goal and record until it ends; return how, and the fault where there is one."""
        route, limit = scenario.mission.route, self._options.answer_limit_s
        dx, dy = world.map_offset

        def pump() -> None:
            recorder.listen()
            time.sleep(_STEP_S)

        session.send_goal(client, [(at.x - dx, at.y - dy, at.yaw) for at in (*route.through, route.goal)], pump)
        recorder.begin()
        while True:
            recorder.listen()
            client.poll()
            if client.feedback is not None:
                recorder.recoveries = max(recorder.recoveries, int(client.feedback.number_of_recoveries))
            if client.status is not None:
                return (Outcome.REACHED if client.status == SUCCEEDED else Outcome.ABORTED), {}
            if recorder.t > route.time_limit_s:
                client.cancel_all(limit)
                return Outcome.TIMED_OUT, {}
            if session.launched is not None and session.launched.ended is not None:
                return Outcome.STACK_FAILED, {"fault": "the launch command ended during the run"}
            if recorder.silent_s > limit:
                return Outcome.STACK_FAILED, {"fault": f"no pose of the robot for {limit:g} s"}
            time.sleep(_STEP_S)


def _refuse_bodies(scenario: Scenario, world: World) -> None:
    """Refuse what the other simulator would leave out without a word."""
    left_out = [
        f"{human.name} ({'trolley' if human.trolley is not None else human.kind.value})"
        for human in scenario.people.humans
        if human.trolley is not None or human.kind is not PersonKind.ADULT
    ]
    left_out += [f"{human.name} (a recorded track)" for human in scenario.people.humans if human.track is not None]
    left_out += [f"the door {door.name}" for door in world.moving_doors]
    left_out += [f"the moved object {each.name}" for each in scenario.mission.moved]
    if left_out:
        raise SimulationError(
            f"The simulator {NAME} knows people who walk, and nothing of {', '.join(left_out)}. Leave them out, or use "
            "the simulator embedded.",
            code="ros2-bodies-unknown",
        )


def _wait() -> None:
    time.sleep(0.02)
