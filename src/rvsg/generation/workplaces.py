"""Places people work at, the graph of waypoints between them, and the activities that name them."""

from __future__ import annotations

import heapq
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

from rvsg.core.records import Pose
from rvsg.scenario.scenario import Human, ends_of
from rvsg.scenario.validity import is_walkable
from rvsg.world.space import robot_space
from rvsg.world.world import Route, World


@dataclass(frozen=True)
class Place:
    """A place people work at: the name and kind of a labelled area, and where people stand to work it."""

    name: str
    kind: str
    waypoints: tuple[str, ...]


GOODS = frozenset(
    {
        *("shelf", "shelves", "rack", "racks", "boxes", "box", "pallet", "pallets", "crate", "crates", "store"),
        *("storage", "goods", "machine", "machines", "equipment", "loading", "dock", "packing", "waste", "workshop"),
        *("warehouse", "area", "waypoint"),
    }
)
"""Words in the kinds of places where people handle goods; elsewhere nobody is said to sort them or push them about."""


def handles_goods(places: Sequence[Place]) -> bool:
    """Return whether the kinds of most places are kinds of a place of goods."""
    kinds = [place for place in places if GOODS & set(place.kind.lower().split())]
    return 2 * len(kinds) >= len(places)


def places_of(world: World, *, reachable_from: Pose) -> tuple[Place, ...]:
    """The places of the part of the world the robot starts in; where nothing is labelled, every waypoint is one."""
    if not world.grid.valid:
        return ()
    start = world.grid.nearest(reachable_from.x, reachable_from.y)
    near = next(part for part in world.grid.parts if start in part)
    places = tuple(
        Place(area.name, area.kind, names)
        for area in world.areas
        if (names := tuple(name for name in area.waypoints if name in near))
    )
    if len({name for place in places for name in place.waypoints}) >= 3 and len(places) >= 2:
        return places
    return tuple(Place(w.name, "waypoint", (w.name,)) for w in world.grid.waypoints if w.name in near)


Point = tuple[float, float]
Path = tuple[str, ...]

PLANNER_CLEARANCE_M = 0.5
"""Planners keep about this far from obstacles where there is room (inflation radius of the study's robot: 0.55 m)."""


TURN_M = 0.5
"""People walk this much farther rather than turn by a right angle; a turn by 45° counts 0.15 m."""
MOST_GRAPHS = 8


class WalkingGraph:
    """Positions (metres) and free hops of a world's grid, with remembered paths; the route passes `corridor`."""

    def __init__(self, world: World, route: Route) -> None:
        grid = world.grid
        self.at: dict[str, Point] = {w.name: (w.x, w.y) for w in grid.waypoints}
        self.hops = {
            name: [
                (other, math.dist(self.at[name], self.at[other])) for other in others if is_walkable(name, other, world)
            ]
            for name, others in grid.neighbours.items()
        }
        self._came: dict[tuple[str, bool, bool], list[int]] = {}
        self._along: dict[str, tuple[float, float]] = {}
        self.robot_path = _robot_path(world, route)
        self.corridor = frozenset(name for name in self.hops if self.along(name)[1] < 0.7)
        self._names = sorted(self.hops)
        self._number = {name: number for number, name in enumerate(self._names)}
        # The hops of every waypoint with costs and directions, by number: the numbers are in the order of the names.
        self._weighed = {
            along_route: [
                [
                    (
                        self._number[other],
                        length * (discount if {name, other} <= self.corridor else 1.0),
                        (complex(*self.at[other]) - complex(*self.at[name])) / length,
                    )
                    for other, length in self.hops[name]
                ]
                for name in self._names
            ]
            for along_route, discount in ((False, 1.0), (True, 0.6))
        }

    def path(self, start: str, end: str, *, along_route: bool = False, straight: bool = False) -> Path | None:
        """Return the shortest valid path or None.

        Args:
            along_route: Hops in the robot's corridor count at 0.6.
            straight: Turns count too, as people take the way with fewer of them.
        """
        key = (start, along_route, straight)
        if key not in self._came:
            turn_m = TURN_M if straight else 0.0
            self._came[key] = self._search(self._number[start], self._weighed[along_route], turn_m)
        came, names, at = self._came[key], self._names, self._number.get(end, -1)
        if at < 0 or came[at] < 0:
            return None
        path = [end]
        while names[at] != start:
            at = came[at]
            path.append(names[at])
        return tuple(reversed(path))

    @staticmethod
    def _search(start: int, hops: list[list[tuple[int, float, complex]]], turn_m: float) -> list[int]:
        """For every waypoint the one before it on the cheapest way from `start`; -1 where there is no way."""
        best, came, queue = [math.inf] * len(hops), [-1] * len(hops), [(0.0, start)]
        ahead = [0j] * len(hops)
        best[start], came[start] = 0.0, start
        pop, push = heapq.heappop, heapq.heappush
        while queue:
            cost, at = pop(queue)
            if cost > best[at]:
                continue
            here = ahead[at]
            for other, length, way in hops[at]:
                further = cost + length
                if turn_m and at != start:
                    further += turn_m * (1.0 - here.real * way.real - here.imag * way.imag)
                if further < best[other]:
                    best[other], came[other], ahead[other] = further, at, way
                    push(queue, (further, other))
        return came

    def along(self, name: str) -> tuple[float, float]:
        """Return where a waypoint lies against the robot's route: metres along it to the nearest point, metres away."""
        if name not in self._along:
            self._along[name] = nearest_on(self.robot_path, self.at[name])
        return self._along[name]


