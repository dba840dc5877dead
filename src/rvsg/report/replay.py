"""The data of the replay on a campaign's page."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import resources
from typing import Any

from rvsg.evaluation.wording import counted
from rvsg.generation.people_sampler import added
from rvsg.report.facts import AttemptFacts, RunFacts
from rvsg.report.payload import ReplayGroup, ReplayRun, replay_payload
from rvsg.report.robots import footprint_of
from rvsg.report.shown import Shown, group_label, in_order
from rvsg.report.tables import manner
from rvsg.report.words import quantity, unbroken, untimed
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission
from rvsg.world.drawing.svg import FloorPlan
from rvsg.world.world import World


def component() -> str:
    """Return the JavaScript of the replay and its traces; the files in `static` say how to use them."""
    folder = resources.files("rvsg.report") / "static"
    return "\n".join((folder / name).read_text(encoding="utf-8") for name in ("replay.js", "trace.js"))


def styles() -> str:
    """Return the styles of the replay component, with the colours that they use."""
    folder = resources.files("rvsg.report") / "templates"
    return "\n".join((folder / name).read_text(encoding="utf-8") for name in ("plan.css", "replay.css"))


def look() -> str:
    """Return the style sheet of the pages, that of the replay component included."""
    folder = resources.files("rvsg.report") / "templates"
    return "".join((folder / name).read_text(encoding="utf-8") for name in ("plan.css", "look.css", "replay.css"))


def replay_data(shown: Shown) -> dict[str, Any]:
    """Return the data of the replay: the runs of every configuration, the subject of the page first."""
    plan = shown.plan
    return data_of(
        in_order(shown), mission=plan.mission, requirement=plan.requirement, world=shown.world, floor=shown.floor
    )


def data_of(
    shown: Iterable[AttemptFacts], *, mission: Mission, requirement: Requirement, world: World, floor: FloorPlan
) -> dict[str, Any]:
    """Return the data of the replay component for the runs of these configurations, in this order."""
    groups = []
    for facts in shown:
        scenario = facts.attempt.proposal.scenario
        groups.append(
            ReplayGroup(
                id=str(facts.attempt.index),
                label=f"{group_label(facts)[:1].upper()}{group_label(facts)[1:]} ({counted(len(facts.runs), 'run')})",
                purpose=facts.attempt.purpose,
                status=facts.attempt.verdict.status.value if facts.attempt.verdict else "",
                manners={human.name: manner(human) for human in scenario.people.humans} if scenario else {},
                runs=tuple(_replay_run(run) for run in _worst_first(facts, requirement)),
                moved=tuple(thing.footprint for thing in added(mission, scenario.mission)) if scenario else (),
            )
        )
    return replay_payload(
        groups,
        mission=mission,
        requirement=requirement,
        waypoints=[(w.name, w.x, w.y) for w in world.grid.waypoints if w.human],
        matrix=floor.matrix,
        quantity=f"{quantity(requirement)} so far",
        footprint=lambda run: footprint_of(run, mission.robot_record),
        doors=world.moving_doors,
    )


def _worst_first(facts: AttemptFacts, requirement: Requirement) -> list[RunFacts]:
    def key(run: RunFacts) -> float:
        value = run.measurement.objective
        return -requirement.badness(value) if value is not None else float("inf")

    return sorted(facts.runs, key=key)


def _replay_run(run: RunFacts) -> ReplayRun:
    return ReplayRun(
        run=run.run,
        objective=run.measurement.objective,
        violated=run.violated,
        curve=run.curve,
        opens_s=run.decisive_s,
        note=run.note,
        lanes=run.lanes,
        moments=[(sentence.time_s, unbroken(untimed(sentence))) for sentence in run.story],
    )
