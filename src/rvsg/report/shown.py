"""Shared data of the parts of the page: the plan, the attempts and the facts of their runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rvsg.campaign.attempt import Attempt, Plan
from rvsg.campaign.findings import Finding
from rvsg.campaign.ranking import best_attempt, confirmed_candidate
from rvsg.report.causes import Cause, cause_of
from rvsg.report.facts import AttemptFacts
from rvsg.report.frames import Look, Turn
from rvsg.report.payload import people_colours
from rvsg.report.robots import footprint_of
from rvsg.report.summary import Summary
from rvsg.world.drawing.svg import FloorPlan
from rvsg.world.world import World


@dataclass(frozen=True, kw_only=True)
class Shown:
    """What the parts of the page share."""

    plan: Plan
    world: World
    attempts: Sequence[Attempt]
    summary: Summary
    facts: Sequence[AttemptFacts]
    findings: Sequence[Finding]
    floor: FloorPlan

    @property
    def confirmed(self) -> AttemptFacts | None:
        """The confirmation runs of the first finding."""
        wanted = self.summary.confirmed
        return next((f for f in self.facts if wanted is not None and f.attempt.index == wanted.index), None)

    @property
    def candidate(self) -> Attempt | None:
        """The configuration of the search that the first finding confirms."""
        return self.candidate_of(self.summary.confirmed) if self.summary.confirmed is not None else None

    def candidate_of(self, confirmation: Attempt) -> Attempt | None:
        """Return the configuration of the search that an attempt confirms."""
        return confirmed_candidate(confirmation, self.attempts)

    @property
    def cause(self) -> Cause | None:
        """Return whether the people cause the finding; None before a confirmation."""
        confirmed = self.confirmed
        found = [f for f in self.findings if confirmed is not None and f.confirmation == confirmed.attempt.index]
        return cause_of(found[0], confirmed, self.facts) if found and confirmed is not None else None

    @property
    def searched(self) -> list[AttemptFacts]:
        """The configurations of the search that were simulated."""
        return [f for f in self.facts if f.attempt.purpose == "search"]

    @property
    def others(self) -> list[AttemptFacts]:
        """The confirmations of other configurations than that of the first finding."""
        own = _kind(self.confirmed) if self.confirmed is not None else None
        return [f for f in self.facts if f.attempt.purpose == "confirmation" and _kind(f) != own]

    @property
    def subject(self) -> AttemptFacts | None:
        """What the page tells of: the confirmed finding, else the worst candidate."""
        best = best_attempt(self.attempts, self.plan.requirement)
        return self.confirmed or next((f for f in self.facts if best and f.attempt.index == best.index), None)


def look_of(shown: Shown, facts: AttemptFacts) -> Look:
    """Return how still pictures of these runs are drawn."""
    runs = [each.run for each in facts.runs]
    return Look(
        turn=Turn.of(shown.floor.matrix),
        view_box=shown.floor.view_box,
        outline=footprint_of(runs[0], shown.plan.mission.robot_record),
        colours=people_colours(runs),
    )


def in_order(shown: Shown) -> list[AttemptFacts]:
    """Sort: the subject first, then other confirmations, then the search by rank, then the rest.

    A configuration that the search measured several times, each time in more runs, is shown with all of them.
    """
    rank = {entry.attempt: entry.rank for entry in shown.summary.ranking}
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
    runs = {each.attempt.index: {run.id for run in each.runs} for each in facts}
    held: dict[tuple[str, str], list[AttemptFacts]] = {}
    for each in facts:
        if each.attempt.purpose in ("search", "confirmation"):
            held.setdefault(_kind(each), []).append(each)

    def superseded(each: AttemptFacts) -> bool:
        others = held.get(_kind(each), [])
        mine, index = runs[each.attempt.index], each.attempt.index
        return any(
            mine < runs[other.attempt.index] or (mine == runs[other.attempt.index] and other.attempt.index < index)
            for other in others
        )

    return [each for each in facts if each is subject or not superseded(each)]


def _kind(facts: AttemptFacts) -> tuple[str, str]:
    """Return what the runs of a configuration are for, and its scenario."""
    scenario = facts.attempt.proposal.scenario
    return facts.attempt.purpose, scenario.id if scenario is not None else ""


def group_label(facts: AttemptFacts) -> str:
    """Return what a set of runs is called in menus and tables."""
    attempt = facts.attempt
    brief, verdict = attempt.brief, attempt.verdict
    scenario = f"scenario {brief.scenario_index + 1}, configuration {brief.configuration_index + 1}"
    match attempt.purpose:
        case "baseline":
            return "mission without people"
        case "removal":
            return f"{scenario}, without {', '.join(attempt.without)}"
        case "shrinking":
            return f"{scenario}, shrunk"
        case "confirmation":
            return f"{scenario}, confirmation{f', {verdict.status.value}' if verdict else ''}"
        case _:
            return f"{scenario}, search"
