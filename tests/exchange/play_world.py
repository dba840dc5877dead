"""A process that plays Gazebo with HuNavSim for the tests: the embedded world, published as such a world is.

`python play_world.py AGENTS.yaml SETTINGS.json`. It starts the people of the agents file, waits for a goal, drives to
it with the embedded simulator and publishes clock, transforms, odometry and people. With the setting `manager`, the
command of HuNavSim's agent manager (2023), the people are its: it is asked as the plug-in of Gazebo asks it, and
publishes them itself.
"""

from __future__ import annotations

import json
import math
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from tests.simulation.ros2.peer import ABORTED, EXECUTING, SUCCEEDED, Options, Peer

from rvsg.core.records import Pose
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded.episode import Episode, Outside
from rvsg.simulation.embedded.simulator import empty_room, rehearsal, simulate_agents
from rvsg.simulation.run import Outcome
from rvsg.world.world import Route
from rvsg_exchange.hunav_agents import read_agents
from rvsg_ros2.dds import Bus
from rvsg_ros2.interfaces import interfaces
from rvsg_ros2.ros2_world import FLAT_HUNAV_TYPES, HUNAV_TYPES

SPEED = 3.0
STEP_S = 0.05
START_S = 50.0
COMPUTE = "hunav_msgs/srv/ComputeAgents"
COMPUTED = {
    **FLAT_HUNAV_TYPES,
    f"{COMPUTE}_Request": "hunav_msgs/Agents current_agents\nhunav_msgs/Agent robot\n",
    f"{COMPUTE}_Response": "hunav_msgs/Agents updated_agents\n",
}


