"""Describes in one line what differs between two configurations."""

from __future__ import annotations

from rvsg.scenario.scenario import Human, HumanConfiguration

MOST_PAUSES = 3
"""More pauses than this are summed up."""


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
    if [task.name for task in human.tasks] != [task.name for task in was.tasks]:
        words.append("does other tasks")
    elif [task.path for task in human.tasks] != [task.path for task in was.tasks]:
        words.append("takes another way")
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
