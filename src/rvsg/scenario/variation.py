"""Variation of scenarios: families with ranges ("0.8 to 1.4" where a speed would stand), differences between two
configurations, and adaptation to a changed world.
"""

from __future__ import annotations

import copy
import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from rvsg.core.documents import Key, key_text, mistakes_of
from rvsg.core.errors import InputError, UnknownName
from rvsg.core.records import Record
from rvsg.scenario.scenario import (
    Attention,
    Human,
    HumanConfiguration,
    Mission,
    Scenario,
    Task,
    at_places,
    ends_of,
    goal_names,
    pauses_of,
)
from rvsg.world.grid import Grid
from rvsg.world.world import Route, World

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_TO = " to "
_RANGE = re.compile(rf"\s*({_NUMBER})\s+to\s+({_NUMBER})\s*")


class Range(Record):
    """A number of a scenario that may lie anywhere from `low` to `high`, or the attention of a person."""

    name: str
    """As people write it: the person and the key, e.g. `Human 1.speed_m_s`."""
    key: Key
    """Where it is in the scenario."""
    low: float
    high: float
    words: Annotated[tuple[str, ...], Field(exclude_if=lambda words: not words)] = ()
    """Attentions in order: the first from 0 to 1, the next from 1 to 2."""

    @model_validator(mode="after")
    def _ordered(self) -> Range:
        if not self.low < self.high:
            raise ValueError(f"{self.name}: a range goes from a smaller to a larger number, not {self}")
        return self

    def __str__(self) -> str:
        return f"{self.words[0]} to {self.words[-1]}" if self.words else f"{self.low:g} to {self.high:g}"

    def at(self, share: float) -> float:
        """Return the value at a share of the range, 0 for `low` and 1 for `high`."""
        return self.low + share * (self.high - self.low)

    def word(self, value: float) -> str:
        """Return the attention at a value; empty where the range is one of numbers."""
        return self.words[min(int(value), len(self.words) - 1)] if self.words else ""


class ScenarioFamily(Record):
    """The scenarios that ranges span."""

    middle: Scenario
    """The scenario with every range at its middle."""
    ranges: Annotated[tuple[Range, ...], Field(min_length=1, max_length=20)]

    def at(self, values: Sequence[float]) -> Scenario:
        """Return the scenario with these values, in the order of `ranges`.

        Raises:
            InputError: a value is outside what the scenario allows there.
        """
        data = self.middle.model_dump(mode="json")
        for span, value in zip(self.ranges, values, strict=True):
            _set(data, span.key, span.word(value) or value)
        return _scenario(data)


def family_of(value: dict[str, Any], vary: Sequence[str] = ()) -> ScenarioFamily:
    """Return the family of a scenario as plain values, with ranges in its people, and those given besides.

    Args:
        value: a scenario as JSON holds it; a number may be the text "LOW to HIGH".
        vary: ranges as `PERSON.KEY=LOW to HIGH`, e.g. `Human 1.speed_m_s=0.8 to 1.4`.

    Raises:
        InputError: a range cannot be read, is outside of `people`, or there is none.
    """
    data = copy.deepcopy(value)
    ranges: dict[Key, Range] = {}
    for key, text in list(_leaves(data, ())):
        if not isinstance(text, str) or {"description", "name"} & {*key} or not _is_range(key, text):
            continue
        if key[:2] != ("people", "humans") or len(key) < 4:
            raise InputError(f"{key_text(key)}: {text!r} is a range, and only numbers of people may be ranges.")
        human = data["people"]["humans"][key[2]]
        ranges[key] = _range(f"{human.get('name', f'person {key[2]}')}.{key_text(key[3:])}", key, text)
    for key, span in ranges.items():
        _set(data, key, span.word(span.at(0.5)) or span.at(0.5))
    data = _scenario(data).model_dump(mode="json")
    for text in vary:
        span = _varied(data["people"]["humans"], text)
        ranges[span.key] = span
        _set(data, span.key, span.word(span.at(0.5)) or span.at(0.5))
    if not ranges:
        raise InputError(
            'The scenario has no range. Write one instead of a number, e.g. "speed_m_s": "0.8 to 1.4", or give '
            "--vary 'Human 1.speed_m_s=0.8 to 1.4'."
        )
    family = ScenarioFamily(middle=_scenario(data), ranges=tuple(ranges.values()))
    for ends in ([span.low for span in family.ranges], [span.high for span in family.ranges]):
        family.at(ends)
    return family


