"""Realism of simulated people: how far each person of a run goes, beside recorded people.

The recordings are ETH and HOTEL (Pellegrini et al. 2009), ZARA 1, ZARA 2 and students 3 (Lerner et al. 2007): some
1,300 people on streets and a campus, sampled every 0.4 s as simulated people are here. Members of one group do not
count for what people do to others; the robot counts as somebody there, with the radius of its body. Positions in the
recordings are marked by hand, so the accelerations include that noise.
`benchmarks/people_realism.py` counts the percentiles.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Record
from rvsg.simulation.events import PersonPaused
from rvsg.simulation.run import Run

Floats = NDArray[np.float64]
PEOPLE_REALISM = "people_realism"
"""The metric."""
SAMPLE_S = 0.4
WALKING_M_S = 0.2
"""Slower people stand."""
RARE_PERCENT = 1.0
"""What fewer recorded people did is named."""
PERCENTILES = (0.0, 0.5, 1.0, 2.5, 5.0, 10.0, 25.0, 50.0, 75.0, 90.0, 95.0, 97.5, 99.0, 99.5, 100.0)


@dataclass(frozen=True)
class Quantity:
    """What is compared: words, unit, whether large values are unusual, and recorded values at `PERCENTILES`."""

    words: str
    unit: str
    high: bool
    recorded: tuple[float, ...]

    def rarity(self, value: float) -> float:
        """Return the percentage of recorded people who go as far as this value or farther."""
        below = float(np.interp(value, self.recorded, PERCENTILES))
        return 100.0 - below if self.high else below


QUANTITIES = {
    "speed": Quantity(
        "walks at", "m/s", True,
        (0.21, 0.26, 0.3, 0.41, 0.49, 0.59, 0.84, 1.19, 1.48, 1.71, 1.82, 1.91, 2.02, 2.11, 2.23),
    ),
    "acceleration": Quantity(
        "accelerates with", "m/s²", True,
        (0.0, 0.005, 0.01, 0.3, 0.41, 0.55, 0.8, 1.13, 1.57, 2.15, 2.63, 3.26, 3.95, 4.66, 9.5),
    ),
    "distance": Quantity(
        "comes within", "m of another person's centre", False,
        (0.14, 0.21, 0.25, 0.3, 0.34, 0.4, 0.53, 0.78, 1.1, 1.57, 2.03, 2.4, 3.49, 4.27, 9.68),
    ),
    "standing": Quantity(
        "stands on the way for", "s", True,
        (0.0, 0.001, 0.002, 0.003, 0.004, 0.005, 0.006, 0.007, 0.008, 2.0, 5.6, 11.2, 23.1, 52.2, 150.4),
    ),
    "closing": Quantity(
        "moves at somebody less than 0.2 m away with", "m/s", True,
        (0.0, 0.001, 0.002, 0.003, 0.004, 0.005, 0.095, 0.42, 0.638, 0.808, 0.897, 1.013, 1.092, 1.145, 1.244),
    ),
    "following": Quantity(
        "follows for 2 s within", "m", False,
        (0.01, 0.155, 0.253, 0.395, 0.518, 0.777, 1.503, 2.982, 5.506, 8.219, 9.752, 10.431, 11.285, 12.206, 13.019),
    ),
    "turning": Quantity(
        "turns round without a stop", "times", True,
        (0.0, 0.001, 0.002, 0.003, 0.004, 0.005, 0.006, 0.007, 0.008, 0.009, 0.01, 0.011, 0.012, 0.013, 1.2),
    ),
}  # fmt: skip
NEAR_M = 0.2
"""The gap of two bodies from which somebody's own speed towards the other counts."""
FOLLOWS_M_S, FOLLOWS_ALONG, FOLLOWS_SAMPLES = 0.5, math.cos(math.radians(45.0)), 5
"""Who follows walks, as the other ahead does, faster than this, within 45° of the same direction, for 2 s."""
TURN_SAMPLES, TURN_M = 3, 0.5
"""A turn is between the ways of the 1.2 s before and after, each so long at least; beyond 120° it is round."""


