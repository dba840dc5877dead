"""From people to a Proposal: checked, repaired, checked again. Every generator's configuration goes through here."""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.generation.generator import Call, Proposal
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Human, HumanConfiguration, Scenario
from rvsg.scenario.validity import Finding, Repair, check, repair
from rvsg.world.world import World

EARLIER = "(This describes an earlier configuration of the scenario; the tasks have changed since.)"


def answer(
    people: HumanConfiguration,
    brief: Brief,
    world: World,
    *,
    generator: str,
    description: str,
    reasoning: str = "",
    repairs: Sequence[Repair] = (),
    calls: Sequence[Call] = (),
    extra: dict[str, object] | None = None,
) -> Proposal:
    """The proposal of a configuration: with a scenario where it is valid or can be repaired, else with problems.

    `repairs` are what the generator has changed before. A refinement without a description inherits one.
    """
    first = check(people, brief.mission, world)
    mended, changes = repair(people, brief.mission, world) if first else (people, ())
    left = check(mended, brief.mission, world) if first else ()
    description = description or inherited_description(brief, mended)
    scenario = None if left else Scenario(mission=brief.mission, people=mended, description=description)
    return Proposal(
        generator=generator,
        scenario=scenario,
        reasoning=reasoning,
        first_findings=first,
        problems=left,
        repairs=(*repairs, *changes),
        calls=tuple(calls),
        extra=extra or {},
    )


def inherited_description(brief: Brief, people: HumanConfiguration) -> str:
    """What a refinement that does not describe itself is described by: the configuration it refines.

    Where other tasks are done than there, the text says so: it may tell of work that nobody does any more.
    """
    if brief.feedback is None:
        return ""
    refined = brief.feedback.scenario
    same = [_work(human) for human in people.humans] == [_work(human) for human in refined.people.humans]
    if same or not refined.description or refined.description.endswith(EARLIER):
        return refined.description
    return f"{refined.description} {EARLIER}"


def _work(human: Human) -> tuple[str, list[str]]:
    return human.name, [task.name for task in human.tasks]


def nowhere_to_walk(world: World, *, generator: str) -> Proposal:
    """The proposal of a generator that finds no two joined waypoints in the world: one problem says so."""
    problem = Finding(
        rule="unknown-area",
        reason=f"{world.name} has fewer than two waypoints between which people can walk.",
        suggestion="Label areas with waypoints that are joined by free hops.",
    )
    return Proposal(generator=generator, scenario=None, problems=(problem,))
