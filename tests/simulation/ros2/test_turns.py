"""Runs of several processes on one ROS 2 system take turns."""

from __future__ import annotations

from pathlib import Path

import pytest

from rvsg.core.errors import SimulationError
from rvsg_ros2 import session
from rvsg_ros2.session import GAP_S, Turn


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(session.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(session, "TELL_S", 0.05)


def test_who_waits_is_told_for_what() -> None:
    told: list[str] = []
    one, other = Turn(7), Turn(7)
    one.take(0.0)
    with pytest.raises(SimulationError):
        other.take(0.2, told.append)
    assert len(told) == 1 and "domain 7" in told[0]


def test_ros_time_never_goes_back_from_one_process_to_the_next() -> None:
    one, other = Turn(7), Turn(7)
    reached = one.take(0.0) + 1000 * 10**9
    one.give_back(reached)
    assert other.take(0.2) == reached + GAP_S * 10**9
