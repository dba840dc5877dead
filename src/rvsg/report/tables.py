"""The rows of the page's tables: people, findings and candidates, runs."""

from __future__ import annotations

from collections import Counter
from typing import Any

from rvsg.campaign.attempt import Attempt
from rvsg.evaluation.judge import still_open
from rvsg.evaluation.verdict import Status, Verdict
from rvsg.evaluation.wording import OPEN, number, outcome_in_words
from rvsg.report.answer import CAUSE_WORDS, tone_of
from rvsg.report.facts import AttemptFacts
from rvsg.report.payload import people_colours
from rvsg.report.shown import Shown, group_label, in_order
from rvsg.report.summary import in_short, interval
from rvsg.report.words import metres
from rvsg.scenario.scenario import Behaviour, Human

LIKE = 60
"""Descriptions that share this many characters from the beginning do not tell scenarios apart."""


REACTS = {
    Behaviour.REGULAR: "treats the robot as a person (regular)",
    Behaviour.IMPASSIVE: "ignores the robot (impassive)",
    Behaviour.SURPRISED: "stops and looks at the robot (surprised)",
    Behaviour.SCARED: "shies away from the robot (scared)",
    Behaviour.CURIOUS: "approaches the robot (curious)",
    Behaviour.THREATENING: "blocks the robot's way (threatening)",
}
"""How a person reacts to the robot, with the name of the behaviour in HuNavSim."""


def people_rows(subject: AttemptFacts) -> list[dict[str, Any]]:
    """Return what each person of the scenario is asked to do, with its colour in the replay."""
    scenario = subject.attempt.proposal.scenario
    colours = people_colours([each.run for each in subject.runs])
    return [_tasks(human) | {"colour": colours.get(human.name)} for human in scenario.people.humans] if scenario else []


def _tasks(human: Human) -> dict[str, Any]:
    """Return a person's work as the page shows it."""
    return {
        "name": human.name,
        "manner": manner(human),
        "tasks": [
            {
                "name": task.name,
                "path": " ".join(task.path),
                "pauses": [f"stands {number(pause.duration_s, 's')} at {pause.at}" for pause in task.pauses],
            }
            for task in human.tasks
        ],
    }


def manner(human: Human) -> str:
    """Return how a person walks and reacts, in a few words."""
    ways = [f"{REACTS[human.behaviour]}, {number(human.speed_m_s, 'm/s')}"]
    if human.start_delay_s:
        ways.append(f"starts after {number(human.start_delay_s, 's')}")
    if human.group is not None:
        ways.append(f"group {human.group}")
    return ", ".join(ways)


def finding_rows(shown: Shown) -> list[dict[str, Any]]:
    """Return findings and candidates, the worst first. A confirmed scenario shows its confirmation verdict.

    Where descriptions begin alike, `short` says instead what everybody does first, which tells the scenarios apart.
    After the scenarios come further configurations that were confirmed.
    """
    attempts = {attempt.index: attempt for attempt in shown.attempts}
    by_index = {each.attempt.index: each for each in shown.facts}
    confirmations = {_scenario_id(f.attempt): f for f in shown.facts if f.attempt.purpose == "confirmation"}
    causes = {finding.attempt: CAUSE_WORDS[finding.about_people] for finding in shown.findings}
    rows = []
    begins = Counter(entry.description[:LIKE] for entry in shown.summary.ranking)
    for entry in (*shown.summary.ranking, *shown.summary.further):
        facts = confirmations[entry.scenario_id] if entry.state == "confirmed" else by_index[entry.attempt]
        row = {"rank": entry.rank or "", "configurations": entry.configurations, "description": entry.description}
        scenario = attempts[entry.attempt].proposal.scenario
        row["short"] = entry.description
        if scenario is not None and max(begins.values()) > 1:
            row["short"] = in_short(scenario)
        row |= {"cause": causes.get(entry.attempt, "–"), "touched": entry.seen.contacts.runs > 0}
        rows.append(row | _finding_row(shown, attempts[entry.attempt], facts, entry.state))
    return rows


def _finding_row(shown: Shown, attempt: Attempt, facts: AttemptFacts, state: str) -> dict[str, Any]:
    """Return the row of a configuration, by its confirmation runs where it has any, else by its search runs."""
    verdict, scenario = facts.attempt.verdict, attempt.proposal.scenario
    assert verdict is not None and scenario is not None
    return {
        "scenario": attempt.brief.scenario_index,
        "configuration": attempt.brief.configuration_index,
        "state": state,
        "attempt": attempt.index,
        "objective": interval(verdict, shown.plan.requirement.unit),
        "violated": f"{verdict.violations} of {verdict.runs}" if _judged(verdict) else "–",
        "status": verdict.status.value,
        "tone": tone_of(verdict),
        "means": f"violated; {OPEN}" if still_open(verdict) else "",
        "contacts": f"{len(facts.with_contact)} of {len(facts.runs)}",
        "arrived": f"{len(facts.runs) - len(facts.not_arrived)} of {len(facts.runs)}",
        "address": "#runs=" + ",".join(run.id for run in facts.runs),
        "people": [_tasks(human) for human in scenario.people.humans],
        "repairs": [f"{repair.human}: {repair.what}" for repair in attempt.proposal.repairs],
    }


def _scenario_id(attempt: Attempt) -> str:
    scenario = attempt.proposal.scenario
    return scenario.id if scenario is not None else ""


def _judged(verdict: Verdict) -> bool:
    return verdict.status is not Status.UNJUDGED


def run_rows(shown: Shown) -> list[dict[str, Any]]:
    """Return every recorded run of the campaign, for the table at the end."""
    unit = shown.plan.requirement.unit
    return [row | {"of": group_label(facts)} for facts in in_order(shown) for row in run_rows_of(facts, unit)]


def run_rows_of(facts: AttemptFacts, unit: str) -> list[dict[str, Any]]:
    """Return the runs of one configuration for a table."""
    return [
        {
            "id": run.id,
            "address": f"#run={run.id}",
            "seed": run.run.seed,
            "objective": number(run.measurement.objective, unit),
            "violated": run.violated,
            "outcome": outcome_in_words(run.run.outcome),
            "contacts": len(run.contacts),
            "gap": metres(run.closest_m) if run.closest_m is not None else "–",
        }
        for run in facts.runs
    ]
