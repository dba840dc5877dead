"""Drives runs with the stack ros2 against a peer and prints what came of it as JSON. Run by isolated.drive."""

from __future__ import annotations

import fcntl
import json
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from rvsg.core.errors import RvsgError
from rvsg.core.records import Pose
from rvsg.robots.robot import load_robot
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.embedded.simulator import empty_room, simulate_agents
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg.world.world import Route
from rvsg_ros2 import launch
from rvsg_ros2.check import check_ros2
from rvsg_ros2.stack import Ros2Stack

HERE = Path(__file__).parent


def raise_loopback() -> None:
    """Set lo up in a new network namespace; where that is not allowed it is up already."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as handle:
        flags = struct.unpack("16sh", fcntl.ioctl(handle, 0x8913, struct.pack("16sh", b"lo", 0)))[1]
        if not flags & 1:
            fcntl.ioctl(handle, 0x8914, struct.pack("16sh", b"lo", flags | 1))


def main(given: dict[str, Any]) -> dict[str, Any]:
    folder = Path(tempfile.mkdtemp())
    report = folder / "report.json"
    settings = folder / "peer.json"
    settings.write_text(json.dumps({**(given["peer"] or {}), "report": str(report)}))
    options = {
        "start_limit_s": 300.0,
        "answer_limit_s": 30.0,
        **given.get("options", {}),
    }  # a busy machine starts slowly
    process, program = None, HERE / given.get("program", "peer.py")
    if "launch" in options:
        options["launch"] = options["launch"].replace("{peer}", f"{sys.executable} {program} {settings}")
    elif given["peer"] is not None:
        process = subprocess.Popen([sys.executable, str(program), str(settings)])
    told: dict[str, Any] = {"messages": [], "runs": []}
    stack = None
    try:
        if "check" in given:
            found = check_ros2(options, seconds=given["check"])
            told["usable"], told["release"] = found.is_usable, found.release
            told["findings"] = {each.name: [each.status.name, each.detail] for each in found.findings}
            return told
        stack = Ros2Stack(**options)
        stack.prepare(told["messages"].append)
        for seed in range(given.get("runs", 1)):
            told["runs"].append(run(stack, seed, given))
            told["runs"][-1]["entities"] = len(stack._session.bus._kept) if stack._session is not None else 0
        told["mark"] = mark_of(stack)
    except RvsgError as error:
        told["error"] = str(error)
    finally:
        if stack is not None:
            mark = mark_of(stack)
            stack.close()
            told["left"] = launch.marked(mark) if mark else []
        if process is not None:
            process.terminate()
            process.wait()
    told["heard"] = json.loads(report.read_text()) if report.exists() else {}
    return told


def mark_of(stack: Ros2Stack) -> str:
    session = stack._session
    return session.launched.mark if session is not None and session.launched is not None else ""


def run(stack: Ros2Stack, seed: int, given: dict[str, Any]) -> dict[str, Any]:
    through = tuple(Pose(x=x, y=y) for x, y in given.get("through", ()))
    route = Route(
        name="room", start=Pose(x=-2.0, y=0.0), goal=Pose(x=1.0, y=0.5), through=through,
        time_limit_s=given.get("limit", 15.0),
    )  # fmt: skip
    human = HumanAgent(name="human", start=(0.5, 2.0), goals=((0.5, 2.0), (2.0, 2.0)), pauses_s=(0.0, 0.0))
    begun = time.monotonic()
    made = simulate_agents(
        empty_room(), route, [human], seed=seed, robot=load_robot(given.get("robot", "tiago_omni")),
        stack=StackChoice.of(stack),
    )  # fmt: skip
    return {
        "outcome": made.outcome.name, "t": float(made.trajectory.t[-1]), "wall": time.monotonic() - begun,
        "recoveries": made.recoveries, "x": float(made.trajectory.x[-1]), "y": float(made.trajectory.y[-1]),
        "stack": made.details["stack"], "id": made.id,
    }  # fmt: skip


if __name__ == "__main__":
    raise_loopback()
    print(json.dumps(main(json.loads(sys.argv[1]))))
