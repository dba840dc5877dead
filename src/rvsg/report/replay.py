"""The data of the replay on a campaign's page."""

from __future__ import annotations

from importlib import resources
from typing import Any

from rvsg.campaign.plan import Plan
from rvsg.report.facts import AttemptFacts, RunFacts
from rvsg.report.payload import ReplayGroup, ReplayRun, replay_payload
from rvsg.report.robots import footprint_of
from rvsg.report.shown import Shown, group_label, in_order
from rvsg.report.summary import counted
from rvsg.report.tables import manner
from rvsg.report.words import quantity, untimed


def component() -> str:
    """Return the JavaScript of the replay component; `static/replay.js` says how to mount it."""
    return (resources.files("rvsg.report") / "static" / "replay.js").read_text(encoding="utf-8")


def styles() -> str:
    """Return the styles of the replay component, with the colours that they use."""
    folder = resources.files("rvsg.report") / "templates"
    return "\n".join((folder / name).read_text(encoding="utf-8") for name in ("plan.css", "replay.css"))


def replay_data(shown: Shown) -> dict[str, Any]:
    """Return the data of the replay: the runs of every configuration, the subject of the page first."""
    groups = []
    for facts in in_order(shown):
        scenario = facts.attempt.proposal.scenario
        groups.append(
            ReplayGroup(
                id=str(facts.attempt.index),
                label=f"{group_label(facts)[:1].upper()}{group_label(facts)[1:]} ({counted(len(facts.runs), 'run')})",
                purpose=facts.attempt.purpose,
                status=facts.attempt.verdict.status.value if facts.attempt.verdict else "",
                manners={human.name: manner(human) for human in scenario.people.humans} if scenario else {},
                runs=tuple(_replay_run(run) for run in _worst_first(facts, shown.plan)),
            )
        )
    return replay_payload(
        groups,
        mission=shown.plan.mission,
        requirement=shown.plan.requirement,
        waypoints=[(w.name, w.x, w.y) for w in shown.world.grid.waypoints if w.human],
        matrix=shown.floor.matrix,
        quantity=f"{quantity(shown.plan.requirement)} so far",
        footprint=lambda run: footprint_of(run, shown.plan.mission.robot_record),
    )


def _worst_first(facts: AttemptFacts, plan: Plan) -> list[RunFacts]:
    def key(run: RunFacts) -> float:
        value = run.measurement.objective
        return -plan.requirement.badness(value) if value is not None else float("inf")

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
        moments=[(sentence.time_s, untimed(sentence)) for sentence in run.story],
    )
