"""Search space of the numbers of a configuration: what an optimiser may change, and within which limits.

Start delays, speeds, one pause per person, the time of the work where a task ends, where along the cycle of tasks a
person begins, and at which of an area's waypoints a task ends. People walk at 0.35 to 1.6 m/s and not more than half as
fast again as proposed, wait at most 10 s and pause at most 12 s. Work takes what such work usually takes. Nobody comes
to turn round without a stop who did not before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rvsg.generation.replies import LONGEST_DELAY_S
from rvsg.generation.workplaces import WalkingGraph, places_of, walking_graph
from rvsg.scenario.brief import TuningLimits
from rvsg.scenario.placement import start_gap_m
from rvsg.scenario.rules import START_CLEARANCE_M
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Pause, Task, at_places, begin_at, ends_of
from rvsg.scenario.validity import about_turns, check
from rvsg.world.world import World

Vector = NDArray[np.float64]

LONGEST_PAUSE_S = 12.0
SHORTEST_PAUSE_S = 0.5
"""A pause shorter than this is no pause."""
SPEEDS_M_S = (0.35, 1.6)
FASTER, SLOWER = 1.5, 0.6
"""How far a speed may leave the one that was proposed."""
TUNED_STOPS = 4
"""The number of stops of a person that may move to another waypoint of their area."""


@dataclass(frozen=True)
class Dimension:
    """One number of the search space, in the unit of `name`; `choices` > 0: a choice among that many values instead."""

    human: int
    name: str
    low: float
    high: float
    start: float
    choices: int = 0

    @property
    def start_share(self) -> float:
        """The number as proposed, as a share of its range."""
        if self.choices:
            return (self.start + 0.5) / self.choices
        return (self.start - self.low) / (self.high - self.low)

    def at(self, share: float) -> float:
        """The number at a share of its range."""
        share = min(1.0, max(0.0, share))
        if self.choices:
            return float(min(self.choices - 1, int(share * self.choices)))
        return self.low + share * (self.high - self.low)


class TuningSpace:
    """The search space around one configuration. A vector has one value in [0, 1] per dimension.

    `limits` narrow it to what may change.
    """

    def __init__(
        self, people: HumanConfiguration, mission: Mission, world: World, limits: TuningLimits | None = None
    ) -> None:
        self.people, self.mission, self.world, self.limits = people, mission, world, limits or {}
        self.ground: WalkingGraph = walking_graph(world, mission.route)
        self.waypoints = {place.name: place.waypoints for place in places_of(world, reachable_from=mission.route.start)}
        self.dimensions: tuple[Dimension, ...] = tuple(
            narrowed
            for index, human in enumerate(people.humans)
            for dimension in self._dimensions(index, human)
            if (narrowed := _narrowed(dimension, self.limits.get(human.name, {}))) is not None
        )
        self.start: Vector = np.array([dimension.start_share for dimension in self.dimensions])
        """The vector of the configuration as proposed."""

    def configuration(self, vector: Sequence[float] | Vector) -> HumanConfiguration | None:
        """Return the configuration of a vector; None where it breaks a rule or a start is too near."""
        values: dict[int, dict[str, float]] = {}
        for dimension, share, base in zip(self.dimensions, vector, self.start, strict=True):
            if abs(float(share) - float(base)) > 1e-9:
                values.setdefault(dimension.human, {})[dimension.name] = dimension.at(float(share))
        humans: list[Human] = []
        leaders: dict[int, Human] = {}
        for i, human in enumerate(self.people.humans):
            changed = self._changed(human, values[i]) if i in values else human
            if changed is None:
                return None
            if changed.group is not None:  # a group keeps the pace and the delay of its first member
                leader = leaders.setdefault(changed.group, changed)
                pace = {"speed_m_s": leader.speed_m_s, "start_delay_s": leader.start_delay_s}
                changed = changed.model_copy(update=pace)
                if not _keeps(human, changed, self.limits.get(human.name, {})):
                    return None
            humans.append(changed)
        people = HumanConfiguration(humans=tuple(humans))
        for human, before in zip(people.humans, self.people.humans, strict=True):
            if human is not before and not self._turns_as(human, before):
                return None
            at = self.ground.at[human.tasks[0].path[0]]
            if start_gap_m(human.body_radius_m, at, self.mission) < START_CLEARANCE_M:
                return None
        return None if check(people, self.mission, self.world) else people

    def _turns_as(self, human: Human, before: Human) -> bool:
        """Return whether a person turns round without a stop at most as often as before."""
        grid = self.world.grid
        return len(about_turns(human, grid)) <= len(about_turns(before, grid))

    def words(self, vector: Vector) -> str:
        """Return which numbers of a vector differ from the configuration as proposed."""
        changed = (abs(vector - self.start) > 1e-9).nonzero()[0]
        dimensions = [self.dimensions[i] for i in changed]
        return ", ".join(f"{d.name} of {self.people.humans[d.human].name}" for d in dimensions)

    def _dimensions(self, index: int, human: Human) -> list[Dimension]:
        low = max(SPEEDS_M_S[0], SLOWER * human.speed_m_s)
        high = max(low + 0.01, min(SPEEDS_M_S[1], FASTER * human.speed_m_s))
        speed = min(high, max(low, human.speed_m_s))
        tasks, begins = _cycle(human)
        pause = _first_pause(tasks)
        at = _share_of(tasks, pause.at) if pause else 0.5
        length = min(LONGEST_PAUSE_S, pause.duration_s) if pause else 0.0
        found = [
            Dimension(index, "delay", 0.0, LONGEST_DELAY_S, min(LONGEST_DELAY_S, human.start_delay_s)),
            Dimension(index, "speed", low, high, speed),
            Dimension(index, "begins", 0.0, 1.0, begins),
            Dimension(index, "pause at", 0.0, 1.0, at),
            Dimension(index, "pause", -3.0, LONGEST_PAUSE_S, length),
        ]
        for k, task in enumerate(tasks[:TUNED_STOPS]):
            if task.work is not None and task.work.doing is not None:
                (least, most), now = task.work.doing.seconds, task.work.duration_s
                found.append(Dimension(index, f"work {k}", min(least, now), max(most, now), now))
            others = self._others(task)
            if len(others) > 1:
                found.append(Dimension(index, f"stop {k}", 0.0, 1.0, others.index(task.path[0]), len(others)))
        return found

    def _others(self, task: Task) -> list[str]:
        """The waypoints at which the task may start instead, in order along the robot's way; its own among them."""
        place = self.waypoints.get(ends_of(task)[0], ())
        if task.path[0] not in place:
            return []
        return sorted(place, key=lambda name: (self.ground.along(name)[0], name))

    def _changed(self, human: Human, values: dict[str, float]) -> Human | None:
        """The person with these values; None where a stop that moved cannot be reached."""
        before, begins = _cycle(human)
        stops = [task.path[0] for task in before]
        for k, task in enumerate(before[:TUNED_STOPS]):
            if f"stop {k}" in values:
                stops[k] = self._others(task)[int(values[f"stop {k}"])]
        moved: list[Task] = []
        for task, start, end in zip(before, stops, [*stops[1:], *stops[:1]], strict=True):
            if (start, end) != (task.path[0], task.path[-1]):
                path = self.ground.path(start, end, along_route=True, straight=task.work is not None)
                if path is None or len(path) < 2:
                    return None
                pauses = tuple(pause for pause in task.stops if pause.at in path)
                task = task.model_copy(update={"path": path, "pauses": pauses}).working(task.work)
            if (work := task.work) is not None and f"work {len(moved)}" in values:
                seconds = round(values[f"work {len(moved)}"], 1)
                task = task.working(work.model_copy(update={"duration_s": seconds}))
            moved.append(task)
        tasks = tuple(moved)
        if "pause" in values or "pause at" in values:
            tasks = _paused(tasks, _first_pause(before), values)
        tasks = begin_at(tasks, *_at(tasks, values.get("begins", begins)))
        delay = round(values.get("delay", human.start_delay_s), 1)
        speed = round(values.get("speed", human.speed_m_s), 2)
        return human.model_copy(update={"tasks": tasks, "start_delay_s": delay, "speed_m_s": speed})


