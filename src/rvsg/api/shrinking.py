"""Find the smallest scenario that violates a requirement about as often."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rvsg.api.requirements import load_requirement
from rvsg.api.scenarios import check_valid
from rvsg.api.simulating import ignore, simulator_of
from rvsg.api.worlds import world_of
from rvsg.campaign.measuring import Measuring
from rvsg.campaign.parallel import Simulations
from rvsg.campaign.shrink import Shrinking, Shrunk, Simplification
from rvsg.core.plugins import Spec
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.protocol import Simulator
from rvsg.world.world import World

__all__ = ["Shrunk", "Simplification", "shrink"]


def shrink(
    scenario: Scenario,
    requirement: str | Path | Requirement = "R1",
    *,
    repeats: int = 12,
    confirmations: int = 20,
    keep: float = 0.8,
    seed: int = 0,
    jobs: int = 1,
    simulator: str | Spec | Simulator = "embedded",
    world: World | str | Path | None = None,
    on_step: Callable[[Simplification], None] = ignore,
    on_message: Callable[[str], None] = ignore,
) -> Shrunk:
    """Find the smallest scenario that violates a requirement about as often.

    People, tasks, pauses and delays are removed one by one as long as the violations stay.

    Args:
        repeats: runs of every simpler scenario.
        confirmations: runs with new seeds of the original and of the smallest.
        keep: the share of the original's violations that has to stay.
        simulator: a name, a Spec, or an instance, which stays open.

    Raises:
        InvalidScenario: the scenario breaks a rule.
        InputError: the requirement has no limit, or the scenario does not violate it.
    """
    place = world_of(scenario.mission, world)
    check_valid(scenario, place)
    asked = load_requirement(requirement, scenario.mission.route)
    measuring = Measuring(asked, place)
    with (
        simulator_of(simulator, scenario=scenario, on_message=on_message) as made,
        Simulations(made, place, measure=measuring.judged, jobs=jobs, notify=on_message) as simulations,
    ):
        return Shrinking(
            requirement=asked,
            simulations=simulations,
            judge=measuring.judge,
            seed=seed,
            repeats=repeats,
            confirmations=confirmations,
            keep=keep,
            watch=on_step,
        )(scenario)
