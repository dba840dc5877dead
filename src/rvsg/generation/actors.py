"""Who and what takes part besides people on foot, where the world names it: trolleys, children, wheelchairs, objects.

A world lists them in `actors`. Worlds that list none get people on foot alone, drawn from the same random numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from rvsg.scenario.scenario import LIMITS, Human, HumanConfiguration, Mission, PersonKind, Trolley
from rvsg.scenario.validity import check
from rvsg.world.io.files import ObjectEntry
from rvsg.world.space import robot_space
from rvsg.world.world import SolidObject, World

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
    humans: Sequence[Human], activity: str | None, worker: str | None, mission: Mission, world: World,
    rng: np.random.Generator, *, anybody: bool = False,
) -> list[Human]:  # fmt: skip
    """Let people be of other kinds or push a trolley, as the world allows; who does not fit stays on foot.

    Args:
        activity: What is told of the work; whoever does it (`worker`) pushes a trolley where the world says so.
        anybody: Let also those who walk fast push one, where people's speeds are not drawn.
    """
    result = list(humans)
    pushes = activity is not None and world.needs_trolley(activity)
    for index, human in enumerate(humans):
        drawn, size = rng.random(3), TROLLEYS[int(rng.integers(len(TROLLEYS)))]
        if human.group is not None:
            continue
        works = pushes and human.name == worker
        changed = _changed(human, works, anybody, drawn.tolist(), size, world.actors)
        if changed is None:
            continue
        tried = [*result[:index], changed, *result[index + 1 :]]
        if not check(HumanConfiguration(humans=tuple(tried)), mission, world):
            result = tried
    return result


def _changed(
    human: Human, works: bool, anybody: bool, drawn: Sequence[float], trolley: Trolley, actors: Sequence[str]
) -> Human | None:
    """Return a person of another kind, or with a trolley; None for who stays on foot."""
    walks_slowly = (anybody or human.speed_m_s <= SLOW_M_S) and not any(task.pauses for task in human.tasks)
    if TROLLEY in actors and (works or (walks_slowly and drawn[0] < SHARES[TROLLEY])):
        return human.replace(trolley=trolley, speed_m_s=min(human.speed_m_s, 1.2))
    if works:
        return None
    for name, kind, chance in ((WHEELCHAIR, PersonKind.WHEELCHAIR, drawn[1]), (CHILD, PersonKind.CHILD, drawn[2])):
        if name in actors and chance < SHARES[name]:
            low, high = LIMITS[kind].speeds_m_s
            speed = min(max(human.speed_m_s, low), high)
            return human.replace(kind=kind, radius_m=LIMITS[kind].radius_m, speed_m_s=speed)
    return None


def left_behind(
    humans: Sequence[Human], mission: Mission, world: World, rng: np.random.Generator
) -> tuple[SolidObject, ...]:
    """Return an object left beside the robot's way, in some scenarios of worlds that allow it."""
    if MOVED not in world.actors or rng.random() >= SHARES[MOVED]:
        return ()
    way = _way(mission, world)
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


def _way(mission: Mission, world: World) -> list[tuple[float, float]]:
    route = mission.route
    inner = [world.grid.position(name) for name in route.via if name in world.grid.by_name]
    return [(route.start.x, route.start.y), *inner, (route.goal.x, route.goal.y)]


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
