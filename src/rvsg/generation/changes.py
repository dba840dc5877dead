"""Small changes to what people do, from which a refinement chooses: times, speeds, pauses, ways and places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rvsg.generation.descriptions import work_of
from rvsg.generation.people_sampler import (
    HEEDLESS_AIMS,
    UNDERWAY,
    PeopleSampler,
    Stop,
    drawn,
    shares_of,
)
from rvsg.generation.places import Place
from rvsg.generation.replies import LONGEST_DELAY_S
from rvsg.scenario.brief import Feedback
from rvsg.scenario.requirement import Aim
from rvsg.scenario.scenario import Behaviour, Human, Pause, Task, at_places, ends_of

Change = Callable[["Changing", Human], tuple[Human, str] | None]

SPEEDS_M_S = (0.45, 1.6)


@dataclass
class Changing:
    """Changes people at random. `idle` are waypoints that never came near the robot, as the feedback says."""

    work: PeopleSampler
    idle: frozenset[str] = frozenset()

    @classmethod
    def after(cls, work: PeopleSampler, feedback: Feedback) -> Changing:
        """Changes that know what the feedback says."""
        return cls(work, frozenset(name for influence in feedback.influences for name in influence.idle_waypoints))

    def once(self, human: Human) -> tuple[Human, str] | None:
        """One random change and its words; None where it is not possible for this person."""
        changes, shares = _changes_for(self.work.aim)
        return changes[drawn(shares, self.work.rng)](self, human)

    def place_of(self, waypoint: str) -> Place | None:
        """The place a waypoint belongs to."""
        return next((place for place in self.work.places if waypoint in place.waypoints), None)

    def stops(self, human: Human) -> list[Stop] | None:
        """Return where a person's tasks start; None where one does not start at a place."""
        by_name = {place.name: place for place in self.work.places}
        stops = []
        for task in at_places(human.tasks):
            name = ends_of(task)[0]
            place = by_name.get(name) or self.place_of(task.path[0])
            if place is None or task.path[0] not in place.waypoints:
                return None
            stops.append(Stop(place, task.path[0]))
        return stops

    def rebuilt(self, human: Human, stops: list[Stop]) -> Human | None:
        """The person going round these stops, with the pauses that still lie on the way."""
        tasks = self.work.tasks(stops, along_route=self.work.aim is not Aim.NONE)
        if not tasks:
            return None
        pauses = [pause for task in human.tasks for pause in task.pauses]
        kept = tuple(
            task.model_copy(update={"pauses": tuple(p for p in pauses if p.at in task.path[1:])}) for task in tasks
        )
        changed = human.model_copy(update={"tasks": kept})
        return self.work.underway(changed) if at_places(human.tasks) != human.tasks else changed


def _delay(changing: Changing, human: Human) -> tuple[Human, str]:
    rng = changing.work.rng
    delay = round(min(LONGEST_DELAY_S, max(0.0, human.start_delay_s + float(rng.normal(0.0, 2.0)))), 1)
    return human.model_copy(update={"start_delay_s": delay}), f"sets off after {delay:g} s"


def _speed(changing: Changing, human: Human) -> tuple[Human, str]:
    low, high = SPEEDS_M_S
    speed = round(min(high, max(low, human.speed_m_s * float(changing.work.rng.lognormal(0.0, 0.15)))), 2)
    return human.model_copy(update={"speed_m_s": speed}), f"walks at {speed:g} m/s"


def _pause(changing: Changing, human: Human) -> tuple[Human, str]:
    rng = changing.work.rng
    index = int(rng.integers(len(human.tasks)))
    task = human.tasks[index]
    if task.pauses and rng.random() < 0.4:
        changed, words = task.model_copy(update={"pauses": ()}), f"no longer stops in {task.name}"
    else:
        at = changing.work.pick(task.path, [2.718 ** -changing.work.ground.along(n)[1] for n in task.path])
        pause = Pause(at=at, duration_s=round(float(rng.uniform(2.0, 12.0)), 1))
        changed = task.model_copy(update={"pauses": (pause,)})
        words = f"stops at {at} for {pause.duration_s:g} s"
    return _with_task(human, index, changed), words


def _first(changing: Changing, human: Human) -> tuple[Human, str] | None:
    if len(human.tasks) < 2:
        return None
    by = int(changing.work.rng.integers(1, len(human.tasks)))
    tasks = (*human.tasks[by:], *human.tasks[:by])
    return human.model_copy(update={"tasks": tasks}), f"begins with {tasks[0].name}"


