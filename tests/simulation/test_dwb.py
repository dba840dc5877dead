"""DWB against a slow reading of its rules."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.simulation.parts import INFLATION, MECANUM, STACK, TIAGO

import rvsg
from rvsg.core.references import refer
from rvsg.robots.robot import Robot, load_robot
from rvsg.simulation.costmap import inflate_marks
from rvsg.simulation.embedded import dwb
from rvsg.simulation.embedded.robot_parameters import stack_of
from rvsg.simulation.embedded.rollouts import fill_window, roll_out_ends, rollouts, sample_table
from rvsg.simulation.embedded.trace import CRITICS, trace_run

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
TABLE = sample_table(stack_of(TIAGO))
SLOW = TIAGO.replace(
    limits=TIAGO.limits.replace(acceleration_m_s2=0.2, deceleration_m_s2=0.2, yaw_acceleration_rad_s2=0.3)
)
WIDE = load_robot(MECANUM)
"""It moves sideways."""
START = (0.2, -0.1, 0.4)


def slow_rollout(v0: float, side0: float, w0: float, sample: Floats, robot: Robot = TIAGO) -> Floats:
    """All poses of one sample from the pose (0, 0, 0)."""
    speed_up, slow_down = robot.limits.acceleration_m_s2, robot.limits.deceleration_m_s2
    turn_up = robot.limits.yaw_acceleration_rad_s2
    v1, w1, steps, dt, side1 = sample
    poses = [(0.0, 0.0, 0.0)]
    v, side, w = v0, side0, w0
    for _ in range(int(steps)):
        v += max(-slow_down * dt, min(speed_up * dt, v1 - v))
        side += max(-speed_up * dt, min(speed_up * dt, side1 - side))
        w += max(-turn_up * dt, min(turn_up * dt, w1 - w))
        x, y, yaw = poses[-1]
        along, across = (v * math.cos(yaw) - side * math.sin(yaw)), (v * math.sin(yaw) + side * math.cos(yaw))
        poses.append((x + along * dt, y + across * dt, yaw + w * dt))
    return np.array(poses)


def slow_totals(
    master: Bytes, path: Floats, pose: tuple[float, float, float], v0: float, w0: float
) -> list[float | None]:
    """Every sample's total away from the goal, None where a critic forbids it; the window's corner is at 0, 0."""
    near = [i for i, p in enumerate(path) if math.dist(p, pose[:2]) < 1.5]
    begin = near[0]
    end = next((i for i in range(begin, len(path)) if math.dist(path[i], pose[:2]) > 1.5), len(path))
    window = path[begin:end]
    goal = path[-1]
    bearing = math.atan2(goal[1] - pose[1], goal[0] - pose[0])
    moved = window.copy()
    moved[-1] += 0.1 * np.array([math.cos(bearing), math.sin(bearing)])

    def cell(p: Floats) -> tuple[int, int] | None:
        c, r = math.floor(p[0] / 0.05), math.floor(p[1] / 0.05)
        return (c, r) if 0 <= c < 60 and 0 <= r < 60 else None

    def cells(points: Floats) -> list[tuple[int, int]]:
        found: list[tuple[int, int]] = []
        for p in points:
            c = cell(p)
            if c is None and found:
                break
            if c is not None and c not in found:
                found.append(c)
        return found

    sources = cells(window)
    last = [c for c in (cell(p) for p in window) if c][-1]
    align = [c for c in (cell(p) for p in moved) if c][-1]

    def path_distance(c: tuple[int, int]) -> int:
        nearest = min(sources, key=lambda s: (s[0] - c[0]) ** 2 + (s[1] - c[1]) ** 2)
        return abs(nearest[0] - c[0]) + abs(nearest[1] - c[1])

    totals: list[float | None] = []
    for sample in TABLE:
        rolled = slow_rollout(v0, 0.0, w0, sample)
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        world = np.column_stack(
            [pose[0] + cos * rolled[:, 0] - sin * rolled[:, 1], pose[1] + sin * rolled[:, 0] + cos * rolled[:, 1]]
        )
        yaw = pose[2] + rolled[-1, 2]
        touched = [cell(p) for p in world]
        ahead = cell(world[-1] + 0.1 * np.array([math.cos(yaw), math.sin(yaw)]))
        if ahead is None or any(c is None or master[c[1], c[0]] >= 253 for c in touched):
            totals.append(None)
            continue
        e = touched[-1]
        assert e is not None
        totals.append(
            0.02 * int(master[e[1], e[0]])
            + 0.6 * (abs(ahead[0] - align[0]) + abs(ahead[1] - align[1]))
            + 0.8 * path_distance(ahead)
            + 0.8 * path_distance(e)
            + 0.6 * (abs(e[0] - last[0]) + abs(e[1] - last[1]))
        )
    return totals


def choose(
    master: Bytes, path: Floats, pose: tuple[float, float, float], v0: float, w0: float, goal_yaw: float = 0.0,
    samples: Floats = TABLE, p: Any = STACK,
) -> int:  # fmt: skip
    state = np.zeros(dwb.CONTROLLER_INTS, np.int64)
    state[dwb.PLAN_END] = len(path)
    count = len(samples)
    return dwb.choose(
        state, np.zeros(dwb.CONTROLLER_REALS), dwb.scratch(60), rollouts(count), samples, master, 0, 0, path,
        goal_yaw, *pose, v0, 0.0, w0, p,
    )  # fmt: skip


def test_there_are_419_samples_in_dwbs_order() -> None:
    assert len(TABLE) == 419
    assert TABLE[0, :2].tolist() == [0.0, -1.0]
    assert (TABLE[:, 1] == 0.0).sum() == 19
    assert not ((TABLE[:, 0] == 0.0) & (TABLE[:, 1] == 0.0)).any()
    assert (np.diff(TABLE[:, 0]) >= 0).all()
    assert TABLE[:, 2].max() == 68
    assert TABLE[:, 2] * TABLE[:, 3] == pytest.approx(1.7)


@pytest.mark.parametrize(
    ("robot", "begin", "every"),
    [(TIAGO, (0.0, 0.0, 0.0), 1), (TIAGO, (0.5, 0.0, 0.3), 1), (TIAGO, (0.26, 0.0, -0.755), 1), (WIDE, START, 97)],
)
def test_rollouts_end_where_the_slow_reading_ends(robot: Robot, begin: tuple[float, float, float], every: int) -> None:
    stack, samples = refer(stack_of(robot)), sample_table(stack_of(robot))
    samples = samples[: fill_window(samples, *begin, 1.0, stack)]
    ends = np.zeros((len(samples), 5))
    roll_out_ends(ends, *begin, samples, stack)
    slow = np.array([slow_rollout(*begin, sample, robot)[-1] for sample in samples[::every]])
    assert np.allclose(ends[::every, :3], slow, atol=1e-12)
    ahead = slow[:, :2] + 0.1 * np.column_stack([np.cos(slow[:, 2]), np.sin(slow[:, 2])])
    assert np.allclose(ends[::every, 3:], ahead, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_the_chosen_sample_is_the_first_of_least_total_among_those_that_are_free(seed: int) -> None:
    rng = np.random.default_rng(seed)
    marks = np.zeros((60, 60), np.uint8)
    for r, c in rng.integers(2, 58, (5, 2)):
        if math.hypot(r - 30, c - 30) > 12:
            marks[r - 1 : r + 2, c - 1 : c + 2] = 254
    master = np.zeros((60, 60), np.uint8)
    inflate_marks(master, np.stack([marks, np.zeros_like(marks)]), INFLATION)
    turn = rng.uniform(-math.pi, math.pi)
    along = np.arange(0.0, 4.0, 0.025)
    bend = 0.3 * np.sin(along)
    path = np.column_stack([1.5 + along * math.cos(turn) - bend * math.sin(turn),
                            1.5 + along * math.sin(turn) + bend * math.cos(turn)])  # fmt: skip
    pose = (1.513, 1.487, turn + rng.uniform(-0.6, 0.6))
    totals = slow_totals(master, path, pose, 0.37, 0.21)
    legal = [t for t in totals if t is not None]
    best = choose(master, path, pose, 0.37, 0.21)
    if not legal:
        assert best == -1
    else:
        assert totals[best] == pytest.approx(min(legal), abs=1e-9)
        assert best == next(i for i, t in enumerate(totals) if t is not None and t <= min(legal) + 1e-9)


@pytest.mark.parametrize(("blocked", "begin"), [(253, 1.5), (0, 20.0)], ids=["inscribed", "plan out of reach"])
def test_where_there_is_no_command(blocked: int, begin: float) -> None:
    master = np.zeros((60, 60), np.uint8)
    master[30, 30] = blocked
    path = np.column_stack([np.linspace(begin, begin + 3.0, 120), np.full(120, 1.5)])
    assert choose(master, path, (1.51, 1.51, 0.0), 0.0, 0.0) == -1


def test_near_the_goal_the_robot_slows_down_then_turns_on_the_spot_towards_the_goals_yaw() -> None:
    master = np.zeros((60, 60), np.uint8)
    path = np.column_stack([np.linspace(1.0, 1.6, 25), np.full(25, 1.5)])
    slowing = TABLE[choose(master, path, (1.45, 1.5, 0.0), 0.5, 0.0, goal_yaw=1.5)]
    assert slowing[0] < 0.5
    turning = TABLE[choose(master, path, (1.45, 1.5, 0.0), 0.1, 0.0, goal_yaw=1.5)]
    assert turning[0] == 0.0
    assert turning[1] > 0.5


def test_a_reversed_turn_on_the_spot_bans_the_way_back_until_the_robot_has_moved() -> None:
    state = np.zeros(dwb.CONTROLLER_INTS, np.int64)
    reals = np.zeros(dwb.CONTROLLER_REALS)
    dwb.remember_turn(state, reals, 0.0, 0.0, -0.5, 0.0, 0.0, 0.0, STACK)
    dwb.remember_turn(state, reals, 0.4, 0.0, 0.5, 0.0, 0.0, 0.0, STACK)
    assert state[dwb.BAN_RIGHT] == 0
    dwb.remember_turn(state, reals, 0.05, 0.0, 0.5, 0.0, 0.0, 0.0, STACK)
    assert state[dwb.BAN_RIGHT] == 1
    dwb.remember_turn(state, reals, 0.5, 0.0, 0.5, 0.04, 0.0, 0.1, STACK)
    assert state[dwb.BAN_RIGHT] == 1
    dwb.remember_turn(state, reals, 0.5, 0.0, 0.5, 0.06, 0.0, 0.1, STACK)
    assert state[dwb.BAN_RIGHT] == 0
    assert state[dwb.LAST_SIGN] == 0


def nav2_axis(current: float, low: float, high: float, acceleration: float, time_s: float, count: int) -> list[float]:
    """The velocities of nav2_dwb's OneDVelocityIterator, by its source: even steps, and 0 where one passes it."""
    current = min(high, max(low, current))
    top = min(high, current + acceleration * time_s)
    bottom = max(low, current - acceleration * time_s)
    if top - bottom < 1e-5:
        return [bottom]
    step = (top - bottom) / (count - 1)
    found: list[float] = []
    now = bottom
    for _ in range(count):
        if found and found[-1] < 0.0 < now:
            found.append(0.0)
        found.append(now)
        now += step
    return found


