"""The record of a run on a ROS 2 system: plans, costmaps, missed control periods, and how the action ended."""

from __future__ import annotations

import base64
import math
import zlib
from typing import TYPE_CHECKING, Any

from rvsg.simulation.stacks.protocol import Observation, Task
from rvsg_ros2.dds import ActionClient, Subscription
from rvsg_ros2.interfaces import Release
from rvsg_ros2.nav2_file import CONTROL_HZ
from rvsg_ros2.options import Ros2Options

if TYPE_CHECKING:
    from rvsg_ros2.session import Session

PAUSE_S = 1.0
"""A longer gap between commands is a pause of the behaviour tree, not a missed period."""
NEAR_M, AWAY_M = 1.0, 1.5
"""The robot turns back at a pose to drive through where it was nearer than the first and is farther than the second,
and the pose is still to come."""
MOST_PLANS, MOST_POINTS, MOST_CHANGES, MOST_COSTMAPS = 200, 60, 2000, 200
COSTMAP_EVERY_S = 1.0
LOST_SHARE, LOST_AFTER = 0.1, 100
"""A run with a larger share of missed control periods, after so many of them, says nothing of the system under test."""
FOLLOWS = "FollowPath"
"""The node of Nav2's behaviour trees in which its controller drives; recoveries command at rates of their own."""


Pose2D = tuple[float, float, float]


def composed(a: Pose2D, b: Pose2D) -> Pose2D:
    """Return the pose b, which is given in the frame at a, in a's frame: x m, y m, yaw rad."""
    cos, sin = math.cos(a[2]), math.sin(a[2])
    return a[0] + cos * b[0] - sin * b[1], a[1] + sin * b[0] + cos * b[1], a[2] + b[2]


