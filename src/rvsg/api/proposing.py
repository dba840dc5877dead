"""Ask a generator for one scenario."""

from __future__ import annotations

from pathlib import Path

from rvsg.api.config import CampaignConfig
from rvsg.api.records import WORLD_FOLDER, validated, with_world_folder
from rvsg.api.requirements import load_requirement
from rvsg.api.scenarios import check_route
from rvsg.api.wiring import Wired
from rvsg.api.worlds import as_world, folder_of
from rvsg.core import plugins
from rvsg.core.inputs import parse_json, read_text
from rvsg.core.plugins import Spec
from rvsg.evaluation.aims import aim_of, moved_by
from rvsg.generation.generator import Generator, Proposal
from rvsg.scenario.brief import Brief, Feedback
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission
from rvsg.world.world import Route, World

__all__ = ["Feedback", "Proposal", "make_generator", "proposal_json", "propose", "propose_as", "read_proposal"]


def make_generator(given: str | Spec | Generator) -> Generator:
    """Return a generator given by name, by Spec or by itself."""
    if isinstance(given, str | Spec):
        spec = Spec.of(given)
        generator: Generator = plugins.make("generator", spec.name, spec.options)
    else:
        generator = given
    plugins.check_complete("generator", generator, Generator)
    return generator


def propose(
    world: World | str | Path,
    route: Route | str,
    requirement: str | Path | Requirement | None = "R1",
    *,
    generator: str | Spec | Generator = "heuristic",
    humans: int = CampaignConfig.model_fields["humans"].default,
    seed: int = 0,
    feedback: Feedback | None = None,
) -> Proposal:
    """Ask a generator for one scenario.

    Args:
        requirement: what the scenario should violate; None: none.
        feedback: what an earlier scenario measured; the proposal refines that one.

    Returns:
        The proposal. Its `scenario` is None if nothing valid came of it; `problems` says why.
    """
    place = as_world(world)
    taken = place.route(route) if isinstance(route, str) else route
    check_route(taken, place)
    brief = brief_of(
        Mission.of(place, taken),
        load_requirement(requirement, taken) if requirement is not None else None,
        humans=humans,
        seed=seed,
        feedback=feedback,
    )
    return make_generator(generator).propose(brief, place)


def brief_of(
    mission: Mission, requirement: Requirement | None, *, humans: int, seed: int, feedback: Feedback | None
) -> Brief:
    """Return the brief for one scenario outside a campaign."""
    return Brief(
        mission=mission,
        requirement=requirement,
        aim=aim_of(requirement),
        moved_by=moved_by(requirement) if requirement else "",
        kind="refine" if feedback else "new",
        humans=humans,
        seed=seed,
        configuration_index=1 if feedback else 0,
        feedback=feedback,
    )


def propose_as(wired: Wired, *, unguided: bool = False, feedback: Feedback | None = None) -> Proposal:
    """Ask the generator of checked settings for one scenario."""
    plan = wired.plan
    requirement = None if unguided else plan.requirement
    brief = brief_of(plan.mission, requirement, humans=plan.humans, seed=plan.seed, feedback=feedback)
    return wired.generator.propose(brief, wired.world)


def read_proposal(path: Path) -> Proposal:
    """Return a proposal from its file; FileError names everything that is wrong."""
    value = parse_json(read_text(path), path)
    if isinstance(value, dict):
        value.pop(WORLD_FOLDER, None)
    return validated(path, value, Proposal)


def proposal_json(proposal: Proposal) -> str:
    """Return a proposal as JSON, with the folder of its world beside it where that is not a shipped one."""
    scenario = proposal.scenario
    folder = folder_of(scenario.mission.world_id) if scenario is not None else None
    return with_world_folder(proposal.to_json(), folder)
