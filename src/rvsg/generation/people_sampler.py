"""Sampler of people who work between the places of a world, and the other actors (`actors`) of a world.

A way of working gives the reason for a speed, a pause and a way. Worlds that list no actors get people on foot alone,
drawn from the same random numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rvsg.generation.workplaces import Path, Place, WalkingGraph, handles_goods
from rvsg.scenario.activity import Activity
from rvsg.scenario.requirement import Aim
from rvsg.scenario.scenario import (
    LIMITS,
    Attention,
    Behaviour,
    ForceFactors,
    Human,
    HumanConfiguration,
    Mission,
    Pause,
    PersonKind,
    Task,
    Trolley,
    at_places,
    begin_at,
    ends_of,
)
from rvsg.scenario.validity import check
from rvsg.world.schema import ObjectEntry
from rvsg.world.space import robot_space
from rvsg.world.world import SolidObject, World

T = TypeVar("T")

HEEDLESS_AIMS = (Aim.MEET, Aim.DISTURB, Aim.DELAY)
"""For these aims some people do not step aside for the robot; for nearness it makes no measurable difference."""
UNDERWAY = {Aim.DELAY: 0.7}
"""How often a person is already on the way when the robot sets off, by the aim."""
STOPS = (2, 2, 3, 4)
"""How many places a person goes round, each as likely as the other."""
DELAYS_S = (0.0, 4.0)
REACH_M = 2.0
"""Places this far from the robot's route are drawn 1/e as often as those beside it."""


@dataclass(frozen=True, kw_only=True)
class Role:
    """A way of working. Speeds m/s, pauses s. `far`: between places apart along the robot's route, not side by side.

    `heedless`: how often such a person does not step aside for a robot (HuNavSim's impassive behaviour); `distracted`:
    how often they look at something else than the way; `weights`: how often it is tried for each of `AIMS`. `unseeing`:
    how often a load hides the way, or they walk backwards; `goods`, `others`: what they do where a task ends, in a
    place of goods and elsewhere. These three are for people whose work takes time.
    """

    speeds: tuple[float, float]
    pauses: tuple[float, float] | None = None
    far: bool = True
    heedless: float = 0.0
    distracted: float = 0.15
    weights: tuple[float, ...]
    unseeing: float = 0.0
    goods: tuple[Activity, ...] = (Activity.HAND_OVER,)
    others: tuple[Activity, ...] = (Activity.HAND_OVER, Activity.TALK)


PICK, INSPECT, WAIT = Activity.PICK, Activity.INSPECT, Activity.WAIT
AIMS = (Aim.SHARE, Aim.MEET, Aim.DISTURB, Aim.DELAY, Aim.NONE)
"""The order of the weights of roles."""
ROLES = (
    # pushes a trolley, carries, checks, sorts, moves something heavy
    Role(speeds=(0.5, 0.75), heedless=0.5, distracted=0.4, weights=(4, 1, 1, 3, 1), unseeing=0.1),
    Role(speeds=(1.0, 1.5), heedless=0.3, weights=(3, 4, 3, 2, 1), unseeing=0.15, goods=(Activity.HAND_OVER, PICK)),
    Role(speeds=(0.7, 1.2), pauses=(2.0, 12.0), weights=(2, 1, 1, 4, 1), goods=(INSPECT,), others=(INSPECT, WAIT)),
    Role(speeds=(0.8, 1.4), far=False, weights=(2, 3, 4, 1, 1), goods=(Activity.SORT, PICK), others=(PICK, WAIT)),
    Role(speeds=(0.35, 0.5), heedless=0.7, distracted=0.4, weights=(0, 0, 0, 4, 0), unseeing=0.3),
)


class Stop(NamedTuple):
    """A place with the waypoint at which it is worked."""

    place: Place
    waypoint: str


SOMEBODY = Human(name="Somebody", tasks=(Task(name="Work", path=()),), factors=ForceFactors())


