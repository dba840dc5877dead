"""Repair: replace what breaks a rule by the shortest valid path, and report every change.

Each step relies on the ones before: names of waypoints and areas, then each path by itself, then the chain of tasks
and its loop, then where people start. The steps are repeated up to three times, since a moved start may open a loop.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Set
from itertools import pairwise

from rvsg.scenario.placement import spawn_finding, speed_range
from rvsg.scenario.rules import MAX_HUMANS, Repair, TaskEnd, near_place, spelled, task_ends
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Pause, Task
from rvsg.scenario.validity import check
from rvsg.world.grid import Grid
from rvsg.world.world import World

_ROUNDS = 3

Path = tuple[str, ...]
Placed = list[tuple[Human, tuple[float, float]]]


def repair(people: HumanConfiguration, mission: Mission, world: World) -> tuple[HumanConfiguration, tuple[Repair, ...]]:
    """Repair a configuration as far as possible; return it with the changes made.

    A valid configuration is returned unchanged. What cannot be repaired (two places that are not connected, a person
    without a usable task, a blocked route) stays as it is, and `check` reports it.
    """
    repairs: list[Repair] = []
    for _ in range(_ROUNDS):
        if not check(people, mission, world):
            break
        repairer = _Repairer(world)
        humans = tuple(repairer.human(human) for human in repairer.crowd(people.humans))
        changed = HumanConfiguration(humans=repairer.starts(humans, mission))
        repairs += repairer.repairs
        if changed == people:
            break
        people = changed
    return people, tuple(repairs)


def joined(path: Path, grid: Grid) -> Path:
    """Return a path of valid waypoints with every blocked hop replaced by the shortest valid path.

    Repetitions are dropped. Two waypoints that are not connected stay as they are.
    """
    result = list(path[:1])
    for a, b in pairwise(path):
        if a == b:
            continue
        way = (a, b) if b in grid.neighbours[a] else grid.shortest_path(a, b) or (a, b)
        result += way[1:]
    return tuple(result)


def nearest_of(start: str, allowed: Set[str], grid: Grid) -> Path | None:
    """Return the shortest valid path from a waypoint to one of several; None if none can be reached."""

    def length_m(path: Path) -> float:
        return sum(math.dist(grid.position(a), grid.position(b)) for a, b in pairwise(path))

    ways = (grid.shortest_path(start, other) for other in sorted(allowed))
    return min((way for way in ways if way), key=lambda way: (length_m(way), way), default=None)


class _Repairer:
    """Repairs one configuration and records what it changes."""

    def __init__(self, world: World) -> None:
        self.world, self.grid = world, world.grid
        self.repairs: list[Repair] = []

    def record(self, human: str, task: str, what: str, before: Path = (), after: Path = ()) -> None:
        self.repairs.append(Repair(human=human, task=task, what=what, before=before, after=after))

    # -- everybody ---------------------------------------------------------------------------------------------

    def crowd(self, humans: tuple[Human, ...]) -> tuple[Human, ...]:
        """Repair the number of people, their names, groups and speeds."""
        for human in humans[MAX_HUMANS:]:
            self.record(human.name, "", f"left out: at most {MAX_HUMANS} people are simulated")
        taken: set[str] = set()
        names = {human.name for human in humans}
        sizes = Counter(h.group for h in humans[:MAX_HUMANS] if h.group is not None)
        repaired = []
        for human in humans[:MAX_HUMANS]:
            changes: dict[str, object] = {}
            if human.name in taken:
                numbered = (f"{human.name} ({number})" for number in itertools.count(2))
                name = next(name for name in numbered if name not in taken | names)
                changes["name"] = name
                self.record(human.name, "", f"renamed to {name}: the name was taken")
            taken.add(str(changes.get("name", human.name)))
            if human.group is not None and sizes[human.group] == 1:
                changes["group"] = None
                self.record(human.name, "", f"left group {human.group}: nobody else is in it")
            low, high = speed_range(human)
            speed = min(max(human.speed_m_s, low), high)
            if speed != human.speed_m_s:
                changes["speed_m_s"] = speed
                self.record(human.name, "", f"walks at {speed:g} instead of {human.speed_m_s:g} m/s")
            repaired.append(human.model_copy(update=changes))
        return tuple(repaired)

    # -- one person --------------------------------------------------------------------------------------------

    def human(self, human: Human) -> Human:
        """Repair the names, paths, chain and loop of one person."""
        tasks: list[Task] = []
        for task in human.tasks:
            last = tasks[-1].path[-1] if tasks else None
            if (repaired := self.task(task, human.name, last)) is not None:
                tasks.append(repaired)
        if not tasks and (walk := self.walk_of_stops(human)) is not None:
            tasks = [walk]
        if not tasks:
            return human
        tasks = self.chain(tasks, human.name)
        return human.model_copy(update={"tasks": tuple(self.pauses(task, human.name) for task in tasks)})

    def walk_of_stops(self, human: Human) -> Task | None:
        """Return a walk between waypoints of tasks that hold one each, where no task by itself is a walk."""
        stops = [name for task in human.tasks for name in self.names(task, human.name)]
        others = set(stops[1:]) - {stops[0]} if stops else set()
        way = nearest_of(stops[0], others, self.grid) if others else None
        if way is None:
            return None
        walk = human.tasks[0].model_copy(update={"path": way, "start_area": None, "end_area": None})
        self.record(human.name, walk.name, "joined: each task held one waypoint", human.tasks[0].path, way)
        return walk

    def task(self, task: Task, human: str, came_from: str | None) -> Task | None:
        """Repair one task by itself; return None if it has to be dropped."""
        path = self.names(task, human)
        task = self.areas(task.model_copy(update={"path": path}), human)
        start, end = task_ends(task, self.world)
        before, path = task.path, self.connected(task.path, start, end, came_from)
        if not path or (len(path) == 1 and not task.pauses):
            self.record(human, task.name, "left out: it has no walk", before, ())
            return None
        if path != before:
            self.record(human, task.name, "rerouted along the shortest valid path", before, path)
        return task.model_copy(update={"path": path})

    def names(self, task: Task, human: str) -> Path:
        """Correct misspelt waypoints; drop unknown or invalid ones and repetitions."""
        path: list[str] = []
        for name in task.path:
            meant = name if name in self.grid.valid else spelled(name, self.world)
            if meant is None or meant not in self.grid.valid:
                why = "nobody can stand there" if name in self.grid.by_name else "there is no such waypoint"
                self.record(human, task.name, f"{name} left out: {why}", task.path, ())
                continue
            if meant != name:
                self.record(human, task.name, f"{name} read as {meant}", task.path, ())
            if path and path[-1] == meant:
                self.record(human, task.name, f"repeated {meant} left out", task.path, ())
                continue
            path.append(meant)
        return tuple(path)

    def areas(self, task: Task, human: str) -> Task:
        """Correct unknown areas of a task, or replace them by the waypoint at that end of its path."""
        ends = task_ends(task, self.world)
        if all(end.known for end in ends):
            return task
        names = []
        for end, at in zip(ends, (0, -1), strict=True):
            text = end.text if end.known else near_place(end.text, self.world, cutoff=0.8)
            names.append(text or (task.path[at] if task.path else ""))
        first, last = names
        name = f"{first} → {last}" if first and last else task.name
        changes = {
            "name": name,
            "start_area": first or None if task.start_area is not None else None,
            "end_area": last or None if task.end_area is not None else None,
        }
        self.record(human, task.name, f'renamed to "{name}": its place is not on the map', task.path, task.path)
        return task.model_copy(update=changes)

    def connected(self, path: Path, start: TaskEnd, end: TaskEnd, came_from: str | None) -> Path:
        """Return a path over valid hops from the start to the end of a task."""
        if not path and end.waypoints:  # no valid waypoint: it begins where the task before ended, or in its area
            if came_from is not None and start.allows(came_from):
                path = (came_from,)
            elif start.waypoints:
                path = (min(start.waypoints),)
        if not path:
            return ()
        if not start.allows(path[0]) and (way := nearest_of(path[0], start.waypoints or frozenset(), self.grid)):
            path = (*reversed(way), *path[1:])
        if not end.allows(path[-1]) and (way := nearest_of(path[-1], end.waypoints or frozenset(), self.grid)):
            path = (*path, *way[1:])
        if len(path) == 1 and end.waypoints and (others := end.waypoints - {path[0]}):
            path = nearest_of(path[0], others, self.grid) or path
        return joined(path, self.grid)

    # -- the chain of tasks ------------------------------------------------------------------------------------

    def chain(self, tasks: list[Task], human: str) -> list[Task]:
        """Connect the end of each task to the start of the next, and the last one to the first."""
        result = [tasks[0]]
        for task in tasks[1:]:
            result += self.link(result.pop(), task, human)
        closing = self.link(result.pop(), result[0] if result else tasks[0], human, closes=True)
        return [*result, *closing[:-1]]

    def link(self, before: Task, after: Task, human: str, closes: bool = False) -> list[Task]:
        """Return both tasks so that one ends where the other starts, with a task in between where areas differ."""
        here, there = before.path[-1], after.path[0]
        way = self.grid.shortest_path(here, there)
        if here == there or way is None:
            return [before, after]
        ends, starts = task_ends(before, self.world)[1], task_ends(after, self.world)[0]
        if ends.allows(there):
            longer = before.model_copy(update={"path": (*before.path, *way[1:])})
            what = f"extended to {there}, where the next task starts"
            self.record(human, before.name, what, before.path, longer.path)
            return [longer, after]
        if starts.allows(here) and not closes:
            longer = after.model_copy(update={"path": (*way, *after.path[1:])})
            self.record(human, after.name, f"started at {here}, where the task before ended", after.path, longer.path)
            return [before, longer]
        between = Task.between(_area_text(ends, here), _area_text(starts, there), way)
        self.record(human, between.name, "inserted: the tasks were not connected", (), way)
        return [before, between, after]

    def pauses(self, task: Task, human: str) -> Task:
        """Move pauses onto the path; drop those at unknown waypoints."""
        pauses: list[Pause] = []
        for pause in task.pauses:
            at = pause.at if pause.at in task.path else spelled(pause.at, self.world)
            if at is None:
                self.record(human, task.name, f"pause at {pause.at} left out: there is no such waypoint")
                continue
            if at not in task.path:
                here = self.grid.position(at)
                at = min(task.path, key=lambda name: math.dist(self.grid.position(name), here))
            if at != pause.at:
                self.record(human, task.name, f"pause at {pause.at} moved to {at}, which is on the path")
            pauses.append(pause.model_copy(update={"at": at}))
        return task.model_copy(update={"pauses": tuple(pauses)})

    # -- where people start ------------------------------------------------------------------------------------

    def starts(self, humans: tuple[Human, ...], mission: Mission) -> tuple[Human, ...]:
        """Give everybody a start that is clear of the robot, of obstacles and of people listed earlier."""
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
        """Give one person a clear start: elsewhere in the same area, with another task, or with an inserted one."""

        def clear(waypoint: str) -> bool:
            return spawn_finding(human, self.grid.position(waypoint), placed, mission, self.world) is None

        tasks = human.tasks
        old = tasks[0].path[0]
        if clear(old):
            return human
        begin, end = task_ends(tasks[0], self.world)[0], task_ends(tasks[-1], self.world)[1]
        free = {name for name in self.grid.valid if name != old and clear(name)}
        inside = {name for name in free if begin.allows(name)}
        for allowed in ({name for name in inside if end.allows(name)}, inside):
            if (way := nearest_of(old, allowed, self.grid)) is not None:
                return self._moved(human, way)
        for index, task in enumerate(tasks[1:], start=1):
            if clear(task.path[0]):
                self.record(human.name, task.name, f"moved to the start of the list: {old} is occupied")
                return human.model_copy(update={"tasks": (*tasks[index:], *tasks[:index])})
        if (way := nearest_of(old, free, self.grid)) is not None:
            approach = Task.between(way[-1], _area_text(begin, old), tuple(reversed(way)))
            self.record(human.name, approach.name, f"inserted: {old} is occupied at the start", (), approach.path)
            return human.model_copy(update={"tasks": tuple(self.chain([approach, *tasks], human.name))})
        return human

    def _moved(self, human: Human, way: Path) -> Human:
        """Move the start of a person to the end of a path that begins at the old start."""
        first, new = human.tasks[0], way[-1]
        path = first.path[first.path.index(new) :] if new in first.path[:-1] else (*reversed(way), *first.path[1:])
        self.record(human.name, first.name, f"started at {new}: {way[0]} is occupied", first.path, path)
        tasks = self.chain([first.model_copy(update={"path": path}), *human.tasks[1:]], human.name)
        return human.model_copy(update={"tasks": tuple(self.pauses(task, human.name) for task in tasks)})


def _area_text(end: TaskEnd, waypoint: str) -> str:
    return end.text if end.known and end.text else waypoint
