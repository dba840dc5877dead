"""Realism of simulated people: how far each person of a run goes, beside recorded people.

The recordings are ETH and HOTEL (Pellegrini et al. 2009), ZARA 1, ZARA 2 and students 3 (Lerner et al. 2007): some
1,300 people on streets and a campus, sampled every 0.4 s as simulated people are here. Members of one group do not
count for distances. Positions in the recordings are marked by hand, so the accelerations include that noise.
`benchmarks/people_realism.py` counts the percentiles.
"""

from __future__ import annotations

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
}  # fmt: skip


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
    if len(times) < 4:
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
        others = [
            np.hypot(*(places[h] - places[o]))
            for o in range(len(places))
            if o != h and (groups[h] is None or groups[o] != groups[h])
        ]
        if others:
            nearest = np.min(others, axis=0)
            add(name, "distance", float(nearest.min()), float(times[int(nearest.argmin())]))
        paused = [(e.time_s, e.until_s) for e in run.events if isinstance(e, PersonPaused) and e.person == name]
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