def _leaves(value: Any, key: Key) -> Iterator[tuple[Key, Any]]:
    """Yield every value inside that is no list or mapping, with the path of keys to it."""
    if isinstance(value, dict | list):
        for name, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(inner, (*key, name))
    else:
        yield key, value


def _is_range(key: Key, text: str) -> bool:
    return bool(_RANGE.fullmatch(text)) or (key[-1] == "attention" and _TO in text)


def _range(name: str, key: Key, text: str) -> Range:
    if key[-1] == "attention":
        known = [member.value for member in Attention]
        first, _, last = (word.strip() for word in text.partition(_TO))
        words = known[known.index(first) : known.index(last) + 1] if {first, last} <= {*known} else []
        if len(words) < 2:
            raise InputError(
                f"{name}: expected two of {', '.join(known)} in this order with `to` between, got {text!r}."
            )
        return Range(name=name, key=key, low=0.0, high=float(len(words)), words=tuple(words))
    match = _RANGE.fullmatch(text)
    if match is None:
        raise InputError(f"{name}: expected a range such as 0.8 to 1.4, got {text!r}.")
    try:
        return Range(name=name, key=key, low=float(match[1]), high=float(match[2]))
    except ValidationError as error:
        raise InputError(str(error.errors()[0]["msg"]).removeprefix("Value error, ")) from None


def _varied(humans: list[dict[str, Any]], text: str) -> Range:
    name, equals, span = text.partition("=")
    matching = [(k, human) for k, human in enumerate(humans) if name.startswith(f"{human['name']}.")]
    if not equals or not matching:
        names = ", ".join(human["name"] for human in humans) or "nobody"
        raise InputError(f"{text!r}: expected PERSON.KEY=LOW to HIGH. People of the scenario: {names}.")
    index, human = max(matching, key=lambda pair: len(pair[1]["name"]))
    rest = name.removeprefix(f"{human['name']}.")
    leaves = _leaves(human, ())
    keys = {key_text(k): k for k, v in leaves if isinstance(v, int | float) and not isinstance(v, bool)}
    keys["attention"] = ("attention",)
    hint, track = f"Numbers of {human['name']} that may vary.", human.get("track")
    if track is not None:
        idle = _idle(track)
        keys = {name: key for name, key in keys.items() if key[0] not in idle and key[:2] not in idle}
        hint += (
            " Who follows a recorded track does so earlier or later by track.start_s; for places, speeds and attention "
            "make the scenario with `rvsg recording scenario --people intent`."
        )
    if rest not in keys:
        raise UnknownName("number", rest, keys, hint=hint)
    return _range(name, ("people", "humans", index, *keys[rest]), span)


def _idle(track: dict[str, Any]) -> set[str | Key]:
    """Return the keys of a person on a track that change nothing in a run."""
    if len(track["points"]) == 1:  # appears there, and then walks by intent
        return {"start", "start_delay_s", ("track", "period_s")}
    by_intent = {"speed_m_s", "attention", "factors", "points"} if track.get("until_m") is None else set()
    return {"start", "start_delay_s", ("track", "period_s"), ("track", "points"), *by_intent}


def _set(data: Any, key: Key, value: float | str) -> None:
    for part in key[:-1]:
        data = data[part]
    data[key[-1]] = value


def _scenario(data: dict[str, Any]) -> Scenario:
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        raise InputError("The scenario cannot be used: " + "; ".join(mistakes_of(error, Scenario))) from None


MOST_PAUSES = 3
"""More pauses than this are summed up."""
MOST_TASKS, MOST_WAYPOINTS = 4, 8
"""More tasks, or waypoints of a way, than this are cut off."""


NO_CHANGE = "no change"
"""What `differences` says of equal configurations."""