class PeopleSampler:
    """Makes people. `uses` counts how often a place was worked in earlier scenarios: those are drawn less often.

    `works`: people do something where a task ends, and take the way with few turns; else as in the study.
    """

    def __init__(
        self,
        ground: WalkingGraph,
        places: Sequence[Place],
        aim: Aim,
        rng: np.random.Generator,
        uses: dict[str, int],
        *,
        works: bool = True,
    ) -> None:
        self.ground, self.places, self.aim, self.rng, self.works = ground, places, aim, rng, works
        self.goods = handles_goods(places)
        self._roles = shares_of([role.weights[AIMS.index(aim)] for role in ROLES])
        closest = [min((ground.along(name) for name in p.waypoints), key=lambda at: at[1]) for p in places]
        self._along = np.array([along for along, _ in closest])
        beside = [1.0 if aim is Aim.NONE else math.exp(-away / REACH_M) for _, away in closest]
        worked = [0.4 ** min(3, uses.get(place.name, 0)) for place in places]
        self._usual = np.array([a * b for a, b in zip(worked, beside, strict=True)])

    def role(self) -> Role:
        """A way of working, as often as it suits the aim."""
        return ROLES[drawn(self._roles, self.rng)]

    def human(self, name: str, role: Role, named: Sequence[Sequence[Place]] | None = None) -> Human | None:
        """Return a person at work, at the `named` places in their order; None where places are not joined."""
        stops = self._stops(role) if named is None else self._stops_at(named, role)
        tasks = self.tasks(stops, role, along_route=role.far and self.aim is not Aim.NONE)
        if not tasks:
            return None
        heedless = self.aim in HEEDLESS_AIMS and self.rng.random() < role.heedless
        speed = round(float(self.rng.uniform(*role.speeds)), 2)
        delay = round(float(max(0.0, self.rng.uniform(*DELAYS_S) - 1.0)), 1)
        if role.pauses:
            tasks = self._pausing(tasks, role.pauses)
        if self.aim in UNDERWAY and self.rng.random() < UNDERWAY[self.aim]:
            tasks = self.underway(tasks)
        behaviour = Behaviour.IMPASSIVE if heedless else Behaviour.REGULAR
        attention = Attention.DISTRACTED if self.rng.random() < role.distracted else Attention.ATTENTIVE
        if self.works and self.rng.random() < role.unseeing:
            attention = Attention.UNSEEING
        given = {"name": name, "tasks": tasks, "behaviour": behaviour, "speed_m_s": speed, "start_delay_s": delay}
        given["attention"] = attention
        return SOMEBODY.model_copy(update=given)  # hundreds are drawn for each one kept, within the bounds of a Human

    def _stops(self, role: Role) -> list[Stop]:
        """Two to four places to go round."""
        count = min(len(self.places), STOPS[int(self.rng.integers(len(STOPS)))])
        chosen: list[Stop] = []
        while len(chosen) < count and (stop := self.stop(chosen, role)) is not None:
            chosen.append(stop)
        return chosen

    def _stops_at(self, named: Sequence[Sequence[Place]], role: Role) -> list[Stop]:
        stops: list[Stop] = []
        for places in named:
            taken = {stop.place.name for stop in stops}
            here = [place for place in places if place.name not in taken]
            stop = self.at(here[int(self.rng.integers(len(here)))], {s.waypoint for s in stops}) if here else None
            if stop is not None:
                stops.append(stop)
        more = self.stop(stops, role) if len(stops) == 1 else None
        return [*stops, more] if more is not None else stops

    def underway(self, given: tuple[Task, ...]) -> tuple[Task, ...]:
        """Return the tasks of somebody already on the way through one of them, sooner where it is the robot's."""
        tasks = at_places(given)
        inner = [(k, at) for k, task in enumerate(tasks) for at in range(1, len(task.path) - 1)]
        weights = [math.exp(-self.ground.along(tasks[k].path[at])[1] / 0.5) for k, at in inner]
        return begin_at(tasks, *self.pick(inner, weights)) if sum(weights) else given

    def mate(self, name: str, other: Human, group: int) -> Human | None:
        """Return somebody with the same tasks at the same time, from a start beside the other's; or None."""
        begins = other.tasks[0].path[0]
        starts = [hop for hop, _ in self.ground.hops[begins]]
        if not starts:
            return None
        here = self.pick(starts, [math.exp(-self.ground.along(start)[1] / 0.5) + 1e-9 for start in starts])
        first, last = other.tasks[0], other.tasks[-1]
        out, back = self.way(here, first.path[-1]), self.way(last.path[0], here)
        if len(other.tasks) < 2 or out is None or back is None or len(out) < 2 or len(back) < 2:
            return None
        end, start = ends_of(first)[1], ends_of(last)[0]
        joined = (
            Task.between(here, end, out, tuple(p for p in first.pauses if p.at in out[1:])),
            *other.tasks[1:-1],
            Task.between(start, here, back, tuple(p for p in last.stops if p.at in back[1:])).working(last.work),
        )
        changes = {"name": name, "tasks": joined, "group": group, "factors": ForceFactors()}
        if other.behaviour is Behaviour.THREATENING:
            changes["behaviour"] = Behaviour.REGULAR
        return other.model_copy(update=changes)

    def stop(self, chosen: Sequence[Stop], role: Role) -> Stop | None:
        """One more place: near the robot's route, seldom worked before, far from or near to the last by the role."""
        weights = self._usual
        if chosen:
            last = chosen[-1]
            weights = np.where([place.name != last.place.name for place in self.places], weights, 0.0)
            if self.aim is not Aim.NONE:
                apart = np.abs(self._along - self.ground.along(last.waypoint)[0])
                near = np.minimum(apart, 6.0) + 0.3 if role.far else [math.exp(-each / 2.0) for each in apart]
                weights = weights * near
        if not weights.any():
            return None
        return self.at(self.pick(self.places, weights), {stop.waypoint for stop in chosen[-1:]})

    def at(self, place: Place, without: Set[str]) -> Stop | None:
        """A waypoint of a place, sooner near the robot's route."""
        names = [name for name in place.waypoints if name not in without]
        near = [1.0 if self.aim is Aim.NONE else math.exp(-self.ground.along(name)[1]) for name in names]
        return Stop(place, self.pick(names, near)) if names else None

    def tasks(self, stops: Sequence[Stop], role: Role | None, *, along_route: bool) -> tuple[Task, ...]:
        """The cyclic tasks from stop to stop; none where two are not joined or the same. None: any role."""
        tasks = []
        for (place, start), (goal, end) in zip(stops, [*stops[1:], *stops[:1]], strict=True):
            path = self.way(start, end, along_route=along_route)
            if path is None or len(path) < 2:
                return ()
            tasks.append(Task.between(place.name, goal.name, path, self.work_at(end, role)))
        return tuple(tasks) if len(tasks) > 1 else ()

    def way(self, start: str, end: str, *, along_route: bool = False) -> Path | None:
        """The way that people take; None where there is none."""
        return self.ground.path(start, end, along_route=along_route, straight=self.works)

    def work_at(self, at: str, role: Role | None = None) -> tuple[Pause, ...]:
        """What somebody does at the end of a task."""
        if not self.works:
            return ()
        role = role or self.role()
        usual = role.goods if self.goods else role.others
        doing = usual[int(self.rng.integers(len(usual)))]
        return (Pause(at=at, duration_s=doing.drawn_s(self.rng), doing=doing),)

    def _pausing(self, given: tuple[Task, ...], seconds: tuple[float, float]) -> tuple[Task, ...]:
        """The tasks with a pause in one or two of them, where the path comes near the robot's route."""
        tasks = list(given)
        for index in self.rng.choice(len(tasks), size=min(len(tasks), int(self.rng.integers(1, 3))), replace=False):
            task = tasks[index]
            inner = task.path[1:-1] or task.path
            weights = [math.exp(-self.ground.along(name)[1]) for name in inner]
            pause = Pause(at=self.pick(inner, weights), duration_s=round(float(self.rng.uniform(*seconds)), 1))
            tasks[index] = task.model_copy(update={"pauses": (pause, *task.pauses)})
        return tuple(tasks)

    def pick(self, options: Sequence[T], weights: Sequence[float] | NDArray[np.float64]) -> T:
        """One of the options, drawn by weight."""
        return options[drawn(shares_of(weights), self.rng)]


