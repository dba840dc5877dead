"""A Gymnasium environment over the simulator: train and test a learned local planner (extra `gym`).

::

    import rvsg
    from rvsg.gym import DriveEnv

    env = DriveEnv([rvsg.load_scenario("best_scenario.json")])
    seen, info = env.reset(seed=0)
    seen, reward, terminated, truncated, info = env.step(env.action_space.sample())

The policy is a local planner: the built-in Nav2 plans the path and keeps the costmaps, the policy answers every control
period (50 ms) with a velocity.
"""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rvsg.app.campaign import Campaign
from rvsg.campaign.ranking import candidates, search_attempts
from rvsg.core.errors import InputError, how_to_install
from rvsg.core.records import Record
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.world_lookup import world_of
from rvsg.simulation.embedded.simulator import EmbeddedSimulator
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.stacks.protocol import Command, LocalObservation, LocalPlanner, Task, Twist
from rvsg.world.world import World

try:
    import gymnasium
except ImportError as error:
    raise InputError(f"rvsg.gym needs Gymnasium: {how_to_install('gym')}") from error

Singles = NDArray[np.float32]

RAYS = 72
PLAN_POINTS = 10
PEOPLE = 4
FAR_M = 10.0
"""Ranges and distances are cut off here."""
HUMAN_M = 0.45
"""Distance of a person from the robot's outline below which the reward counts it as too close."""


class Reward(Record):
    """What a step is worth."""

    progress_per_m: float = 1.0
    """Per metre that the robot comes nearer to the goal."""
    per_step: float = -0.01
    reached: float = 10.0
    contact: float = -10.0
    """Per step in which the robot's outline touches a person's circle."""
    close: float = -0.2
    """Per step in which a person is nearer than 0.45 m."""
    failed: float = -5.0
    """Navigation gives up."""


class _Stopped(BaseException):
    """The environment is closed or reset in the middle of a run."""


class _Bridge(LocalPlanner):
    """Hands observations from the simulator's thread to the environment, and velocities back."""

    answer_time_s: ClassVar[float | None] = None
    name: ClassVar[str] = "gym"

    def __init__(self) -> None:
        self.seen: queue.Queue[Any] = queue.Queue()
        self.answers: queue.Queue[Command | None] = queue.Queue()

    def reset(self, task: Task) -> None:
        self.task = task

    def command(self, seen: LocalObservation) -> Command | None:
        self.seen.put(seen)
        answer = self.answers.get()
        if answer is None:
            raise _Stopped
        return answer