def objects_changed(before: Mission, after: Mission) -> str:
    """Return which moved objects are elsewhere, new or gone; empty where none is."""
    boxes = {thing.name: thing.box for thing in before.moved}
    changes = []
    for thing in after.moved:
        (x, y, _), (length, width, _) = thing.box.center, thing.box.size
        if boxes.pop(thing.name, None) != thing.box:
            changes.append(f"{thing.name} stands at ({x:g}, {y:g}), {length:g} x {width:g} m")
    return "; ".join([*changes, *(f"without {name}" for name in boxes)])


def differences(before: HumanConfiguration, after: HumanConfiguration) -> str:
    """Return what changed from one configuration to another; `no change` where they are equal."""
    earlier = {human.name: human for human in before.humans}
    changes = []
    for human in after.humans:
        was = earlier.pop(human.name, None)
        words = _changed(was, human) if was is not None else ["is new"]
        if words:
            changes.append(f"{human.name} {', '.join(words)}")
    changes += [f"without {name}" for name in earlier]
    return "; ".join(changes) or NO_CHANGE


def _changed(was: Human, human: Human) -> list[str]:
    words = []
    if human.speed_m_s != was.speed_m_s:
        words.append(f"walks at {human.speed_m_s:g} m/s (was {was.speed_m_s:g})")
    if human.start_delay_s != was.start_delay_s:
        words.append(f"starts after {human.start_delay_s:g} s (was {was.start_delay_s:g})")
    if human.behaviour is not was.behaviour:
        words.append(f"is {human.behaviour.value} (was {was.behaviour.value})")
    if human.group != was.group:
        words.append("leaves the group" if human.group is None else "joins a group")
    words += _other_work(was, human)
    now, before = pauses_of(human), pauses_of(was)
    new, gone = _without(now, before), _without(before, now)
    if len(new) > MOST_PAUSES:
        words.append(f"pauses {len(now)} times, {sum(s for _, _, s in now):g} s in all")
    elif new:
        words.append(f"pauses {', '.join(f'{s:g} s at {at} (leg {leg})' for leg, at, s in new)}")
    if gone and not now:
        words.append("pauses nowhere")
    elif gone:
        words.append(f"no longer pauses {', '.join(f'{s:g} s at {at}' for _, at, s in gone[:MOST_PAUSES])}")
    return words


PauseOf = tuple[int, str, float]


def _without(pauses: Sequence[PauseOf], others: Sequence[PauseOf]) -> list[PauseOf]:
    """Return the pauses that the others lack, wherever these are on the way."""
    left, new_pauses = Counter(other[1:] for other in others), []
    for pause in pauses:
        left[pause[1:]] -= 1
        new_pauses += [pause] if left[pause[1:]] < 0 else []
    return new_pauses


def _other_work(was: Human, human: Human) -> list[str]:
    """Which tasks are new and which are gone, else which part of the way is another; and where the person starts."""
    before = _whole(was.tasks, human.tasks)
    tasks = _whole(human.tasks, before)
    old_names = [task.name for task in before]
    turns = [(*tasks[k:], *tasks[:k]) for k in range(len(tasks))]
    alike = [turn for turn in turns if [task.name for task in turn] == old_names]  # the same cycle
    tasks = max(alike or turns[:1], key=lambda t: sum(a.path == b.path for a, b in zip(t, before, strict=False)))
    names = [task.name for task in tasks]
    if names != old_names:
        new, gone = (
            [name for name in dict.fromkeys(a) if name not in b] for a, b in ((names, old_names), (old_names, names))
        )
        words = [f"now does {_listed(new, MOST_TASKS)}"] if new else []
        words += [f"no longer {_listed(gone, MOST_TASKS)}"] if gone else []
        words = words or ["does its tasks in another order"]
    else:
        stops = [(a.path[0], b.path[0]) for a, b in zip(before, tasks, strict=True) if a.path[0] != b.path[0]]
        words = [f"stops at {now} instead of {then}" for then, now in stops]
        old_way, way = ([name for task in cycle for name in task.path] for cycle in (before, tasks))
        words = words or _other_way(old_way, way, goal_names(human))
    start, old_start = _start(human), _start(was)
    if start != old_start:
        words.append(f"starts at {start} (was {old_start})")
    elif names == old_names and human.tasks[0].name != was.tasks[0].name:
        words.append(f"starts with {human.tasks[0].name}")
    return words


