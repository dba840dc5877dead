"""What arrays of a run foretell of others, in whole steps, so that only the difference is stored.

The rows of the log are the trajectory between two samples (the robot) or before the last change (people); a person's
speed is the length of the last step; the acceleration of a sample is about the mean of the inertial sensor since the
sample before. Foretelling uses integers and correctly rounded operations alone: it is the same on every machine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]
Steps = Mapping[str, Integers]
"""Arrays by name as multiples of their steps, (rows, columns)."""
How = tuple[int, ...]
"""The number of the rule, and what it needs to know."""

BETWEEN, AT_THE_TIME, BEFORE_CHANGE, STEP_LENGTH, MEAN_SINCE = range(1, 6)
LOGGED = {"x": BETWEEN, "y": BETWEEN, "yaw": BETWEEN, "v": AT_THE_TIME, "omega": AT_THE_TIME}
LOGGED_PEOPLE = ("human_x", "human_y", "human_yaw", "human_speed")
LARGEST = 2**52
"""A difference at least as large is no foretelling."""
PHASES = range(0, 50_000, 10_000)
"""Microseconds by which people may change after a sample: they are seen at the next."""
SAMPLES_OF_A_TICK = 5
"""The inertial sensor measures this often between two samples."""


def less_foretold(steps: Steps) -> tuple[dict[str, Integers], dict[str, How]]:
    """Return what is left of each array, and by which rule; arrays that foretelling would not make smaller stay."""
    left, how = dict(steps), {}
    run = _Known(steps)
    for name, rule in run.rules().items():
        known = steps[name]
        rest = known - run.foretold(name, rule)
        if np.abs(rest).max() < LARGEST and 2 * _size(rest) < _size(known[1:] - known[:-1]):
            left[name], how[name] = rest, rule
    return left, how


def add_foretold(left: Steps, how: Mapping[str, How]) -> dict[str, Integers]:
    """Return the arrays of which `less_foretold` left these.

    Raises:
        KeyError: There is no such rule, or an array that it needs is missing.
    """
    steps = dict(left)
    run = _Known(steps)
    for name in sorted(how, key=lambda name: name.startswith("log.")):  # the log is foretold from the trajectory
        steps[name] = left[name] + run.foretold(name, how[name])
    return steps


def _size(values: Integers) -> float:
    return float(np.abs(values).sum(dtype=np.float64))


class _Known:
    """The arrays of a run that are known so far."""

    def __init__(self, steps: Steps) -> None:
        self.steps = steps
        self._rows: dict[int, Integers] = {}

    def foretold(self, name: str, how: How) -> Integers:
        """Return what a rule says of an array, (rows, columns)."""
        rules: dict[int, Callable[[str, How], Integers]] = {
            BETWEEN: self._between,
            AT_THE_TIME: lambda name, _: self._sampled(name)[self._at()],
            BEFORE_CHANGE: lambda name, how: self._sampled(name)[self._before(how[1])],
            STEP_LENGTH: self._step_length,
            MEAN_SINCE: self._mean_since,
        }
        return rules[how[0]](name, how)

    def rules(self) -> dict[str, How]:
        """Return the rule of each array that there is one for."""
        found: dict[str, How] = {}
        known, t = self.steps.keys(), self.steps.get("trajectory.t")
        if t is None or len(t) < 2 or not (t[1:] > t[:-1]).all():
            return found
        people = {"trajectory.human_x", "trajectory.human_y"} <= known
        if people and "trajectory.human_speed" in known:
            between = np.diff(t[1:, 0][self.moved.any(axis=1)])
            if len(between):
                found["trajectory.human_speed"] = (STEP_LENGTH, int(np.median(between)))
        if {"imu", "trajectory.acceleration"} <= known:
            found["trajectory.acceleration"] = (MEAN_SINCE,)
        if "log.t" in known:
            logged: dict[str, How] = {name: (rule,) for name, rule in LOGGED.items()}
            if people and "log.human_x" in known:
                logged |= dict.fromkeys(LOGGED_PEOPLE, (BEFORE_CHANGE, min(PHASES, key=self._missed)))
            found |= {f"log.{n}": how for n, how in logged.items() if {f"log.{n}", f"trajectory.{n}"} <= known}
        return found

    @cached_property
    def moved(self) -> NDArray[np.bool_]:
        """(N - 1, H) whether a person is elsewhere than at the sample before."""
        x, y = self.steps["trajectory.human_x"], self.steps["trajectory.human_y"]
        return np.asarray((x[1:] != x[:-1]) | (y[1:] != y[:-1]))

    @cached_property
    def changed(self) -> Integers:
        """(N,) the sample before the last at which anybody moved."""
        last = np.zeros(len(self.moved) + 1, np.int64)
        last[1:] = np.where(self.moved.any(axis=1), np.arange(len(self.moved)), 0)
        return np.maximum.accumulate(last)

    def _at(self, later: int = 0) -> Integers:
        """The last sample of the trajectory at the time of each row of the log, or so much later."""
        if later not in self._rows:
            t = self.steps["trajectory.t"][:, 0]
            rows = np.searchsorted(t, self.steps["log.t"][:, 0] + later, side="right") - 1
            self._rows[later] = np.minimum(np.maximum(rows, 0), len(t) - 1)
        return self._rows[later]

    def _before(self, later: int) -> Integers:
        return np.asarray(self.changed[self._at(later)])

    def _missed(self, later: int) -> float:
        """How far people in the log are from where they were before the last change, so much after each row."""
        return _size(self.steps["log.human_x"] - self._sampled("log.human_x")[self._before(later)])

    def _sampled(self, name: str) -> Integers:
        """The array of the trajectory that one of the log repeats."""
        return self.steps[name.replace("log.", "trajectory.")]

    def _between(self, name: str, _: How) -> Integers:
        t, values = self.steps["trajectory.t"][:, 0], self._sampled(name)
        rows = np.minimum(self._at(), len(t) - 2)
        passed = (self.steps["log.t"][:, 0] - t[rows])[:, None]
        length = np.maximum(t[rows + 1] - t[rows], 1)[:, None]
        return np.asarray(values[rows] + (2 * (values[rows + 1] - values[rows]) * passed + length) // (2 * length))

    def _step_length(self, name: str, how: How) -> Integers:
        x, y = self.steps["trajectory.human_x"], self.steps["trajectory.human_y"]
        dx, dy = (x[1:] - x[:-1]).astype(np.float64), (y[1:] - y[:-1]).astype(np.float64)
        speed = np.zeros(self.steps[name].shape, np.int64)
        speed[1:] = np.minimum(np.rint(np.sqrt(dx * dx + dy * dy) * (1e6 / how[1])), LARGEST)
        last = np.zeros(speed.shape, np.int64)
        last[1:] = np.where(self.moved, np.arange(1, len(speed))[:, None], 0)
        return np.take_along_axis(speed, np.maximum.accumulate(last, axis=0), axis=0)

    def _mean_since(self, name: str, _: How) -> Integers:
        total = np.concatenate([[0], np.cumsum(self.steps["imu"])])
        end = np.minimum(SAMPLES_OF_A_TICK * np.arange(len(self.steps[name])), len(total) - 1)
        since = total[end] - total[np.maximum(end - SAMPLES_OF_A_TICK, 0)]
        return np.asarray((2 * since + SAMPLES_OF_A_TICK) // (2 * SAMPLES_OF_A_TICK))[:, None]