def closing(path: Floats, other: Floats, bodies_m: float) -> tuple[float, int] | None:
    """Return the highest speed of a person, (2, N) every `SAMPLE_S`, towards somebody hard by, m/s, and its sample.

    Args:
        bodies_m: The radii of both together.
    """
    apart = (other - path)[:, :-1]
    distance = np.hypot(*apart)
    towards = (np.diff(path) / SAMPLE_S * apart).sum(axis=0) / np.maximum(distance, 1e-6)
    towards[distance - bodies_m > NEAR_M] = -math.inf
    k = int(towards.argmax()) if len(towards) else 0
    return None if not len(towards) or math.isinf(towards[k]) else (max(0.0, float(towards[k])), k)


def following(path: Floats, other: Floats, bodies_m: float) -> tuple[float, int] | None:
    """Return the gap that a person keeps for 2 s at least behind somebody, m, and the sample where that begins."""
    apart, own, theirs = (other - path)[:, :-1], np.diff(path) / SAMPLE_S, np.diff(other) / SAMPLE_S
    distance, speed, pace = np.hypot(*apart), np.hypot(*own), np.hypot(*theirs)
    walk = (speed > FOLLOWS_M_S) & (pace > FOLLOWS_M_S)
    same = (own * theirs).sum(axis=0) > FOLLOWS_ALONG * speed * pace
    ahead = (own * apart).sum(axis=0) > FOLLOWS_ALONG * speed * distance
    gaps = np.where(walk & same & ahead, distance - bodies_m, math.inf)
    if len(gaps) < FOLLOWS_SAMPLES:
        return None
    widest = np.lib.stride_tricks.sliding_window_view(gaps, FOLLOWS_SAMPLES).max(axis=1)
    k = int(widest.argmin())
    return None if math.isinf(widest[k]) else (max(0.0, float(widest[k])), k)


def turning(path: Floats) -> tuple[int, int]:
    """Return how often a person, (2, N) every `SAMPLE_S`, turns round without a stop, and the sample of the first."""
    n = TURN_SAMPLES
    before, after = path[:, n:-n] - path[:, : -2 * n], path[:, 2 * n :] - path[:, n:-n]
    walked, walks = np.hypot(*before), np.hypot(*after)
    rounds = (walked >= TURN_M) & (walks >= TURN_M) & ((before * after).sum(axis=0) < -0.5 * walked * walks)
    begins = np.flatnonzero(rounds & ~np.concatenate([[False], rounds[:-1]]))
    return len(begins), n + int(begins[0]) if len(begins) else 0


class Motion(Record):
    """How far one person of a run goes in one quantity: the value, when, and how many recorded people go as far."""

    person: str
    quantity: str
    value: float
    time_s: float
    recorded_percent: float

    @property
    def is_rare(self) -> bool:
        """Whether fewer than 1 in 100 recorded people go as far."""
        return self.recorded_percent < RARE_PERCENT

    @property
    def sentence(self) -> str:
        """Who does what when, and how many recorded people do."""
        kind = QUANTITIES[self.quantity]
        share = "no" if self.recorded_percent <= 0.0 else f"{self.recorded_percent:.1f} % of the"
        what = f"{self.person} {kind.words} {self.value:.2g} {kind.unit} at {self.time_s:.1f} s"
        return f"{what}; {share} recorded people go as far."


