"""Signals of a run that temporal formulas name, and the aim of a requirement."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from rvsg.core.registry import Registry
from rvsg.evaluation.metrics.registry import find_metric
from rvsg.evaluation.sampled import Floats, Sampled, sampled
from rvsg.evaluation.temporal import Node, body_of, parse, signals_of
from rvsg.scenario.requirement import Aim, Requirement
from rvsg.simulation.run import Run
from rvsg.world.world import World


class NotKnown(Exception):
    """The run does not have this signal: it needs a person or the world."""


def _time(s: Sampled) -> Floats:
    """Seconds since the start of the run."""
    elapsed: Floats = s.series.t - s.series.t[0]
    return elapsed


def _distance_to_person(s: Sampled) -> Floats:
    """Metres between the bodies of robot and closest person; negative where they overlap."""
    return s.closest_gap


def _clearance(s: Sampled) -> Floats:
    """Metres between the robot's disc and the nearest person or obstacle; needs the world."""
    if s.obstacle_distance is None:
        raise NotKnown
    clear = s.obstacle_distance - s.run.robot_radius_m
    return np.minimum(clear, s.closest_gap) if s.people else clear


def _obstacle_distance(s: Sampled) -> Floats:
    """Metres from the robot's centre to the nearest obstacle; needs the world."""
    if s.obstacle_distance is None:
        raise NotKnown
    return s.obstacle_distance


def _centre_distance(s: Sampled) -> Floats:
    """Metres between the centres of robot and closest person."""
    distance: Floats = s.distance.min(axis=1)
    return distance


def _closing_speed(s: Sampled) -> Floats:
    """m/s at which robot and closest person approach each other; negative apart."""
    return s.closing_speed[np.arange(len(s)), s.closest]


def _person_speed(s: Sampled) -> Floats:
    """m/s of the closest person."""
    return s.series.human_speed[np.arange(len(s)), s.closest]


def _person_bearing(s: Sampled) -> Floats:
    """Radians off the robot's heading at which it has the closest person: 0 ahead, pi behind."""
    return s.bearing_of_human[np.arange(len(s)), s.closest]


def _speed(s: Sampled) -> Floats:
    """m/s, the magnitude of the robot's speed."""
    return s.series.speed


def _forward_speed(s: Sampled) -> Floats:
    """m/s along the robot's heading; negative in reverse."""
    return s.series.v


def _turn_rate(s: Sampled) -> Floats:
    """rad/s, the magnitude of the robot's turn rate."""
    rate: Floats = np.abs(s.series.omega)
    return rate


def _acceleration(s: Sampled) -> Floats:
    """m/s^2 along the heading over the interval before the sample; braking is negative, the first sample 0."""
    return np.concatenate([[0.0], s.acceleration[0]])


def _distance_to_goal(s: Sampled) -> Floats:
    """Metres from the robot's centre to its goal."""
    return s.goal_distance


def _x(s: Sampled) -> Floats:
    """Metres, the robot's x in the world frame."""
    return s.series.x


def _y(s: Sampled) -> Floats:
    """Metres, the robot's y in the world frame."""
    return s.series.y


def _jerk(s: Sampled) -> Floats:
    """m/s^3, the magnitude of the change of acceleration over the interval before the sample; 0 for the first two."""
    if len(s) < 3:
        return np.zeros(len(s))
    along, across = s.acceleration
    return np.concatenate([[0.0, 0.0], np.hypot(np.diff(along), np.diff(across)) / s.dt[1:]])


@dataclass(frozen=True, kw_only=True)
class RunSignal:
    """A quantity over time that temporal formulas can name, and that shows where a metric is lost.

    A plug-in registers one, or a sequence of them, in the entry point group `rvsg.signals`.
    """

    id: str
    """The name in formulas: a word of letters, digits and underscores."""
    title: str
    """What it is, in words, for people and for generators."""
    unit: str
    of: Callable[[Sampled], Floats]
    """Computes it, (N,) for N samples; raises NotKnown where a run does not have it."""
    aim: Aim | None = None
    """What people should do to change it; None if it says nothing of what people do."""
    of_people: bool = False
    """It needs at least one person."""

    @property
    def words(self) -> str:
        """Title and unit."""
        return f"{self.title} in {self.unit}"

    def values(self, s: Sampled) -> Floats:
        """Return the signal at every sample; raises NotKnown."""
        if self.of_people and not s.people:
            raise NotKnown
        return np.asarray(self.of(s), dtype=np.float64)


_person = partial(RunSignal, aim=Aim.MEET, of_people=True)

