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
from numpy.typing import NDArray
from pydantic import Field

from rvsg.core.errors import InputError, SimulationError
from rvsg.core.files import write_whole
from rvsg.scenario.scenario import HumanAgent, PersonKind, Scenario, decode
from rvsg.simulation.run import Outcome, Run, Trajectory
from rvsg.simulation.simulators import Simulator
from rvsg.world.world import Route, World
from rvsg_exchange.bag import HUNAV_TYPES
from rvsg_exchange.hunav_agents import Dialect, agents_yaml
from rvsg_exchange.recordings import SIDEWAYS_M_S
from rvsg_ros2.dds import SUCCEEDED, ActionClient, Bus, Subscription
from rvsg_ros2.options import Ros2Options, checked
from rvsg_ros2.session import Session

Floats = NDArray[np.float64]

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
        self._links: dict[str, tuple[str, tuple[float, float, float]]] = {}
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
        lacks = [] if self._rows else [f"no pose of the robot ({self._source()})"]
        silent = [name for name, rows in self._humans.items() if not rows]
        if silent:
            heard = f"; heard {', '.join(sorted(self._others))}" if self._others else ""
            lacks.append(f"no {', '.join(silent)} on {self._options.people}{heard}")
        return lacks

    def _source(self) -> str:
        return self._options.robot or f"transform from {self._options.map_frame} to {self._options.base_frame}"

    def begin(self) -> None:
        """Let the run begin now: what was recorded before is left out, except for the last pose."""
        self._begin = self._rows[-1][0]
        self._rows = self._rows[-1:]
        self._heard = time.monotonic()

    def feedback(self, feedback: Any) -> None:
        """Take over the number of recoveries."""
        if feedback is not None:
            self.recoveries = max(self.recoveries, int(feedback.number_of_recoveries))

    def listen(self) -> None:
        """Take over what arrived."""
        for message in self._clock.take():
            self._now, self._has_clock = message.clock.sec + message.clock.nanosec / 1e9, True
        if not self._has_clock:
            self._now = time.time()
        for message in (*self._static.take(), *self._tf.take()):
            for each in message.transforms:
                at = each.transform.translation
                pose = (at.x, at.y, _yaw(each.transform.rotation))
                self._links[each.child_frame_id.strip("/")] = (each.header.frame_id.strip("/"), pose)
                if self._options.robot is None and self._moves_robot(each.child_frame_id):
                    self._from_transforms(each.header.stamp.sec + each.header.stamp.nanosec / 1e9)
        for message in self._robot.take():
            twist = message.twist.twist
            self._velocity = (twist.linear.x, twist.angular.z, twist.linear.y)
            if self._options.robot is not None:
                place = message.pose.pose
                stamp = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
                pose = (place.position.x, place.position.y, _yaw(place.orientation))
                self._row(stamp, pose, self._options.robot_frame == "map")
        self._listen_to_people()

    def _listen_to_people(self) -> None:
        """Subscribe to the people as soon as somebody publishes them, and take over what arrived."""
        if self._people is None:
            kinds = {writer.type_name for writer in self._bus.graph().publishers(self._options.people)}
            wanted = {"hunav": AGENTS, "people": PEOPLE}.get(self._options.people_type)
            kind = wanted or next((name for name in (AGENTS, PEOPLE) if name in kinds), None)
            if kind not in kinds:
                return
            self._people = self._bus.subscribe(self._options.people, kind, depth=QUEUE)
        for message in self._people.take():
            self._hear_people(message)

    def _moves_robot(self, child: str) -> bool:
        return child.strip("/") in (self._options.base_frame, self._options.footprint_frame)

    def _from_transforms(self, stamp: float) -> None:
        frame, pose = self._options.base_frame, (0.0, 0.0, 0.0)
        for _ in range(10):
            if frame not in self._links:
                return
            frame, link = self._links[frame]
            pose = _composed(link, pose)
            if frame == self._options.map_frame:
                self._row(stamp, pose, True)
                return

    def _row(self, stamp: float, pose: tuple[float, float, float], in_map: bool) -> None:
        self._heard = time.monotonic()
        if self._rows and stamp < self._rows[-1][0] + 0.9 * ROW_S:
            return
        dx, dy = self._offset if in_map else (0.0, 0.0)
        self._rows.append((stamp, pose[0] + dx, pose[1] + dy, pose[2], *self._velocity))

    def _hear_people(self, message: Any) -> None:
        stamp = message.header.stamp.sec + message.header.stamp.nanosec / 1e9 or self._now
        dx, dy = self._offset if self._options.people_frame == "map" else (0.0, 0.0)
        for each in getattr(message, "agents", None) or getattr(message, "people", []):
            if getattr(each, "type", 1) == ROBOT:
                continue
            if each.name not in self._humans:
                self._others.add(each.name)
                continue
            if hasattr(each, "yaw"):
                row = (each.position.position.x, each.position.position.y, each.yaw, each.linear_vel)
            else:
                speed = math.hypot(each.velocity.x, each.velocity.y)
                row = (each.position.x, each.position.y, math.atan2(each.velocity.y, each.velocity.x), speed)
            rows = self._humans[each.name]
            if not rows or stamp > rows[-1][0]:
                rows.append((stamp, row[0] + dx, row[1] + dy, float(row[2]), float(row[3])))

    def trajectories(self, route: Route) -> tuple[Trajectory, Trajectory]:
        """Return the trajectory and its rows every 0.5 s; times since the goal was accepted, to the time limit."""
        assert self._begin is not None
        rows = np.array(self._rows, np.float64)
        rows[:, 0] -= self._begin
        rows = rows[rows[:, 0] <= route.time_limit_s + 1.0]
        if not np.isfinite(rows).all():
            raise SimulationError("The world reports a pose of the robot that is not finite.")
        t, v, w = rows[:, 0], rows[:, 4], rows[:, 5]
        change = np.gradient(v, t) if len(t) > 1 else np.zeros(len(t))
        humans = [self._person(name, t) for name in self._names]
        parts = [np.stack([each[k] for each in humans], 1) if humans else np.empty((len(t), 0)) for k in range(4)]
        path = Trajectory(
            t=t, x=rows[:, 1].copy(), y=rows[:, 2].copy(), yaw=rows[:, 3].copy(), v=v.copy(), omega=w.copy(),
            acceleration=np.hypot(change, v * w), human_x=parts[0], human_y=parts[1], human_yaw=parts[2],
            human_speed=parts[3],
            lateral=rows[:, 6].copy() if np.abs(rows[:, 6]).max() > SIDEWAYS_M_S else np.empty(0),
        )  # fmt: skip
        marks = np.unique(np.append(np.searchsorted(t, np.arange(0.0, t[-1], LOG_S)), len(t) - 1))
        log = path.at(marks)
        return path, log

    def _person(self, name: str, t: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return x, y, yaw and speed of a person at the robot's times, interpolated between messages."""
        rows = np.array(self._humans[name], np.float64)
        at = rows[:, 0] - (self._begin or 0.0)
        x, y, speed = (np.interp(t, at, rows[:, k]) for k in (1, 2, 4))
        yaw = np.interp(t, at, np.unwrap(rows[:, 3]))
        return x, y, np.arctan2(np.sin(yaw), np.cos(yaw)), np.abs(speed)


def goal_of(client: ActionClient, route: Route, world: World, frame: str) -> Any:
    """Return the goal of a route, in the map frame."""
    goal = client.new_goal()
    dx, dy = world.map_offset
    poses = []
    for place in (*route.through, route.goal):
        pose = client.types["geometry_msgs/msg/PoseStamped"]()
        pose.header.frame_id = frame
        pose.pose.position.x, pose.pose.position.y = float(place.x - dx), float(place.y - dy)
        pose.pose.orientation.z, pose.pose.orientation.w = math.sin(place.yaw / 2), math.cos(place.yaw / 2)
        poses.append(pose)
    if hasattr(goal, "pose"):
        goal.pose = poses[-1]
    elif isinstance(goal.poses, list):
        goal.poses = poses
    else:
        goal.poses.goals = poses
    return goal


def _yaw(turn: Any) -> float:
    return math.atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2))