SLOW_AXES = [(0.0, 1.0, 0.2, 20), (0.0, 0.0, 0.2, 1), (-1.0, 1.0, 0.3, 20)]


class TestDynamicWindow:
    def test_the_tiago_samples_its_whole_range_at_any_velocity(self) -> None:
        assert stack_of(TIAGO).whole_range
        samples = np.zeros((500, 5))
        for v, w in ((0.0, 0.0), (0.5, -1.0), (0.31, 0.7)):
            count = fill_window(samples, v, 0.0, w, 1.0, STACK)
            assert np.allclose(samples[:count], TABLE, atol=1e-12)

    @pytest.mark.parametrize(
        ("robot", "now", "axes"),
        [
            *(
                (SLOW, now, SLOW_AXES)
                for now in ((0.0, 0.0, 0.0), (0.4, 0.0, 0.0), (0.95, 0.0, 0.6), (1.3, 0.0, -0.95))
            ),
            (WIDE, START, [(0.0, 0.6, 1.0, 10), (-0.3, 0.3, 1.0, 5), (-1.5, 1.5, 3.0, 20)]),
        ],
    )
    def test_a_robot_samples_the_speeds_that_it_can_reach(
        self, robot: Robot, now: tuple[float, float, float], axes: list[tuple[float, float, float, int]]
    ) -> None:
        stack = stack_of(robot)
        assert not stack.whole_range
        samples = sample_table(stack)
        count = fill_window(samples, *now, 1.0, refer(stack))
        ahead, aside, turn = (
            nav2_axis(at, low, high, rate, 1.7, number) for at, (low, high, rate, number) in zip(now, axes, strict=True)
        )
        every = ((v, w, side) for v in ahead for side in aside for w in turn)
        expected = [each for each in every if any(each) and math.hypot(each[0], each[2]) <= axes[0][1] + 1e-12]
        assert np.allclose(samples[:count][:, [0, 1, 4]], expected, atol=1e-9)
        assert np.allclose(samples[:count, 2] * samples[:count, 3], 1.7)

    def test_a_tugger_samples_only_what_its_steering_allows(self) -> None:
        stack = stack_of(load_robot("tugger"))
        samples = sample_table(stack)
        count = fill_window(samples, 0.3, 0.0, 0.0, 1.0, refer(stack))
        v, w = samples[:count, 0], samples[:count, 1]
        assert (np.abs(w) <= np.abs(v) * math.tan(1.05) / 0.95 + 1e-9).all()
        assert (np.abs(w) > 0.9 * np.minimum(np.abs(v) * math.tan(1.05) / 0.95, 1.0)).any()
        assert v.min() == pytest.approx(0.0, abs=1e-9) or v.min() > 0.0

    def test_scores_of_an_earlier_larger_window_do_not_count(self) -> None:
        stack = stack_of(SLOW)
        samples = sample_table(stack)
        count = fill_window(samples, 0.0, 0.0, 0.0, 1.0, refer(stack))
        assert count < len(samples)
        path = np.column_stack([np.linspace(1.5, 3.0, 60), np.full(60, 1.5)])
        best = choose(
            np.zeros((60, 60), np.uint8), path, (1.51, 1.51, 0.0), 0.0, 0.0, samples=samples[:count], p=refer(stack)
        )
        assert 0 <= best < count
        assert samples[best, 0] > 0.2


