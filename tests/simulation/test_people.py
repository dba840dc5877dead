"""The social force model against values computed with the original header, and the people's ticks."""

from __future__ import annotations

import pytest

from rvsg.simulation.people.forces import coherence_force, desired_force, gaze_force, obstacle_force, social_force


def test_the_goal_pulls_as_in_the_original() -> None:
    assert desired_force(10.0, 0.0, 0.3, 0.0, 0.0, 1.5, 2.0) == pytest.approx((6.0, 0.0))
    assert desired_force(10.0, 0.0, 0.3, 0.5, 0.5, 1.5, 2.0) == pytest.approx((4.0, -2.0))
    assert desired_force(0.0, 0.0, 0.3, 1.0, 0.0, 1.5, 2.0) == pytest.approx((-2.0, 0.0))


@pytest.mark.parametrize(
    ("other", "velocity", "force"),
    [
        ((2.0, 0.0), (2.5, 0.0), (-1.929107, 0.0)),
        ((2.0, 0.3), (2.5, 0.0), (-0.999606, -1.478699)),
        ((1.0, -0.5), (0.5, 0.5), (-0.181866, 0.302218)),
    ],
)
def test_another_one_pushes_as_in_the_original(
    other: tuple[float, float], velocity: tuple[float, float], force: tuple[float, float]
) -> None:
    assert social_force(*other, *velocity, 5.0, 0.0) == pytest.approx(force, abs=1e-6)


def test_an_obstacle_pushes_as_in_the_original() -> None:
    assert obstacle_force(-0.6, -0.2, 0.4, 10.0) == pytest.approx((-2.967225, -0.989075), abs=1e-6)


def test_a_group_of_three_pulls_as_in_the_original() -> None:
    assert gaze_force(1.0, 0.0, -1.75, -0.15) == pytest.approx((-5.25, 0.0))
    assert coherence_force(-3.5 / 3, -0.1, 3) == pytest.approx((-1.364182, -0.116930), abs=1e-6)


def test_a_group_of_two_pulls_as_in_the_original() -> None:
    assert gaze_force(1.0, 0.0, 0.2, 0.5) == (0.0, 0.0)
    assert coherence_force(0.1, 0.25, 2) == pytest.approx((0.077327, 0.193317), abs=1e-6)
