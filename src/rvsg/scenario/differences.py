"""Describes in one line what differs between two configurations."""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.scenario.scenario import Human, HumanConfiguration

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
    if human.tasks[0].path[:1] != was.tasks[0].path[:1]:
        words.append(f"starts at {human.tasks[0].path[0]} (was {was.tasks[0].path[0]})")
    pauses, before = ([(p.at, p.duration_s) for t in h.tasks for p in t.pauses] for h in (human, was))
    if pauses != before:
        listed = ", ".join(f"{s:g} s at {at}" for at, s in pauses) or "nowhere"
        many = len(pauses) > MOST_PAUSES
        words.append(
            f"pauses {len(pauses)} times, {sum(s for _, s in pauses):g} s in all" if many else f"pauses {listed}"
        )
    return words


def _other_work(was: Human, human: Human) -> list[str]:
    """Which tasks are new and which are gone, else which part of the way is another."""
    tasks, before = [task.name for task in human.tasks], [task.name for task in was.tasks]
    if tasks != before:
        new, gone = (
            [name for name in dict.fromkeys(a) if name not in b] for a, b in ((tasks, before), (before, tasks))
        )
        words = [f"now does {_listed(new, MOST_TASKS)}"] if new else []
        words += [f"no longer {_listed(gone, MOST_TASKS)}"] if gone else []
        return words or ["does its tasks in another order"]
    way, old = _way(human), _way(was)
    if way == old:
        return []
    first = next((k for k, (a, b) in enumerate(zip(way, old, strict=False)) if a != b), min(len(way), len(old)))
    same = min(len(way), len(old)) - first
    last = next((k for k in range(same) if way[-1 - k] != old[-1 - k]), same)
    parts = (each[max(0, first - 1) : len(each) - max(0, last - 1)] for each in (way, old))
    now, then = (_listed(part, MOST_WAYPOINTS, " ") for part in parts)
    return [f"goes {now} instead of {then}"]


def _way(human: Human) -> list[str]:
    """The waypoints of all tasks in walking order, none twice in a row."""
    names = [name for task in human.tasks for name in task.path]
    return [name for k, name in enumerate(names) if not k or name != names[k - 1]]


def _listed(names: Sequence[str], most: int, between: str = ", ") -> str:
    rest = len(names) - most
    return between.join([*names[:most], f"and {rest} more"] if rest > 0 else names)