_LIMITED_BY = {
    "speed": "speed_m_s",
    "delay": "start_delay_s",
    "pause": "pause_s",
    "work": "pause_s",
    "begins": "start",
    "stop": "stops",
}


def _narrowed(dimension: Dimension, limits: Mapping[str, tuple[float, float] | None]) -> Dimension | None:
    """Return a dimension within its limits; None where nothing of it may change."""
    key = _LIMITED_BY[dimension.name.split()[0]]
    if key not in limits:
        return dimension
    bounds = limits[key]
    if bounds is None:
        return None
    if dimension.name == "pause at":
        return dimension
    low = max(dimension.low, bounds[0]) if bounds[0] > 0.0 else dimension.low
    high = min(dimension.high, bounds[1])
    start = min(high, max(low, dimension.start))
    return replace(dimension, low=low, high=high, start=start) if low < high else None


def _keeps(before: Human, after: Human, limits: Mapping[str, tuple[float, float] | None]) -> bool:
    """Return whether the pace that a group gives a member is within the member's limits."""
    for key in _LIMITED_BY["speed"], _LIMITED_BY["delay"]:
        was, now = getattr(before, key), getattr(after, key)
        bounds = limits.get(key, (now, now)) or (was, was)
        if now != was and not bounds[0] <= now <= bounds[1]:
            return False
    return True


