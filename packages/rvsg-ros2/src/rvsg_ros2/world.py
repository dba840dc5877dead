"""The simulator `ros2-world`: the world is somebody else's (Gazebo with HuNavSim, Isaac, a real site), over DDS.

RVSG writes the people as a HuNavSim agents file, starts the user's launch command, sends the goal to the navigation
that runs there, and records the robot's pose and the people as a Run. Runs are not repeatable bit for bit.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from rvsg.core.errors import InputError, SimulationError
from rvsg.scenario.scenario import HumanAgent, PersonKind, Scenario, decode
from rvsg.simulation.protocol import Simulator
from rvsg.simulation.run import Outcome, Run
from rvsg.world.world import World
from rvsg_exchange.hunav import Dialect, export_agents, write_agents
from rvsg_exchange.ros_types import HUNAV_TYPES
from rvsg_ros2.dds import SUCCEEDED, ActionClient
from rvsg_ros2.options import Ros2Options, checked
from rvsg_ros2.recorder import Recorder, goal_of
from rvsg_ros2.session import Session

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
        file, notes = export_agents(agents, map_name=world.name, dialect=options.dialect)
        write_agents(file, path)
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
