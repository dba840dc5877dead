"""The stack `ros2`: a ROS 2 navigation system of the user's, driven over DDS at a multiple of real time."""

from __future__ import annotations

import atexit
import cmath
import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rvsg.core.errors import SimulationError
from rvsg.core.plugins import Spec, ignore
from rvsg.core.records import text_id
from rvsg.robots.robot import Robot
from rvsg.simulation.stacks.nav2_params import read_nav2_text
from rvsg.simulation.stacks.parameter_file import has_place
from rvsg.simulation.stacks.parameters import Parameter
from rvsg.simulation.stacks.protocol import Command, Ended, Observation, StackError, Task, Twist, WholeStack
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg.world.world import OCCUPIED, OccupancyMap
from rvsg_ros2.dds import POLL_S, SUCCEEDED, ActionClient, Subscription
from rvsg_ros2.options import read_options
from rvsg_ros2.run_record import RunRecord, composed
from rvsg_ros2.session import RobotSide, Session

NEAR_M = 0.15
"""A cell of the other map is where an obstacle of the world is if it lies this close."""
SAME = 0.5
"""A map that has fewer of the world's obstacles shows another place."""


def share_of_obstacles(message: Any, world_map: OccupancyMap) -> float:
    """Return the share of a world's occupied cells that a nav_msgs/OccupancyGrid has, too; both in the map frame."""
    from scipy.ndimage import binary_dilation

    info = message.info
    cells = np.asarray(message.data, np.int16)
    if cells.size != info.width * info.height or not cells.size:
        return 0.0
    occupied = cells.reshape(info.height, info.width) >= 50
    steps = max(1, round(NEAR_M / info.resolution))
    occupied = binary_dilation(np.pad(occupied, steps), iterations=steps)
    # Places in the plane as complex numbers: a turn is a product.
    row, column = np.nonzero(world_map.cells == OCCUPIED)
    origin, other = world_map.origin, info.origin
    places = ((column + 0.5) + 1j * (row + 0.5)) * world_map.resolution * cmath.exp(1j * origin.yaw)
    places += complex(origin.x, origin.y) - complex(other.position.x, other.position.y)
    places *= cmath.exp(-2j * math.atan2(other.orientation.z, other.orientation.w)) / info.resolution
    column, row = (np.floor(part).astype(np.int64) + steps for part in (places.real, places.imag))
    inside = (column >= 0) & (row >= 0) & (column < occupied.shape[1]) & (row < occupied.shape[0])
    return float(occupied[row[inside], column[inside]].sum() / max(1, column.size))


STEP_S = 0.01
"""Simulated time between two looks for commands, a tick of the base. A period of 20 Hz is a multiple of it: commands
taken every 20 ms would act after 40 and 60 ms in turn, so that every second sample of 20 Hz repeats the one before."""
LATE_S = 0.2
"""Simulated time that this process may be behind the wall's clock and still catch up. A system goes on by that clock,
and drives with measurements that are as old."""
PERIOD_S = 0.02
"""Simulated time between two messages of odometry, transforms and clock."""
LOCALISED_M, LOCALISED_RAD = 0.5, 0.35
"""A system counts as localised where its estimate is this close to the truth."""
ASK_AGAIN_S = 2.0
"""Wall time after which the initial pose is sent again."""
APPEAR_S = 3.0
"""Wall time in which a map server appears after the action of the goal."""
TURN_LIMIT_S = 3600.0
MAP_LIMIT_S = 2.0
"""Wall time in which a latched map arrives."""
_END_LIMIT_S = 1.0
SOON_S = 1.0
"""An action that fails sooner than this, simulated, without a velocity command, has planned nothing."""


