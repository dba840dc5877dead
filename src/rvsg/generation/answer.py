"""From people to a Proposal: checked, repaired, checked again. Every generator's configuration goes through here."""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.generation.actors import placed
from rvsg.generation.descriptions import Described, inherited
from rvsg.generation.generator import Call, Proposal
from rvsg.scenario.brief import Brief
from rvsg.scenario.repair import repair
from rvsg.scenario.rules import Finding, Repair
from rvsg.scenario.scenario import HumanConfiguration, Scenario
from rvsg.scenario.validity import check
from rvsg.world.world import SolidObject, World


def answer(
    people: HumanConfiguration,
    brief: Brief,
    world: World,
    *,
    generator: str,
    described: Described | None,
    reasoning: str = "",
    repairs: Sequence[Repair] = (),
    calls: Sequence[Call] = (),
    extra: dict[str, object] | None = None,
    moved: Sequence[SolidObject] = (),
) -> Proposal:
    """Return the proposal of a configuration: with a scenario where it is valid or can be repaired, else with problems.

    Args:
        described: The scenario's description; None: a refinement is described by the scenario that it refines.
        repairs: What the generator has changed before.
        moved: Objects that the generator moved into the world.
    """
    mission, place = placed(brief.mission, world, moved)
    first = check(people, mission, place)
    repaired, changes = repair(people, mission, place) if first else (people, ())
    left = check(repaired, mission, place) if first else ()
    return Proposal(
        generator=generator,
        scenario=None if left else described_scenario(brief, repaired, described, moved),
        reasoning=reasoning,
        first_findings=first,
        problems=left,
        repairs=(*repairs, *changes),
        calls=tuple(calls),
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
