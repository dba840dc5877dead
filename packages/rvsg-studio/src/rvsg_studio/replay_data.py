"""Data of floor plans and replays for pages that draw them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rvsg.app.campaign import Campaign
from rvsg.app.runs import RunSet
from rvsg.campaign.attempt import Attempt
from rvsg.campaign.runner import Measuring
from rvsg.core.errors import InputError
from rvsg.generation.generator import Proposal
from rvsg.report.facts import AttemptFacts, facts_of, run_facts
from rvsg.report.floors import area_colours, floor_svg
from rvsg.report.replay import data_of
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.world import World


def floor_of(world: World, *, areas: bool = True) -> dict[str, Any]:
    """Return the floor plan for an editor that draws over it: SVG parts, in which everything is escaped.

    Returns:
        `view_box`, `shapes`, `names` and the `style` of the areas as SVG; `matrix` from world metres to its units.
    """
    plan = floor_plan(world, areas=areas, tooltips=False)
    return {
        "view_box": plan.view_box,
        "matrix": [float(v) for v in plan.matrix[7:-1].replace(",", " ").split()],
        "shapes": plan.shapes,
        "names": plan.names,
        "style": area_colours(world, plan if areas else floor_plan(world, tooltips=False)),
    }


def related(attempts: Sequence[Attempt], index: int) -> list[Attempt]:
    """Return an attempt with those that tell more of it: its confirmation or candidate, and runs with fewer people.

    Raises:
        InputError: there is no such attempt, or it has no runs.
    """
    chosen = next((a for a in attempts if a.index == index and a.measurements), None)
    if chosen is None:
        raise InputError(f"There is no attempt {index} with runs in this campaign.")
    tied = {chosen.confirms} if chosen.confirms is not None else set()
    others = [
        a
        for a in attempts
        if a is not chosen
        and a.measurements
        and (a.index in tied or a.confirms == index or (a.purpose == "baseline" and chosen.purpose == "confirmation"))
    ]
    return [chosen, *others]


def replay_of_attempts(campaign: Campaign, attempts: Iterable[Attempt]) -> dict[str, Any]:
    """Return the data of the replay component for stored attempts of a campaign, in this order."""
    world = campaign.world
    with campaign.reading() as ledger:
        facts = facts_of(attempts, campaign.requirement, world, ledger.run)
    return _data(facts, campaign.plan.mission, campaign.requirement, world)


def replay_of_runs(runs: RunSet, requirement: Requirement) -> dict[str, Any]:
    """Return the data of the replay component for runs that belong to no campaign, the worst first.

    Raises:
        InputError: the scenario or the world of the runs is not known.
    """
    scenario, world = runs.scenario, runs.world
    if scenario is None or world is None:
        raise InputError("A replay needs the scenario and the world of the runs.")
    measuring = Measuring(requirement, world)
    measured = tuple(measuring.measure(run) for run in runs)
    people = len(scenario.people.humans)
    brief = Brief(mission=scenario.mission, requirement=requirement, seed=0, humans=max(1, people))
    attempt = Attempt(
        campaign="by hand",
        index=0,
        strategy="by hand",
        brief=brief,
        proposal=Proposal(generator="by hand", scenario=scenario),
        measurements=measured,
        verdict=measuring.judge(measured),
    )
    each = (run_facts(run, m, requirement, world, scenario) for run, m in zip(runs, measured, strict=True))
    facts = AttemptFacts(attempt=attempt, runs=tuple(each))
    return _data([facts], scenario.mission, requirement, world)


def _data(facts: Iterable[AttemptFacts], mission: Mission, requirement: Requirement, world: World) -> dict[str, Any]:
    """Return the data of the replay component, with the floor plan as SVG that `mount` reads."""
    floor = floor_plan(world, tooltips=False)
    data = data_of(facts, mission=mission, requirement=requirement, world=world, floor=floor)
    return data | {"floor": floor_svg(world)}
