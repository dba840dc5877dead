"""Contents of the report page: attempts, tables and facts of runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from rvsg.evaluation.verdict import metres, number, outcome_in_words
from rvsg.findings.ranking import best_attempt, confirmed_candidate
from rvsg.report.answer_row import status_of
from rvsg.report.result import CampaignAnswer, Result
from rvsg.report.run_facts import AttemptFacts, facts_of
from rvsg.report.words import in_short, shown_at
from rvsg.runs.attempt import Attempt
from rvsg.scenario.scenario import Attention, Behaviour, Human
from rvsg.world.drawing.svg import FloorPlan, floor_plan


@dataclass(frozen=True, eq=False)
class PageContents:
    """What the parts of a page share."""

    result: Result
    answer: CampaignAnswer

    @cached_property
    def facts(self) -> list[AttemptFacts]:
        """The runs of every attempt that was simulated."""
        result = self.result
        return facts_of(result.attempts, result.requirement, result.world, result.run_of)

    @cached_property
    def floor(self) -> FloorPlan:
        """The floor plan without tooltips."""
        return floor_plan(self.result.world, tooltips=False)

    @property
    def confirmed(self) -> AttemptFacts | None:
        """The confirmation runs of the first finding."""
        wanted = self.result.confirmed
        return next((f for f in self.facts if wanted is not None and f.attempt.index == wanted.index), None)

    @property
    def candidate(self) -> Attempt | None:
        """The configuration of the search that the first finding confirms."""
        confirmed = self.result.confirmed
        return confirmed_candidate(confirmed, self.result.attempts) if confirmed is not None else None

    @property
    def subject(self) -> AttemptFacts | None:
        """What the page tells of: the confirmed finding, else the worst candidate."""
        best = best_attempt(self.result.attempts, self.result.requirement)
        return self.confirmed or next((f for f in self.facts if best and f.attempt.index == best.index), None)


def in_order(shown: PageContents) -> list[AttemptFacts]:
    """Sort: the subject first, then other confirmations, then the search by rank, then the rest.

    A configuration that the search measured several times, each time in more runs, is shown with all of them.
    """
    rank = {entry.attempt: entry.rank for entry in shown.result.ranking}
    subject = shown.subject
    return sorted(
        _fullest(shown.facts, shown.subject),
        key=lambda f: (
            f is not subject,
            f.attempt.purpose != "confirmation",
            rank.get(f.attempt.index, len(rank) + 1),
            f.attempt.index,
        ),
    )


def _fullest(facts: Sequence[AttemptFacts], subject: AttemptFacts | None) -> list[AttemptFacts]:
    """Leave out attempts whose runs a later one of the same purpose holds, with more.

    A search may measure a configuration several times, and a confirmation may be continued.
    """
    runs = {facts_of_one.attempt.index: {run.id for run in facts_of_one.runs} for facts_of_one in facts}
    held: dict[tuple[str, str], list[AttemptFacts]] = {}
    for facts_of_one in facts:
        if facts_of_one.attempt.purpose in ("search", "confirmation"):
            held.setdefault(_kind(facts_of_one), []).append(facts_of_one)

    def superseded(facts_of_one: AttemptFacts) -> bool:
        mine, index = runs[facts_of_one.attempt.index], facts_of_one.attempt.index
        others = ((runs[other.attempt.index], other.attempt.index) for other in held.get(_kind(facts_of_one), []))
        return any(mine < theirs or (mine == theirs and other < index) for theirs, other in others)

    return [facts_of_one for facts_of_one in facts if facts_of_one is subject or not superseded(facts_of_one)]


def _kind(facts: AttemptFacts) -> tuple[str, str]:
    scenario = facts.attempt.proposal.scenario
    return facts.attempt.purpose, scenario.id if scenario is not None else ""


def group_label(facts: AttemptFacts) -> str:
    """Return what a set of runs is called in menus and tables."""
    attempt = facts.attempt
    verdict = attempt.verdict
    scenario = attempt.number
    match attempt.purpose:
        case "baseline":
            return "Mission without people"
        case "removal":
            return f"{scenario}, without {', '.join(attempt.without)}"
        case "shrinking":
            return f"{scenario}, shrunk"
        case "confirmation":
            return f"{scenario}, confirmation{f', {status_of(verdict)}' if verdict else ''}"
        case _:
            return f"{scenario}, search"


REACTS = {
    Behaviour.REGULAR: "treats the robot as a person (regular)",
    Behaviour.IMPASSIVE: "ignores the robot (impassive)",
    Behaviour.SURPRISED: "stops and looks at the robot (surprised)",
    Behaviour.SCARED: "shies away from the robot (scared)",
    Behaviour.CURIOUS: "approaches the robot (curious)",
    Behaviour.THREATENING: "blocks the robot's way (threatening)",
}
"""How a person reacts to the robot, with the name of the behaviour in HuNavSim."""
LOOKS = {Attention.DISTRACTED: "notices others late (distracted)", Attention.UNSEEING: "does not see others (unseeing)"}


def tasks_of(human: Human) -> list[str]:
    """Return what a person is asked to do, a line for each task."""
    return [
        f"{task.name}: {' '.join(task.path)}"
        + "".join(f"; stands {number(pause.duration_s, 's')} at {pause.at}" for pause in task.pauses)
        for task in human.tasks
    ]


def manner(human: Human) -> str:
    """Return how a person walks and reacts, in a few words."""
    ways = [f"{REACTS[human.behaviour]}, {number(human.speed_m_s, 'm/s')}"]
    if human.attention is not Attention.ATTENTIVE:
        ways.append(LOOKS[human.attention])
    if human.start_delay_s:
        ways.append(f"starts after {number(human.start_delay_s, 's')}")
    if human.group is not None:
        ways.append(f"group {human.group}")
    return ", ".join(ways)


def at(run_id: str, t_s: float | None = None) -> str:
    """Return the part of the page's address that opens a run, at a time."""
    return f"#run={run_id}" + (f"&t={shown_at(t_s)}" if t_s is not None else "")


