"""Who is responsible for a contact or a near miss: small trajectories whose answer a person would give."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from tests.evaluation.runs import run_of, trajectory

from rvsg.evaluation.detection import events_of
from rvsg.evaluation.metrics import measure
from rvsg.evaluation.responsibility import responsible
from rvsg.evaluation.sampled import sampled
from rvsg.evaluation.story import in_words
from rvsg.evaluation.verdict import MEASURED, summarise_safety
from rvsg.simulation.events import Contact, NearMiss, StandStill
from rvsg.simulation.run import Outcome, Run, Trajectory

STEP_S, TOUCH = 0.05, 100
T = np.arange(0.0, 6.001, STEP_S)
AHEAD, BESIDE, BEHIND = (0.75, 0.0), (0.0, 0.75), (-0.75, 0.0)
"""Offsets of the person, at which two discs just touch."""
BAR = ((0.5, 0.1), (-0.5, 0.1), (-0.5, -0.1), (0.5, -0.1))


def late(before: float, after: float, seconds: float) -> np.ndarray:
    """Return a value that changes this long before the touch."""
    return np.where(T[TOUCH] - seconds + 1e-9 > T, before, after)


def meeting(v=0.0, person=(0.0, 0.0), at=AHEAD, omega=0.0, gap=0.0, **more) -> Run:
    """A robot along x and a person with this velocity, who touch at an offset and stay there."""
    v, omega, ux, uy = (np.where(T[TOUCH] > T, value, 0.0) for value in (v, omega, *person))
    yaw = np.cumsum(omega) * STEP_S
    yaw -= yaw[TOUCH]
    x, y, hx, hy = (np.cumsum(rate) * STEP_S for rate in (v * np.cos(yaw), v * np.sin(yaw), ux, uy))
    away = 1.0 + gap / 0.75
    hx, hy = hx - hx[TOUCH] + x[TOUCH] + at[0] * away, hy - hy[TOUCH] + y[TOUCH] + at[1] * away
    human = (hx, hy, np.arctan2(uy, ux), np.hypot(ux, uy))
    series = trajectory(T, x, y, yaw=yaw, v=v, omega=omega, humans=[human])
    return run_of(series, goal=(9.0, 9.0, 0.0), robot_latency_s=0.1, **more)


CASES = {
    "a robot that stands": (meeting(0.0, (-1.0, 0.0)), "person"),
    "a robot that stopped long before": (meeting(late(0.5, 0.0, 1.2), (-1.0, 0.0)), "person"),
    "a robot that stopped just before": (meeting(late(0.5, 0.0, 0.2), (-1.0, 0.0)), "robot"),
    "into a person who stands": (meeting(0.5), "robot"),
    "backwards into a person who stands": (meeting(-0.3, at=BEHIND), "robot"),
    "head-on, both as before": (meeting(0.5, (-0.8, 0.0)), "robot"),
    "predictable crossing": (meeting(0.5, (0.0, -1.0), at=(0.53, 0.53)), "robot"),
    "a person who turns in from beside": (meeting(0.5, (0.5, late(0.0, -1.2, 0.4)), at=BESIDE), "person"),
    "a person who starts late, from beside": (meeting(0.3, (0.0, late(0.0, -1.5, 0.3)), at=BESIDE), "person"),
    "both approach, the person faster and faster": (meeting(0.5, (late(-0.4, -1.6, 0.4), 0.0)), "shared"),
    "a person who walks into its side": (meeting(0.15, (0.0, -1.0), at=BESIDE), "shared"),
    "a person who runs into its back": (meeting(0.3, (1.0, 0.0), at=BEHIND), "person"),
    "turning on the spot, the person stands": (
        meeting(omega=1.0, at=(0.3, 0.5), robot_outline=BAR, gap=0.001), "robot"
    ),
    "a disc that turns on the spot": (meeting(omega=1.0), "shared"),
    "at the start": (replace(meeting(), trajectory=trajectory([0.0], [0.0], humans=[(0.7, 0.0)])), "person"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_responsible_is_who_a_person_would_say(case: str) -> None:
    run, side = CASES[case]
    assert responsible(sampled(run), min(TOUCH, len(run.trajectory) - 1), 0) == side


@pytest.mark.parametrize(("case", "counted"), [("a robot that stands", 0), ("into a person who stands", 1)])
def test_requirements_count_what_the_robot_is_responsible_for_and_the_old_metrics_all(case: str, counted: int) -> None:
    run, side = CASES[case]
    contact = next(event for event in events_of(run) if isinstance(event, Contact))
    assert contact.responsible == side and in_words(contact).endswith("responsible.")
    values = measure(run, ["contacts", "min_distance", "robot_contacts", "robot_clearance"])
    assert (values["contacts"], values["min_distance"]) == (1.0, pytest.approx(0.0, abs=1e-6))
    assert values["robot_contacts"] == counted
    summary = summarise_safety([measure(run, MEASURED)])
    assert summary.contacts.in_words == f"1 of 1 run (the robot is responsible in {counted})"
    assert (values["robot_clearance"] < 0.1) == bool(counted)


def test_near_misses_and_standstills_have_a_side_and_a_goal_that_is_taken_is_the_persons() -> None:
    run = meeting(0.5, gap=0.1, outcome=Outcome.TIMED_OUT)
    assert [e.responsible for e in events_of(run) if isinstance(e, NearMiss | StandStill)] == ["robot", "robot"]
    on_goal = replace(run, goal=(float(run.trajectory.human_x[-1, 0]), 0.0, 0.0))
    assert [e.responsible for e in events_of(on_goal) if isinstance(e, StandStill)] == ["person"]


def test_sparse_samples_are_judged_and_a_run_without_people_is_not() -> None:
    dense, side = CASES["into a person who stands"]
    path = dense.trajectory
    columns = {f.name: value[::10] if len(value := getattr(path, f.name)) else value for f in fields(path)}
    assert responsible(sampled(replace(dense, trajectory=Trajectory(**columns))), TOUCH // 10, 0) == side
    values = measure(run_of(trajectory(T, 0.0)), ["robot_contacts", "robot_clearance"])
    assert values == {"robot_contacts": None, "robot_clearance": None}