class Running:
    """One run on a system that is ready."""

    def __init__(self, session: Session, task: Task, seen: Observation) -> None:
        self.session, self.task, self.options = session, task, session.options
        self.record = RunRecord(session.speed, task, session.bus.types.release)
        self._base = session.turn.take(TURN_LIMIT_S, session.tell)
        self._now = self._base
        try:
            session.find(wait)
            self.record.release = session.bus.types.release
            self.robot: RobotSide = session.connect(task.robot)
            self.robot.start_over()
            self._frozen = time.monotonic()
            self._get_ready(seen)
        except BaseException:
            self._give_back()
            raise
        self.robot.start_over()
        self._base = self._now - round(seen.t * 1e9)
        self._publish_at = self._now
        self._due = time.monotonic()
        self._begun, self._begun_t = self._due, seen.t
        self._sent = CommandQueue()
        self._heard = self._due

    # Getting ready: simulated time stands still, ROS time goes on at the pace of the run.

    def _get_ready(self, seen: Observation) -> None:
        pump = partial(self._pump, seen)
        limit = self.options.start_limit_s
        until = time.monotonic() + limit
        self._mapped = False
        self._transforms = self.session.bus.subscribe("/tf", "tf2_msgs/msg/TFMessage", reliable=True, depth=200)
        self._wait_until_active(pump, until)
        self._check_map(pump)
        self.record.control_hz = self.session.control_hz(pump)
        for node, wrong in self.session.parameters(pump).of_another_robot(self.task.robot).items():
            self.record.warn(f"{node}: {wrong}")
        self.actions = {through: self.session.action(through) for through in (False, True)}
        for client in self.actions.values():  # goals of others
            if self.session.bus.graph().servers(f"{client.name}/_action/send_goal"):
                client.cancel_all(self.options.answer_limit_s, pump)
        self._wait_until_localised(seen, pump, until)
        for service in self.session.clear_costmaps(self.options.answer_limit_s, pump):
            self.record.warn(f"{service} did not answer")
        settled = self._now + round(self.options.settle_s * 1e9)
        while self._now < settled:
            pump()
        self._commands: Subscription = self.session.commands()
        self.record.listen(self.session, self.options)
        if self.session.launched is not None:
            self.session.launched.note_processes()
        self._send_goal(pump)

    def _wait_until_active(self, pump: Callable[[], None], until: float) -> None:
        lifecycle = self.session.lifecycle
        lifecycle.states.clear()
        sent, begun = 0.0, time.monotonic()
        while True:
            lifecycle.poll()
            self.session.wait_until_alone(pump)
            waiting = lifecycle.waiting_for()
            is_ready = bool(lifecycle.states) and not waiting
            self._provide(is_ready or time.monotonic() - begun > APPEAR_S)
            if is_ready:
                return
            if time.monotonic() - sent > ASK_AGAIN_S:
                sent = time.monotonic()
                self._send_start()
            self.session.check()
            if time.monotonic() > until:
                listed = "; ".join(waiting)
                raise SimulationError(f"Not active after {self.options.start_limit_s:g} s: {listed}.")
            pump()

    def _provide(self, is_complete: bool) -> None:
        """Give the transform from map to odom, and the map, where the system has none of its own.

        Args:
            is_complete: nodes that provide a map have had time to appear.
        """
        graph, options = self.session.bus.graph(), self.options
        own = bool(graph.subscribers(options.initial_pose))
        self.robot.gives_transform = options.localisation == "given" or (options.localisation == "auto" and not own)
        lacks_map = is_complete and options.publish_map == "auto" and not graph.publishers(options.map)
        if not self._mapped and (lacks_map or options.publish_map == "always"):
            self.robot.publish_map(self._now, self.task.world)
            self._mapped = True

    def _check_map(self, pump: Callable[[], None]) -> None:
        """Refuse a system whose own map shows another place; looked at once for each world."""
        topic, world = self.options.map, self.task.world
        if self._mapped or world.id in self.session.checked_worlds or not self.session.bus.graph().publishers(topic):
            return
        found = self.session.bus.subscribe(topic, "nav_msgs/msg/OccupancyGrid", reliable=True, latched=True, depth=1)
        until = time.monotonic() + MAP_LIMIT_S
        while not (messages := found.take()):
            if time.monotonic() > until:
                return  # a publisher that has published nothing, such as a SLAM that begins
            pump()
        share = share_of_obstacles(messages[-1], world.occupancy)
        if share < SAME:
            raise SimulationError(
                f"The map on {topic} has {share:.0%} of the obstacles of the world {world.name}, so it shows another "
                "place. Give your map server that world's map (`rvsg world copy`), or make a world of yours "
                "(`rvsg world new`)."
            )
        self.session.checked_worlds.add(world.id)

    def _send_start(self) -> None:
        """Tell localisation the start: costmaps become active only with a transform from the map."""
        if not self.robot.gives_transform:
            start = self.task.start
            self.robot.publish_initial_pose(self._now, start.x, start.y, start.yaw)

    def _wait_until_localised(self, seen: Observation, pump: Callable[[], None], until: float) -> None:
        if self.robot.gives_transform:
            return
        self._transforms.take()
        sent = 0.0
        while True:
            if time.monotonic() - sent > ASK_AGAIN_S:
                sent = time.monotonic()
                self._send_start()
            off = self._off(seen)
            if off is not None and off[0] < LOCALISED_M and off[1] < LOCALISED_RAD:
                return
            if time.monotonic() > until:
                how = "no transform from map to odom came" if off is None else f"its estimate is {off[0]:.2f} m off"
                raise SimulationError(f"Not localised after {self.options.start_limit_s:g} s: {how}.")
            pump()

    def _off(self, seen: Observation) -> tuple[float, float] | None:
        """Return how far (m, rad) the newest estimate of the robot's place is off its start in the map."""
        found, start = None, self.task.start
        for message in self._transforms.take():
            for each in message.transforms:
                if (each.header.frame_id, each.child_frame_id) == (self.options.map_frame, self.options.odom_frame):
                    at, turn = each.transform.translation, each.transform.rotation
                    x, y, yaw = composed((at.x, at.y, 2.0 * math.atan2(turn.z, turn.w)), seen.pose)
                    aside = math.remainder(yaw - start.yaw, 2.0 * math.pi)
                    found = (math.hypot(x - start.x, y - start.y), abs(aside))
        return found

    def _send_goal(self, pump: Callable[[], None]) -> None:
        goals = self.task.goals
        through = len(goals) > 1 if self.options.goal == "auto" else self.options.goal == "through_poses"
        self.client: ActionClient = self.actions[through]
        self._commands.take()
        self.session.send_goal(self.client, [(pose.x, pose.y, pose.yaw) for pose in goals], pump)

    def _pump(self, seen: Observation) -> None:
        """Let PERIOD_S of ROS time pass while the robot stands."""
        self._now += round(PERIOD_S * 1e9)
        at = (self._now - self._base) / 1e9
        self.robot.publish(self._now, seen, at=at)
        self._frozen += PERIOD_S / self.session.speed
        rest = self._frozen - time.monotonic()
        if rest > 0.0:
            time.sleep(rest)
        else:
            self._frozen = time.monotonic()
            time.sleep(POLL_S)

    # The run itself.

    def step(self, seen: Observation) -> Twist | Ended | None:
        """Send what the robot senses, wait until its time has come, and take what the system answers."""
        self._now = self._base + round(seen.t * 1e9)
        if self._now >= self._publish_at:
            self._publish_at += round(PERIOD_S * 1e9)
            self.robot.publish(self._now, seen)
            self.robot.publish_joints(self._now)
        # Wait until the step is due by the wall clock; a step that comes late is caught up by those that follow.
        self._due += STEP_S / self.session.speed
        rest = self._due - time.monotonic()
        if rest > 0.0:
            time.sleep(rest)
        elif -rest > LATE_S / self.session.speed:
            self._due -= rest
        self.client.poll()
        self.record.note(seen, self.client.feedback)
        if self.client.status is not None:
            self.record.end(self.client)
            if self.client.status == SUCCEEDED:
                return Ended.REACHED
            self._ask_whether_alive()  # the navigator gives up, too, where another node is gone
            if seen.t < SOON_S and not self.record.has_commands:
                raise SimulationError(
                    f"{self.client.name} ended after {seen.t:.1f} s without a velocity command: nothing was planned. "
                    "Read the log of bt_navigator; `rvsg ros2 check` lists the nodes."
                )
            return Ended.GAVE_UP
        return self._command(seen)

    def _command(self, seen: Observation) -> Twist | None:
        """Return the last command that was sent before the end of this step. Those that are taken late, because this
        process was, act in the order and at the distances in which they were sent."""
        now = time.time()
        if self._sent.put(self._commands.take(), now):
            self._heard = time.monotonic()
        end = now - time.monotonic() + self._due
        due = self._sent.before(end)
        for at, _ in due:
            self.record.commanded(seen.t + STEP_S - (end - at) * self.session.speed)
        if self.record.lost_pace and self.session.speed > 1.0:
            raise SimulationError(
                f"{self.record.missed}, so the system does not keep up with {self.session.speed:g} times real time "
                "(option speed; control_hz if its controller has another rate)"
            )
        if not due and time.monotonic() - self._heard > self.options.answer_limit_s:
            self._ask_whether_alive()
        return due[-1][1] if due else None

    def _ask_whether_alive(self) -> None:
        """Name the nodes that are gone or do not answer; a system that only waits goes on."""
        self.session.check()
        silent = self.session.lifecycle.silent(self.options.answer_limit_s)
        if silent:
            self.record.failed = True
            how = self.session.launched.why_silent() if self.session.launched is not None else "crashed or hanging"
            raise SimulationError(f"{', '.join(silent)}: no answer within {self.options.answer_limit_s:g} s, {how}")
        self._heard = self._due = time.monotonic()

    def finish(self) -> dict[str, Any]:
        """Cancel the goal where it still runs; return the facts of the run."""
        wall = time.monotonic() - self._begun
        simulated = (self._now - self._base) / 1e9 - self._begun_t
        if self.client.accepted and self.client.status is None and not self.record.failed:
            self.client.cancel_all(_END_LIMIT_S)
        self._give_back()
        return self.record.facts(simulated / wall if wall > 0.0 else 0.0)

    def _give_back(self) -> None:
        if self.session.launched is None:
            self.session.turn.give_back(self._now)