def _whole(tasks: tuple[Task, ...], known: tuple[Task, ...]) -> tuple[Task, ...]:
    """Return the tasks from place to place: who starts on the way still does the task that is cut there.

    Args:
        known: Tasks from which that one takes its name.
    """
    whole = at_places(tasks)
    if whole == tasks:
        return tasks
    names = {ends_of(task): task.name for task in known}
    first = whole[0]
    return (first.model_copy(update={"name": names.get(ends_of(first), first.name)}), *whole[1:])


def _start(human: Human) -> str:
    """Where a person starts. The cut task has no name of its own: areas name tasks, and this is a waypoint."""
    first = human.tasks[0]
    underway = at_places(human.tasks) != human.tasks
    return f"{first.path[0]} on the way to {ends_of(first)[1]}" if underway else first.path[0]


def _other_way(old: Sequence[str], way: Sequence[str], goals: Sequence[str]) -> list[str]:
    """Return which part of the way is another, from which leg on; a waypoint where two tasks meet counts once.

    Args:
        goals: Those of the way, as the person begins with them.
    """
    old, way = ([name for name, _ in itertools.groupby(names)] for names in (old, way))
    if way == old:
        return []
    same = min(len(way), len(old))
    first = next((k for k in range(same) if way[k] != old[k]), same)
    last = next((k for k in range(same - first) if way[-1 - k] != old[-1 - k]), same - first)
    parts = [names[max(0, first - 1) : len(names) - max(0, last - 1)] for names in (way, old)]
    now, then = (_listed(part, MOST_WAYPOINTS, " ") for part in parts)
    legs = zip(goals, (*goals[1:], *goals[:1]), strict=True)
    leg = next((k for k, ends in enumerate(legs, start=1) if ends == tuple(parts[0][:2])), None)
    return [f"goes {now}{f' (from leg {leg})' if leg else ''} instead of {then}"]


def _listed(names: Sequence[str], most: int, between: str = ", ") -> str:
    rest = len(names) - most
    return between.join([*names[:most], f"and {rest} more"] if rest > 0 else names)


SAME_PLACE_M = 1e-6


def waypoints_used(people: HumanConfiguration) -> tuple[str, ...]:
    """Return the names of the waypoints on people's paths, in order of first use."""
    used = (name for human in people.humans for task in human.tasks for name in task.path if name not in human.points)
    return tuple(dict.fromkeys(used))


def same_floor(mission: Mission, world: World) -> bool:
    """Return whether a mission can take place in a world: it is the one it was made in, or has the same floor.

    The waypoints that people use may differ all the same: `changes_that_matter` compares those.
    """
    if mission.world_id == world.id:
        return True
    return mission.parts is not None and mission.parts.floor == world.floor_id


def changes_that_matter(people: HumanConfiguration, mission: Mission, world: World) -> tuple[str, ...]:
    """Return the differences between the world a scenario was made in and this one that change the scenario.

    Labels, activities, other routes and waypoints that nobody uses do not matter. The robot's route is part of the
    scenario itself. Empty if the scenario means the same in both worlds.
    """
    if mission.world_id == world.id:
        return ()
    if mission.parts is None:
        reason = f"The scenario was made for {mission.world_id} and does not hold what it depends on"
        return (f"{reason}; {world.name} is {world.id}.",)
    changes = []
    if mission.parts.floor != world.floor_id:
        changes.append(f"The map or the objects of {world.name} have changed.")
    for name in waypoints_used(people):
        before, now = mission.parts.position(name), world.grid.by_name.get(name)
        if before is None:
            continue  # it never existed: the checker reports it as unknown
        if now is None:
            changes.append(f"Waypoint {name} at ({before[0]:g}, {before[1]:g}) no longer exists.")
        elif (away := math.dist(before, (now.x, now.y))) > SAME_PLACE_M:
            changes.append(f"Waypoint {name} moved by {away:{'.1g' if away < 0.1 else '.1f'}} m.")
    return tuple(changes)


REACH_M = 1.0