class RunRecord:
    """Counts and lists of one run; `facts` returns them."""

    def __init__(self, speed: float, task: Task, release: Release) -> None:
        self.release = release
        self.failed = False
        """Whether a node crashed or hung."""
        self.control_hz = CONTROL_HZ
        """The rate at which commands are due, in simulated time."""
        self._speed, self._task = speed, task
        self._warnings: list[str] = []
        self._commands = self._missed = 0
        self._last: float | None = None
        self._follows = True
        self._recoveries = self._turned_back = 0
        self._was_near = False
        self._remaining = len(task.goals)
        self._plans: list[Any] = []
        self._changes: list[Any] = []
        self._status: dict[tuple[str, int], str] = {}
        self._result: dict[str, Any] = {}
        self._costmaps: list[dict[str, Any]] = []
        self._costmap_t: dict[str, float] = {}
        self._costmap_topics: dict[str, Subscription] = {}
        self._plan_topic: Subscription | None = None
        self._tree_topic: Subscription | None = None

    def listen(self, session: Session, options: Ros2Options) -> None:
        """Subscribe to plans, costmaps and the log of the behaviour tree."""
        self._plan_topic = session.bus.subscribe(options.plan, "nav_msgs/msg/Path")
        self._tree_topic = session.bus.subscribe(options.behaviour_tree_log, "nav2_msgs/msg/BehaviorTreeLog")
        self._costmap_topics = {
            topic: session.bus.subscribe(topic, "nav_msgs/msg/OccupancyGrid", depth=1) for topic in options.costmaps
        }

    def warn(self, text: str) -> None:
        """Keep a warning, once."""
        if text not in self._warnings:
            self._warnings.append(text)

    def commanded(self, at: float) -> None:
        """Count a command sent at this simulated time, s."""
        self._commands += 1
        if self._last is not None and self._follows:
            gap = at - self._last
            if 1.5 / self.control_hz < gap < PAUSE_S:
                self._missed += round(gap * self.control_hz) - 1
        self._last = at

    @property
    def missed_share(self) -> float:
        """Missed control periods over all."""
        return self._missed / max(1, self._missed + self._commands)

    @property
    def has_commands(self) -> bool:
        """Whether a velocity command came."""
        return self._commands > 0

    @property
    def lost_pace(self) -> bool:
        """Whether so many periods are missed that the run cannot be judged."""
        return self._missed + self._commands > LOST_AFTER and self.missed_share > LOST_SHARE

    @property
    def missed(self) -> str:
        """The missed control periods, in words."""
        due = self._missed + self._commands
        return f"controller: {self._missed} of {due} periods of {1.0 / self.control_hz:.3g} s missed"

    def note(self, seen: Observation, feedback: Any) -> None:
        """Take over feedback, plans, costmaps and the behaviour tree's log."""
        if feedback is not None:
            self._recoveries = max(self._recoveries, int(feedback.number_of_recoveries))
            self._watch_poses(seen, int(getattr(feedback, "number_of_poses_remaining", 0)))
        if self._plan_topic is not None:
            for plan in self._plan_topic.take():
                if len(self._plans) < MOST_PLANS and plan.poses:
                    step = math.ceil(len(plan.poses) / MOST_POINTS)
                    points = [(p.pose.position.x, p.pose.position.y) for p in plan.poses[::step]]
                    self._plans.append([round(seen.t, 2), [[round(x, 3), round(y, 3)] for x, y in points]])
        if self._tree_topic is not None:
            for message in self._tree_topic.take():
                for change in message.event_log:
                    if change.node_name == FOLLOWS:
                        self._follows = change.current_status == "RUNNING"
                    self._keep_change(seen.t, change)
        for topic, subscription in self._costmap_topics.items():
            for grid in subscription.take()[-1:]:
                due = seen.t >= self._costmap_t.get(topic, -math.inf) + COSTMAP_EVERY_S
                if due and len(self._costmaps) < MOST_COSTMAPS:
                    self._costmap_t[topic] = seen.t
                    self._costmaps.append({"topic": topic, "t": round(seen.t, 2), **packed(grid)})

    def _keep_change(self, t: float, change: Any) -> None:
        """Keep a change of the behaviour tree. A node that is reset and comes to the same state again, as conditions do
        at every tick, has not changed."""
        node = (change.node_name, getattr(change, "uid", 0))
        if change.current_status == "IDLE" or self._status.get(node) == change.current_status:
            return
        self._status[node] = change.current_status
        if len(self._changes) < MOST_CHANGES:
            self._changes.append([round(t, 2), change.node_name, change.current_status])

    def _watch_poses(self, seen: Observation, remaining: int) -> None:
        """Count how often the robot leaves a pose to drive through that does not count as passed."""
        if remaining != self._remaining or not 1 < remaining <= len(self._task.goals):
            self._remaining, self._was_near = remaining, False
            return
        x, y, _ = composed(seen.map_from_odom, seen.pose)
        pose = self._task.goals[-remaining]
        distance = math.hypot(pose.x - x, pose.y - y)
        if distance < NEAR_M:
            self._was_near = True
        elif self._was_near and distance > AWAY_M:
            self._turned_back, self._was_near = self._turned_back + 1, False

    def end(self, client: ActionClient) -> None:
        """Keep how the action ended."""
        result = client.result
        self._result = {
            "status": client.status,
            "error_code": int(getattr(result, "error_code", 0)),
            "error_msg": str(getattr(result, "error_msg", "")),
        }

    def facts(self, speed: float) -> dict[str, Any]:
        """Return everything as JSON-able data; `speed` is the one that was reached."""
        warnings = list(self._warnings)
        if self._missed:
            warnings.append(self.missed)
        if speed < 0.95 * self._speed:
            warnings.append(f"speed {speed:.2f} reached, {self._speed:g} asked")
        return {
            "repeatable": False,
            "release": self.release,
            "speed_asked": self._speed,
            "speed": round(speed, 3),
            "control_hz": round(self.control_hz, 3),
            "commands": self._commands,
            "missed_periods": self._missed,
            "recoveries": self._recoveries,
            "turned_back": self._turned_back,
            "result": self._result,
            "plans": self._plans,
            "behaviour_tree": self._changes,
            "costmaps": self._costmaps,
            "warnings": warnings,
        }


def packed(grid: Any) -> dict[str, Any]:
    """Return an OccupancyGrid as JSON-able data: its cells (int8, row by row) compressed by zlib, in base64."""
    info = grid.info
    cells = bytes(cell & 0xFF for cell in grid.data)
    return {
        "frame": grid.header.frame_id,
        "origin": [round(info.origin.position.x, 4), round(info.origin.position.y, 4)],
        "resolution": round(info.resolution, 6),
        "shape": [info.height, info.width],
        "cells": base64.b64encode(zlib.compress(cells, 6)).decode(),
    }
