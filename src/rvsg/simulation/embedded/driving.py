"""Exchange with the navigation stack under test: its observations, its commands and its faults."""

from __future__ import annotations

import math
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.robots.robot import Robot
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.dwb import PLAN_BEGIN, PLAN_END, SHARE
from rvsg.simulation.embedded.episode import Answer, Episode, Outside
from rvsg.simulation.embedded.lidar import first_ray, full_scan
from rvsg.simulation.embedded.localisation import MAP_X, MAP_Y, MAP_YAW
from rvsg.simulation.embedded.robot_parameters import (
    LIDAR_DROPOUT,
    LIDAR_MAX,
    LIDAR_MIN,
    LIDAR_NOISE,
    LIDAR_RAYS,
    LIDAR_TICKS,
    LIDAR_VIEW,
    LIDAR_X,
    LIDAR_Y,
    LIDAR_YAW,
)
from rvsg.simulation.stacks.protocol import (
    Costmap,
    Ended,
    LocalObservation,
    LocalPlanner,
    NavigationStack,
    Scan,
    StackError,
    Task,
    Twist,
    Velocity,
    WholeStack,
)

Floats = NDArray[np.float64]

COMMAND_TIME_S = 1.0
"""Simulated time after which the base stops without a new velocity of a whole stack."""
SEEN_PAST_M = 0.4
"""A person counts as seen where a ray at their bearing ends no nearer than this before them."""
AROUND = np.array([-1, 0, 1])
"""The rays that are looked at: that at the person's bearing and its neighbours."""


class Observed(LocalObservation):
    """What a stack is told, read off an episode when it is asked for."""

    def __init__(self, episode: Episode) -> None:
        self._episode, self._state = episode, episode.state
        self._scans: dict[int, Scan] = {}
        self._goal: tuple[float, float, float] = tuple(self._state.goals[-1].tolist())

    def refresh(self) -> None:
        """Take over the present state; call it before every question."""
        state, body = self._state, self._state.body
        self.t = self._episode.t
        x, y, yaw, v, w = body[base.X : base.W + 1].tolist()
        self.pose = (x, y, yaw)
        self.velocity = (v, w)
        self.lateral = float(body[base.SIDE])
        self.speed_share = float(state.times[SHARE])
        self.map_from_odom = tuple(state.own.present[MAP_X : MAP_YAW + 1].tolist())
        self.plan = state.path[1, state.nav[PLAN_BEGIN] : state.nav[PLAN_END]]
        goal_x, goal_y, goal_yaw = self._goal
        frame = state.own.frame[MAP_X : MAP_YAW + 1].tolist()
        cos, sin = math.cos(frame[MAP_YAW]), math.sin(frame[MAP_YAW])
        dx, dy = goal_x - frame[MAP_X], goal_y - frame[MAP_Y]
        self.goal = (cos * dx + sin * dy, cos * dy - sin * dx, goal_yaw - frame[MAP_YAW])
        side = state.stack.resolution
        corner = (float(state.nav[st.WINDOW_COLUMN] * side), float(state.nav[st.WINDOW_ROW] * side))
        self.costmap = Costmap(state.local[st.MASTER], *corner, side)

    def scan(self, lidar: int = 0) -> Scan:
        """Return the latest scan of a lidar."""
        state, settings = self._state, self._episode.settings
        row = state.stack.lidars[lidar]
        period = int(row[LIDAR_TICKS])
        tick = round(self.t / base.STEP_S)
        tick -= (tick - settings.scan_phase_ticks) % period
        taken = tick * base.STEP_S
        if lidar in self._scans and self._scans[lidar].t == taken:
            return self._scans[lidar]
        rays = int(row[LIDAR_RAYS])
        ranges = np.empty(rays)
        full_scan(
            ranges, state.directions[lidar], row[LIDAR_VIEW] / (rays - 1), *first_ray(row, state.scanned[lidar]),
            self._episode.scene.edges, state.legs[lidar],
        )  # fmt: skip
        begin = (tick * 9973 + lidar * 7919) % state.noise.size
        drawn = (begin + np.arange(rays)) % state.noise.size
        ranges += settings.lidar_noise * row[LIDAR_NOISE] * state.noise[drawn]
        ranges[(ranges > row[LIDAR_MAX]) | (state.dropouts[drawn] < row[LIDAR_DROPOUT])] = np.inf
        self._scans[lidar] = Scan(
            taken, ranges, -0.5 * float(row[LIDAR_VIEW]), float(row[LIDAR_VIEW]) / (rays - 1), float(row[LIDAR_MIN]),
            float(row[LIDAR_MAX]), float(row[LIDAR_X]), float(row[LIDAR_Y]), float(row[LIDAR_YAW]),
        )  # fmt: skip
        return self._scans[lidar]

    def people(self) -> Floats:
        """Return those whom a lidar sees."""
        crowd = self._episode.crowd
        seen = np.zeros(crowd.x.size, bool)
        for lidar in range(len(self._state.stack.lidars)):
            if not seen.all():
                seen |= self._in_sight(lidar, crowd.x, crowd.y)
        return np.column_stack([crowd.x, crowd.y, crowd.vx, crowd.vy])[seen]

    def _in_sight(self, lidar: int, x: Floats, y: Floats) -> NDArray[np.bool_]:
        scan, (rx, ry, yaw) = self.scan(lidar), self._state.scanned[lidar]
        ox = rx + scan.x * math.cos(yaw) - scan.y * math.sin(yaw)
        oy = ry + scan.x * math.sin(yaw) + scan.y * math.cos(yaw)
        distance = np.hypot(x - ox, y - oy)
        bearing = np.arctan2(y - oy, x - ox) - yaw - scan.yaw - scan.angle_min
        ray = np.round(np.mod(bearing, 2.0 * math.pi) / scan.angle_increment).astype(int)
        within = (ray < scan.ranges.size) & (distance < scan.range_max)
        around = np.maximum(0, np.minimum(ray[:, None] + AROUND, scan.ranges.size - 1))
        return np.asarray(within & (scan.ranges[around].max(axis=1) >= distance - SEEN_PAST_M))