def _turned(changing: Changing, human: Human) -> tuple[Human, str] | None:
    stops = changing.stops(human)
    if stops is None:
        return None
    changed = changing.rebuilt(human, [stops[0], *reversed(stops[1:])] if len(stops) > 2 else stops[::-1])
    return (changed, "goes round the other way") if changed else None


def _moved(changing: Changing, human: Human) -> tuple[Human, str] | None:
    stops = changing.stops(human)
    if stops is None:
        return None
    index = int(changing.work.rng.integers(len(stops)))
    others = {stops[index - 1].waypoint, stops[(index + 1) % len(stops)].waypoint, stops[index].waypoint}
    stop = changing.work.at(stops[index].place, others)
    if stop is None:
        return None
    changed = changing.rebuilt(human, [*stops[:index], stop, *stops[index + 1 :]])
    return (changed, f"works {stop.place.name} from {stop.waypoint}") if changed else None


def _replaced(changing: Changing, human: Human) -> tuple[Human, str] | None:
    stops = changing.stops(human)
    if stops is None:
        return None
    weights = [4.0 if stop.waypoint in changing.idle else 1.0 for stop in stops]
    index = changing.work.pick(range(len(stops)), weights)
    stop = changing.work.stop(stops[:index] or stops[-1:], changing.work.role())
    if stop is None:
        return None
    changed = changing.rebuilt(human, [*stops[:index], stop, *stops[index + 1 :]])
    return (changed, f"works {stop.place.name} instead of {stops[index].place.name}") if changed else None


def _shortened(changing: Changing, human: Human) -> tuple[Human, str] | None:
    stops = changing.stops(human)
    if stops is None or len(stops) < 3:
        return None
    weights = [4.0 if stop.waypoint in changing.idle else 1.0 for stop in stops]
    index = changing.work.pick(range(len(stops)), weights)
    changed = changing.rebuilt(human, stops[:index] + stops[index + 1 :])
    return (changed, f"leaves {stops[index].place.name} out") if changed else None


def _anew(changing: Changing, human: Human) -> tuple[Human, str] | None:
    changed = changing.work.human(human.name, changing.work.role())
    if changed is None:
        return None
    kept: dict[str, object] = {"factors": human.factors}
    if human.behaviour is Behaviour.THREATENING:
        kept["behaviour"] = human.behaviour
    return changed.model_copy(update=kept), work_of(changed, goods=changing.work.goods)


def _elsewhere(changing: Changing, human: Human) -> tuple[Human, str] | None:
    changed = changing.work.underway(human)
    at = changed.tasks[0].path[0]
    return (changed, f"is already at {at} when the robot sets off") if changed != human else None


def _heedless(changing: Changing, human: Human) -> tuple[Human, str] | None:
    if human.behaviour is Behaviour.THREATENING:
        return None
    if human.behaviour is Behaviour.IMPASSIVE:
        return human.model_copy(update={"behaviour": Behaviour.REGULAR}), "steps aside for the robot"
    return human.model_copy(update={"behaviour": Behaviour.IMPASSIVE}), "does not step aside for the robot"


def _with_task(human: Human, index: int, task: Task) -> Human:
    return human.model_copy(update={"tasks": (*human.tasks[:index], task, *human.tasks[index + 1 :])})


_CHANGES: tuple[tuple[Change, float], ...] = (
    (_delay, 3.0),
    (_speed, 3.0),
    (_pause, 2.0),
    (_first, 1.5),
    (_turned, 1.0),
    (_moved, 2.0),
    (_replaced, 1.0),
    (_shortened, 1.0),
    (_anew, 0.5),
)
_SPECIAL: tuple[tuple[Change, frozenset[Aim], float], ...] = (
    (_elsewhere, frozenset(UNDERWAY), 1.0),
    (_heedless, frozenset(HEEDLESS_AIMS), 0.5),
)
"""Changes for some aims only."""


@cache
def _changes_for(aim: Aim) -> tuple[tuple[Change, ...], NDArray[np.float64]]:
    """Return the changes for an aim, and how often each is drawn, as `drawn` takes it."""
    changes = (*_CHANGES, *((change, weight) for change, aims, weight in _SPECIAL if aim in aims))
    return tuple(change for change, _ in changes), shares_of([weight for _, weight in changes])
