"""Summary of a campaign as plain data: the one source of `--json`, the ranked table, JUnit and the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from rvsg.campaign.attempt import Attempt, Plan
from rvsg.campaign.execution import Accounting, account, runs_of
from rvsg.campaign.findings import badness, worst_confirmation
from rvsg.campaign.ranking import confirmations, confirmed_candidate, ranking, search_attempts
from rvsg.core.records import Record
from rvsg.evaluation.judge import violated
from rvsg.evaluation.safety_summary import SafetySummary, summarise_safety
from rvsg.evaluation.verdict import Verdict
from rvsg.evaluation.wording import counted, number, status_in_words, value_in_words
from rvsg.scenario.scenario import Scenario

__all__ = [
    "Accounting",
    "Ranked",
    "Summary",
    "account",
    "counted",
    "in_short",
    "interval",
    "number",
    "status_in_words",
    "summarise",
    "tried_of",
]


State = Literal["confirmed", "candidate", "not violated"]


class Ranked(Record):
    """A scenario in its place: one of its configurations and how that did. Indices count from 0.

    Where configurations of the scenario are confirmed it is the worst of these, by its confirmation runs; else the
    worst of the search.
    """

    rank: int
    scenario: int
    configuration: int
    configurations: int
    attempt: int
    scenario_id: str
    description: str
    state: State
    """A candidate violated the requirement in the search and is not confirmed."""
    verdict: Verdict
    """Of the confirmation runs where it is confirmed, else of the runs of the search."""
    seen: SafetySummary
    """What these runs show beside the requirement."""


class Summary(Record):
    """A campaign so far."""

    campaign: str
    complete: bool
    """Whether everything planned is done."""
    ranking: tuple[Ranked, ...]
    """One entry for each scenario: confirmed violations first, then candidates, then the rest, the worst first."""
    further: tuple[Ranked, ...]
    """Other confirmed configurations of the same scenarios."""
    confirmed: Attempt | None
    """The confirmation that says most against the robot."""
    violated: bool
    """Whether a confirmation says so (FAIL, FLAKY, or one of the two), or without one any verdict of the search."""
    accounting: Accounting

    @property
    def seen(self) -> SafetySummary | None:
        """What the runs of the worst confirmation show beside the requirement; without one, of the worst scenario."""
        if self.confirmed is not None:
            return summarise_safety([measured.values for measured in self.confirmed.measurements])
        return self.ranking[0].seen if self.ranking else None


def summarise(plan: Plan, attempts: Sequence[Attempt]) -> Summary:
    """Sum up the attempts of a campaign."""
    confirmed = worst_confirmation(attempts)
    ranked, further = _ranked_scenarios(plan, attempts)
    decided = [confirmed.verdict] if confirmed and confirmed.verdict else [entry.verdict for entry in ranked]
    return Summary(
        campaign=plan.name,
        complete=_complete(plan, attempts, ranked),
        ranking=ranked,
        further=further,
        confirmed=confirmed,
        violated=any(violated(verdict) for verdict in decided),
        accounting=account(attempts),
    )


def _complete(plan: Plan, attempts: Sequence[Attempt], ranked: Sequence[Ranked]) -> bool:
    """Return whether everything planned is done: the search, and its confirmation with the mission without people."""
    if plan.confirmations and ranked:
        return any(a.purpose == "baseline" for a in attempts)
    searched = search_attempts(attempts)
    if all(a.runs in (0, plan.repeats) for a in searched):
        return len(searched) >= plan.attempts
    return runs_of(searched) >= plan.search_runs


def in_short(scenario: Scenario) -> str:
    """Return what everybody does first, for a scenario without a description."""
    return "; ".join(f"{human.name}: {human.tasks[0].name}" for human in scenario.people.humans)


def tried_of(tried: int, planned: int) -> str:
    """Return how many configurations were tried, of how many; a strategy that plans in runs may try more."""
    return f"{tried} of {planned}" if tried <= planned else str(tried)


interval = value_in_words
"""The name by which the tables know it."""


def _ranked_scenarios(plan: Plan, attempts: Sequence[Attempt]) -> tuple[tuple[Ranked, ...], tuple[Ranked, ...]]:
    """Return an entry for each scenario in order, and the other confirmed configurations."""
    searched = search_attempts(attempts)
    by_scenario: dict[int, list[tuple[Attempt, Attempt]]] = {}
    for attempt in confirmations(attempts):
        candidate = confirmed_candidate(attempt, attempts)
        if candidate is not None and attempt.verdict is not None:
            by_scenario.setdefault(candidate.brief.scenario_index, []).append((candidate, attempt))
    shown: list[Ranked] = []
    further: list[Ranked] = []
    for best in ranking(attempts, plan.requirement):
        confirmed = by_scenario.get(best.brief.scenario_index, [])
        confirmed.sort(key=lambda pair: badness(pair[1].verdict), reverse=True)
        entries = [_ranked(*each, searched) for each in confirmed] or [_ranked(best, None, searched)]
        shown.append(entries[0])
        further += entries[1:]
    shown.sort(key=_place)
    return tuple(entry.replace(rank=place) for place, entry in enumerate(shown, 1)), tuple(further)


def _place(entry: Ranked) -> tuple[int, float]:
    """Return where an entry stands in the ranking; entries of the search keep their order."""
    if entry.state == "confirmed" and violated(entry.verdict):
        _, always, least = badness(entry.verdict)
        return (0, -float(always) - least)
    return ({"candidate": 1, "confirmed": 2, "not violated": 3}[entry.state], 0.0)


def _ranked(candidate: Attempt, confirmation: Attempt | None, searched: Sequence[Attempt]) -> Ranked:
    scenario, shown = candidate.proposal.scenario, confirmation or candidate
    assert scenario is not None and shown.verdict is not None
    tried = sum(other.brief.scenario_index == candidate.brief.scenario_index for other in searched)
    state: State = "confirmed" if confirmation else "candidate" if shown.verdict.violations else "not violated"
    return Ranked(
        rank=0,
        scenario=candidate.brief.scenario_index,
        configuration=candidate.brief.configuration_index,
        configurations=tried,
        attempt=candidate.index,
        scenario_id=scenario.id,
        description=scenario.description or in_short(scenario),
        state=state,
        verdict=shown.verdict,
        seen=summarise_safety([measured.values for measured in shown.measurements]),
    )