def test_a_reversed_step_aside_bans_the_way_back() -> None:
    state, reals = np.zeros(dwb.CONTROLLER_INTS, np.int64), np.zeros(dwb.CONTROLLER_REALS)
    dwb.remember_turn(state, reals, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, STACK)
    assert state[dwb.BAN_ASIDE_LEFT] == 0
    dwb.remember_turn(state, reals, 0.0, -0.2, 0.0, 0.0, 0.0, 0.0, STACK)
    assert state[dwb.BAN_ASIDE_LEFT] == 1 and state[dwb.BAN_LEFT] == 0
    dwb.remember_turn(state, reals, 0.0, -0.2, 0.0, 0.0, 0.06, 0.0, STACK)
    assert state[dwb.BAN_ASIDE_LEFT] == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "robot",
    ["tugger", *(pytest.param(name, marks=pytest.mark.exhaustive) for name in ("tiago_omni", "turtlebot3_waffle"))],
)
def test_the_scores_of_the_critics_add_up_to_the_total_of_the_planner(robot: str) -> None:
    world = rvsg.load_world("warehouse")
    scenario = rvsg.scenario(world, "route_1", [rvsg.walk("Anna", "E15", "H15")], robot=robot)
    answers = [frame.evaluation for frame in trace_run(scenario, world, seed=3).frames if frame.evaluation]
    assert len(answers) > 50
    assert [answer.best for answer in answers].count(-1) < 3
    said = dict.fromkeys(CRITICS, 0.0)
    for answer in answers:
        allowed = np.isfinite(answer.score)
        parts = answer.raw * answer.scales
        assert answer.best in (-1, int(answer.score.argmin()))  # what the planner chose; -1 where it has arrived
        assert parts[allowed].sum(axis=1) == pytest.approx(answer.score[allowed], abs=1e-9)
        for name, most in zip(answer.critics, parts[allowed].max(axis=0, initial=0.0), strict=True):
            said[name] = max(said[name], most)
    rotates = said.pop("RotateToGoal") > 0.0
    assert rotates == (robot == "tiago_omni")  # the others arrive without being asked again near the goal
    assert min(said.values()) > 0.0
