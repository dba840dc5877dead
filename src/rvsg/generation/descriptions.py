"""Describe what people do and where, from their tasks: for generators whose scenarios no model describes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rvsg.generation.people_sampler import at_places, ends_of
from rvsg.scenario.bodies import PersonKind
from rvsg.scenario.scenario import Behaviour, Human, HumanConfiguration, Scenario

MOST_DESCRIBED = 6
"""At most this many people are described one by one."""
EARLIER = "(This describes an earlier configuration of the scenario; the tasks have changed since.)"


class Described(NamedTuple):
    """The description of a scenario, and the part of it that a refinement keeps."""

    description: str
    idea: str = ""


def describe_new(humans: Sequence[Human], idea: str, *, goods: bool = True) -> Described:
    """Describe a new scenario by its idea and by what its people do; `goods`: in a place where goods are handled."""
    return Described(f"{idea} {describe(humans, goods=goods)}.".strip(), idea)


def describe_changed(before: Scenario, humans: Sequence[Human], *, goods: bool = True) -> Described:
    """Describe a changed scenario by the idea of the one before and by what its own people do."""
    idea = before.idea or before.description
    return Described(f"{idea} In this configuration {describe(humans, goods=goods)}.".strip(), idea)


def inherited(refined: Scenario, people: HumanConfiguration) -> Described:
    """Describe a refinement that does not describe itself by the scenario it refines.

    Where people have other tasks than there, the text says so.
    """
    idea = refined.idea or refined.description
    if not idea or [_work(human) for human in people.humans] == [_work(human) for human in refined.people.humans]:
        return Described(refined.description, refined.idea)
    return Described(f"{idea} {EARLIER}", idea)


def describe(humans: Sequence[Human], *, goods: bool = True) -> str:
    """Return who does what where, without a full stop: `Human 1 carries goods: Shelf 1, Boxes 3 and Area 2; ...`."""
    parts = [f"{human.name} {_doing(human, humans[:k], goods)}: {_where(human)}" for k, human in enumerate(humans)]
    more = f", and {len(humans) - MOST_DESCRIBED} others work nearby" if len(humans) > MOST_DESCRIBED else ""
    return "; ".join(parts[:MOST_DESCRIBED]) + more


def _doing(human: Human, before: Sequence[Human], goods: bool) -> str:
    mate = next((each.name for each in before if each.group is not None and each.group == human.group), None)
    if mate is not None:
        return in_company_of(mate)
    provoking = human.behaviour is Behaviour.THREATENING
    return work_of(human, goods=goods) + (", and steps in front of the robot to see what it does" if provoking else "")


def in_company_of(name: str) -> str:
    """Return what somebody does who does a task together with another."""
    return f"works together with {name}"


def work_of(human: Human, *, goods: bool = True) -> str:
    """Return the work that fits a person: by what they push, pauses, speed (m/s) and the number of places."""
    if human.trolley is not None:
        return "pushes a trolley"
    if human.kind is PersonKind.WHEELCHAIR:
        return "goes by wheelchair"
    if human.kind is PersonKind.CHILD:
        return "is a child who goes about"
    if not goods:
        return _errand(human)
    if any(task.pauses for task in human.tasks):
        return "checks goods on the way and stops to note what is missing"
    if human.speed_m_s <= 0.5:
        return "moves a heavy load step by step"
    if human.speed_m_s <= 0.8:
        return "pushes a loaded trolley at a slow walk"
    if len(at_places(human.tasks)) == 2:
        return "sorts and tidies, going to and fro"
    return f"carries goods at a {'brisk' if human.speed_m_s >= 1.0 else 'steady'} walk"


def _errand(human: Human) -> str:
    """Return what somebody does in a place without goods, by pauses and speed (m/s)."""
    if any(task.pauses for task in human.tasks):
        return "walks about and stops on the way"
    if human.speed_m_s <= 0.5:
        return "walks slowly, step by step"
    if human.speed_m_s <= 0.8:
        return "walks at a slow pace"
    if len(at_places(human.tasks)) == 2:
        return "goes to and fro"
    return f"walks round at a {'brisk' if human.speed_m_s >= 1.0 else 'steady'} pace"


def _work(human: Human) -> tuple[str, list[str]]:
    return human.name, [task.name for task in human.tasks]


def _where(human: Human) -> str:
    stops = list(dict.fromkeys(ends_of(task)[0] for task in at_places(human.tasks)))
    return f"{', '.join(stops[:-1])} and {stops[-1]}" if len(stops) > 1 else stops[0]
