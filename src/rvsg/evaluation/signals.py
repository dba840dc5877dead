"""The signals that temporal formulas speak of, and the robustness of a formula over a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rvsg.evaluation.sampled import Sampled
from rvsg.evaluation.temporal import Node
from rvsg.evaluation.temporal_syntax import parse
from rvsg.simulation.run import Run
from rvsg.world.world import World

Floats = NDArray[np.float64]


class NotKnown(Exception):
    """A signal that this run does not have: of a person where there is nobody, of a world that is not given."""


def _time(s: Sampled) -> Floats:
    """Seconds since the start of the run."""
    elapsed: Floats = s.series.t - s.series.t[0]
    return elapsed


def _distance_to_person(s: Sampled) -> Floats:
    """Metres between the surfaces of robot and closest person; negative where they overlap."""
    return s.closest_gap


def _clearance(s: Sampled) -> Floats:
    """Metres between the robot's disc and the nearest person or obstacle of its map; needs the world."""
    if s.obstacle_distance is None:
        raise NotKnown
    clear = s.obstacle_distance - s.run.robot_radius_m
    return np.minimum(clear, s.closest_gap) if s.people else clear


def _obstacle_distance(s: Sampled) -> Floats:
    """Metres from the robot's centre to the nearest obstacle of its map; needs the world."""
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
    speed: Floats = np.abs(s.series.v)
    return speed


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


SIGNALS: dict[str, Callable[[Sampled], Floats]] = {
    "time": _time,
    "distance_to_person": _distance_to_person,
    "clearance": _clearance,
    "obstacle_distance": _obstacle_distance,
    "centre_distance": _centre_distance,
    "closing_speed": _closing_speed,
    "person_speed": _person_speed,
    "person_bearing": _person_bearing,
    "speed": _speed,
    "forward_speed": _forward_speed,
    "turn_rate": _turn_rate,
    "acceleration": _acceleration,
    "distance_to_goal": _distance_to_goal,
    "x": _x,
    "y": _y,
}
"""Every signal by its name; its docstring says what it is and its unit."""

OF_PEOPLE = frozenset({"distance_to_person", "centre_distance", "closing_speed", "person_speed", "person_bearing"})


@lru_cache(maxsize=256)
def formula(text: str) -> Node:
    """A formula over the signals above; FormulaError (with the position) where it cannot be read."""
    return parse(text, tuple(SIGNALS))


class _Lazily(Mapping[str, Floats]):
    """Signals of a run, each computed when it is asked for."""

    def __init__(self, sampled: Sampled) -> None:
        self.sampled = sampled

    def __getitem__(self, name: str) -> Floats:
        if name in OF_PEOPLE and not self.sampled.people:
            raise NotKnown
        return SIGNALS[name](self.sampled)

    def __iter__(self) -> Iterator[str]:
        return iter(SIGNALS)

    def __len__(self) -> int:
        return len(SIGNALS)


def robustness(run: Run, text: str, *, world: World | None = None) -> float | None:
    """The robustness of a formula at the start of the run, over its trajectory (20 Hz for our own runs).

    None where it has no finite value: no samples, nobody for a signal of people, no `world` for one of obstacles, an
    interval beyond the end.
    """
    sampled = Sampled(run, run.trajectory, world)
    node = formula(text)
    if not len(sampled):
        return None
    try:
        value = float(node.values(run.trajectory.t, _Lazily(sampled))[0])
    except NotKnown:
        return None
    return value if math.isfinite(value) else None
