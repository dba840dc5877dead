import math

import numpy as np
import pytest
from tests.evaluation.runs import run_of, trajectory

from rvsg.evaluation.metrics.registry import measure
from rvsg.world.space import human_space, robot_space
from rvsg.world.world_folder import load_world


def value(run, name):
    return measure(run, [name])[name]


def head_on(turn):
    """Robot and person walking at each other on a line at angle `turn`, for one second."""
    c, s = math.cos(turn), math.sin(turn)
    human = (2 * c, 2 * s, turn + math.pi, 1.0)
    return run_of(trajectory([0.0, 1.0], 0, yaw=turn, v=0.5, humans=[human]))


@pytest.mark.parametrize("turn", [0.0, 0.4, math.pi / 4, 2.0])
def test_the_social_force_does_not_depend_on_the_direction_of_the_axes(turn):
    # k exp(-D / (gamma L)) with D = 2 m and L = |2 (1 + 0.5) + 1| = 4: 2.1 exp(-2 / 1.4).
    assert value(head_on(turn), "force_on_humans") == pytest.approx(2.1 * math.exp(-2 / 1.4))


def test_the_evaluators_force_is_right_only_along_45_degrees():
    assert value(head_on(0.0), "force_on_humans_hunav") < 1e-8
    along = value(head_on(math.pi / 4), "force_on_humans_hunav")
    assert along == pytest.approx(2 * 2.1 * math.exp(-2 / 1.4))


def test_the_evaluators_sums_grow_with_the_sampling_rate_and_ours_do_not():
    human = (2.0, 2.0, -2.0, 1.0)
    runs = [run_of(trajectory(np.linspace(0, 2, n), 0, yaw=0.7, v=0.5, humans=[human])) for n in (11, 21)]
    ours = [value(run, "social_work") for run in runs]
    theirs = [value(run, "social_work_hunav") for run in runs]
    assert ours[0] == pytest.approx(ours[1])
    assert theirs[1] / theirs[0] == pytest.approx(21 / 11)


def test_turning_right_on_the_spot_stands_still_for_the_evaluator_alone():
    run = run_of(trajectory([0, 1, 2], 0, omega=-0.5))
    assert value(run, "tnm") == 0.0
    assert value(run, "tnm_hunav") == 2.0


def test_the_evaluator_swaps_the_axes_of_the_person_in_the_robots_frame():
    # The person is straight ahead of the robot (bearing 0) and faces it (bearing 0): nobody's fault for us, but the
    # evaluator takes the person's bearing for 90 degrees and blames the robot.
    run = run_of(trajectory([0, 1], 0, v=0.5, humans=[(0.6, 0.0, math.pi, 1.0)]))
    assert (value(run, "rpc"), value(run, "por")) == (0, 0)
    assert (value(run, "rpc_hunav"), value(run, "por_hunav")) == (2, 0)


def test_the_evaluator_forgets_the_persons_radius_in_the_largest_distance():
    run = run_of(trajectory([0, 1], 0, humans=[(3.0, 0.0)]))
    assert value(run, "max_distance") == pytest.approx(2.25)
    assert value(run, "max_distance_hunav") == pytest.approx(2.65)


def around(*groups):
    """A robot at the origin, and three people 3 m off who all look at it: the points 1.5 m ahead are 1.5 m off."""
    humans = [(3.0, 0.0, math.pi, 0.0), (0.0, 3.0, -math.pi / 2, 0.0), (-3.0, 0.0, 0.0, 0.0)]
    return run_of(trajectory([0.0, 1.0], 0, humans=humans), human_groups=groups)


def test_the_space_of_a_group_is_in_front_of_its_members():
    # The first and the third share the very spot of the robot; the first and the second one 1.06 m off.
    assert value(around(1, None, 1), "group_intimate_space") == 100.0
    assert value(around(1, 1, None), "group_personal_space") == 100.0  # 1.06 - 0.35 = 0.71 m from the robot's edge
    assert value(around(1, 1, None), "group_intimate_space") == 0.0
    # With two groups the nearer one counts; all three have their space 0.5 m off.
    assert value(around(4, 4, 4), "group_intimate_space") == 100.0


def test_without_two_of_a_group_there_is_no_space_of_groups_to_intrude_upon():
    for groups in ((), (None, None, None), (1, 2, 3)):
        assert value(around(*groups), "group_social_space") is None


@pytest.fixture(scope="module")
def warehouse():
    return load_world("warehouse")


def test_obstacles_push_as_the_nearest_surface_does(warehouse):
    x, y = warehouse.grid.position("E15")
    run = run_of(trajectory(np.linspace(0, 2, 5), x, y, humans=[(x, y)]))
    found = measure(run, ["obstacle_force_on_humans", "obstacle_force_on_robot"], world=warehouse)
    for name, radius, space in (("humans", 0.4, human_space), ("robot", 0.35, robot_space)):
        clear = space(warehouse).clearance(x, y)
        assert found[f"obstacle_force_on_{name}"] == pytest.approx(2.0 * 10 * math.exp(-(clear - radius) / 0.2))


def test_the_forces_of_obstacles_need_the_world():
    run = run_of(trajectory([0.0, 1.0], 0, humans=[(2.0, 0.0)]))
    assert value(run, "obstacle_force_on_humans") is None is value(run, "obstacle_force_on_robot")
