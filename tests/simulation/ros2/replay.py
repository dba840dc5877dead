"""A process that sends again what the real Nav2 sent during a recorded run: answers, feedback and velocities.

`python replay.py OPTIONS.json`, where the options name the recording. Bytes go out as they were recorded, but for the
ids of the caller and of the goal, which are those of the run now.
"""

from __future__ import annotations

import base64
import json
import math
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from peer import qos, valid

from rvsg_ros2.interfaces import interfaces

ACTION = "navigate_through_poses/_action"


class Replay:
    def __init__(self, recorded: dict[str, Any], domain: int) -> None:
        self.T = interfaces("jazzy")
        self.dp = DomainParticipant(domain)
        self.heard = {"goals": 0, "poses": 0}
        self.now = 0.0
        self.goal: tuple[float, Any] | None = None
        self.waiting: Any = None
        self.clock = self.reader("rt/clock", "rosgraph_msgs/msg/Clock", reliable=False)
        self.replies: dict[str, tuple[Any, Any, Any]] = {}
        self.due: list[tuple[float, Any, Any]] = []
        writers: dict[str, Any] = {}
        for each in recorded["samples"]:
            topic, kind, data = each["topic"], each["type"], base64.b64decode(each["cdr"])
            if topic.startswith("rr/"):
                name = topic.removeprefix("rr/").removesuffix("Reply")
                if name not in self.replies:
                    self.replies[name] = self.server(name, kind, self.T.part_of_service(kind).deserialize(data))
            else:
                made = self.T[kind].deserialize(data)
                if topic not in writers:
                    writers[topic] = self.writer(topic, kind)
                self.due.append((each["t"], writers[topic], made))
            if topic == f"rr/{ACTION}/get_resultReply":
                self.end_t = each["t"]

    def reader(self, topic: str, kind: str, *, reliable: bool = True, made: Any = None) -> Any:
        return DataReader(
            self.dp, Topic(self.dp, topic, made or self.T[kind]), qos=qos(kind, self.T, True, reliable=reliable)
        )

    def writer(self, topic: str, kind: str, made: Any = None) -> Any:
        return DataWriter(self.dp, Topic(self.dp, topic, made or self.T[kind]), qos=qos(kind, self.T, True))

    def server(self, name: str, reply_kind: str, message: Any) -> tuple[Any, Any, Any]:
        kind = reply_kind.replace("_Response", "_Request")
        asked = self.reader(f"rq/{name}Request", kind, made=self.T.part_of_service(kind))
        return asked, self.writer(f"rr/{name}Reply", reply_kind, type(message)), message

    def run(self) -> None:
        while os.getppid() != 1:
            for message in valid(self.clock, 50):
                self.now = message.clock.sec % 100000 + message.clock.nanosec / 1e9
            for name, (asked, answers, message) in self.replies.items():
                for request in valid(asked, 20):
                    self.answer(name, request, answers, message)
            self.play()
            time.sleep(0.0005)

    def answer(self, name: str, request: Any, answers: Any, message: Any) -> None:
        if name == f"{ACTION}/send_goal":
            self.goal = (self.now, request.goal_id)
            self.heard["goals"] += 1
            self.heard["poses"] = len(request.goal.poses)
        if name == f"{ACTION}/get_result":
            self.waiting = request
            return
        message.rmw_guid, message.rmw_sequence = request.rmw_guid, request.rmw_sequence
        answers.write(message)

    def play(self) -> None:
        """Send what is due since the goal came; the result last."""
        since = self.now - self.goal[0] if self.goal is not None else -math.inf
        while self.due and self.due[0][0] <= since:
            _, writer, message = self.due.pop(0)
            if hasattr(message, "goal_id"):
                message.goal_id = self.goal[1]  # type: ignore[index]
            writer.write(message)
        if self.waiting is not None and since >= self.end_t:
            _, answers, message = self.replies[f"{ACTION}/get_result"]
            message.rmw_guid, message.rmw_sequence = self.waiting.rmw_guid, self.waiting.rmw_sequence
            answers.write(message)
            self.waiting = None


if __name__ == "__main__":
    given = json.loads(Path(sys.argv[1]).read_text())
    replay = Replay(json.loads(Path(given["recording"]).read_text()), int(os.environ.get("ROS_DOMAIN_ID", "0")))

    def stop(*_: object) -> None:
        raise SystemExit(0)

    signal.signal(signal.SIGTERM, stop)
    try:
        replay.run()
    finally:
        Path(given["report"]).write_text(json.dumps(replay.heard))
