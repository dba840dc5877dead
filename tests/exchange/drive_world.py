"""Makes a run of the simulator ros2-world against play_world.py and prints how far it is from the played one."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from tests.simulation.ros2.drive import raise_loopback

from rvsg.core.errors import RvsgError
from rvsg.core.records import Pose
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.archive import run_from_json, run_to_json
from rvsg.simulation.embedded.simulator import empty_room
from rvsg.world.world import Route
from rvsg_ros2 import ros2_world
from rvsg_ros2.ros2_world import Ros2World

HUMANS = (
    HumanAgent(name="Ann", start=(0.5, 2.0), goals=((0.5, 2.0), (0.5, -2.0)), pauses_s=(0.0, 0.0)),
    HumanAgent(name="Bob", start=(2.0, -2.0), goals=((2.0, -2.0), (-2.0, -2.0)), pauses_s=(0.0, 0.0), speed_m_s=0.7),
)


class Mission:
    route = Route(name="room", start=Pose(x=-2.0, y=0.0), goal=Pose(x=1.5, y=0.5), time_limit_s=25.0)
    moved = ()


class Scenario:
    """What the simulator reads of a scenario, in a room without waypoints."""

    id = "scenario-room"
    mission = Mission()
    people = SimpleNamespace(humans=())


def main(given: dict[str, Any]) -> dict[str, Any]:
    ros2_world.decode = lambda people, grid, radius_m: HUMANS  # type: ignore[assignment]
    folder = Path(tempfile.mkdtemp())
    settings = folder / "settings.json"
    settings.write_text(json.dumps({"truth": str(folder / "truth.npz"), **given.get("world", {})}))
    player = Path(__file__).with_name("play_world.py")
    simulator = Ros2World(
        launch=f"{sys.executable} {player} {{agents}} {settings}",
        release="humble",
        **{"start_limit_s": 300.0, "answer_limit_s": 30.0, **given.get("options", {})},  # a busy machine starts slowly
    )
    notes: list[str] = []
    simulator.prepare(notes.append)
    try:
        run = simulator.run(Scenario(), empty_room(), seed=3)  # type: ignore[arg-type]
    except RvsgError as error:
        return {"error": str(error)}
    told: dict[str, Any] = {
        "outcome": run.outcome.name, "details": run.details, "t": run.trajectory.t[[0, -1]].tolist(),
        "rows": len(run.trajectory), "names": run.human_names, "again": run_from_json(run_to_json(run)).id == run.id,
        "log": np.diff(run.log.t).tolist(),
    }  # fmt: skip
    if (folder / "truth.npz").exists():
        truth, path = np.load(folder / "truth.npz"), run.trajectory
        told["off"] = _off(truth, path)
        steps = np.hypot(np.diff(path.human_x, axis=0), np.diff(path.human_y, axis=0))
        told["walked"] = steps.sum(axis=0).tolist()
    return told


def _off(truth: Any, path: Any) -> dict[str, float]:
    """The largest differences (m) of the robot and of people, with the shift of time between the two taken out."""
    shifts = np.arange(-0.3, 5.0, 0.01)  # a busy machine hears late that the goal was accepted
    apart = [float(np.abs(np.interp(path.t + s, truth["t"], truth["x"]) - path.x).max()) for s in shifts]
    best = shifts[int(np.argmin(apart))]
    people = [
        np.hypot(
            np.interp(path.t + best, truth["t"], truth["human_x"][:, k]) - path.human_x[:, k],
            np.interp(path.t + best, truth["t"], truth["human_y"][:, k]) - path.human_y[:, k],
        ).max()
        for k in range(2)
    ]
    return {"shift": float(best), "robot": min(apart), "people": float(max(people))}


if __name__ == "__main__":
    raise_loopback()
    print(json.dumps(main(json.loads(sys.argv[1]))))
