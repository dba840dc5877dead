"""Describe what people do and where, for the scenarios of the offline generators."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from rvsg.generation.people_sampler import HAND_IN_HAND, ROLES, at_places, ends_of
from rvsg.scenario.scenario import Human, Scenario

MOST_DESCRIBED = 6
"""At most this many people are described one by one."""

NOW = "In this configuration"


def describe(humans: Sequence[Human], doing: Mapping[str, str]) -> str:
    """What people do and where, without a full stop: `Human 1 carries goods: Shelf 1, Boxes 3 and Area 2; ...`."""
    parts = [f"{human.name} {doing[human.name]}: {_where(human)}" for human in humans[:MOST_DESCRIBED]]
    more = f", and {len(humans) - MOST_DESCRIBED} others work nearby" if len(humans) > MOST_DESCRIBED else ""
    return "; ".join(parts) + more


def describe_changed(before: Scenario, humans: Sequence[Human], changes: Sequence[str]) -> str:
    """The description of a refined scenario, true of the changed people.

    `changes` are the words of the changes; a person who was given another way of working is described with it. Where
    the description does not tell of a person in our words, as one from a model or a user, a sentence is added.
    """
    description, added = before.description, []
    known = {human.name: human for human in before.people.humans}
    for human in humans[:MOST_DESCRIBED]:
        was, where = known.get(human.name), _where(human)
        doing = next((r.doing for r in reversed(ROLES) if f"{human.name} {r.doing}" in changes), None)
        mate = f"{human.name} {HAND_IN_HAND}"
        doing = next((c.removeprefix(f"{human.name} ") for c in reversed(changes) if c.startswith(mate)), doing)
        found = _found(description, was) if was is not None else None
        if human.group is None and found is not None and found[1].startswith(HAND_IN_HAND):
            doing = doing if doing and not doing.startswith(HAND_IN_HAND) else "works"
        if before.description and was is not None and doing is None and _where(was) == where:
            continue
        if found is None:
            added.append(f"{human.name} {doing or 'works'}: {where}")
        else:
            part = f"{human.name} {doing or found[1]}: {where}"
            description = description[: found.start()] + part + description[found.end() :]
    if not added:
        return description
    parts = "; ".join(added)
    if not description:
        return f"{parts}."
    if NOW in description:
        return f"{description.removesuffix('.')}; {parts}."
    return f"{description} {NOW} {parts}.".strip()


def _found(description: str, human: Human) -> re.Match[str] | None:
    """Return where a description mentions a person as `describe` does; the group is what they do."""
    return re.search(f"{re.escape(human.name)} ([^:;]+): {re.escape(_where(human))}", description)


def _where(human: Human) -> str:
    stops = list(dict.fromkeys(ends_of(task)[0] for task in at_places(human.tasks)))
    return f"{', '.join(stops[:-1])} and {stops[-1]}" if len(stops) > 1 else stops[0]
