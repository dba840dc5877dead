"""The social force model against values computed with the original header, and the people's ticks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.coded import coded
from tests.simulation.parts import BOX, CORRECT, FAR, PUBLISHED, box, crowd_of, human, tick, walk, world_with

from rvsg.core.errors import InputError
from rvsg.scenario.scenario import Behaviour, HumanAgent
from rvsg.simulation.embedded.people.crowd import PeopleOptions, initial
from rvsg.simulation.embedded.people.obstacles import boxes_of, entry_point, point_towards_origin
from rvsg.simulation.embedded.people.social_force import (
    coherence_force,
    desired_force,
    gaze_force,
    obstacle_force,
    reach_of,
    social_force,
)


class TestCheckValues:
    """Values of the original header: factors 2, 10, 5, radius 0.4 m, speed 1.5 m/s, goal at (10, 0)."""

    @pytest.mark.parametrize(
        ("force_of", "given", "force"),
        [
            (desired_force, (10.0, 0.0, 0.3, 0.0, 0.0, 1.5, 2.0), (6.0, 0.0)),
            (desired_force, (10.0, 0.0, 0.3, 0.5, 0.5, 1.5, 2.0), (4.0, -2.0)),
            (desired_force, (0.0, 0.0, 0.3, 1.0, 0.0, 1.5, 2.0), (-2.0, 0.0)),
            (social_force, (2.0, 0.0, 2.5, 0.0, 5.0, math.inf), (-1.929107, 0.0)),
            (social_force, (2.0, 0.3, 2.5, 0.0, 5.0, math.inf), (-0.999606, -1.478699)),
            (social_force, (1.0, -0.5, 0.5, 0.5, 5.0, math.inf), (-0.181866, 0.302218)),
            (obstacle_force, (-0.6, -0.2, 0.4, 10.0), (-2.967225, -0.989075)),
            (gaze_force, (1.0, 0.0, -1.75, -0.15), (-5.25, 0.0)),
            (gaze_force, (1.0, 0.0, 0.2, 0.5), (0.0, 0.0)),
            (coherence_force, (-3.5 / 3, -0.1, 3), (-1.364182, -0.116930)),
            (coherence_force, (0.1, 0.25, 2), (0.077327, 0.193317)),
        ],
    )
    def test_each_force(self, force_of: Any, given: tuple[float, ...], force: tuple[float, float]) -> None:
        assert force_of(*given) == pytest.approx(force, abs=1e-6)

    def test_a_group_walks_by_the_sum_of_its_forces(self) -> None:
        others = [human((-1.5, 0.5), group=3), human((-2.0, -0.8), group=3)]
        crowd = crowd_of(human((10.0, 0.0), start=(0.0, 0.0), group=3), *others, options=PUBLISHED)
        crowd.vx[:] = 1.0
        tick(crowd, 0.0, 0.1, *FAR)
        force_x = 2.0 - 5.25 - 1.364182 + 0.061639
        force_y = -0.116930 - 0.013315
        assert (crowd.vx[0], crowd.vy[0]) == pytest.approx((1.0 + 0.1 * force_x, 0.1 * force_y), abs=1e-5)

    def test_the_first_step_from_rest(self) -> None:
        crowd = crowd_of(human((10.0, 0.0), start=(0.0, 0.0)), options=PUBLISHED)
        tick(crowd, 0.0, 0.1, *FAR)
        assert (crowd.vx[0], crowd.x[0]) == pytest.approx((0.6, 0.06))

    def test_a_step_towards_another(self) -> None:
        crowd = crowd_of(human((10.0, 0.0), start=(0.0, 0.0)), human((-10.0, 0.3), start=(2.0, 0.3)), options=PUBLISHED)
        crowd.vx[:] = (1.5, -1.0)
        tick(crowd, 0.0, 0.1, *FAR)
        assert (crowd.x[0], crowd.y[0]) == pytest.approx((0.140004, -0.014787), abs=1e-6)
        assert (crowd.vx[0], crowd.vy[0]) == pytest.approx((1.400039, -0.147870), abs=1e-6)
        assert crowd.yaw[0] == pytest.approx(-0.105228, abs=1e-5)

    def test_a_person_at_their_only_goal_brakes(self) -> None:
        crowd = crowd_of(human((0.0, 0.0)))
        crowd.vx[0] = 1.0
        tick(crowd, 0.0, 0.1, *FAR)
        assert (crowd.vx[0], crowd.x[0]) == pytest.approx((0.6, 0.06))

    @pytest.mark.parametrize(
        ("offset", "speed", "closest"),
        [
            *((0.05, 0.8, 0.478), (0.05, 1.5, 0.394), (0.2, 1.0, 0.538), (0.2, 1.5, 0.493), (0.5, 0.8, 0.770)),
            *((0.5, 1.5, 0.696), (0.8, 1.0, 0.971)),
        ],
    )
    def test_the_closest_distance_of_an_encounter(self, offset: float, speed: float, closest: float) -> None:
        crowd = crowd_of(human((12.0, 0.0), start=(0.0, 0.0), speed_m_s=speed), options=PUBLISHED)
        crowd.height[0] = 100.0  # out of reach of the robot as an obstacle: the table is of the social force alone
        distances = walk(crowd, 150, robot=(8.0, offset, math.pi, 0.5))
        assert min(distances) == pytest.approx(closest, abs=0.03)


class TestGoals:
    def test_the_stop_at_every_goal_costs_the_published_walk_its_speed(self) -> None:
        goals = tuple((float(x), 0.0) for x in range(-9, 10))
        published = crowd_of(human(*goals), options=PUBLISHED)
        correct = crowd_of(human(*goals))
        speeds = []
        for crowd in (published, correct):
            walk(crowd, 20)
            before = crowd.walked[0]
            walk(crowd, 100)
            speeds.append((crowd.walked[0] - before) / 10.0)
        assert speeds == pytest.approx([1.17, 1.5], abs=0.02)

    def test_goals_come_round_again_and_a_pause_is_stood_out_at_its_waypoint(self) -> None:
        crowd = crowd_of(human((0.0, 0.0), (2.0, 0.0), (4.0, 0.0), pauses_s=(0.0, 3.0, 0.0)))
        xs, goals = [], set()
        for k in range(150):
            tick(crowd, 0.1 * k, 0.1, *FAR)
            xs.append(crowd.x[0])
            goals.add(int(crowd.goal_index[0]))
        assert 28 <= len([x for x in xs[:60] if abs(x - 2.0) < 0.5]) <= 40
        assert goals == {0, 1, 2}
        assert crowd.walked[0] > 8.0

    def test_a_late_starter_stands_until_its_time(self) -> None:
        crowd = crowd_of(human((0.0, 0.0), (5.0, 0.0), start_delay_s=2.0))
        walk(crowd, 20)
        assert crowd.x[0] == 0.0
        walk(crowd, 40)
        assert crowd.x[0] > 1.0

    def test_a_start_that_is_not_a_number_is_refused(self) -> None:
        with pytest.raises(InputError, check=coded("agent-not-finite")):
            crowd_of(HumanAgent.model_construct(name="a", start=(math.nan, 0.0), goals=((0.0, 0.0),), pauses_s=(0.0,)))


class TestBehaviours:
    def test_impassive_humans_treat_the_robot_as_an_obstacle_only_in_the_correct_profile(self) -> None:
        def path(behaviour: Behaviour, options: PeopleOptions) -> float:
            crowd = crowd_of(human((8.0, 0.0), start=(0.0, 0.0), behaviour=behaviour), options=options)
            walk(crowd, 20, robot=(4.0, 0.3, math.pi, 0.3))
            return float(crowd.y[0])

        assert path(Behaviour.IMPASSIVE, PUBLISHED) == path(Behaviour.REGULAR, PUBLISHED)
        assert path(Behaviour.IMPASSIVE, CORRECT) != path(Behaviour.REGULAR, CORRECT)

    @pytest.mark.parametrize(
        ("options", "dt", "turned"),
        [(CORRECT, 0.05, 0.1), (CORRECT, 0.1, 0.1), (PUBLISHED, 0.05, 20 * 0.01)],
        ids=["18 degrees per second", "at any tick length", "published: a fixed step per tick"],
    )
    def test_surprised_humans_stand_and_turn(self, options: PeopleOptions, dt: float, turned: float) -> None:
        crowd = crowd_of(human((0.0, 0.0), (5.0, 0.0), behaviour=Behaviour.SURPRISED), options=options)
        walk(crowd, round(1.0 / dt), robot=(0.0, 2.0, 0.0, 0.0), dt=dt)
        assert (crowd.x[0], crowd.y[0]) == (0.0, 0.0)
        assert crowd.yaw[0] == pytest.approx(turned * math.pi)

    def test_a_reaction_ends_and_does_not_come_again(self) -> None:
        agent = human((0.0, 0.0), (5.0, 0.0), behaviour=Behaviour.SURPRISED)
        agent = agent.model_copy(update={"reaction": agent.reaction.model_copy(update={"duration_s": 1.0})})
        crowd = crowd_of(agent)
        walk(crowd, 9, robot=(3.0, 1.0, 0.0, 0.0))
        assert crowd.x[0] == 0.0
        walk(crowd, 15, robot=(3.0, 1.0, 0.0, 0.0))
        assert crowd.x[0] > 0.5
        assert crowd.expired[0] == 1

    @settings(max_examples=30, deadline=None)
    @given(st.floats(0.05, 0.9), st.floats(-math.pi, math.pi))
    def test_fear_never_attracts_in_the_correct_profile(self, distance: float, bearing: float) -> None:
        agent = human((0.0, 0.0), behaviour=Behaviour.SCARED)
        crowd = crowd_of(agent)
        crowd.yaw[0] = bearing
        x, y = distance * math.cos(bearing), distance * math.sin(bearing)
        tick(crowd, 0.0, 0.1, x, y, 0.0, 0.0)
        assert math.hypot(crowd.x[0] - x, crowd.y[0] - y) > distance

    def test_published_fear_attracts_within_the_radius(self) -> None:
        crowd = crowd_of(human((0.0, 0.0), behaviour=Behaviour.SCARED), options=PUBLISHED)
        crowd.height[0] = 100.0
        tick(crowd, 0.0, 0.1, 0.2, 0.0, 0.0, 0.0)
        assert crowd.x[0] > 0.0

    def test_curious_humans_come_near_and_stop(self) -> None:
        crowd = crowd_of(human((0.0, 0.0), (0.0, 9.0), behaviour=Behaviour.CURIOUS))
        crowd.yaw[0] = 0.0
        distances = walk(crowd, 300, robot=(5.0, 0.0, 0.0, 0.0))
        assert distances[-1] == pytest.approx(1.5, abs=0.1)
        assert abs(crowd.yaw[0]) < 0.2

    @pytest.mark.parametrize(("options", "where"), [(CORRECT, (1.6, 0.0)), (PUBLISHED, (3.0, -1.4))])
    def test_threatening_humans_stand_before_the_robot_where_the_profile_says(
        self, options: PeopleOptions, where: tuple[float, float]
    ) -> None:
        crowd = crowd_of(human((0.0, 0.0), (-9.0, 0.0), behaviour=Behaviour.THREATENING), options=options)
        crowd.yaw[0] = 0.0
        nearest = math.inf
        for k in range(100):
            tick(crowd, 0.1 * k, 0.1, 3.0, 0.0, math.pi, 0.0)
            nearest = min(nearest, math.hypot(crowd.x[0] - where[0], crowd.y[0] - where[1]))
        assert nearest < 0.25

    def test_nobody_turns_on_the_spot_for_having_stopped(self) -> None:
        crowd = crowd_of(human((0.0, 0.0)))
        crowd.yaw[0] = 2.0
        walk(crowd, 20)
        assert crowd.yaw[0] == 2.0
        published = crowd_of(human((10.0, 0.0), start=(0.0, 0.0)), options=PUBLISHED)
        published.yaw[0] = 2.0
        published.factor_goal[0] = 0.0
        walk(published, 20)
        assert published.yaw[0] == pytest.approx(0.0, abs=1e-3)


class TestObstacles:
    def test_the_point_lies_towards_the_models_origin(self) -> None:
        box = np.array([4.0, 6.0, -1.0, 1.0, 0.0, 2.0])
        x, y, distance = entry_point(2.0, 3.0, 0.5, 5.0, 0.0, 0.5, box)
        assert (x, y) == pytest.approx((4.0, 1.0))
        assert distance == pytest.approx(math.hypot(2.0, 2.0))

    def test_a_human_inside_a_box_does_not_feel_it(self) -> None:
        box = np.array([-1.0, 1.0, -1.0, 1.0, 0.0, 2.0])
        assert entry_point(0.5, 0.0, 0.5, 0.0, 0.0, 0.0, box)[2] == 0.0

    def test_models_at_x_or_y_zero_are_left_out_as_published(self) -> None:
        boxes, _ = boxes_of((box("a", 0.0, 3.0, 1.0, 1.0), box("b", 2.0, 3.0, 1.0, 1.0)))
        assert len(boxes) == 1

    def test_the_robots_body_is_an_obstacle_too(self) -> None:
        none = np.zeros((0, 6)), np.zeros((0, 3))
        x, y, found = point_towards_origin(0.5, 0.0, 0.96, *none, 0.0, 0.0, 0.0, BOX, 0.345)
        assert found
        assert (x, y) == pytest.approx((0.5 * 0.345 / 0.96, 0.0))
        x, y, found = point_towards_origin(1.7, 0.0, 0.96, *none, 0.0, 0.0, 0.0, BOX, 0.345)
        assert (x, y) == pytest.approx((0.3585, 0.0))
        assert not point_towards_origin(3.0, 0.0, 0.96, *none, 0.0, 0.0, 0.0, BOX, 0.345)[2]

    @pytest.mark.parametrize("bare", [False, True])
    def test_nobody_walks_through_a_wall(self, bare: bool) -> None:
        wall = (3.0, 0.0, 0.2, 8.0)
        occupied = (slice(120, 280), slice(258, 262))
        world = world_with(occupied=occupied) if bare else world_with(wall)
        pushers = [human((9.0, y), start=(1.0, y)) for y in (-0.5, 0.0, 0.5)]
        weak = human((9.0, 0.2), start=(0.5, 0.2), speed_m_s=3.0, factors={"goal": 8, "obstacle": 0, "social": 2})
        crowd = crowd_of(*pushers, weak, world=world)
        for k in range(150):
            tick(crowd, 0.1 * k, 0.1, *FAR)
            assert (crowd.x < 2.95).all()

    def test_a_human_that_starts_in_a_box_is_pushed_out(self) -> None:
        crowd = crowd_of(human((2.2, 0.0)), world=world_with((3.0, 0.0, 2.0, 2.0)))
        walk(crowd, 30)
        assert crowd.x[0] < 2.0


class TestRandomness:
    def test_drawn_factors_follow_hunavsims_distribution(self) -> None:
        agent = human((0.0, 0.0), factors="random_normal")
        goal, obstacle, social = [], [], []
        for seed in range(400):
            crowd = initial([agent], world_with(), options=PUBLISHED, seed=seed)
            goal.append(crowd.factor_goal[0])
            obstacle.append(crowd.factor_obstacle[0])
            social.append(crowd.factor_social[0])
        assert np.mean(goal) == pytest.approx(2.15, abs=0.2)
        assert np.mean(obstacle) == pytest.approx(10.0, abs=0.6)
        assert np.min(goal) >= 0.5
        assert np.min(social) >= 2.0

    def test_without_factor_noise_everybody_has_the_mean(self) -> None:
        agent = human((0.0, 0.0), factors="random_normal")
        quiet = PUBLISHED.model_copy(update={"factor_noise": 0.0})
        crowd = initial([agent], world_with(), options=quiet, seed=3)
        assert (crowd.factor_goal[0], crowd.factor_obstacle[0], crowd.factor_social[0]) == (2.0, 10.0, 4.0)

    @settings(max_examples=25, deadline=None)
    @given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=2, max_size=8), st.booleans())
    def test_no_position_is_ever_undefined(self, points: list[tuple[float, float]], published: bool) -> None:
        agents = [human(p, points[0], behaviour=list(Behaviour)[i % 6], group=i % 2) for i, p in enumerate(points)]
        crowd = crowd_of(*agents, options=PUBLISHED if published else CORRECT, world=world_with((0.0, 1.0, 3.0, 1.0)))
        walk(crowd, 40, robot=(points[0][0], points[0][1], 0.0, 0.2))
        assert np.isfinite(np.concatenate([crowd.x, crowd.y, crowd.yaw, crowd.vx, crowd.vy])).all()

    def test_the_neglected_force_is_below_the_declared_bound(self) -> None:
        rng = np.random.default_rng(2)
        bound = CORRECT.neglect_m_s2
        skipped = 0
        for dx, dy, dvx, dvy in rng.uniform(-6, 6, (3000, 4)):
            exact = social_force(dx, dy, dvx, dvy, 5.0, math.inf)
            quick = social_force(dx, dy, dvx, dvy, 5.0, reach_of(5.0, bound))
            skipped += quick == (0.0, 0.0)
            assert math.hypot(exact[0] - quick[0], exact[1] - quick[1]) <= bound
        assert skipped > 300


@pytest.mark.parametrize("seed", range(3))
def test_each_pair_of_people_is_worked_out_once_with_equal_sums(seed: int) -> None:
    rng = np.random.default_rng(seed)
    spots = rng.uniform(-3.0, 3.0, (30, 2))
    spots[7] = spots[3]
    people = [human((9.0, 9.0), start=(float(x), float(y)), group=i % 3 or None) for i, (x, y) in enumerate(spots)]
    crowd = crowd_of(*people)
    crowd.factor_social[:] = rng.uniform(2.0, 15.0, 30)
    crowd.vx[:], crowd.vy[:] = rng.uniform(-1.5, 1.5, (2, 30))
    tick(crowd, 0.0, 0.1, *FAR)
    for i in range(30):
        x = y = near_x = near_y = 0.0
        reach = reach_of(float(crowd.factor_social[i]), crowd.neglect)
        for j in range(30):
            if i == j:
                continue
            dx, dy = float(crowd.old_x[j] - crowd.old_x[i]), float(crowd.old_y[j] - crowd.old_y[i])
            dvx, dvy = float(crowd.old_vx[i] - crowd.old_vx[j]), float(crowd.old_vy[i] - crowd.old_vy[j])
            fx, fy = social_force(dx, dy, dvx, dvy, float(crowd.factor_social[i]), reach, True)
            if math.isfinite(fx) and math.isfinite(fy):
                x, y = x + fx, y + fy
            same_group = crowd.group[i] >= 0 and crowd.group[i] == crowd.group[j]
            if same_group and math.sqrt(dx * dx + dy * dy) < crowd.radius[i] + crowd.radius[j]:
                near_x, near_y = near_x - dx, near_y - dy
        assert (crowd.push_x[i], crowd.push_y[i]) == (x, y)
        assert (crowd.near_x[i], crowd.near_y[i]) == (near_x, near_y)
