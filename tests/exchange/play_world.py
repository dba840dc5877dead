"""A process that plays Gazebo with HuNavSim for the tests: the embedded world, published as such a world is.

`python play_world.py AGENTS.yaml SETTINGS.json`. It starts the people of the agents file, waits for a goal, drives to
it with the embedded simulator and publishes clock, transforms, odometry and people.
"""

from __future__ import annotations

import json
import math
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from tests.simulation.ros2.peer import ABORTED, EXECUTING, SUCCEEDED, Options, Peer

from rvsg.core.records import Pose
from rvsg.exchange.hunav import read_agents, to_humans
from rvsg.exchange.ros_types import HUNAV_TYPES
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded.episode import Episode, Outside
from rvsg.simulation.embedded.rehearsal import empty_room, rehearsal
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.ros2.interfaces import interfaces
from rvsg.simulation.run import Outcome
from rvsg.world.world import Route

SPEED = 3.0
STEP_S = 0.05
START_S = 50.0


class PlayedWorld(Peer):
    """Publishes what Gazebo and HuNavSim's manager publish."""

    def __init__(self, agents: Path, settings: dict[str, Any]) -> None:
        interfaces("humble").register(HUNAV_TYPES)
        super().__init__(Options(domain=settings.get("domain", 0), localises=False))
        self.settings = settings
        self.people = to_humans(read_agents(agents)).agents
        self.clock_out = self.writer("rt/clock", "rosgraph_msgs/msg/Clock")
        self.odom_out = self.writer("rt/odom", "nav_msgs/msg/Odometry")
        kind = "people_msgs/msg/People" if settings.get("people_msgs") else "hunav_msgs/msg/Agents"
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
        run = simulate_agents(
            empty_room(), route, self.people, seed=5, outside=Outside(probe=self.probe, probe_ticks=5)
        )
        path = run.trajectory
        np.savez(self.settings["truth"], t=path.t, x=path.x, y=path.y, human_x=path.human_x, human_y=path.human_y)
        self.end(SUCCEEDED if run.outcome is Outcome.REACHED else ABORTED)
        until = time.monotonic() + 20.0
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


if __name__ == "__main__":

    def stop(*_: object) -> None:
        raise SystemExit(0)

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    PlayedWorld(Path(sys.argv[1]), json.loads(Path(sys.argv[2]).read_text())).play()