def _composed(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    cos, sin = math.cos(a[2]), math.sin(a[2])
    return a[0] + cos * b[0] - sin * b[1], a[1] + sin * b[0] + cos * b[1], a[2] + b[2]


NAME = "ros2-world"
VERSION = 1
FLAT_HUNAV_TYPES = {
    "hunav_msgs/msg/Agent": """int32 id
uint8 type
uint8 skin
uint8 behavior
string name
uint8 behavior_state
int8 group_id
geometry_msgs/Pose position
float32 yaw
geometry_msgs/Twist velocity
float32 desired_velocity
float32 radius
float32 linear_vel
float32 angular_vel
geometry_msgs/Pose[] goals
bool cyclic_goals
float32 goal_radius
geometry_msgs/Point[] closest_obs
""",
    "hunav_msgs/msg/Agents": HUNAV_TYPES["hunav_msgs/msg/Agents"],
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
        self._tell: Callable[[str], None] = lambda _: None

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
        self._options, self._tell = state["_options"], lambda _: None

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        """Make one run.

        Raises:
            SimulationError: the world cannot be started, does not report what is needed, or is asked for what a file
                of agents cannot say: trolleys, wheelchairs, children, doors that move, objects that were moved.
        """
        _refuse_bodies(scenario, world)
        agents = decode(scenario.people, world.grid)
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
        until = time.monotonic() + limit
        while not client.is_matched and time.monotonic() < until:
            _wait()
        client.send_goal(goal_of(client, route, world, self._options.map_frame))
        while client.accepted is None:
            recorder.listen()
            client.poll()
            if time.monotonic() > until + limit:
                raise SimulationError(f"The action {client.name} did not answer the goal.")
            time.sleep(_STEP_S)
        if not client.accepted:
            raise SimulationError(f"The action {client.name} rejected the goal.")
        recorder.begin()
        while True:
            recorder.listen()
            client.poll()
            recorder.feedback(client.feedback)
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