class PlayedWorld(Peer):
    """Publishes what Gazebo and HuNavSim's manager publish."""

    def __init__(self, agents: Path, settings: dict[str, Any]) -> None:
        interfaces("humble").register(COMPUTED if "manager" in settings else HUNAV_TYPES)
        domain = int(os.environ["ROS_DOMAIN_ID"])  # another run of this machine may hold the first one
        super().__init__(Options(domain=domain, localises=False))
        self.settings = settings
        self.people = read_agents(agents)[0]
        self.clock_out = self.writer("rt/clock", "rosgraph_msgs/msg/Clock")
        self.odom_out = self.writer("rt/odom", "nav_msgs/msg/Odometry")
        kind = "people_msgs/msg/People" if settings.get("people_msgs") else "hunav_msgs/msg/Agents"
        if "manager" in settings:
            self.manager = Manager(settings["manager"], domain, self.people)
        else:
            self.people_out = self.writer(f"rt/{settings.get('topic', 'human_states')}", kind)

    def play(self) -> None:
        world, route, humans = rehearsal()
        simulate_agents(world, route, humans)  # loads the kernels: afterwards there is no pause
        frozen = START_S
        while self.goal is None:
            still = [(*human.start, 0.0, 0.0) for human in self.people]
            self.publish(frozen, (-2.0, 0.0, 0.0), (0.0, 0.0), still)
            self.serve()
            frozen += STEP_S
            time.sleep(STEP_S / SPEED)
        self.begun_at, self.wall = frozen, time.monotonic()
        x, y = self.goal["poses"][-1]
        route = Route(name="room", start=Pose(x=-2.0, y=0.0), goal=Pose(x=x, y=y), time_limit_s=30.0)
        people = () if "manager" in self.settings else self.people
        run = simulate_agents(empty_room(), route, people, seed=5, outside=Outside(probe=self.probe, probe_ticks=5))
        path = run.trajectory
        human_x, human_y = self.manager.along(path.t) if "manager" in self.settings else (path.human_x, path.human_y)
        np.savez(self.settings["truth"], t=path.t, x=path.x, y=path.y, human_x=human_x, human_y=human_y)
        self.end(SUCCEEDED if run.outcome is Outcome.REACHED else ABORTED)
        until = time.monotonic() + 300.0  # a busy reader hears of the end late; it ends this process
        while time.monotonic() < until:
            self.serve()
            time.sleep(0.01)

    def probe(self, episode: Episode) -> None:
        assert self.goal is not None
        if self.goal["status"] != EXECUTING:
            raise SystemExit(0)
        if episode.t > self.settings.get("stop_at_s", math.inf):
            time.sleep(30.0)
        body, crowd = episode.state.body, episode.crowd
        people = [
            (float(crowd.x[k]), float(crowd.y[k]), float(crowd.yaw[k]), float(crowd.speed[k]))
            for k in range(crowd.x.size)
        ]
        pose = (float(body[base.X]), float(body[base.Y]), float(body[base.YAW]))
        self.publish(self.begun_at + episode.t, pose, (float(body[base.V]), float(body[base.W])), people)
        self.serve()
        time.sleep(max(0.0, self.wall + episode.t / SPEED - time.monotonic()))

    def publish(self, t: float, pose: Any, velocity: Any, people: Any) -> None:
        seconds, rest = divmod(round(t * 1e9), 10**9)
        T, stamp = self.T, self.T["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
        self.clock_out.write(T["rosgraph_msgs/msg/Clock"](clock=stamp))
        links = []
        for parent, child, (x, y, yaw) in (("map", "odom", (0, 0, 0)), ("odom", "base_footprint", pose),
                                           ("base_footprint", "base_link", (0, 0, 0))):  # fmt: skip
            each = T["geometry_msgs/msg/TransformStamped"](child_frame_id=child)
            each.header.frame_id, each.header.stamp = parent, stamp
            each.transform.translation.x, each.transform.translation.y = float(x), float(y)
            each.transform.rotation.z, each.transform.rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
            links.append(each)
        self.tf_out.write(T["tf2_msgs/msg/TFMessage"](transforms=links))
        odom = T["nav_msgs/msg/Odometry"]()
        odom.header.stamp = stamp
        odom.twist.twist.linear.x, odom.twist.twist.angular.z = velocity
        self.odom_out.write(odom)
        if "manager" in self.settings:
            self.manager.ask(t - self.begun_at if self.goal is not None else 0.0, stamp, pose, velocity)
        else:
            self.publish_people(stamp, people)

    def publish_people(self, stamp: Any, people: Any) -> None:
        T = self.T
        if self.settings.get("people_msgs"):
            message = T["people_msgs/msg/People"]()
            for human, (x, y, yaw, speed) in zip(self.people, people, strict=True):
                each = T["people_msgs/msg/Person"](name=human.name)
                each.position.x, each.position.y = x, y
                each.velocity.x, each.velocity.y = speed * math.cos(yaw), speed * math.sin(yaw)
                message.people.append(each)
        else:
            message = T["hunav_msgs/msg/Agents"]()
            for number, (human, (x, y, yaw, speed)) in enumerate(zip(self.people, people, strict=True)):
                each = T["hunav_msgs/msg/Agent"](id=number + 1, type=1, name=human.name, yaw=yaw, linear_vel=speed)
                each.position.position.x, each.position.position.y = x, y
                message.agents.append(each)
        message.header.stamp = stamp
        self.people_out.write(message)


class Manager:
    """HuNavSim's agent manager in a process of its own."""

    def __init__(self, command: str, domain: int, people: Any) -> None:
        self.process = subprocess.Popen(shlex.split(command), env={**os.environ, "ROS_DOMAIN_ID": str(domain)})
        self.bus = Bus(domain, "humble")
        self.client = self.bus.client("/compute_agents", COMPUTE)
        self.agents = [self._agent(number + 1, human) for number, human in enumerate(people)]
        self.seen: list[tuple[float, list[tuple[float, float]]]] = []

    def _agent(self, number: int, human: Any) -> Any:
        T = self.bus.types
        each = T["hunav_msgs/msg/Agent"](
            id=number, type=1, behavior=1, name=f"agent{number}", group_id=-1, cyclic_goals=True, goal_radius=0.3,
            desired_velocity=human.speed_m_s, radius=human.radius_m,
        )  # fmt: skip
        each.position.position.x, each.position.position.y = human.start
        for x, y in human.goals:
            goal = T["geometry_msgs/msg/Pose"]()
            goal.position.x, goal.position.y = x, y
            each.goals.append(goal)
        return each

    def ask(self, t: float, stamp: Any, pose: Any, velocity: Any) -> None:
        """Have the people moved on to a time; they stand until t is above 0."""
        T = self.bus.types
        now = T["hunav_msgs/msg/Agents"](agents=self.agents)
        now.header.stamp = stamp
        robot = T["hunav_msgs/msg/Agent"](id=0, type=2, name="robot", radius=0.35, yaw=pose[2], linear_vel=velocity[0])
        robot.position.position.x, robot.position.position.y = pose[:2]
        robot.velocity.linear.x = velocity[0] * math.cos(pose[2])
        robot.velocity.linear.y = velocity[0] * math.sin(pose[2])
        answer = self.client.call(20.0, current_agents=now, robot=robot)
        if answer is None:
            raise SystemExit("the agent manager does not answer")
        self.seen.append((t, [(each.position.position.x, each.position.position.y) for each in self.agents]))
        if t > 0.0:
            self.agents = sorted(answer.updated_agents.agents, key=lambda each: each.id)

    def along(self, t: Any) -> tuple[Any, ...]:
        """Return the people's places at these times, (T, N) each."""
        at = [one for one, _ in self.seen]
        places = np.array([each for _, each in self.seen])
        return tuple(
            np.column_stack([np.interp(t, at, places[:, k, axis]) for k in range(len(self.agents))]) for axis in (0, 1)
        )


if __name__ == "__main__":

    def stop(*_: object) -> None:
        raise SystemExit(0)

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    PlayedWorld(Path(sys.argv[1]), json.loads(Path(sys.argv[2]).read_text())).play()