def migrate(
    scenario: Scenario, world: World, *, reach_m: float = REACH_M, route: Route | None = None
) -> tuple[Scenario, tuple[str, ...]]:
    """Return a scenario adapted to a world, and what changed: every waypoint becomes the nearest to where it was.

    Args:
        reach_m: A waypoint without a successor this near (metres) is an error.
        route: The route to drive instead of the one the scenario holds.

    Raises:
        InputError: A waypoint has no successor. Names all of them.
    """
    parts = scenario.mission.parts
    successors: dict[str, str] = {}
    lost, changes = [], []
    for name in waypoints_used(scenario.people):
        before = parts.position(name) if parts is not None else None
        if before is None:  # where it was is unknown, so only its name is left
            if name in world.grid.valid:
                successors[name] = name
            else:
                lost.append(name)
            continue
        near = world.grid.nearest(*before)
        away = math.dist(before, world.grid.position(near))
        if away > reach_m:
            lost.append(f"{name} ({before[0]:g}, {before[1]:g})")
            continue
        successors[name] = near
        if near != name or away > 1e-6:
            changes.append(f"Waypoint {name} becomes {near}, {away:.2f} m from where it was.")
    if lost:
        raise InputError(
            f"{world.name} has no waypoint within {reach_m:g} m of {', '.join(lost)}. Edit the paths of the scenario, "
            "or make a new one for this world.",
            code="waypoint-too-far",
        )

    def renamed(task: Task) -> Task:
        path = [successors.get(name, name) for name in task.path]
        joined = [name for name, _ in itertools.groupby(path)]
        pauses = tuple(pause.model_copy(update={"at": successors.get(pause.at, pause.at)}) for pause in task.pauses)
        return task.model_copy(update={"path": tuple(joined if len(joined) > 1 else path), "pauses": pauses})

    people = scenario.people
    humans = [human.model_copy(update={"tasks": tuple(map(renamed, human.tasks))}) for human in people.humans]
    old = scenario.mission
    same = next((candidate for candidate in world.routes if candidate.name == old.route.name), None)
    if route is None and (same is None or (same.start, same.goal) != (old.route.start, old.route.goal)):
        why = "differs now" if same is not None else "is not there"
        changes.append(f"{old.route.name} stays as it was saved; in {world.name} it {why}. To change it, give --route.")
    mission = Mission.of(
        world, route or old.route, robot=old.robot, moved=old.moved, doors=old.doors, driven=old.driven
    )
    return scenario.replace(mission=mission, people=people.model_copy(update={"humans": tuple(humans)})), tuple(changes)


def shifted(human: Human, grid: Grid, seconds: float, metres: tuple[float, float] = (0.0, 0.0)) -> Human | None:
    """Return a person who does all of it later and elsewhere; None for who cannot begin so early.

    The places of a shifted person are points of its own; a track that would begin before the run loses its first part.
    """
    dx, dy = metres

    def moved(at: tuple[float, float]) -> tuple[float, float]:
        return round(at[0] + dx, 3), round(at[1] + dy, 3)

    changes: dict[str, Any] = {}
    if human.track is not None:
        begin = human.track.start_s + seconds
        lost = max(0, math.ceil(-begin / human.track.period_s - 1e-9))
        points = tuple(moved(at) for at in human.track.points[lost:])
        if not points:
            return None
        start_s = round(begin + lost * human.track.period_s, 3)
        changes["track"] = human.track.replace(start_s=start_s, points=points)
    elif human.start_delay_s + seconds < 0.0:
        return None
    else:
        changes["start_delay_s"] = round(human.start_delay_s + seconds, 3)
    if dx or dy:
        names = dict.fromkeys(name for task in human.tasks for name in task.path)
        own = {name: name if name in human.points else f"{name} moved" for name in names}
        places = {own[name]: at for name in names if (at := human.position(name, grid)) is not None}
        changes["points"] = {name: moved(at) for name, at in places.items()}
        changes["start"] = None if human.start is None else moved(human.start)
        changes["tasks"] = tuple(
            Task(
                name=task.name,
                path=tuple(own[name] for name in task.path),
                pauses=tuple(pause.replace(at=own.get(pause.at, pause.at)) for pause in task.pauses),
            )
            for task in human.tasks
        )
    return human.replace(**changes)
