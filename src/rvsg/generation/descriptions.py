"""Descriptions of what people do and where, and the checked proposals that carry them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rvsg.generation.generator import Proposal
from rvsg.generation.people_sampler import placed
from rvsg.scenario.brief import Brief
from rvsg.scenario.repair import repair
from rvsg.scenario.rules import Finding
from rvsg.scenario.scenario import Behaviour, Human, HumanConfiguration, PersonKind, Scenario, Task, at_places, ends_of
from rvsg.scenario.validity import check
from rvsg.world.world import SolidObject, World

MOST_DESCRIBED = 6
"""At most this many people are described one by one."""
EARLIER = "(This describes an earlier configuration of the scenario; the tasks have changed since.)"
TUNED = "(Start delays, speeds, pauses and where people begin were tuned since.)"


class Described(NamedTuple):
    """The description of a scenario, and the part of it that a refinement keeps."""

    description: str
    idea: str = ""


def describe_new(humans: Sequence[Human], idea: str, *, goods: bool) -> Described:
    """Describe a new scenario by its idea and by what its people do; `goods`: in a place where goods are handled."""
    return Described(f"{idea} {describe(humans, goods=goods)}.".strip(), idea)


def describe_changed(before: Scenario, humans: Sequence[Human], *, goods: bool) -> Described:
    """Describe a changed scenario by the idea of the one before and by what its own people do."""
    idea = before.idea or before.description
    return Described(f"{idea} In this configuration {describe(humans, goods=goods)}.".strip(), idea)


def tells_of(scenario: Scenario, *, goods: bool) -> bool:
    """Return whether the description of a scenario is of this module, or there is none: it can be written anew."""
    humans, idea = scenario.people.humans, scenario.idea
    own = (describe_new(humans, idea, goods=goods), describe_changed(scenario, humans, goods=goods)) if idea else ()
    return not scenario.description or Described(scenario.description, idea) in own


def describe_tuned(before: Scenario, people: HumanConfiguration, *, goods: bool) -> Described:
    """Describe a scenario whose tasks are those of the one before and whose numbers are not; a model's text says so."""
    if not before.description:
        return Described("", before.idea)
    if tells_of(before, goods=goods):
        return describe_changed(before, people.humans, goods=goods)
    said = before.description if before.description.endswith(TUNED) else f"{before.description} {TUNED}"
    return Described(said, before.idea)


def same_work(human: Human, other: Human) -> bool:
    """Return whether two people have the same name and the same tasks, so that one text is true of both."""
    return _work(human) == _work(other)


def inherited(refined: Scenario, people: HumanConfiguration) -> Described:
    """Describe a refinement by the scenario it refines, and say so where people have other tasks than there."""
    idea = refined.idea or refined.description
    if not idea or [_work(human) for human in people.humans] == [_work(human) for human in refined.people.humans]:
        return Described(refined.description, refined.idea)
    return Described(f"{idea} {EARLIER}", idea)


def describe(humans: Sequence[Human], *, goods: bool) -> str:
    """Return who does what where, without a full stop: `Human 1 carries goods: picks at Shelf 1 for 8 s and ...`."""
    parts = []
    for k, human in enumerate(humans[:MOST_DESCRIBED]):
        mates = (each.name for each in humans[:k] if each.group is not None and each.group == human.group)
        mate = next(mates, None)
        doing = f"works together with {mate}" if mate is not None else work_of(human, goods=goods)
        if mate is None and human.behaviour is Behaviour.THREATENING:
            doing += ", and steps in front of the robot to see what it does"
        *stops, last = dict.fromkeys(worked(task) for task in at_places(human.tasks))
        parts.append(f"{human.name} {doing}: {', '.join(stops)}{' and ' if stops else ''}{last}")
    more = f", and {len(humans) - MOST_DESCRIBED} others work nearby" if len(humans) > MOST_DESCRIBED else ""
    return "; ".join(parts) + more


def worked(task: Task) -> str:
    """Return what is done where a task ends (`sorts at Boxes 1 for 12 s`); where it starts if that is nothing."""
    (start, end), work = ends_of(task), task.work
    if work is None or work.doing is None:
        return start
    return f"{work.doing.words} at {end} for {work.duration_s:.0f} s"


def work_of(human: Human, *, goods: bool) -> str:
    """Return the work that fits a person: by what they push, pauses, speed (m/s), number of places, and goods there."""
    if human.trolley is not None:
        return "pushes a trolley"
    if human.kind is PersonKind.WHEELCHAIR:
        return "goes by wheelchair"
    if human.kind is PersonKind.CHILD:
        return "is a child who goes about"
    if any(task.stops for task in human.tasks):
        works = "checks goods on the way and stops to note what is missing", "walks about and stops on the way"
    elif human.speed_m_s <= 0.5:
        works = "moves a heavy load step by step", "walks slowly, step by step"
    elif human.speed_m_s <= 0.8:
        works = "carries a heavy load at a slow walk", "walks at a slow pace"
    elif len(at_places(human.tasks)) == 2:
        works = "sorts and tidies, going to and fro", "goes to and fro"
    elif human.speed_m_s >= 1.0:
        works = "carries goods at a brisk walk", "walks round at a brisk pace"
    else:
        works = "carries goods at a steady walk", "walks round at a steady pace"
    return works[0 if goods else 1]


def _work(human: Human) -> tuple[str, list[str]]:
    return human.name, [task.name for task in human.tasks]


def answer(
    people: HumanConfiguration,
    brief: Brief,
    world: World,
    *,
    generator: str,
    described: Described | None,
    reasoning: str = "",
    extra: dict[str, object] | None = None,
    moved: Sequence[SolidObject] = (),
) -> Proposal:
    """Return the proposal of a configuration: with a scenario where it is valid or can be repaired, else with problems.

    Without `described` a refinement is described by the scenario it refines.
    """
    mission, place = placed(brief.mission, world, moved)
    first = check(people, mission, place)
    repaired, repairs = repair(people, mission, place) if first else (people, ())
    left = check(repaired, mission, place) if first else ()
    return Proposal(
        generator=generator,
        scenario=None if left else described_scenario(brief, repaired, described, moved),
        reasoning=reasoning,
        first_findings=first,
        problems=left,
        repairs=repairs,
        extra=extra or {},
    )


def described_scenario(
    brief: Brief, people: HumanConfiguration, described: Described | None, moved: Sequence[SolidObject] = ()
) -> Scenario:
    """Return the scenario of valid people; without a description it has that of the scenario it refines, if any."""
    if described is None:
        described = inherited(brief.feedback.scenario, people) if brief.feedback else Described("")
    mission = brief.mission.replace(moved=(*brief.mission.moved, *moved)) if moved else brief.mission
    return Scenario(mission=mission, people=people, description=described.description, idea=described.idea)


def nowhere_to_walk(world: World, *, generator: str) -> Proposal:
    """The proposal of a generator that finds no two joined waypoints in the world: one problem says so."""
    problem = Finding(
        rule="unknown-area",
        reason=f"{world.name} has fewer than two waypoints between which people can walk.",
        suggestion="Label areas with waypoints that are joined by free hops.",
    )
    return Proposal(generator=generator, scenario=None, problems=(problem,))
