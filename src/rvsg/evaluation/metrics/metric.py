"""The record of a metric: how it is computed, and what it declares about itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.evaluation.sampled import Sampled
from rvsg.scenario.requirement import Aim
from rvsg.simulation.run import Run
from rvsg.world.world import World

Worse = Literal["smaller", "larger", "neither"]
Series = Literal["trajectory", "log"]
Value = Callable[[Sampled], float | None]
SoFar = Callable[[Sampled], NDArray[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Metric:
    """A number that is read off one run.

    A plug-in registers one, or a sequence of them, in the entry point group `rvsg.metrics`.
    """

    id: str
    title: str
    unit: str
    worse: Worse
    """The direction in which the robot does worse."""
    source: str
    of: Value
    """Computes it from a sampled run; None means that the run holds no judgement. Its docstring is the formula."""
    series: Series = "trajectory"
    """The series it reads: our own samples (20 Hz), or the rows that the study's client would have logged."""
    aim: Aim = Aim.SHARE
    """What people should do to make it worse."""
    shown: str = "distance_to_person"
    """The signal that shows over time where it is lost."""
    moved_by: str = "People who stay close to the robot."
    """One plain sentence: what makes it worse."""
    least: float | None = 0.0
    """The smallest value it can have; None: no bound."""
    most: float | Literal["time_limit"] | None = None
    """The largest value it can have; `time_limit`: the route's time limit, in seconds."""
    two_valued: bool = False
    """It is either `least` or `most`, so its mean over runs is a share of them."""
    so_far: SoFar | None = None
    """Computes at once, for every sample (N,), what the metric is if the run ends there at its goal; NaN: no judgement.
    None: curves measure beginnings of the run, one by one."""
    of_people: bool = False
    """It has no value in a run without people."""
    censored: bool = False
    """The value of a run that does not arrive is only a lower bound: it would have been larger without the limit."""

    def __post_init__(self) -> None:
        """Refuse a bound that is none, at the place that declares it: InputError."""
        if isinstance(self.least, str) or (isinstance(self.most, str) and self.most != "time_limit"):
            said = f"metric {self.id}: least and most are {self.least!r} and {self.most!r}; expected numbers or None"
            raise InputError(f'{said}, or most="time_limit".', code="metric-bound")

    @property
    def formula(self) -> str:
        """The formula in words, from the docstring of the function."""
        return " ".join((self.of.__doc__ or "").split())

    def bounds(self, time_limit_s: float | None = None) -> tuple[float | None, float | None]:
        """Return the smallest and the largest possible value; None if there is no bound or it is not known."""
        return self.least, time_limit_s if self.most == "time_limit" else self.most

    def value(self, s: Sampled) -> float | None:
        """Return this metric of a sampled run, or None if the run holds no judgement."""
        return None if self.of_people and not s.people else self.of(s)

    def measure(self, run: Run, world: World | None = None) -> float | None:
        """Return this metric of one run, or None if the run holds no judgement."""
        return self.value(Sampled(run, run.log if self.series == "log" else run.trajectory, world))


MOVED_BY = {
    Aim.SHARE: "People who work close to the robot all along its way.",
    Aim.MEET: "People who meet the robot where it has no room to pass.",
    Aim.DISTURB: "People who come up in front of the robot repeatedly.",
    Aim.DELAY: "People who walk or stand in the robot's lane.",
}


def measures(
    metrics: list[Metric], id: str, title: str, unit: str, worse: Worse, aim: Aim, *, source: str, **more: Any
) -> Callable[[Value], Value]:
    """Return a decorator that adds the metric which a function computes to a list; `more` as for `Metric`."""

    def add(of: Value) -> Value:
        fields = {"moved_by": MOVED_BY[aim]} | more
        metrics.append(Metric(id=id, title=title, unit=unit, worse=worse, aim=aim, source=source, of=of, **fields))
        return of

    return add