_graphs: dict[tuple[str, str], WalkingGraph] = {}


def walking_graph(world: World, route: Route) -> WalkingGraph:
    """Return the graph of a world and a route. The last few are cached together with their paths."""
    key = (world.place_id, route.id)
    if key not in _graphs:
        while len(_graphs) >= MOST_GRAPHS:
            _graphs.pop(next(iter(_graphs)))
        _graphs[key] = WalkingGraph(world, route)
    return _graphs[key]


def _robot_path(world: World, route: Route) -> tuple[Point, ...]:
    """Return the way the robot is expected to take: along named waypoints or the shortest walk, pulled straight."""
    grid = world.grid
    start, goal = (route.start.x, route.start.y), (route.goal.x, route.goal.y)
    through = [(pose.x, pose.y) for pose in route.through]
    names = [name for name in route.via if name in grid.by_name]
    if not names and grid.valid:
        for a, b in pairwise(grid.nearest(*stop) for stop in (start, *through, goal)):
            names += grid.shortest_path(a, b) or (a, b)
    points = [start, *(grid.position(name) for name in names), goal]
    kept = [points[0], *(q for p, q in pairwise(points) if math.dist(p, q) > 0.1)]
    if len(kept) == 1:
        return (start, goal)
    return _pulled(_pulled(_dense(kept), world, fixed=set(through)), world, fixed=set(through))


def _dense(line: list[Point], step_m: float = 0.5) -> list[Point]:
    """The line with points at most half a metre apart."""
    result = [line[0]]
    for (ax, ay), (bx, by) in pairwise(line):
        count = max(1, math.ceil(math.dist((ax, ay), (bx, by)) / step_m))
        result += [(ax + (bx - ax) * k / count, ay + (by - ay) * k / count) for k in range(1, count + 1)]
    return result


def _pulled(line: Sequence[Point], world: World, fixed: set[Point]) -> tuple[Point, ...]:
    """The line with detours cut off where the robot fits straight through; points that must be passed stay."""
    space = robot_space(world)
    result, at = [line[0]], 0
    while at < len(line) - 1:
        reach = next((k for k in range(at + 1, len(line)) if line[k] in fixed), len(line) - 1)
        candidates = range(reach, at + 1, -1)
        at = next((k for k in candidates if space.segment_free(line[at], line[k], PLANNER_CLEARANCE_M)), at + 1)
        result.append(line[at])
    return tuple(result)


def nearest_on(line: tuple[Point, ...], point: Point) -> tuple[float, float]:
    """Metres along a line to its point nearest to another one, and metres between the two."""
    best, walked = (0.0, math.dist(line[0], point)), 0.0
    for (ax, ay), (bx, by) in pairwise(line):
        length = math.dist((ax, ay), (bx, by))
        if length > 0.0:
            share = ((point[0] - ax) * (bx - ax) + (point[1] - ay) * (by - ay)) / length**2
            share = min(1.0, max(0.0, share))
            away = math.dist((ax + share * (bx - ax), ay + share * (by - ay)), point)
            if away < best[1]:
                best = (walked + share * length, away)
        walked += length
    return best


@lru_cache(maxsize=256)
def named_in(activity: str, places: tuple[Place, ...]) -> tuple[tuple[Place, ...], ...]:
    """Return the places that an activity names, in its order: one by its name, or all of a kind; longer names first."""
    text = activity.lower()
    found: list[tuple[int, int, tuple[Place, ...]]] = []
    names: dict[str, list[Place]] = {}
    for place in places:
        names.setdefault(place.name.lower(), []).append(place)
        names.setdefault(place.kind.lower(), []).append(place)
        word, _, number = place.name.lower().rpartition(" ")
        if number.isdigit():
            names.setdefault(word, []).append(place)
    for name in sorted(names, key=lambda each: (-len(each), each)):
        stem = re.escape(re.sub("(?:(?<=shel)(?:f|ves)|s)$", "", name))
        ending = "(?:f|ves)" if name.endswith(("shelf", "shelves")) else "(?:s|es)?"  # singular or plural
        for match in re.finditer(rf"\b{stem}{ending}\b", text):
            if all(match.end() <= begin or end <= match.start() for begin, end, _ in found):
                found.append((match.start(), match.end(), tuple(dict.fromkeys(names[name]))))
    return tuple(named for _, _, named in sorted(found, key=lambda each: each[:2]))


def follows(human: Human, named: Sequence[tuple[Place, ...]]) -> bool:
    """Return whether a person goes to the places that an activity names, in its order (their tasks come round)."""
    stops = [ends_of(task)[0] for task in human.tasks]
    wanted = [{place.name for place in each} for each in named]
    for begin in range(len(stops)):
        turned = iter([*stops[begin:], *stops[:begin]])
        if all(any(stop in each for stop in turned) for each in wanted):
            return True
    return not wanted


def sentence(text: str) -> str:
    """Return a text without the full stop at its end, to be put into a sentence."""
    return text.strip().rstrip(".").rstrip()
