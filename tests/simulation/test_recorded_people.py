"""People who follow recorded tracks in the embedded simulator."""

from __future__ import annotations

import numpy as np
import pytest
from tests.simulation.parts import ALONG, hall, person

from rvsg.core.errors import InputError
from rvsg.scenario.scenario import HumanAgent, Track
from rvsg.simulation.archive import PackedRun
from rvsg.simulation.embedded.profiles import profile
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.events import Contact
from rvsg.simulation.run import Outcome, Run

ROOM = hall(gap=False)
WAY = tuple((14.0 - 0.2 * k, 3.0) for k in range(51))
"""From x = 14 to 4 m at 1 m/s."""


def walker(track: Track, *goals: tuple[float, float]) -> HumanAgent:
    return person(*(goals or (track.points[0], track.points[-1]))).model_copy(update={"track": track})


def drive(*people: HumanAgent, driven: Track | None = None, limit_s: float = 40.0) -> Run:
    route = ALONG.model_copy(update={"time_limit_s": limit_s})
    return simulate_agents(ROOM, route, people, seed=1, driven=driven)


def test_a_person_is_where_the_track_says_and_absent_before_and_after() -> None:
    track = Track(start_s=3.0, points=WAY)
    run = drive(walker(track))
    t, x, y = run.trajectory.t, run.trajectory.human_x[:, 0], run.trajectory.human_y[:, 0]
    there = (t >= 3.2) & (t <= 12.9)
    expected = np.interp(t, 3.0 + 0.2 * np.arange(51), [point[0] for point in WAY])
    assert np.abs(x - expected)[there].max() <= 0.11  # people move every 0.1 s
    assert np.abs(y - 3.0)[there].max() < 1e-6
    assert run.trajectory.human_speed[there, 0] == pytest.approx(1.0, abs=0.05)
    assert (x[(t < 2.9) | (t > 13.2)] < -20.0).all()
    assert run.outcome is Outcome.REACHED
    assert PackedRun.of(drive(walker(track))).data == PackedRun.of(run).data


def test_a_person_on_a_track_does_not_make_way() -> None:
    track = Track(points=tuple((14.0 - 0.2 * k, 2.0) for k in range(51)))
    run = drive(walker(track))
    moved = np.abs(run.trajectory.human_y[run.trajectory.t < 9.9, 0] - 2.0)
    assert moved.max() < 0.11 and any(isinstance(event, Contact) for event in run.events)


def test_who_does_not_leave_goes_on_with_the_tasks_at_the_end_of_the_track() -> None:
    track = Track(points=WAY[:11], leaves=False)
    run = drive(walker(track, WAY[0], WAY[10], (12.0, 1.0)))
    assert run.details["left_tracks_s"] == {"P": pytest.approx(2.1, abs=0.2)}
    assert np.hypot(run.trajectory.human_x[-1, 0] - 12.0, run.trajectory.human_y[-1, 0] - 1.0) < 0.6


def test_a_blended_person_turns_to_the_tasks_where_the_robot_differs_from_the_recording() -> None:
    same = drive()
    rows = same.trajectory.t <= 30.0
    k = np.searchsorted(same.trajectory.t[rows], np.arange(0.0, 20.0, 0.2))
    driven = Track(points=tuple(zip(same.trajectory.x[k], same.trajectory.y[k], strict=True)))
    track = Track(points=WAY, until_m=0.5)
    as_recorded = drive(walker(track), driven=driven)
    assert "left_tracks_s" not in as_recorded.details
    stands = Track(points=((2.0, 2.0),))
    differs = drive(walker(track), driven=stands)
    left = differs.details["left_tracks_s"]
    assert isinstance(left, dict) and 1.0 < left["P"] < 6.0
    before = slice(int(np.searchsorted(differs.trajectory.t, left["P"] - 0.2)))
    assert np.array_equal(differs.trajectory.human_x[before], as_recorded.trajectory.human_x[before])
    assert np.hypot(differs.trajectory.human_x[-1, 0] - 4.0, differs.trajectory.human_y[-1, 0] - 3.0) < 0.6


def test_the_profile_of_the_study_refuses_tracks() -> None:
    with pytest.raises(InputError):
        simulate_agents(ROOM, ALONG, [walker(Track(points=WAY))], options=profile("published-study"))