def motions(run: Run) -> tuple[Motion, ...]:
    """Return how far each person of a run goes, in every quantity that the run shows."""
    path = run.trajectory
    times = np.arange(float(path.t[0]), float(path.t[-1]), SAMPLE_S) if len(path.t) else np.empty(0)
    if len(times) < 2 * TURN_SAMPLES + 1:
        return ()
    places = np.stack(
        [[np.interp(times, path.t, axis[:, h]) for axis in (path.human_x, path.human_y)]
         for h in range(len(run.human_names))]
    ) if run.human_names else np.empty((0, 2, len(times)))  # fmt: skip
    result: list[Motion] = []

    def add(person: str, quantity: str, value: float, time_s: float) -> None:
        rarity = QUANTITIES[quantity].rarity(value)
        result.append(Motion(person=person, quantity=quantity, value=round(value, 3), time_s=round(time_s, 2),
                            recorded_percent=round(rarity, 2)))  # fmt: skip

    robot = np.stack([np.interp(times, path.t, axis) for axis in (path.x, path.y)])
    groups = run.human_groups or (None,) * len(run.human_names)
    for h, name in enumerate(run.human_names):
        velocity = np.diff(places[h], axis=1) / SAMPLE_S
        speed = np.hypot(*velocity)
        walking = speed > WALKING_M_S
        if walking.sum() >= 4:
            pace = float(np.median(speed[walking]))
            add(name, "speed", pace, float(times[np.flatnonzero(walking)[0]]))
        acceleration = np.hypot(*(np.diff(velocity, axis=1) / SAMPLE_S))
        row = int(acceleration.argmax())
        add(name, "acceleration", float(acceleration[row]), float(times[row + 1]))
        radius = run.human_radius_m[h]
        others = [
            (places[o], radius + run.human_radius_m[o])
            for o in range(len(places))
            if o != h and (groups[h] is None or groups[o] != groups[h])
        ]
        if others:
            nearest = np.min([np.hypot(*(places[h] - other)) for other, _ in others], axis=0)
            add(name, "distance", float(nearest.min()), float(times[int(nearest.argmin())]))
        paused = [(e.time_s, e.until_s) for e in run.events if isinstance(e, PersonPaused) and e.person == name]
        others.append((robot, radius + run.robot_radius_m))
        for quantity, shown, worst in (("closing", closing, max), ("following", following, min)):
            found = [known for other, bodies in others if (known := shown(places[h], other, bodies)) is not None]
            if found:
                value, row = worst(found)
                add(name, quantity, value, float(times[row]))
        count, row = turning(places[h])
        add(name, "turning", float(count), float(times[row]))
        add(name, "standing", *_longest(times[:-1], ~walking, paused))
    return tuple(result)


def _longest(times: Floats, standing: NDArray[np.bool_], paused: Iterable[tuple[float, float]]) -> tuple[float, float]:
    """Return the longest time of standing that is no pause, and when it begins; before the first step nobody stands."""
    counts = standing.copy()
    for begin, end in paused:
        counts &= ~((times >= begin - SAMPLE_S) & (times <= end))
    steps = np.flatnonzero(~standing)
    counts[: steps[0] if len(steps) else len(counts)] = False
    best, at, length = 0, 0, 0
    for k, stands in enumerate(counts):
        length = length + 1 if stands else 0
        if length > best:
            best, at = length, k - length + 1
    return best * SAMPLE_S, float(times[at])


def rarest(shown: Iterable[Motion]) -> Motion | None:
    """Return the motion that the fewest recorded people show; None where there is nobody."""
    return min(shown, key=lambda motion: motion.recorded_percent, default=None)


def is_left_out(values: Mapping[str, float | None], least: float | None) -> bool:
    """Return whether somebody in a run of these metrics does what fewer than `least` percent of recorded people do."""
    share = values.get(PEOPLE_REALISM)
    return least is not None and share is not None and share < least


def summary(shown: Iterable[Motion]) -> str:
    """Return in one sentence whether anybody does what fewer than 1 in 100 recorded people do; empty without people."""
    rare = rarest(shown)
    if rare is None:
        return ""
    return rare.sentence if rare.is_rare else "No person does what fewer than 1 in 100 recorded people did."