class DriveEnv(gymnasium.Env[dict[str, Singles], Singles]):
    """One robot that drives scenarios; each episode takes the next scenario, in an order that the seed decides.

    Observation, in the base frame: `scan` (72,) ranges around the base, m, at most 10; `plan` (10, 2) points of the
    plan, about 0.3 m apart; `goal` (3,) x, y, yaw; `velocity` (2,) v, w; `people` (4, 4) x, y, vx, vy of the nearest
    people that a lidar sees, (10, 10, 0, 0) where there are fewer.

    Action: (2,) within -1 and 1: the share of the robot's highest (reverse) speed and yaw rate.

    Where a robot of the scenarios moves sideways, `velocity` is (3,) vx, vy, w, and so is the action.

    Args:
        scenarios: the tasks.
        simulator_options: options of the embedded simulator.
        reward: what a step is worth.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  (Gymnasium's own declaration)

    def __init__(
        self, scenarios: Sequence[Scenario], *, worlds: Sequence[World] | None = None,
        simulator_options: dict[str, Any] | None = None, reward: Reward | None = None,
    ) -> None:  # fmt: skip
        if not scenarios:
            raise InputError("DriveEnv needs at least one scenario.")
        self.scenarios = tuple(scenarios)
        self.worlds = tuple(worlds) if worlds is not None else tuple(world_of(s.mission) for s in self.scenarios)
        robots = [scenario.mission.robot_record for scenario in self.scenarios]
        self.sideways = any(robot is not None and robot.limits.lateral_m_s > 0.0 for robot in robots)
        self.reward = reward or Reward()
        self._options = dict(simulator_options or {})
        self._bridge: _Bridge | None = None
        self._thread: threading.Thread | None = None
        self._seen: LocalObservation | None = None
        self._last: dict[str, Singles] | None = None
        far = np.float32(FAR_M)
        box = gymnasium.spaces.Box
        self.observation_space: Any = gymnasium.spaces.Dict({
            "scan": box(0.0, far, (RAYS,), np.float32),
            "plan": box(-far, far, (PLAN_POINTS, 2), np.float32),
            "goal": box(np.array([-far, -far, -4.0], np.float32), np.array([far, far, 4.0], np.float32)),
            "velocity": box(-far, far, (2 + self.sideways,), np.float32),
            "people": box(-far, far, (PEOPLE, 4), np.float32),
        })  # fmt: skip
        self.action_space = box(-1.0, 1.0, (2 + self.sideways,), np.float32)
        EmbeddedSimulator(**self._options).prepare(lambda _: None)

    @classmethod
    def of_campaign(cls, folder: str, *, limit: int | None = None, **options: Any) -> DriveEnv:
        """Return an environment whose tasks are the scenarios of a campaign, the worst first."""
        campaign = Campaign.open(folder)
        found = candidates(search_attempts(campaign.attempts()), campaign.requirement)
        scenarios = [attempt.proposal.scenario for attempt in found if attempt.proposal.scenario is not None]
        chosen = scenarios[:limit]
        return cls(chosen, worlds=[campaign.world] * len(chosen), **options)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Singles], dict[str, Any]]:
        """Begin an episode; `options={"scenario": 2, "run_seed": 7}` chooses the task and the seed of the run."""
        super().reset(seed=seed)
        self._stop()
        given = options or {}
        task = int(given.get("scenario", self.np_random.integers(len(self.scenarios))))
        if not 0 <= task < len(self.scenarios):
            raise InputError(f"There is no scenario {task}; there are {len(self.scenarios)}.")
        run_seed = int(given.get("run_seed", self.np_random.integers(2**31)))
        self._begin(task, run_seed)
        first = self._next()
        if isinstance(first, Run):
            raise InputError(f"Scenario {task} ends before it begins: {first.outcome.value}. Leave it out.")
        self._seen, self._last = first, self._observed(first)
        self._distance = math.dist(first.pose[:2], first.goal[:2])
        return self._last, {"scenario": task, "run_seed": run_seed}

    def step(self, action: Singles) -> tuple[dict[str, Singles], float, bool, bool, dict[str, Any]]:
        """Drive for a control period."""
        if self._bridge is None or self._seen is None:
            raise gymnasium.error.ResetNeeded("Call reset() before step().")
        limits = self._bridge.task.robot.limits
        forward, *left, turn = (float(np.clip(value, -1.0, 1.0)) for value in action)
        v = forward * (limits.speed_m_s if forward > 0.0 else limits.reverse_m_s)
        side = sum(left) * limits.lateral_m_s
        self._bridge.answers.put(Twist(v, side, turn * limits.yaw_rate_rad_s))
        after = self._next()
        if isinstance(after, Run):
            return self._ended(after)
        self._seen, self._last = after, self._observed(after)
        distance = math.dist(after.pose[:2], after.goal[:2])
        worth = self.reward.per_step + self.reward.progress_per_m * (self._distance - distance)
        self._distance = distance
        gap = self._gap(after)
        worth += self.reward.contact * (gap <= 0.0) + self.reward.close * (0.0 < gap < HUMAN_M)
        return self._last, float(worth), False, False, {"clearance_m": gap}

    def close(self) -> None:
        """End the run that is under way."""
        self._stop()

    def _begin(self, task: int, run_seed: int) -> None:
        bridge = self._bridge = _Bridge()
        scenario, world = self.scenarios[task], self.worlds[task]
        simulator = EmbeddedSimulator(stack=bridge, **self._options)

        def work() -> None:
            try:
                bridge.seen.put(simulator.run(scenario, world, seed=run_seed))
            except _Stopped:
                bridge.seen.put(None)
            except Exception as error:
                bridge.seen.put(error)

        self._thread = threading.Thread(target=work, daemon=True)
        self._thread.start()

    def _next(self) -> Any:
        """Return the next observation, or the run where it is over."""
        assert self._bridge is not None
        found = self._bridge.seen.get()
        if isinstance(found, Exception):
            self._bridge = None
            raise found
        return found

    def _ended(self, run: Run) -> tuple[dict[str, Singles], float, bool, bool, dict[str, Any]]:
        self._stop()
        self._seen = None
        assert self._last is not None
        timed_out = run.outcome is Outcome.TIMED_OUT
        worth = self.reward.reached if run.completed else 0.0 if timed_out else self.reward.failed
        return self._last, worth, not timed_out, timed_out, {"outcome": run.outcome.name, "run": run}

    def _stop(self) -> None:
        if self._bridge is not None and self._thread is not None:
            self._bridge.answers.put(None)
            self._thread.join()
        self._bridge = self._thread = self._seen = None

    def _gap(self, seen: LocalObservation) -> float:
        """Return the distance from the robot's disc to the nearest person seen, m; 10 where nobody is."""
        assert self._bridge is not None
        people = seen.people()
        if not len(people):
            return FAR_M
        nearest = float(np.hypot(people[:, 0] - seen.pose[0], people[:, 1] - seen.pose[1]).min())
        return min(FAR_M, nearest - self._bridge.task.robot.radius_m - 0.35)

    def _observed(self, seen: LocalObservation) -> dict[str, Singles]:
        x, y, yaw = seen.pose
        cos, sin = math.cos(yaw), math.sin(yaw)

        def in_base(points: Any) -> NDArray[np.float64]:
            offset = np.atleast_2d(points) - (x, y)
            return np.column_stack([offset @ (cos, sin), offset @ (-sin, cos)])

        goal = in_base(seen.goal[:2])[0]
        people = np.tile(np.array([FAR_M, FAR_M, 0.0, 0.0]), (PEOPLE, 1))
        found = seen.people()
        if len(found):
            order = np.argsort(np.hypot(found[:, 0] - x, found[:, 1] - y))[:PEOPLE]
            moved = in_base(found[order, 2:] + (x, y))
            people[: len(order)] = np.column_stack([in_base(found[order, :2]), moved])
        values = {
            "scan": self._scan(seen),
            "plan": in_base(_spaced(seen.plan, x, y)),
            "goal": np.array([goal[0], goal[1], math.remainder(seen.goal[2] - yaw, math.tau)]),
            "velocity": np.array([seen.velocity[0], *([seen.lateral] if self.sideways else []), seen.velocity[1]]),
            "people": people,
        }
        return {key: np.clip(value, -FAR_M, FAR_M).astype(np.float32) for key, value in values.items()}

    def _scan(self, seen: LocalObservation) -> NDArray[np.float64]:
        """Return the nearest return of all lidars in each of 72 sectors around the base."""
        assert self._bridge is not None
        ranges = np.full(RAYS, FAR_M)
        for lidar in range(len(self._bridge.task.robot.lidars)):
            scan = seen.scan(lidar)
            angle = scan.yaw + scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
            hit = np.isfinite(scan.ranges)
            px = scan.x + scan.ranges[hit] * np.cos(angle[hit])
            py = scan.y + scan.ranges[hit] * np.sin(angle[hit])
            sector = np.floor(np.mod(np.arctan2(py, px), math.tau) / math.tau * RAYS).astype(int) % RAYS
            np.minimum.at(ranges, sector, np.hypot(px, py))
        return ranges


def _spaced(plan: NDArray[np.float64], x: float, y: float) -> NDArray[np.float64]:
    """Return ten points of the plan, about 0.3 m apart, from the one nearest to the robot; the last one is repeated."""
    begin = int(np.hypot(plan[:, 0] - x, plan[:, 1] - y).argmin())
    rest = plan[begin:]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rest, axis=0).T))])
    picked = np.minimum(np.searchsorted(along, 0.3 * np.arange(1, PLAN_POINTS + 1)), len(rest) - 1)
    return rest[picked]
