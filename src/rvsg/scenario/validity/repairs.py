"""Repair: replace what breaks a rule by the shortest valid path, and report every change.

The mending goes from the inside out, so that each step may rely on the ones before: names of waypoints and areas,
then each path by itself, then the chain of tasks and its loop, then where people start, then the rest. It goes
round again while something is left (a moved start may open a loop), a few times at most.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise

from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Pause, Task
from rvsg.scenario.validity.checker import check, spawn_finding
from rvsg.scenario.validity.findings import Repair
from rvsg.scenario.validity.rules import MAX_HUMANS, SPEED_RANGE_M_S
from rvsg.scenario.validity.task_ends import Side, near_place, parts_of, sides, spelled
from rvsg.world.grid import Grid
from rvsg.world.world import World

_ROUNDS = 3

Path = tuple[str, ...]
Placed = list[tuple[Human, tuple[float, float]]]


def repair(people: HumanConfiguration, mission: Mission, world: World) -> tuple[HumanConfiguration, tuple[Repair, ...]]:
    """The configuration with what can be mended mended, and what was changed.

    A valid configuration comes back as it is. What cannot be mended (no way between two places, nobody knows what
    a person should do, a blocked route) is left as it is, and `check` finds it.
    """
    repairs: list[Repair] = []
    for _ in range(_ROUNDS):
        if not check(people, mission, world):
            break
        mended = _Repairer(world)
        humans = tuple(mended.human(human) for human in mended.crowd(people.humans))
        changed = HumanConfiguration(humans=mended.starts(humans, mission))
        repairs += mended.repairs
        if changed == people:
            break
        people = changed
    return people, tuple(repairs)


def joined(path: Path, grid: Grid) -> Path:
    """The path with each hop that is not a free one replaced by the shortest valid path; repetitions left out.

    Expects valid waypoints. A pair with no way between stays as it is.
    """
    result = list(path[:1])
    for a, b in pairwise(path):
        if a == b:
            continue
        way = (a, b) if b in grid.neighbours[a] else grid.shortest_path(a, b) or (a, b)
        result += way[1:]
    return tuple(result)


def nearest_of(start: str, allowed: frozenset[str], grid: Grid) -> Path | None:
    """The shortest valid path from a waypoint to one of several; None where none can be reached."""
    ways = (grid.shortest_path(start, other) for other in sorted(allowed))
    return min((way for way in ways if way), key=lambda way: (walk_length(way, grid), way), default=None)


def walk_length(path: Path, grid: Grid) -> float:
    """Length in metres of the straight legs of a path."""
    points = [grid.position(name) for name in path]
    return sum(math.dist(a, b) for a, b in pairwise(points))


@dataclass
class _Repairer:
    world: World
    repairs: list[Repair] = field(default_factory=list)

    @property
    def grid(self) -> Grid:
        return self.world.grid

    def say(self, human: str, task: str, what: str, before: Path = (), after: Path = ()) -> None:
        self.repairs.append(Repair(human=human, task=task, what=what, before=before, after=after))

    # -- everybody ---------------------------------------------------------------------------------------------

    def crowd(self, humans: tuple[Human, ...]) -> tuple[Human, ...]:
        """Limits, names and groups."""
        for human in humans[MAX_HUMANS:]:
            self.say(human.name, "", f"left out: at most {MAX_HUMANS} people are simulated")
        taken: set[str] = set()
        sizes = Counter(h.group for h in humans[:MAX_HUMANS] if h.group is not None)
        low, high = SPEED_RANGE_M_S
        kept = []
        for human in humans[:MAX_HUMANS]:
            changes: dict[str, object] = {}
            if human.name in taken:
                changes["name"] = _free_name(human.name, taken | {h.name for h in humans})
                self.say(human.name, "", f"renamed to {changes['name']}: the name was taken")
            taken.add(str(changes.get("name", human.name)))
            if human.group is not None and sizes[human.group] == 1:
                changes["group"] = None
                self.say(human.name, "", f"left group {human.group}: nobody else is in it")
            speed = min(max(human.speed_m_s, low), high)
            if speed != human.speed_m_s:
                changes["speed_m_s"] = speed
                self.say(human.name, "", f"walks at {speed:g} instead of {human.speed_m_s:g} m/s")
            kept.append(human.model_copy(update=changes))
        return tuple(kept)

    # -- one person --------------------------------------------------------------------------------------------

    def human(self, human: Human) -> Human:
        """Names, paths, chain and loop of one person."""
        tasks: list[Task] = []
        for task in human.tasks:
            last = tasks[-1].path[-1] if tasks else None
            if (mended := self.task(task, human.name, last)) is not None:
                tasks.append(mended)
        if not tasks:
            return human
        tasks = self.chain(tasks, human.name)
        tasks = [self.pauses(task, human.name) for task in tasks]
        return human.model_copy(update={"tasks": tuple(tasks)})

    def task(self, task: Task, human: str, came_from: str | None) -> Task | None:
        """One task by itself; None where it has to be left out."""
        path = self.names(task, human)
        task = self.sides(task.model_copy(update={"path": path}), human)
        start, end = sides(task, self.world)
        before, path = task.path, self.led(task.path, start, end, came_from)
        if not path or (len(path) == 1 and not task.pauses):
            self.say(human, task.name, "left out: it has no walk", before, ())
            return None
        if path != before:
            self.say(human, task.name, "led along the shortest valid path", before, path)
        return task.model_copy(update={"path": path})

    def names(self, task: Task, human: str) -> Path:
        """The path with misspelt waypoints corrected, and unknown or invalid ones and repetitions left out."""
        kept: list[str] = []
        for name in task.path:
            meant = name if name in self.grid.valid else spelled(name, self.world)
            if meant is None or meant not in self.grid.valid:
                why = "nobody can stand there" if name in self.grid.by_name else "there is no such waypoint"
                self.say(human, task.name, f"{name} left out: {why}", task.path, ())
                continue
            if meant != name:
                self.say(human, task.name, f"{name} read as {meant}", task.path, ())
            if kept and kept[-1] == meant:
                self.say(human, task.name, f"the repetition of {meant} left out", task.path, ())
                continue
            kept.append(meant)
        return tuple(kept)

    def sides(self, task: Task, human: str) -> Task:
        """The task with unknown areas in its name corrected, or replaced by the waypoint at that end."""
        start, end = sides(task, self.world)
        if start.known and end.known:
            return task
        first, last = (self._side_text(side, task.path, at) for side, at in ((start, 0), (end, -1)))
        parts = parts_of(task.name, self.world)
        name = f"{first} → {last}" if first and last else task.name.replace("→", "to").replace(">", "")
        changes: dict[str, object] = {"name": name}
        if task.start_area is not None or not parts:
            changes["start_area"] = first if first and task.start_area is not None else None
        if task.end_area is not None or not parts:
            changes["end_area"] = last if last and task.end_area is not None else None
        self.say(human, task.name, f'renamed to "{name}": its place is not on the map', task.path, task.path)
        return task.model_copy(update=changes)

    def _side_text(self, side: Side, path: Path, at: int) -> str:
        if side.known:
            return side.text or (path[at] if path else "")
        return near_place(side.text, self.world, cutoff=0.8) or (path[at] if path else "")

    def led(self, path: Path, start: Side, end: Side, came_from: str | None) -> Path:
        """The path led from the start to the end the task promises, over valid hops."""
        if not path:
            path = self.begun(start, end, came_from)
        if not path:
            return ()
        if not start.allows(path[0]) and (way := nearest_of(path[0], start.waypoints or frozenset(), self.grid)):
            path = (*reversed(way), *path[1:])
        if not end.allows(path[-1]) and (way := nearest_of(path[-1], end.waypoints or frozenset(), self.grid)):
            path = (*path, *way[1:])
        if len(path) == 1 and end.waypoints and (others := end.waypoints - {path[0]}):
            path = nearest_of(path[0], others, self.grid) or path
        return joined(path, self.grid)

    def begun(self, start: Side, end: Side, came_from: str | None) -> Path:
        """Where a task without any valid waypoint begins; empty where nothing says so."""
        if came_from is not None and start.allows(came_from) and end.waypoints:
            return (came_from,)
        return (min(start.waypoints),) if start.waypoints and end.waypoints else ()

    # -- the chain of tasks ------------------------------------------------------------------------------------

    def chain(self, tasks: list[Task], human: str) -> list[Task]:
        """The tasks joined end to start, and the last one to the first."""
        result = [tasks[0]]
        for task in tasks[1:]:
            result += self.link(result.pop(), task, human)
        closing = self.link(result.pop(), result[0] if result else tasks[0], human, closes=True)
        return [*result, *closing[:-1]]

    def link(self, before: Task, after: Task, human: str, closes: bool = False) -> list[Task]:
        """Both tasks so that one ends where the other starts, with a task in between where areas differ."""
        here, there = before.path[-1], after.path[0]
        way = self.grid.shortest_path(here, there)
        if here == there or way is None:
            return [before, after]
        ends, starts = sides(before, self.world)[1], sides(after, self.world)[0]
        if ends.allows(there):
            longer = before.model_copy(update={"path": (*before.path, *way[1:])})
            self.say(human, before.name, f"led on to {there}, where the next task starts", before.path, longer.path)
            return [longer, after]
        if starts.allows(here) and not closes:
            longer = after.model_copy(update={"path": (*way, *after.path[1:])})
            self.say(human, after.name, f"started at {here}, where the task before ended", after.path, longer.path)
            return [before, longer]
        name = f"{_area_text(ends, here)} → {_area_text(starts, there)}"
        self.say(human, name, "put in: the tasks were not joined", (), way)
        return [before, Task(name=name, path=way), after]

    def pauses(self, task: Task, human: str) -> Task:
        """The task with its pauses on its path."""
        kept: list[Pause] = []
        for pause in task.pauses:
            at = pause.at if pause.at in task.path else spelled(pause.at, self.world)
            if at is None:
                self.say(human, task.name, f"pause at {pause.at} left out: there is no such waypoint")
                continue
            if at not in task.path:
                here = self.grid.position(at)
                at = min(task.path, key=lambda name: math.dist(self.grid.position(name), here))
            if at != pause.at:
                self.say(human, task.name, f"pause at {pause.at} moved to {at}, which is on the path")
            kept.append(pause.model_copy(update={"at": at}))
        return task.model_copy(update={"pauses": tuple(kept)})

    # -- where people start ------------------------------------------------------------------------------------

    def starts(self, humans: tuple[Human, ...], mission: Mission) -> tuple[Human, ...]:
        """Everybody with a start that is clear of the robot, of obstacles and of those listed earlier."""
        placed: Placed = []
        result: list[Human] = []
        for human in humans:
            if all(task.path and self.grid.valid.issuperset(task.path) for task in human.tasks):
                human = self.start(human, placed, mission)
            if (path := human.tasks[0].path) and path[0] in self.grid.valid:
                placed.append((human, self.grid.position(path[0])))
            result.append(human)
        return tuple(result)

    def start(self, human: Human, placed: Placed, mission: Mission) -> Human:
        """One person with a clear start: elsewhere in the same area, with another task of the list, or a new one."""

        def clear(waypoint: str) -> bool:
            return spawn_finding(human, self.grid.position(waypoint), placed, mission, self.world) is None

        tasks = human.tasks
        old = tasks[0].path[0]
        if clear(old):
            return human
        begin, end = sides(tasks[0], self.world)[0], sides(tasks[-1], self.world)[1]
        free = frozenset(name for name in self.grid.valid if name != old and clear(name))
        inside = frozenset(name for name in free if begin.allows(name))
        for allowed in (frozenset(name for name in inside if end.allows(name)), inside):
            if (way := nearest_of(old, allowed, self.grid)) is not None:
                return self._moved(human, way)
        for index, task in enumerate(tasks[1:], start=1):
            if clear(task.path[0]):
                self.say(human.name, task.name, f"the list starts with this task: {old} was taken")
                return human.model_copy(update={"tasks": (*tasks[index:], *tasks[:index])})
        if (way := nearest_of(old, free, self.grid)) is not None:
            return self._led_in(human, tuple(reversed(way)), begin)
        return human

    def _led_in(self, human: Human, way: Path, begin: Side) -> Human:
        """The person with a task put in before the first one, from a clear start."""
        name = f"{way[0]} → {_area_text(begin, way[-1])}"
        self.say(human.name, name, f"put in: {way[-1]} was taken at the start", (), way)
        tasks = self.chain([Task(name=name, path=way), *human.tasks], human.name)
        return human.model_copy(update={"tasks": tuple(tasks)})

    def _moved(self, human: Human, way: Path) -> Human:
        """The person starting at the end of a way that begins at the old start."""
        first, new = human.tasks[0], way[-1]
        path = first.path[first.path.index(new) :] if new in first.path[:-1] else (*reversed(way), *first.path[1:])
        moved = first.model_copy(update={"path": path})
        self.say(human.name, first.name, f"started at {new}: {way[0]} was taken", first.path, path)
        tasks = [moved, *human.tasks[1:]]
        tasks = [self.pauses(task, human.name) for task in self.chain(tasks, human.name)]
        return human.model_copy(update={"tasks": tuple(tasks)})


def _area_text(side: Side, waypoint: str) -> str:
    return side.text if side.known and side.text else waypoint


def _free_name(name: str, taken: set[str]) -> str:
    number = 2
    while f"{name} ({number})" in taken:
        number += 1
    return f"{name} ({number})"