def scenario_rows(shown: PageContents) -> list[dict[str, Any]]:
    """Return every scenario and every further confirmed configuration: its row, and what belongs to its fold."""
    attempts = {attempt.index: attempt for attempt in shown.result.attempts}
    by_index = {other.attempt.index: other for other in shown.facts}
    rows = []
    for row in shown.answer.rows:
        attempt = attempts[row.attempt]
        facts = by_index[row.shown_attempt]
        scenario = attempt.proposal.scenario
        assert scenario is not None
        rows.append(
            {
                "row": row,
                "description": scenario.description or in_short(scenario),
                "address": "#runs=" + ",".join(run.id for run in facts.runs),
                "people": [(human.name, manner(human), tasks_of(human)) for human in scenario.people.humans],
                "repairs": [f"{repair.human}: {repair.what}" for repair in attempt.proposal.repairs],
            }
        )
    return rows


def run_rows(shown: PageContents) -> list[dict[str, Any]]:
    """Return every recorded run of the campaign, for the table at the end."""
    unit = shown.result.requirement.unit
    return [row | {"of": group_label(facts)} for facts in in_order(shown) for row in run_rows_of(facts, unit)]


def run_rows_of(facts: AttemptFacts, unit: str) -> list[dict[str, Any]]:
    """Return the runs of one configuration for a table."""
    return [
        {
            "id": run.id,
            "address": at(run.id),
            "seed": run.run.seed,
            "objective": number(run.measurement.objective, unit),
            "violated": run.violated,
            "outcome": outcome_in_words(run.run.outcome),
            "contacts": len(run.contacts),
            "gap": metres(run.closest_m) if run.closest_m is not None else "–",
            "late": not run.arrived,
        }
        for run in facts.runs
    ]
