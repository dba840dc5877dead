"""Parts of a run on a ROS 2 system: when commands act, what is recorded, whose map it has, and whose turn it is."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rvsg.core.errors import SimulationError
from rvsg.core.records import Pose
from rvsg.simulation.stacks.protocol import Observation, Task
from rvsg.world.world import OCCUPIED
from rvsg.world.world_folder import load_world
from rvsg_ros2 import session
from rvsg_ros2.interfaces import interfaces
from rvsg_ros2.run_record import RunRecord
from rvsg_ros2.session import GAP_S, DdsMessages, Turn
from rvsg_ros2.stack import SAME, STEP_S, CommandQueue, share_of_obstacles


@pytest.mark.parametrize("rate_hz", [10.0, 20.0, 25.0, 50.0])
def test_commands_of_a_usual_rate_act_at_equal_distances(rate_hz: float) -> None:
    step, period = round(1000 * STEP_S), round(1000 / rate_hz)
    for phase in range(period):
        acts = [-(-(phase + k * period) // step) * step for k in range(50)]
        assert {later - earlier for earlier, later in pairwise(acts)} == {period}


def sent(at: float, v: float) -> Any:
    velocity = SimpleNamespace(linear=SimpleNamespace(x=v, y=0.0), angular=SimpleNamespace(z=0.0))
    return SimpleNamespace(twist=velocity, sample_info=SimpleNamespace(source_timestamp=round(at * 1e9)))


def test_commands_that_are_taken_late_act_at_the_distances_in_which_they_were_sent() -> None:
    queue = CommandQueue()
    assert queue.put([sent(10.01, 0.1), sent(10.02, 0.2), sent(10.03, 0.3)], now=10.035)
    assert not queue.put([], now=10.035)
    acted = [[twist.vx for _, twist in queue.before(10.0 + 0.005 * k)] for k in range(1, 8)]
    assert acted == [[], [0.1], [], [0.2], [], [0.3], []]


def test_a_sender_whose_clock_is_ahead_is_obeyed_when_it_is_heard() -> None:
    queue = CommandQueue()
    queue.put([sent(99.0, 0.4)], now=10.0)
    assert [(at, twist.vx) for at, twist in queue.before(10.0)] == [(10.0, 0.4)]


SEEN = cast(Observation, SimpleNamespace(t=1.0))


def record() -> RunRecord:
    return RunRecord(1.0, cast(Task, SimpleNamespace(goals=(Pose(x=0.0, y=0.0),))), "jazzy")


def log(*changes: tuple[str, int, str]) -> Any:
    events = [SimpleNamespace(node_name=name, uid=uid, current_status=status) for name, uid, status in changes]
    return SimpleNamespace(event_log=events)


def test_conditions_that_are_asked_at_every_tick_do_not_fill_the_log_of_the_tree() -> None:
    made = record()
    tick = log(("GoalUpdated", 7, "FAILURE"), ("GoalUpdated", 7, "IDLE"))
    begun, ended = log(("Spin", 8, "RUNNING")), log(("Spin", 8, "SUCCESS"), ("Spin", 8, "IDLE"))
    messages = [begun, *[tick] * 5000, ended, begun]
    made._tree_topic = cast(Any, SimpleNamespace(take=lambda: messages))
    made.note(SEEN, None)
    kept = [change[1:] for change in made.facts(1.0)["behaviour_tree"]]
    assert kept == [["Spin", "RUNNING"], ["GoalUpdated", "FAILURE"], ["Spin", "SUCCESS"], ["Spin", "RUNNING"]]


def test_nodes_of_one_name_are_told_apart() -> None:
    made = record()
    messages = [log(("ComputePathToPose", 3, "RUNNING"), ("ComputePathToPose", 4, "RUNNING"))]
    made._tree_topic = cast(Any, SimpleNamespace(take=lambda: messages))
    made.note(SEEN, None)
    assert len(made.facts(1.0)["behaviour_tree"]) == 2


def grid(world: str, *, resolution: float = 0.05, aside_m: float = 0.0) -> object:
    """The map of a shipped world as a map server publishes it."""
    shown = load_world(world).occupancy
    rows, columns = shown.cells.shape
    step = round(resolution / shown.resolution)
    cells = np.where(shown.cells == OCCUPIED, 100, 0)[: rows - rows % step, : columns - columns % step]
    cells = cells.reshape(rows // step, step, columns // step, step).max(axis=(1, 3))
    made = DdsMessages(interfaces("jazzy"))
    origin = (shown.origin.x + aside_m, shown.origin.y, 0.0)
    found: object = made.grid(made.stamp(0), "map", cells, resolution, origin)
    return found


@pytest.mark.parametrize(("resolution", "aside_m"), [(0.05, 0.0), (0.1, 0.0), (0.05, 0.1)])
def test_the_map_of_the_world_is_taken_in_other_resolutions_too(resolution: float, aside_m: float) -> None:
    shown = grid("warehouse", resolution=resolution, aside_m=aside_m)
    assert share_of_obstacles(shown, load_world("warehouse").occupancy) > 0.95


@pytest.mark.parametrize("world", ["hospital", "office"])
def test_the_map_of_another_world_is_not(world: str) -> None:
    assert share_of_obstacles(grid(world), load_world("warehouse").occupancy) < SAME


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(session.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(session, "TELL_S", 0.05)


@pytest.mark.usefixtures("folder")
def test_who_waits_is_told_for_what() -> None:
    told: list[str] = []
    one, other = Turn(7), Turn(7)
    one.take(0.0)
    with pytest.raises(SimulationError):
        other.take(0.2, told.append)
    assert len(told) == 1 and "domain 7" in told[0]


@pytest.mark.usefixtures("folder")
def test_ros_time_never_goes_back_from_one_process_to_the_next() -> None:
    one, other = Turn(7), Turn(7)
    reached = one.take(0.0) + 1000 * 10**9
    one.give_back(reached)
    assert other.take(0.2) == reached + GAP_S * 10**9
