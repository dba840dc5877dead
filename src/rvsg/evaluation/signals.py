"""Signals of a run that temporal formulas name, and the aim of a requirement."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rvsg.core.plugins import Registry
from rvsg.evaluation.metrics import find_metric
from rvsg.evaluation.sampled import Floats, Sampled, sampled
from rvsg.evaluation.temporal import Node, Range, body_of, bounds, joined_in, signals_of
from rvsg.scenario.requirement import Aim, Requirement
from rvsg.scenario.scenario import FASTEST_M_S, Mission
from rvsg.simulation.run import Run
from rvsg.world.world import World


class NotKnown(Exception):
    """The run does not have this signal: it needs a person or the world."""


def _obstacle_distance(s: Sampled) -> Floats:
    if s.obstacle_distance is None:
        raise NotKnown
    return s.obstacle_distance


def _clearance(s: Sampled) -> Floats:
    clear = _obstacle_distance(s) - s.run.robot_radius_m
    return np.minimum(clear, s.closest_gap) if s.people else clear


def _jerk(s: Sampled) -> Floats:
    if len(s) < 3:
        return np.zeros(len(s))
    along, across = s.acceleration
    return np.concatenate([[0.0, 0.0], np.hypot(np.diff(along), np.diff(across)) / s.dt[1:]])


def _of_closest(values: Floats, s: Sampled) -> Floats:
    """Return (N,) the values of the person whose centre is nearest, from (N, H)."""
    return values[np.arange(len(s)), s.closest]


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


def _signal(id: str, title: str, unit: str, aim: Aim | None, of: Callable[[Sampled], Floats]) -> RunSignal:
    return RunSignal(id=id, title=title, unit=unit, aim=aim, of=of)


def _person(id: str, title: str, unit: str, of: Callable[[Sampled], Floats]) -> RunSignal:
    return RunSignal(id=id, title=title, unit=unit, aim=Aim.MEET, of=of, of_people=True)


BUILT_IN = (
    _signal("time", "time since the start", "s", None, lambda s: s.series.t - s.series.t[0]),
    _person("distance_to_person", "gap to the nearest human", "m", lambda s: s.closest_gap),
    _signal("clearance", "gap to what is nearest", "m", Aim.MEET, _clearance),
    _signal("obstacle_distance", "distance to the nearest obstacle", "m", Aim.DISTURB, _obstacle_distance),
    _person("centre_distance", "distance to the nearest human, centres", "m", lambda s: s.distance.min(axis=1)),
    _person("closing_speed", "closing speed of the nearest human", "m/s", lambda s: _of_closest(s.closing_speed, s)),
    _person("person_speed", "speed of the nearest human", "m/s", lambda s: _of_closest(s.series.human_speed, s)),
    _person("person_bearing", "bearing of the nearest human", "rad", lambda s: _of_closest(s.bearing_of_human, s)),
    _signal("speed", "speed", "m/s", Aim.DELAY, lambda s: s.series.speed),
    _signal("forward_speed", "forward speed", "m/s", Aim.DELAY, lambda s: s.series.v),
    _signal("turn_rate", "turn rate", "rad/s", Aim.DISTURB, lambda s: np.abs(s.series.omega)),
    # Along the heading over the interval before the sample; braking is negative, the first sample 0.
    _signal("acceleration", "acceleration", "m/s2", Aim.DISTURB, lambda s: np.append(0.0, s.acceleration[0])),
    # The magnitude over the interval before the sample; 0 for the first two.
    _signal("jerk", "jerk", "m/s3", Aim.DISTURB, _jerk),
    _signal("distance_to_goal", "distance to the goal", "m", Aim.DELAY, lambda s: s.goal_distance),
    _signal("x", "x of the robot", "m", Aim.DELAY, lambda s: s.series.x),
    _signal("y", "y of the robot", "m", Aim.DELAY, lambda s: s.series.y),
)

NEVER_NEGATIVE = (
    "time",
    "time",
    "obstacle_distance",
    "centre_distance",
    "distance_to_goal",
    "speed",
    "person_speed",
    "turn_rate",
    "jerk",
)
SIGNALS: Registry[RunSignal] = Registry("signal", RunSignal, {signal.id: signal for signal in BUILT_IN})
"""Every signal by its name: those that ship, then those of plug-ins."""


@lru_cache(maxsize=256)
def formula(text: str) -> Node:
    """Return a parsed formula over the signals; FormulaError, with the position, where it cannot be parsed."""
    from rvsg.evaluation.temporal_grammar import parse  # loads lark, which most commands do not need

    return parse(text, tuple(SIGNALS))


def doubts_of(requirement: Requirement, mission: Mission, world: World) -> Iterator[str]:
    """Yield why a requirement says nothing here: no run can violate it, or every run does.

    Map, robot and time limit bound lengths, speeds and times; other quantities are taken as unbounded.
    """
    limit, name = requirement.threshold, requirement.name
    if limit is None:
        return
    if requirement.formula is not None:
        low, high = bounds(formula(requirement.formula), lambda id: _range(SIGNALS[id].unit, id, mission, world))
        text = f"{name}: the value of its formula lies between {low:.4g} and {high:.4g} here"
        never, always = low >= limit, high < limit
    elif (metric := find_metric(requirement.metric or "")) is not None:
        low, high = _range(metric.unit, "", mission, world)
        least, most = metric.bounds(mission.route.time_limit_s)
        low, high = low if least is None else least, high if most is None else most
        text = f"{name}: its limit is {limit:g} {metric.unit}, and values here lie between {low:.4g} and {high:.4g}"
        never, always = (limit <= low, limit > high) if requirement.worse == "smaller" else (limit >= high, limit < low)
    if never or always:
        yield f"{text}: {'no run can violate it' if never else 'every run violates it'}. Check the limit and its unit."


def _range(unit: str, of: str, mission: Mission, world: World) -> Range:
    """Return the least and the largest value of a quantity; `of`: the signal that it is."""
    rows, columns = world.occupancy.cells.shape
    origin, robot, limit_s = world.occupancy.origin, mission.robot_record, mission.route.time_limit_s
    high = limit_s if of == "time" else math.inf
    if robot is not None and unit in ("m", "m/s"):
        speed = math.hypot(robot.limits.speed_m_s, robot.limits.lateral_m_s)
        across = math.hypot(rows, columns) * world.occupancy.resolution + math.hypot(origin.x, origin.y)
        high = max(across, speed * limit_s) if unit == "m" else speed + FASTEST_M_S
    return 0.0 if of in NEVER_NEGATIVE else -high, high


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
        metric = find_metric(requirement.metric)
        return metric.aim if metric is not None else None
    aims = {SIGNALS[name].aim for name in signals_of(formula(requirement.formula))}
    return next((aim for aim in _STRONGEST if aim in aims), Aim.DELAY)


def moved_by(requirement: Requirement) -> str:
    """Return one plain sentence on what makes a requirement worse; empty if nothing declares it."""
    metric = find_metric(requirement.metric)
    return metric.moved_by if metric is not None else ""


def series_name(requirement: Requirement) -> str:
    """Return the name of the series of `series_of`, with its unit."""
    if requirement.formula is not None:
        return "room left by the formula (violated below 0)"
    metric = find_metric(requirement.metric)
    return SIGNALS[metric.shown if metric is not None else NEARNESS].words


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
            values = body_of(formula(requirement.formula)).values(run.trajectory.t, _Lazily(s))
            return np.where(np.isfinite(values), values, np.nan)
        metric = find_metric(requirement.metric)
        return SIGNALS[metric.shown if metric is not None else NEARNESS].values(s)
    except NotKnown:
        return np.full(len(s), np.nan)


def least_room(
    run: Run, requirement: Requirement, *, world: World | None = None
) -> tuple[float, dict[str, float]] | None:
    """Return when a formula has least room in a run (s), and the room of each part that it joins there.

    None for a metric, a formula of one part, and where the formula has no value.
    """
    values = series_of(run, requirement, world=world)
    parts = joined_in(body_of(formula(requirement.formula))) if requirement.formula is not None else ()
    if len(parts) < 2 or not np.isfinite(values).any():
        return None
    k, time, signals = int(np.nanargmin(values)), run.trajectory.t, _Lazily(sampled(run, world))
    room = {str(part): round(float(part.values(time, signals)[k]), 3) for part in parts}
    return round(float(time[k]), 1), {part: value for part, value in room.items() if math.isfinite(value)}
