"""People of the default profile: they see each other coming, differ from one another, and keep company."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Any, cast

import numpy as np
import pytest
from tests.simulation.test_people import world_with

from rvsg.core.references import refer
from rvsg.scenario.scenario import Attention, Behaviour, HumanAgent, reaction_of
from rvsg.simulation.embedded.people.anticipation import past_body
from rvsg.simulation.embedded.people.behaviour import tick
from rvsg.simulation.embedded.people.crowd import TOUCHED, Anticipation, PeopleOptions, initial
from rvsg.simulation.embedded.people.obstacles import on_outline
from rvsg.world.world import World

OPTIONS = PeopleOptions(anticipation=Anticipation())
EVEN = OPTIONS.model_copy(update={"factor_noise": 0.0})
FAR = (1000.0, 1000.0, 0.0, 0.0, 0.0)


def somebody(x: float, y: float, to_x: float, to_y: float, **more: object) -> HumanAgent:
    fields = {"name": "human", "start": (x, y), "goals": ((x, y), (to_x, to_y)), "pauses_s": (0.0, 36_000.0)}
    return HumanAgent.model_validate({**fields, "reaction": reaction_of(Behaviour.REGULAR, 1.5), **more})


def walk(
    *agents: HumanAgent, seconds: float = 12.0, seed: int = 1, options: PeopleOptions = OPTIONS,
    robot: tuple[float, float, float, float, float] = FAR, world: World | None = None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return positions (T, N, 2) and the peak acceleration of each person after the first second."""
    crowd = initial(agents, world or world_with(), options=options, seed=seed)
    reference, places, speeds = refer(crowd), [], []
    for k in range(round(seconds / 0.1)):
        tick(reference, 0.1 * (k + 1), 0.1, *robot)
        places.append(np.column_stack([crowd.x, crowd.y]))
        speeds.append(np.column_stack([crowd.vx, crowd.vy]))
    peaks = np.hypot(*np.moveaxis(np.diff(speeds[10:], axis=0) / 0.1, 2, 0)).max(axis=0)
    return np.array(places), peaks


def apart(places: np.ndarray) -> np.ndarray:
    return np.hypot(*(places[:, 0] - places[:, 1]).T)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("turn", [180, 150, 90, 60])
def test_people_who_meet_keep_apart_without_haste(turn: int, seed: int) -> None:
    x, y = 7.0 * math.cos(math.radians(turn)), 7.0 * math.sin(math.radians(turn))
    places, peaks = walk(somebody(-7.0, 0.0, 7.0, 0.0), somebody(-x, -y, x, y), seed=seed)
    assert apart(places).min() > 0.5
    assert peaks.max() <= 1.7


def test_people_share_the_work_and_choose_the_same_side() -> None:
    places, _ = walk(somebody(-7.0, 0.0, 7.0, 0.0), somebody(7.0, 0.0, -7.0, 0.0), options=EVEN)
    row = int(apart(places).argmin())
    assert places[row, 0, 1] < -0.2  # to the right of their way
    assert places[row, 1, 1] == pytest.approx(-places[row, 0, 1], abs=0.02)


def test_attention_is_how_early_people_turn_off() -> None:
    """A robot stands in the way of three people."""

    def turned(attention: Attention) -> float:
        places, _ = walk(somebody(-6.0, 0.02, 6.0, 0.02, attention=attention), options=EVEN, robot=(0.0,) * 5)
        aside = np.flatnonzero(np.abs(places[:, 0, 1] - 0.02) > 0.15)
        return -float(places[aside[0], 0, 0]) if len(aside) else -math.inf

    attentive, distracted, unseeing = (turned(each) for each in Attention)
    assert attentive > distracted + 0.5 > unseeing + 0.5
    assert unseeing < 1.0


def test_a_group_of_two_walks_abreast_and_opens_for_who_comes() -> None:
    pair = [somebody(-8.0, y, 8.0, y, group=1) for y in (-0.2, 0.2)]
    places, _ = walk(*pair, seconds=6.0, options=EVEN)
    side = np.abs(places[-20:, 0, 1] - places[-20:, 1, 1])
    assert side.mean() == pytest.approx(Anticipation().formation_m, abs=0.15)
    assert np.abs(places[-20:, 0, 0] - places[-20:, 1, 0]).max() < 0.3
    alone = somebody(8.0, 0.0, -8.0, 0.0)
    places, _ = walk(*pair, alone)
    for k in (0, 1):
        assert np.hypot(*(places[:, k] - places[:, 2]).T).min() > 0.5