def shares_of(weights: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shares of weights of all, each added to those before it."""
    given = np.asarray(weights, float)
    ends: NDArray[np.float64] = (given / given.sum()).cumsum()
    ends /= ends[-1]
    return ends


def drawn(shares: NDArray[np.float64], rng: np.random.Generator) -> int:
    """Return an index drawn by weight: as `rng.choice` draws it, without its checks. `shares` is of `shares_of`."""
    return int(shares.searchsorted(rng.random(), side="right"))


TROLLEY, CHILD, WHEELCHAIR, MOVED = "trolley", "child", "wheelchair", "moved_object"
SLOW_M_S = 0.8
SHARES = {CHILD: 0.25, WHEELCHAIR: 0.2, TROLLEY: 0.5, MOVED: 0.5}
"""How often somebody is a child or sits in a wheelchair, somebody slow pushes a trolley, and a scenario has an object
that was moved."""
TROLLEYS = (Trolley(), Trolley(length_m=1.1, width_m=0.5), Trolley(length_m=0.7, width_m=0.45))
OBJECTS = (("pallet of boxes", 1.2, 0.8, 0.9), ("crate", 0.8, 0.6, 0.8), ("cart", 0.9, 0.55, 1.0))
"""What is left somewhere: name, length, width and height in metres."""
TRIES = 12


def placed(mission: Mission, world: World, moved: Sequence[SolidObject]) -> tuple[Mission, World]:
    """Return the mission and the world with more objects moved into them."""
    if not moved:
        return mission, world
    things = (*mission.moved, *moved)
    later = mission.replace(moved=things)
    return later, later.place(world)


def added(mission: Mission, later: Mission) -> tuple[SolidObject, ...]:
    """Return the objects of a later mission that a mission does not have."""
    return tuple(thing for thing in later.moved if thing not in mission.moved)


def cast(
    humans: Sequence[Human],
    activity: str | None,
    worker: str | None,
    mission: Mission,
    world: World,
    rng: np.random.Generator,
    *,
    anybody: bool = False,
) -> list[Human]:
    """Let people be of other kinds or push a trolley, as the world allows; who does not fit stays on foot.

    The `worker` of the told activity pushes a trolley where the world says so; `anybody`: also those who walk fast.
    """
    result, actors = list(humans), world.actors
    pushes = activity is not None and world.needs_trolley(activity)
    for index, human in enumerate(humans):
        (to_push, to_sit, to_be_small), size = rng.random(3), TROLLEYS[int(rng.integers(len(TROLLEYS)))]
        if human.group is not None:
            continue
        works = pushes and human.name == worker
        may_push = (anybody or human.speed_m_s <= SLOW_M_S) and not any(task.stops for task in human.tasks)
        if TROLLEY in actors and (works or (may_push and to_push < SHARES[TROLLEY])):
            changed = human.replace(trolley=size, speed_m_s=min(human.speed_m_s, 1.2))
        elif WHEELCHAIR in actors and to_sit < SHARES[WHEELCHAIR] and not works:
            changed = _of_kind(human, PersonKind.WHEELCHAIR)
        elif CHILD in actors and to_be_small < SHARES[CHILD] and not works:
            changed = _of_kind(human, PersonKind.CHILD)
        else:
            continue
        tried = [*result[:index], changed, *result[index + 1 :]]
        if not check(HumanConfiguration(humans=tuple(tried)), mission, world):
            result = tried
    return result


def _of_kind(human: Human, kind: PersonKind) -> Human:
    low, high = LIMITS[kind].speeds_m_s
    speed = min(max(human.speed_m_s, low), high)
    return human.replace(kind=kind, radius_m=LIMITS[kind].radius_m, speed_m_s=speed)


def left_behind(
    humans: Sequence[Human], mission: Mission, world: World, rng: np.random.Generator
) -> tuple[SolidObject, ...]:
    """Return an object left beside the robot's way, in some scenarios of worlds that allow it."""
    if MOVED not in world.actors or rng.random() >= SHARES[MOVED]:
        return ()
    route = mission.route
    inner = [world.grid.position(name) for name in route.via if name in world.grid.by_name]
    way = [(route.start.x, route.start.y), *inner, (route.goal.x, route.goal.y)]
    for _ in range(TRIES):
        name, length, width, height = OBJECTS[int(rng.integers(len(OBJECTS)))]
        (x, y), yaw = _somewhere(way, rng)
        thing = box(name, (x, y), (length, width, height), yaw, world.lidar_height_m)
        if robot_space(world).clearance(x, y) < 0.5 * width:
            continue
        there, place = placed(mission, world, (thing,))
        if not check(HumanConfiguration(humans=tuple(humans)), there, place):
            return (thing,)
    return ()


def box(
    name: str, at: tuple[float, float], size: tuple[float, float, float], yaw: float, lidar_height_m: float
) -> SolidObject:
    """Return a box that stands on the floor: its middle, its length, width and height in metres, and its yaw."""
    x, y = at
    entry = {"name": name, "kind": name, "box": {"center": (x, y, size[2] / 2), "size": size, "yaw": yaw}}
    return ObjectEntry.model_validate(entry).solid(lidar_height_m)


def _somewhere(way: Sequence[tuple[float, float]], rng: np.random.Generator) -> tuple[tuple[float, float], float]:
    """Return a point beside the middle part of a way, and a yaw, rounded to centimetres and hundredths."""
    lengths = np.array([math.dist(a, b) for a, b in pairwise(way)])
    along = float(rng.uniform(0.2, 0.8)) * float(lengths.sum())
    k = min(int(np.searchsorted(lengths.cumsum(), along)), len(lengths) - 1)
    (ax, ay), (bx, by) = way[k], way[k + 1]
    share = (along - float(lengths[:k].sum())) / max(float(lengths[k]), 1e-9)
    turn = math.atan2(by - ay, bx - ax)
    aside = float(rng.uniform(0.3, 1.2)) * (1.0 if rng.random() < 0.5 else -1.0)
    x, y = ax + share * (bx - ax) - aside * math.sin(turn), ay + share * (by - ay) + aside * math.cos(turn)
    return (round(x, 2), round(y, 2)), round(turn + float(rng.uniform(-0.2, 0.2)), 2)