def _cycle(human: Human) -> tuple[tuple[Task, ...], float]:
    """The tasks from place to place, and at what share of the cycle the person begins."""
    tasks = at_places(human.tasks)
    return tasks, (_share_of(tasks, human.tasks[0].path[0]) if tasks != human.tasks else 0.5 / len(_positions(tasks)))


def _positions(tasks: Sequence[Task]) -> list[tuple[int, int]]:
    """Every waypoint of the cycle once, as task and place in its path, in walking order."""
    return [(k, i) for k, task in enumerate(tasks) for i in range(max(1, len(task.path) - 1))]


def _at(tasks: Sequence[Task], share: float) -> tuple[int, int]:
    """Task and place in its path at a share of the cycle."""
    positions = _positions(tasks)
    return positions[min(len(positions) - 1, int(share * len(positions)))]


def _share_of(tasks: Sequence[Task], waypoint: str) -> float:
    """The share of the cycle at which a waypoint is first passed; the middle where it is not."""
    positions = _positions(tasks)
    found = next((n for n, (k, i) in enumerate(positions) if tasks[k].path[i] == waypoint), len(positions) // 2)
    return (found + 0.5) / len(positions)


def _first_pause(tasks: Sequence[Task]) -> Pause | None:
    """The first pause that is no work at the end of a task."""
    return next((pause for task in tasks for pause in task.stops), None)


def _paused(tasks: Sequence[Task], first: Pause | None, values: dict[str, float]) -> tuple[Task, ...]:
    """The tasks with the first pause moved, made longer, shorter, or left out."""
    length = values.get("pause", first.duration_s if first else 0.0)
    left = [task.model_copy(update={"pauses": tuple(p for p in task.pauses if p != first)}) for task in tasks]
    if length >= SHORTEST_PAUSE_S:
        k, i = _at(tasks, values.get("pause at", _share_of(tasks, first.at) if first else 0.5))
        name = left[k].path[i]
        rest = tuple(p for p in left[k].pauses if p.at != name or p is left[k].work)
        pause = Pause(at=name, duration_s=round(length, 1))
        left[k] = left[k].model_copy(update={"pauses": (*rest, pause)})
    return tuple(left)


FEW = 2.5
"""The average number of values changed at a time; changing all of them loses what was good."""
ANYWHERE = 0.25
"""How often a number that changes is drawn again from its whole range instead of near its value."""
STEP = 0.15
"""The standard deviation of a change, as a share of the range."""
TRIES = 60


class Mutations:
    """Draws configurations near one, by changing a few of its numbers."""

    def __init__(self, space: TuningSpace, rng: np.random.Generator) -> None:
        self.space, self.rng = space, rng

    def draw(self) -> tuple[HumanConfiguration | None, str]:
        """Return a valid configuration that differs, and what changed in words; None where no draw is valid."""
        start = self.space.start
        for _ in range(TRIES if len(start) else 0):
            changed = self.rng.random(len(start)) < FEW / len(start)
            near = np.clip(start + STEP * self.rng.normal(size=len(start)), 0.0, 1.0)
            far = self.rng.random(len(start))
            vector = np.where(changed, np.where(self.rng.random(len(start)) < ANYWHERE, far, near), start)
            people = self.space.configuration(vector)
            if people is not None and people != self.space.people:
                return people, self.space.words(vector)
        return None, ""