BUILT_IN = (
    RunSignal(id="time", title="time since the start", unit="s", of=_time),
    _person(id="distance_to_person", title="gap to the nearest human", unit="m", of=_distance_to_person),
    RunSignal(id="clearance", title="gap to what is nearest", unit="m", of=_clearance, aim=Aim.MEET),
    RunSignal(
        id="obstacle_distance",
        title="distance to the nearest obstacle",
        unit="m",
        of=_obstacle_distance,
        aim=Aim.DISTURB,
    ),
    _person(id="centre_distance", title="distance to the nearest human, centres", unit="m", of=_centre_distance),
    _person(id="closing_speed", title="closing speed of the nearest human", unit="m/s", of=_closing_speed),
    _person(id="person_speed", title="speed of the nearest human", unit="m/s", of=_person_speed),
    _person(id="person_bearing", title="bearing of the nearest human", unit="rad", of=_person_bearing),
    RunSignal(id="speed", title="speed", unit="m/s", of=_speed, aim=Aim.DELAY),
    RunSignal(id="forward_speed", title="forward speed", unit="m/s", of=_forward_speed, aim=Aim.DELAY),
    RunSignal(id="turn_rate", title="turn rate", unit="rad/s", of=_turn_rate, aim=Aim.DISTURB),
    RunSignal(id="acceleration", title="acceleration", unit="m/s2", of=_acceleration, aim=Aim.DISTURB),
    RunSignal(id="jerk", title="jerk", unit="m/s3", of=_jerk, aim=Aim.DISTURB),
    RunSignal(id="distance_to_goal", title="distance to the goal", unit="m", of=_distance_to_goal, aim=Aim.DELAY),
    RunSignal(id="x", title="x of the robot", unit="m", of=_x, aim=Aim.DELAY),
    RunSignal(id="y", title="y of the robot", unit="m", of=_y, aim=Aim.DELAY),
)

SIGNALS: Registry[RunSignal] = Registry("signal", RunSignal, {signal.id: signal for signal in BUILT_IN})
"""Every signal by its name: those that ship, then those of plug-ins."""


@lru_cache(maxsize=256)
def formula(text: str) -> Node:
    """Return a parsed formula over the signals; FormulaError, with the position, where it cannot be parsed."""
    return parse(text, tuple(SIGNALS))


def known_signals(s: Sampled) -> Mapping[str, Floats]:
    """Return the signals of a sampled run, each computed when it is read; reading one raises NotKnown."""
    return _Lazily(s)


class _Lazily(Mapping[str, Floats]):
    """Signals of a run, each computed when it is asked for."""

    def __init__(self, sampled: Sampled) -> None:
        self.sampled = sampled

    def __getitem__(self, name: str) -> Floats:
        return SIGNALS[name].values(self.sampled)

    def __iter__(self) -> Iterator[str]:
        return iter(SIGNALS)

    def __len__(self) -> int:
        return len(SIGNALS)


def robustness(run: Run, text: str, *, world: World | None = None) -> float | None:
    """Return the robustness of a formula at the start of the run, over its trajectory.

    It is None if it has no finite value: no samples, no person for a signal of people, no `world` for one of
    obstacles, or an interval beyond the end.
    """
    seen = sampled(run, world)
    node = formula(text)
    if not len(seen):
        return None
    try:
        value = float(node.values(run.trajectory.t, _Lazily(seen))[0])
    except NotKnown:
        return None
    return value if math.isfinite(value) else None


_STRONGEST = (Aim.MEET, Aim.DISTURB, Aim.DELAY, Aim.SHARE)
"""A formula has the first of these aims that one of its signals has: people come before time."""
NEARNESS = "distance_to_person"


def aim_of(requirement: Requirement | None) -> Aim | None:
    """Return the aim for a requirement; None without one, or if its metric is not installed."""
    if requirement is None:
        return None
    if requirement.formula is None:
        known = find_metric(requirement.metric)
        return known.aim if known is not None else None
    aims = {SIGNALS[name].aim for name in signals_of(formula(requirement.formula))}
    return next((aim for aim in _STRONGEST if aim in aims), Aim.DELAY)


def moved_by(requirement: Requirement) -> str:
    """Return one plain sentence on what makes a requirement worse; empty if nothing declares it."""
    known = find_metric(requirement.metric)
    return known.moved_by if known is not None else ""


def series_name(requirement: Requirement) -> str:
    """Return the name of the series of `series_of`, with its unit."""
    if requirement.formula is not None:
        return "room left by the formula (violated below 0)"
    known = find_metric(requirement.metric)
    return SIGNALS[known.shown if known is not None else NEARNESS].words


def series_of(run: Run, requirement: Requirement, *, world: World | None = None) -> Floats:
    """Return (N,) the series that shows when a requirement is violated, at every sample of the trajectory.

    For a metric, it is the signal that the metric declares; for a formula, the robustness of the part that must always
    hold. NaN where there is no value.
    """
    s = sampled(run, world)
    if not len(s):
        return np.empty(0)
    try:
        if requirement.formula is not None:
            return _finite(body_of(formula(requirement.formula)).values(run.trajectory.t, known_signals(s)))
        known = find_metric(requirement.metric)
        return SIGNALS[known.shown if known is not None else NEARNESS].values(s)
    except NotKnown:
        return np.full(len(s), np.nan)


def _finite(values: Floats) -> Floats:
    return np.where(np.isfinite(values), values, np.nan)
