"""The Gymnasium environment: Gymnasium's own checker, equal seeds, vector environments, the end of an episode."""

from __future__ import annotations

import threading
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rvsg
from rvsg.core.errors import InputError

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from rvsg.gym import DriveEnv  # noqa: E402

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scenario() -> Any:
    world = rvsg.load_world("warehouse")
    return rvsg.scenario(world, "route_1", people=[])


@pytest.fixture
def env(scenario: Any) -> Any:
    made = DriveEnv([scenario])
    yield made
    made.close()


def passes_the_checker(env: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the checker warns of spaces that are not normalised
        check_env(env, skip_render_check=True)


def test_it_passes_the_checker(env: Any) -> None:
    passes_the_checker(env)


def test_equal_seeds_and_actions_give_equal_episodes(env: Any) -> None:
    def episode() -> list[float]:
        env.reset(seed=3)
        return [env.step(np.array([0.5, 0.1], np.float32))[1] for _ in range(20)]

    assert episode() == episode()


def test_a_policy_that_follows_the_plan_gets_nearer_and_one_that_stands_ends(env: Any) -> None:
    seen, info = env.reset(seed=1, options={"scenario": 0, "run_seed": 5})
    assert info == {"scenario": 0, "run_seed": 5}
    assert seen["scan"].min() > 0.2 and seen["plan"].shape == (10, 2)
    total = 0.0
    for _ in range(100):
        angle = np.arctan2(seen["plan"][1, 1], seen["plan"][1, 0])
        seen, reward, *_ = env.step(np.array([0.5 * (abs(angle) < 0.8), np.clip(2 * angle, -1, 1)], np.float32))
        total += reward
    assert total > 0.5
    ended = False
    for _ in range(2000):
        _, _, terminated, truncated, info = env.step(np.zeros(2, np.float32))
        if ended := terminated or truncated:
            break
    assert ended and info["outcome"] != "REACHED" and info["run"].trajectory.t[-1] > 5.0
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(2, np.float32))


def test_a_robot_that_moves_sideways_has_a_third_action() -> None:
    robot = Path(__file__).parents[2] / "examples" / "robots" / "mecanum.yaml"
    scenario = rvsg.scenario(rvsg.load_world("warehouse"), "route_1", people=[], robot=robot)
    env = DriveEnv([scenario])
    passes_the_checker(env)
    env.reset(seed=1, options={"scenario": 0, "run_seed": 5})
    for _ in range(20):
        seen, *_ = env.step(np.array([0.0, 0.5, 0.0], np.float32))
    assert seen["velocity"] == pytest.approx((0.0, 0.25, 0.0), abs=0.01)
    env.close()


def test_environments_run_side_by_side_and_leave_no_thread(scenario: Any) -> None:
    before = threading.active_count()
    vector = gymnasium.vector.SyncVectorEnv([lambda: DriveEnv([scenario])] * 2)
    seen, _ = vector.reset(seed=[1, 2])
    assert seen["scan"].shape == (2, 72)
    _, rewards, *_ = vector.step(np.zeros((2, 2), np.float32))
    assert rewards.shape == (2,)
    vector.close()
    assert threading.active_count() == before


@pytest.mark.exhaustive
def test_environments_run_in_processes_as_in_one(scenario: Any) -> None:
    def episodes(kind: Any) -> list[Any]:
        vector = kind([lambda: DriveEnv([scenario])] * 2)
        try:
            seen, _ = vector.reset(seed=[1, 2])
            found = [seen["scan"].copy()]
            for speed in (0.5, 1.0, -0.2):
                seen, rewards, *_ = vector.step(np.array([[speed, 0.1], [speed, -0.4]], np.float32))
                found += [seen["scan"].copy(), rewards.copy()]
            return found
        finally:
            vector.close()

    parallel = episodes(lambda envs: gymnasium.vector.AsyncVectorEnv(envs, context="spawn"))
    for ours, theirs in zip(episodes(gymnasium.vector.SyncVectorEnv), parallel, strict=True):
        assert np.array_equal(ours, theirs)


def test_no_scenario_is_one_error() -> None:
    with pytest.raises(InputError):
        DriveEnv([])
