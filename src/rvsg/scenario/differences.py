"""Describes in one line what differs between two configurations."""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.scenario.scenario import Human, HumanConfiguration, Task, at_places, ends_of

MOST_PAUSES = 3
"""More pauses than this are summed up."""
MOST_TASKS, MOST_WAYPOINTS = 4, 8
"""More tasks, or waypoints of a way, than this are cut off."""


def differences(before: HumanConfiguration, after: HumanConfiguration) -> str:
    """Return what changed from one configuration to another; `no change` where they are equal."""
    known = {human.name: human for human in before.humans}
    found = []
    for human in after.humans:
        was = known.pop(human.name, None)
        words = _changed(was, human) if was is not None else ["is new"]
        if words:
            found.append(f"{human.name} {', '.join(words)}")
    found += [f"without {name}" for name in known]
    return "; ".join(found) or "no change"


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
    pauses, before = ([(p.at, p.duration_s) for t in h.tasks for p in t.pauses] for h in (human, was))
    if sorted(pauses) != sorted(before):
        listed = ", ".join(f"{s:g} s at {at}" for at, s in pauses) or "nowhere"
        many = len(pauses) > MOST_PAUSES
        words.append(
            f"pauses {len(pauses)} times, {sum(s for _, s in pauses):g} s in all" if many else f"pauses {listed}"
        )
    return words


def _other_work(was: Human, human: Human) -> list[str]:
    """Which tasks are new and which are gone, else which part of the way is another; and where the person starts."""
    before = _whole(was.tasks, human.tasks)
    tasks = _turned(_whole(human.tasks, before), before)
    names, old_names = _names(tasks), _names(before)
    if names != old_names:
        new, gone = (
            [name for name in dict.fromkeys(a) if name not in b] for a, b in ((names, old_names), (old_names, names))
        )
        words = [f"now does {_listed(new, MOST_TASKS)}"] if new else []
        words += [f"no longer {_listed(gone, MOST_TASKS)}"] if gone else []
        words = words or ["does its tasks in another order"]
    else:
        words = _other_way(_way(before), _way(tasks))
    start, old_start = _start(human), _start(was)
    if start != old_start:
        words.append(f"starts at {start} (was {old_start})")
    elif names == old_names and human.tasks[0].name != was.tasks[0].name:
        words.append(f"starts with {human.tasks[0].name}")
    return words


def _whole(tasks: tuple[Task, ...], known: tuple[Task, ...]) -> tuple[Task, ...]:
    """The tasks from place to place: who starts on the way still does the task that is cut there.

    Args:
        known: Tasks from which that one takes its name.
    """
    whole = at_places(tasks)
    if whole == tasks:
        return tasks
    names = {ends_of(task): task.name for task in known}
    first = whole[0]
    return (first.model_copy(update={"name": names.get(ends_of(first), first.name)}), *whole[1:])


def _turned(tasks: tuple[Task, ...], before: tuple[Task, ...]) -> tuple[Task, ...]:
    """The cycle of tasks from the task with which an earlier cycle begins, where both are the same cycle."""
    turns = [(*tasks[k:], *tasks[:k]) for k in range(len(tasks))]
    alike = [turn for turn in turns if _names(turn) == _names(before)]
    return max(alike or turns[:1], key=lambda turn: sum(a.path == b.path for a, b in zip(turn, before, strict=False)))


def _names(tasks: Sequence[Task]) -> list[str]:
    return [task.name for task in tasks]


def _start(human: Human) -> str:
    """Where a person starts. The cut task has no name of its own: areas name tasks, and this is a waypoint."""
    first = human.tasks[0]
    underway = at_places(human.tasks) != human.tasks
    return f"{first.path[0]} on the way to {ends_of(first)[1]}" if underway else first.path[0]


def _other_way(old: Sequence[str], way: Sequence[str]) -> list[str]:
    """Which part of the way is another."""
    if way == old:
        return []
    first = next((k for k, (a, b) in enumerate(zip(way, old, strict=False)) if a != b), min(len(way), len(old)))
    same = min(len(way), len(old)) - first
    last = next((k for k in range(same) if way[-1 - k] != old[-1 - k]), same)
    parts = (each[max(0, first - 1) : len(each) - max(0, last - 1)] for each in (way, old))
    now, then = (_listed(part, MOST_WAYPOINTS, " ") for part in parts)
    return [f"goes {now} instead of {then}"]


def _way(tasks: Sequence[Task]) -> list[str]:
    """The waypoints of all tasks in walking order, none twice in a row."""
    names = [name for task in tasks for name in task.path]
    return [name for k, name in enumerate(names) if not k or name != names[k - 1]]


def _listed(names: Sequence[str], most: int, between: str = ", ") -> str:
    rest = len(names) - most
    return between.join([*names[:most], f"and {rest} more"] if rest > 0 else names)