class Driving:
    """A stack that drives one run."""

    def __init__(self, driver: NavigationStack, task: Task) -> None:
        self.driver, self.task = driver, task
        self.fault: str | None = None
        """Why the stack could not go on."""
        self.counts = {"calls": 0, "without_command": 0, "not_finite": 0, "clipped": 0}
        self._fault_t = 0.0
        self._seen: Observed | None = None
        self._commanded_t = -math.inf

    def outside(self, besides: Outside | None = None) -> Outside:
        """Reset the stack and return what the episode calls; `besides` may hold a recorder."""
        besides = besides or Outside()
        try:
            with _in_time(self.driver.answer_time_s):
                self.driver.reset(self.task)
        except Exception as error:
            self._fail(error)
        if isinstance(self.driver, WholeStack):
            return replace(besides, stack=self._step, stack_ticks=_ticks(self.driver))
        return replace(besides, control=self._control)

    def details(self) -> dict[str, Any]:
        """End the run; return what it tells of the stack."""
        facts: Mapping[str, Any] = {}
        try:
            with _in_time(self.driver.answer_time_s):
                facts = self.driver.finish()
        except Exception as error:
            self._fail(error)
        told = {**self.counts, **facts}
        return told if self.fault is None else {**told, "fault": self.fault, "fault_t": self._fault_t}

    def _control(self, episode: Episode) -> Answer | None:
        planner = self.driver
        assert isinstance(planner, LocalPlanner)
        answer = self._ask(episode, planner.command)
        if self.fault is not None:
            nav = episode.state.nav
            nav[st.MODE], nav[st.RESULT] = st.DONE, st.ABORTED
            episode.state.times[st.VALID_T] = episode.t
            return None
        velocity = self._velocity(answer)
        self.counts["without_command"] += velocity is None
        return velocity

    def _step(self, episode: Episode) -> Answer | bool | None:
        stack = self.driver
        assert isinstance(stack, WholeStack)
        answer = self._ask(episode, stack.step)
        if self.fault is not None or isinstance(answer, Ended):
            return self.fault is None and answer is Ended.REACHED
        velocity = self._velocity(answer)
        if velocity is not None:
            self._commanded_t = episode.t
        elif episode.t - self._commanded_t > COMMAND_TIME_S:
            return (0.0, 0.0)
        return velocity

    def _ask(self, episode: Episode, question: Callable[[Observed], Any]) -> Any:
        if self._seen is None:
            self._seen = Observed(episode)
        if self.fault is not None:
            return None
        self._seen.refresh()
        self.counts["calls"] += 1
        try:
            with _in_time(self.driver.answer_time_s):
                return question(self._seen)
        except Exception as error:
            self._fail(error, self._seen.t)
            return None

    def _velocity(self, answer: Any) -> Answer | None:
        """Return a velocity within the limits of the robot; None where there is none or it is not finite."""
        if answer is None:
            return None
        try:
            numbers = [float(number) for number in answer]
            v, side, w = numbers if len(numbers) == 3 else (numbers[0], 0.0, *numbers[1:])
        except (TypeError, ValueError, IndexError):
            assert self._seen is not None
            self._fail(StackError(f"it answered {answer!r:.80}; expected (v, w), (vx, vy, wz) or None"), self._seen.t)
            return None
        if not all(map(math.isfinite, (v, side, w))):
            self.counts["not_finite"] += 1
            return None
        limits = self.task.robot.limits
        kept = Twist(
            min(limits.speed_m_s, max(-limits.reverse_m_s, v)),
            min(limits.lateral_m_s, max(-limits.lateral_m_s, side)),
            min(limits.yaw_rate_rad_s, max(-limits.yaw_rate_rad_s, w)),
        )
        self.counts["clipped"] += kept != (v, side, w)
        return kept if limits.lateral_m_s > 0.0 else Velocity(kept.vx, kept.wz)

    def _fail(self, error: Exception, t: float = 0.0) -> None:
        """Keep the first fault; what a stack of somebody else raises ends its run, not the campaign."""
        if self.fault is None:
            self._fault_t = t
            self.fault = str(error)
            if not isinstance(error, StackError):
                frames = traceback.extract_tb(error.__traceback__)
                place = f" ({frames[-1].filename.rpartition('/')[2]}:{frames[-1].lineno})" if frames else ""
                self.fault = f"{type(error).__name__}: {error}{place}"[:500]


def called_every(driver: NavigationStack, robot: Robot) -> float:
    """Return the simulated time between two calls of a stack, s."""
    if isinstance(driver, WholeStack):
        return _ticks(driver) * base.STEP_S
    return 1.0 / robot.navigation.behaviours.controller_hz


def _ticks(driver: WholeStack) -> int:
    return max(1, round(driver.period_s / base.STEP_S))


@contextmanager
def _in_time(limit_s: float | None) -> Iterator[None]:
    """Raise StackError in a call that takes too long; only the main thread can be interrupted."""
    if limit_s is None or threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def late(*_: object) -> None:
        raise StackError(f"it did not answer within {limit_s:g} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