def test_who_stands_gives_way_and_comes_back() -> None:
    stands = somebody(0.0, 0.1, 0.0, 0.1).model_copy(update={"goals": ((0.0, 0.1),), "pauses_s": (36_000.0,)})
    walker = somebody(-6.0, 0.0, 6.0, 0.0, attention=Attention.UNSEEING)
    places, _ = walk(stands, walker, options=EVEN)
    away = np.hypot(places[:, 0, 0], places[:, 0, 1] - 0.1)
    assert away.max() > 0.2
    assert away[-1] < 0.1


def test_people_differ_from_run_to_run_and_not_within_one() -> None:
    agent = somebody(-6.0, 0.0, 6.0, 0.0)
    first, again, other = (walk(agent, seed=seed, seconds=3.0)[0] for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert abs(first[-1, 0, 0] - other[-1, 0, 0]) > 0.05
    forty = [agent.model_copy(update={"name": f"human {k}"}) for k in range(40)]
    crowds = [initial(forty, world_with(), options=OPTIONS, seed=seed) for seed in range(10)]
    speeds = np.concatenate([crowd.speed for crowd in crowds])
    assert speeds.mean() == pytest.approx(1.34, abs=0.04)  # Weidmann's free walking
    assert speeds.std() == pytest.approx(0.26, abs=0.03)


def test_people_slow_down_behind_who_is_slower() -> None:
    slow = somebody(-4.0, 0.0, 12.0, 0.0, speed_m_s=0.4)
    followers = [somebody(-5.5 - k, 0.0, 12.0, 0.0, speed_m_s=1.5) for k in range(2)]
    _, peaks = walk(slow, *followers, options=EVEN)
    assert peaks.max() <= 1.7


def test_a_surprised_person_brakes_as_people_can() -> None:
    agent = somebody(-6.0, 0.3, 6.0, 0.3, behaviour="surprised", reaction=reaction_of(Behaviour.SURPRISED, 1.5))
    places, peaks = walk(agent, robot=(0.0, 0.0, 0.0, 0.0, 0.0))
    assert peaks.max() < 3.0
    assert np.ptp(places[-10:, 0, 0]) < 0.01


@pytest.mark.parametrize("seed", range(8))
def test_people_who_meet_in_a_corridor_keep_apart_though_walls_push_them_to_its_middle(seed: int) -> None:
    corridor = world_with((0.0, 1.6, 20.0, 1.0), (0.0, -1.6, 20.0, 1.0))
    people = [somebody(-7.0, 0.1, 7.0, 0.1), somebody(7.0, -0.1, -7.0, -0.1), somebody(-8.2, -0.2, 7.0, -0.2)]
    places, peaks = walk(*people, seed=seed, world=corridor)
    for other in (0, 2):
        assert np.hypot(*(places[:, 1] - places[:, other]).T).min() > 0.5
    assert peaks.max() <= 1.7


@pytest.mark.parametrize("seed", range(8))
def test_four_people_who_cross_at_one_point_do_not_touch(seed: int) -> None:
    ends = [(6.0 * math.cos(a), 6.0 * math.sin(a)) for a in (0.3, 1.7, 3.3, 4.9)]
    places, peaks = walk(*(somebody(x, y, -x, -y) for x, y in ends), seed=seed)
    for i, j in combinations(range(4), 2):
        assert np.hypot(*(places[:, i] - places[:, j]).T).min() > 0.5
    assert peaks.max() <= 1.7


@pytest.mark.parametrize("pause_s", [0.0, 5.0])
def test_people_brake_before_they_turn_round_or_stop_and_do_not_run_into_the_wall_behind(pause_s: float) -> None:
    wall = world_with((5.0, 0.0, 2.0, 6.0))
    agent = somebody(-4.0, 0.0, 3.6, 0.0).model_copy(update={"pauses_s": (0.0, pause_s)})
    places, peaks = walk(agent, world=wall, options=EVEN)
    assert peaks.max() <= 1.7
    assert places[:, 0, 0].max() < 3.7


def test_a_velocity_that_touches_nobody_stays_and_others_pass_on_the_nearer_side() -> None:
    change = cast(Any, past_body).py_func
    assert change(3.0, 0.0, 1.0, 0.4, 0.5, 1.5) == (0.0, 0.0)  # passes beside
    assert change(3.0, 0.0, 1.0, 0.0, 0.5, 1.5) == (0.0, 0.0)  # touches later
    assert change(3.0, 0.0, -1.0, 0.0, 0.5, 1.5) == (0.0, 0.0)  # walks away
    x, y = change(2.0, 0.1, 2.0, 0.0, 0.5, 1.5)
    assert y < -0.2
    assert change(2.0, 0.1, 2.0 + 1.01 * x, 1.01 * y, 0.5, 1.5) == (0.0, 0.0)


def test_somebody_who_stands_steps_back_before_a_robot_that_turns_to_them_touches() -> None:
    stands = somebody(-1.0, -1.0, -1.0, -1.0).model_copy(update={"goals": ((-1.0, -1.0),), "pauses_s": (36_000.0,)})
    crowd = initial([stands], world_with(), options=EVEN, seed=1)
    reference, x, y, yaw, gaps = refer(crowd), 0.0, 0.0, math.pi, []
    for k in range(30):
        yaw += 0.1 if k < 13 else 0.0
        x, y = x + 0.05 * math.cos(yaw), y + 0.05 * math.sin(yaw)
        tick(reference, 0.1 * (k + 1), 0.1, x, y, yaw, 0.5, 0.0)
        px, py, _ = on_outline(crowd.outline, crowd.x[0], crowd.y[0], x, y, yaw)
        gaps.append(math.hypot(crowd.x[0] - px, crowd.y[0] - py) - crowd.radius[0])
    assert 0.1 < min(gaps) < 0.3


@pytest.mark.parametrize("attention", [Attention.ATTENTIVE, Attention.DISTRACTED])
@pytest.mark.parametrize("behaviour", list(Behaviour))
def test_nobody_who_sees_the_robot_walks_into_one_that_stands(behaviour: Behaviour, attention: Attention) -> None:
    how = {"behaviour": behaviour, "reaction": reaction_of(behaviour, 1.5), "attention": attention, "speed_m_s": 1.8}
    corridor = world_with((0.0, 1.7, 20.0, 1.0), (0.0, -1.7, 20.0, 1.0))
    for seed in range(12):
        y = 0.1 * seed - 0.55
        starts = (-5.0, -6.2, 6.0) if attention is Attention.ATTENTIVE else (-5.0,)
        agents = [somebody(x, y, -x, -y, **how, name=f"human {x}") for x in starts]
        crowd = initial(agents, corridor, options=OPTIONS, seed=seed)
        reference = refer(crowd)
        for k in range(250):
            tick(reference, 0.1 * (k + 1), 0.1, 0.0, 0.1, 0.3 * seed, 0.0, 0.0)
        assert not (crowd.events[: int(crowd.event_count[0]), 0] == TOUCHED).any(), seed


def test_waypoints_on_a_straight_way_change_nothing_of_it_and_are_reached() -> None:
    places = []
    for xs in ([-6.0, 6.0], np.arange(-6.0, 6.5)):
        agents = [somebody(-6.0, 0.0, 6.0, 0.0, name="a").model_copy(
            update={"goals": tuple((float(x), 0.3 * (k % 2) * (abs(x) < 6)) for k, x in enumerate(xs)),
                    "pauses_s": (0.0,) * (len(xs) - 1) + (36_000.0,)})]  # fmt: skip
        agents.append(somebody(6.0, 0.1, -6.0, 0.1, name="b"))
        places.append(walk(*agents, seconds=14.0)[0])
    assert np.array_equal(*places)
    crowd = initial(agents, world_with(), options=OPTIONS, seed=1)
    reference = refer(crowd)
    for k in range(140):
        tick(reference, 0.1 * (k + 1), 0.1, *FAR)
    assert (np.diff(crowd.reached[0, 1:]) > 0.0).all()


def test_a_way_round_a_shelf_is_not_drawn_through_it() -> None:
    shelf = world_with((0.0, 0.0, 2.0, 2.0))
    goals = ((-2.0, -1.0), (-2.0, 0.0), (-2.0, 2.0), (0.0, 2.0), (2.0, 2.0), (2.0, 0.0))
    agent = somebody(-2.0, -1.0, 2.0, 0.0).model_copy(update={"goals": goals, "pauses_s": (0.0,) * 5 + (36_000.0,)})
    places, _ = walk(agent, world=shelf)
    assert np.hypot(*(places[-1, 0] - (2.0, 0.0))) < 0.3
    assert np.maximum(*np.abs(places[:, 0].T)).min() > 1.0 + 0.2  # beside the shelf with room for a body


def test_a_person_is_as_they_are_whoever_else_is_there_until_they_can_meet() -> None:
    """Leaving out, adding and renaming somebody changes nothing of the others before."""
    near, other = somebody(-8.0, 6.0, 8.0, 6.0, name="near"), somebody(8.0, -9.0, -8.0, -9.0, name="other")
    comes = somebody(8.0, 6.0, -8.0, 6.0, name="comes", factors="random_normal")
    for seed in range(4):
        with_all, without = walk(comes, near, other, seed=seed)[0], walk(near, other, seed=seed)[0]
        renamed = walk(near, other, comes.model_copy(update={"name": "anna"}), seed=seed)[0]
        for a, b, c in ((with_all[:, 1], with_all[:, 2], with_all[:, 0]), renamed.swapaxes(0, 1)):
            first = int((np.hypot(*(a - c).T) < 13.5).argmax())
            assert first > 5
            assert np.array_equal(a[:first], without[:first, 0])
            assert np.array_equal(b, without[:, 1])