class CommandQueue:
    """Commands that a system has sent and that have not acted yet, in the order in which they were sent."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, Twist]] = deque()

    def put(self, messages: Sequence[Any], now: float) -> bool:
        """Add messages of type Twist or TwistStamped that were taken at a time of the system's clock, s.

        Returns:
            Whether there were any.
        """
        for message in messages:
            twist = getattr(message, "twist", message)
            velocity = Twist(float(twist.linear.x), float(twist.linear.y), float(twist.angular.z))
            # No command is from the future: the clock of its sender may be ahead.
            self._sent.append((min(message.sample_info.source_timestamp / 1e9, now), velocity))
        return bool(messages)

    def before(self, end: float) -> list[tuple[float, Twist]]:
        """Remove and return the commands that were sent until then, each with its time, s."""
        due = []
        while self._sent and self._sent[0][0] <= end:
            due.append(self._sent.popleft())
        return due


def wait() -> None:
    """Let a moment of wall time pass."""
    time.sleep(0.02)


VERSION = "2"
"""2: commands act within 0.01 s of simulated time, 0.02 s before."""
MISSED_SHARE = 0.02
"""A larger share of missed control periods lowers the speed of the runs that follow."""
REACHED_SHARE = 0.85
"""A smaller share of the speed asked for does so, too: a system whose rates are scaled for it runs them too fast."""
SLOWER = 0.75


class Ros2Stack(WholeStack):
    """The user's running or launched ROS 2 navigation. Runs are not repeatable bit for bit: the seed is a run number.

    Options are those of `rvsg_ros2.options.Ros2Options`.
    """

    name: ClassVar[str] = "ros2"
    title: ClassVar[str] = "your own ROS 2 navigation (Nav2), running or launched, over DDS"
    version: str = "1"
    code_options = ("launch",)
    repeatable: ClassVar[bool] = False
    """Whether equal seeds give equal runs."""
    answer_time_s: ClassVar[float | None] = None
    """No limit of the caller's own: this stack keeps time itself."""

    def __init__(self, **options: Any) -> None:
        self._options = read_options(options)
        if self._options.params is None:
            self.version = VERSION
        else:  # the version covers the content of the parameter file
            self._options.parameter_text()  # refuses values for which the file has no place
            content = text_id("params", Path(self._options.params).read_text())
            self.version = f"{VERSION}+{content.removeprefix('params-')}"
        self._clear()

    def _clear(self) -> None:
        self._speed = self._options.speed
        self._session: Session | None = None
        self._tell: Callable[[str], None] = ignore
        self._task: Task | None = None
        self._run: Running | None = None
        self._restart = False

    def __getstate__(self) -> dict[str, Any]:
        """Close the connection: the copy makes its own where it is used."""
        self.close()
        return {"_options": self._options, "version": self.version}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._options, self.version = state["_options"], state["version"]
        self._clear()

    @property
    def options(self) -> Mapping[str, Any]:
        """The effective options."""
        return self._options.model_dump(mode="json")

    def tunable_parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Return those of the built-in stack that the parameter file asks for and has a place for."""
        if (text := self._options.parameter_text()) is None:
            return ()
        path = Path(str(self._options.params))
        read = read_nav2_text(text, path)
        driver = StackChoice.of(Spec(read.stack, read.options)).driver
        return tuple(
            each.replace(name=f"values.{each.name}")
            for each in driver.tunable_parameters(robot)
            if has_place(text, path, each.name, each.value(each.at(0.37)))
        )

    def parameter_file(self) -> tuple[str, str] | None:
        """Return name and text of the parameter file that the system is launched with."""
        text = self._options.parameter_text()
        return None if text is None else (Path(str(self._options.params)).name, text)

    @property
    def period_s(self) -> float:
        """Simulated time between two steps."""
        return STEP_S

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Find the running system or start it, so that what is missing is said before the first run.

        Raises:
            InputError, SimulationError: see `Session`.
        """
        self._tell = tell
        if self._session is not None:
            return
        session = self._open()
        try:
            session.find(wait)
        except BaseException:
            self.close()
            raise
        if session.scaled is not None and self._speed != 1.0:
            for each in (*session.scaled.changes, *session.scaled.notes):
                tell(f"speed {self._speed:g}: {each}")
        elif self._speed != 1.0:
            tell(
                f"speed {self._speed:g}: the running system keeps its parameters. Start it with those that "
                "`rvsg ros2 params` prints, or its loops run too slowly."
            )

    def _open(self) -> Session:
        self._session = Session(self._options, self._speed, self._tell)
        atexit.register(self.close)
        return self._session

    def reset(self, task: Task) -> None:
        """Keep the task; the system is made ready in the first step, where the robot's sensors are known."""
        if self._run is not None:
            self.finish()
        self._task = task

    def step(self, seen: Observation) -> Command | Ended | None:
        """Send the sensors, keep pace, and return the newest velocity or how the goal ended."""
        try:
            if self._run is None:
                assert self._task is not None
                self._run = self._begin(self._task, seen)
            return self._run.step(seen)
        except SimulationError as error:
            raise StackError(str(error)) from error

    def _begin(self, task: Task, seen: Observation) -> Running:
        if self._session is not None and (self._restart or self._options.restart):
            self._session.close()
            self._session = None
        self._restart = False
        session = self._session or self._open()
        try:
            return Running(session, task, seen)
        except BaseException:
            if session.launched is not None:
                self.close()  # a system that did not get ready is started again for the next run
            raise

    def finish(self) -> Mapping[str, Any]:
        """End the goal and let other processes use the system; return what there is to tell of the run."""
        if self._run is None:
            return {}
        running, self._run = self._run, None
        facts = running.finish()
        too_slow = facts["speed"] < REACHED_SHARE * self._speed
        if (running.record.missed_share > MISSED_SHARE or too_slow) and self._speed > 1.0:
            reached = facts["speed"] if too_slow else self._speed
            self._speed = max(1.0, min(reached, self._speed * SLOWER))
            self._restart = self._options.launch is not None
            facts["speed_of_next_runs"] = self._speed
            if self._session is not None:
                self._session.speed = self._speed
        if running.record.failed and self._options.launch is not None:
            self._restart = True
        return facts

    def close(self) -> None:
        """Disconnect, and end the system where it was launched."""
        if self._run is not None:
            self.finish()
        if self._session is not None:
            self._session.close()
            self._session = None
        atexit.unregister(self.close)
