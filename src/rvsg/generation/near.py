"""The generator of a campaign that starts from a scenario: the scenario itself, then small changes of its people.

Somebody does everything earlier or later and somewhat elsewhere, or walks faster or slower. Refinements change what was
worst for the robot and never leave the neighbourhood of the scenario. More people than the scenario has are added as
the heuristic generator would place them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rvsg.core.errors import InputError
from rvsg.generation.descriptions import Described, answer
from rvsg.generation.generator import Generator, Proposal, rng_of
from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Human, HumanConfiguration, Scenario
from rvsg.scenario.validity import check
from rvsg.scenario.variation import shifted
from rvsg.world.grid import Grid
from rvsg.world.world import World

PER_SPEED_S = 5.0
"""A change of speed moves a person by the allowed distance after so many seconds."""
STEP = 0.4
"""The standard deviation of a refinement, as a share of what is allowed."""
TRIES = 60


class _Change(NamedTuple):
    """How one person differs from the scenario: seconds later, metres elsewhere, m/s faster."""

    seconds: float
    x_m: float
    y_m: float
    speed_m_s: float

    def __str__(self) -> str:
        away = math.hypot(self.x_m, self.y_m)
        parts = (
            (f"{abs(self.seconds):.2f} s {'later' if self.seconds > 0 else 'earlier'}", self.seconds),
            (f"{away:.2f} m elsewhere", away),
            (f"{abs(self.speed_m_s):.2f} m/s {'faster' if self.speed_m_s > 0 else 'slower'}", self.speed_m_s),
        )
        return ", ".join(words for words, size in parts if abs(size) >= 0.005)


class NearGenerator(Generator):
    """Changes a given scenario by at most `near` metres and seconds, and its speeds by a fifth of that in m/s.

    Raises:
        InputError: `near` is not positive.
    """

    name = "near"

    def __init__(self, scenario: Scenario, near: float = 0.5) -> None:
        if not near > 0.0:
            raise InputError(f"--near {near:g}: expected more than 0 metres and seconds.")
        self.scenario = scenario
        self.near = near

    def propose(self, brief: Brief, world: World) -> Proposal:
        """Return the scenario as it is first, then changes of it; from the brief's seed."""
        rng, own = rng_of(brief, self.name), self.scenario.people.humans
        others = self._others(brief, world)
        changes = [_Change(0.0, 0.0, 0.0, 0.0)] * len(own)
        if brief.scenario_index or brief.configuration_index:
            changes = self._drawn(brief, world, others, rng)
        people = _changed(own, changes, world.grid)
        words = "; ".join(f"{human.name} {change}" for human, change in zip(own, changes, strict=True) if str(change))
        described = f"{self.scenario.description} Changed: {words}." if words else self.scenario.description
        return answer(
            HumanConfiguration(humans=(*(people or own), *others)),
            brief,
            world,
            generator=self.name,
            described=Described(described.strip(), self.scenario.idea),
            reasoning=words or "The scenario as it was given.",
        )

    def _others(self, brief: Brief, world: World) -> tuple[Human, ...]:
        """The people beyond those of the scenario; the same in all refinements of one."""
        own = self.scenario.people.humans
        if brief.humans == len(own):
            return ()
        asked = brief.replace(
            kind="new", configuration_index=0, feedback=None, memory=(), humans=brief.humans - len(own)
        )
        found = HeuristicGenerator().propose(asked, world).scenario
        humans = found.people.humans if found is not None else ()
        return tuple(human.replace(name=f"Human {len(own) + k + 1}", group=None) for k, human in enumerate(humans))

    def _drawn(self, brief: Brief, world: World, others: tuple[Human, ...], rng: np.random.Generator) -> list[_Change]:
        """Changes that are valid: of the scenario for a new one, else of what was worst for the robot."""
        own, grid = self.scenario.people.humans, world.grid
        origin = [_Change(0.0, 0.0, 0.0, 0.0)] * len(own)
        if brief.feedback is not None:
            worst = (brief.feedback.best or brief.feedback.scenario).people.humans
            origin = [_between(human, other, grid) for human, other in zip(own, worst, strict=False)]
        for _ in range(TRIES):
            moves = rng.random(len(own)) < 0.5
            moves[rng.integers(len(own))] = True
            drawn = [
                self._near(change, brief.feedback is not None, rng) if moved else change
                for change, moved in zip(origin, moves, strict=True)
            ]
            people = _changed(own, drawn, grid)
            if people and not check(HumanConfiguration(humans=(*people, *others)), brief.mission, world):
                return drawn
        return origin

    def _near(self, origin: _Change, refined: bool, rng: np.random.Generator) -> _Change:
        """A change drawn around another one, or anywhere in the neighbourhood."""
        scale = np.array([self.near, self.near, self.near, self.near / PER_SPEED_S])
        drawn = np.array(origin) / scale + STEP * rng.normal(size=4) if refined else rng.uniform(-1.0, 1.0, size=4)
        drawn[1:3] /= max(1.0, math.hypot(*drawn[1:3]))
        return _Change(*(round(float(value), 2) for value in np.clip(drawn, -1.0, 1.0) * scale))


def _changed(own: tuple[Human, ...], changes: list[_Change], grid: Grid) -> tuple[Human, ...] | None:
    """The people with their changes; None where somebody cannot begin so early."""
    found = []
    for human, change in zip(own, changes, strict=True):
        moved = shifted(human, grid, change.seconds, (change.x_m, change.y_m)) if any(change) else human
        if moved is None:
            return None
        if human.track is None and change.speed_m_s:
            moved = moved.replace(speed_m_s=round(max(0.1, human.speed_m_s + change.speed_m_s), 2))
        found.append(moved)
    return tuple(found)


def _between(human: Human, other: Human, grid: Grid) -> _Change:
    """How a person of the scenario was changed."""
    (when, at), (then, there) = _last(human, grid), _last(other, grid)
    return _Change(then - when, there[0] - at[0], there[1] - at[1], other.speed_m_s - human.speed_m_s)


def _last(human: Human, grid: Grid) -> tuple[float, tuple[float, float]]:
    """A moment and a place that are shifted with everything that a person does."""
    if human.track is not None:
        return human.track.end_s, human.track.points[-1]
    at = human.position(human.tasks[-1].path[-1], grid)
    assert at is not None
    return human.start_delay_s, at
