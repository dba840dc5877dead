"""Summary of a campaign as plain data, and as JUnit XML and Markdown for continuous integration."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Literal

from pydantic import Field

from rvsg.campaign.attempt import Attempt, Plan
from rvsg.campaign.execution import Accounting, account, runs_of
from rvsg.campaign.findings import Severity, severity_of, worst_confirmation
from rvsg.campaign.ranking import confirmations, confirmed_candidate, ranking, search_attempts
from rvsg.campaign.suite import CaseResult, State, SuiteResult
from rvsg.core.records import Record
from rvsg.evaluation.verdict import (
    SafetySummary,
    Status,
    Verdict,
    counted,
    how_sure,
    metres,
    status_in_words,
    summarise_safety,
    value_in_words,
    violated,
)
from rvsg.report.words import limit_in_words
from rvsg.scenario.scenario import Scenario

Standing = Literal["confirmed", "candidate", "not violated"]


class Ranked(Record):
    """A scenario in its place: one of its configurations and how that did. Indices count from 0.

    Where configurations of the scenario are confirmed it is the worst of these, by its confirmation runs; else the
    worst of the search.
    """

    rank: int
    """From 1, the most severe first; of a further configuration of a scenario 0."""
    scenario: int
    configuration: int
    configurations: int
    attempt: int
    scenario_id: str
    description: str
    state: Standing
    """A candidate violated the requirement in the search and is not confirmed."""
    verdict: Verdict
    """Of the confirmation runs where it is confirmed, else of the runs of the search."""
    seen: SafetySummary
    """What these runs show beside the requirement."""
    severity: Annotated[Severity, Field(exclude=True)]

    @property
    def number(self) -> str:
        """Scenario and configuration, from 1, e.g. `3.2`."""
        return f"{self.scenario + 1}.{self.configuration + 1}"

    @property
    def place(self) -> tuple[int, Severity]:
        """Where it stands, larger first: confirmed violations and contacts, candidates, other confirmed ones, the rest.

        What is not confirmed comes later, however severe: the search selected it for being extreme.
        """
        bad = violated(self.verdict) or self.seen.contacts.runs > 0
        confirmed = 3 if bad else 1
        return {"confirmed": confirmed, "candidate": 2, "not violated": 0}[self.state], self.severity


class Summary(Record):
    """A campaign so far."""

    campaign: str
    complete: bool
    """Whether everything planned is done."""
    ranking: tuple[Ranked, ...]
    """One entry for each scenario, as `Ranked.place` orders them."""
    further: tuple[Ranked, ...]
    """Other confirmed configurations of the same scenarios."""
    confirmed: Attempt | None
    """The most severe confirmation."""
    violated: bool
    """Whether any confirmation says so (FAIL, FLAKY, or one of the two), or without one any verdict of the search."""
    accounting: Accounting


def summarise(plan: Plan, attempts: Sequence[Attempt]) -> Summary:
    """Sum up the attempts of a campaign."""
    confirmed = worst_confirmation(attempts, plan.requirement)
    ranked, further = _ranked_scenarios(plan, attempts)
    decided = [a.verdict for a in confirmations(attempts) if a.verdict] or [entry.verdict for entry in ranked]
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


def configuration_number(attempt: Attempt) -> str:
    """Return scenario and configuration of an attempt, from 1, e.g. `3.2`."""
    return f"{attempt.brief.scenario_index + 1}.{attempt.brief.configuration_index + 1}"


def tried_of(tried: int, planned: int) -> str:
    """Return how many configurations were tried, of how many; a strategy that plans in runs may try more."""
    return f"{tried} of {planned}" if tried <= planned else str(tried)


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
        entries = [_ranked(*each, searched, plan) for each in confirmed] or [_ranked(best, None, searched, plan)]
        entries.sort(key=lambda entry: entry.place, reverse=True)
        shown.append(entries[0])
        further += entries[1:]
    shown.sort(key=lambda entry: entry.place, reverse=True)
    return tuple(entry.replace(rank=place) for place, entry in enumerate(shown, 1)), tuple(further)


def _ranked(candidate: Attempt, confirmation: Attempt | None, searched: Sequence[Attempt], plan: Plan) -> Ranked:
    scenario, shown = candidate.proposal.scenario, confirmation or candidate
    assert scenario is not None and shown.verdict is not None
    tried = sum(other.brief.scenario_index == candidate.brief.scenario_index for other in searched)
    state: Standing = "confirmed" if confirmation else "candidate" if shown.verdict.violations else "not violated"
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
        severity=severity_of(shown, plan.requirement),
    )


Named = tuple[Plan, Summary, Mapping[str, str]]
"""A campaign with the names of its configurations, by their numbers, as its answer gives them."""


def junit_of(campaigns: Iterable[Named]) -> str:
    """Return a test suite for each campaign, with a case for each scenario and each further confirmed configuration.

    Where there is a confirmation, confirmations decide: a candidate is skipped with that reason, because the search
    selected it for being extreme. A verdict that needs more runs or has no limit is skipped with the reason.
    """
    return _document(_suite(*each) for each in campaigns)


def _document(made: Iterable[ET.Element]) -> str:
    suites = ET.Element("testsuites")
    suites.extend(made)
    for suite in suites:
        counts = {"tests": len(suite), "failures": len(suite.findall("*/failure")), "errors": 0}
        counts["skipped"] = len(suite.findall("*/skipped"))
        suite.attrib.update({key: str(count) for key, count in counts.items()})
    ET.indent(suites, "")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(suites, encoding="unicode")}\n'


def _suite(plan: Plan, summary: Summary, names: Mapping[str, str]) -> ET.Element:
    name = clean(f"rvsg {plan.mission.world} {plan.mission.route.name} {plan.requirement.name}")
    suite, alone = ET.Element("testsuite", name=name), summary.confirmed is None
    every = (*summary.ranking, *summary.further)
    for entry in sorted(every, key=lambda entry: (entry.scenario, entry.configuration)):
        suite.append(_case(name, f"{entry.number} {names[entry.number]}", entry, plan, decides=alone))
    return suite


def _properties(entry: Ranked) -> dict[str, str]:
    """Return the state of a scenario, and what its runs show beside the requirement."""
    seen = entry.seen
    found = {"state": entry.state, "attempt": str(entry.attempt)}
    found["violated"] = f"{entry.verdict.violations}/{entry.verdict.runs}"
    if seen.contacts.of:
        found["contacts"] = f"{seen.contacts.runs} of {counted(seen.contacts.of, 'run')}"
    if seen.arrived.of:
        found["arrived"] = f"{seen.arrived.runs} of {counted(seen.arrived.of, 'run')}"
    if seen.least_clearance_m is not None:
        found["minimum clearance"] = metres(seen.least_clearance_m)
    return found


def _case(suite: str, name: str, entry: Ranked, plan: Plan, *, decides: bool) -> ET.Element:
    """Return a case. A verdict of the search counts only where it `decides`."""
    verdict, properties = entry.verdict, _properties(entry)
    said = f"{status_in_words(verdict)}: {value_in_words(verdict, plan.requirement.unit)}"
    if limit := limit_in_words(plan.requirement):
        said += f", limit: {limit}"
    whole = f"{said}. {how_sure(verdict)}"
    if "contacts" in properties and "arrived" in properties:
        whole += f". Contact with people in {properties['contacts']}; {properties['arrived']} arrived"
    case = ET.Element("testcase", classname=suite, name=clean(name))
    _add_properties(case, {"description": entry.description, **properties})
    if violated(verdict) and (decides or entry.state == "confirmed"):
        ET.SubElement(case, "failure", message=clean(said)).text = clean(whole)
    elif entry.state == "candidate" and not decides:
        ET.SubElement(case, "skipped", message=clean(f"{whole}. A candidate of the search; the confirmation decides"))
    elif violated(verdict) or verdict.status in (Status.INCONCLUSIVE, Status.UNJUDGED):
        ET.SubElement(case, "skipped", message=clean(whole))
    else:
        ET.SubElement(case, "system-out").text = clean(whole)
    return case


def _add_properties(case: ET.Element, properties: Mapping[str, str]) -> None:
    added = ET.SubElement(case, "properties")
    for name, value in properties.items():
        ET.SubElement(added, "property", name=name, value=clean(value))


def clean(text: str) -> str:
    """Replace the characters that XML 1.0 cannot hold."""
    return re.sub(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", text)


def suite_junit(result: SuiteResult) -> str:
    """Return JUnit XML with one test case for each case and requirement, under stable names.

    A broken case is a failure. A known failure and an unclear case are skipped with the reason; a fixed one passes
    and says in `system-out` that the expectation can be updated. A picture is named there in the notation of Jenkins
    and GitLab, `[[ATTACHMENT|path]]`.
    """
    suite = ET.Element("testsuite", name=clean(f"rvsg {result.suite}"))
    suite.extend(_suite_case(result, case) for case in result.cases)
    return _document([suite])


def _suite_case(result: SuiteResult, case: CaseResult) -> ET.Element:
    element = ET.Element(
        "testcase",
        classname=clean(f"rvsg.{result.suite}.{case.requirement}"),
        name=clean(case.case),
    )
    probability = case.verdict.violation_probability
    properties = {
        "title": case.title,
        "version": result.version,
        "simulator": case.simulator.name if case.simulator else result.simulator,
        "stack": case.stack,
        "robot": case.robot,
        "simulated_seconds": f"{case.seconds:.1f}",
        "state": case.state.value,
        "verdict": case.verdict.status.value,
        "runs": str(case.verdict.runs),
        "violation_probability": "" if probability is None else f"{probability:.3f}",
        "runs_with_contact": str(case.contacts),
        "runs_that_arrived": str(case.arrived),
    }
    _add_properties(element, properties)
    message = clean(f"{case.state.value}: {case.verdict.reason}")
    if case.state is State.BROKEN:
        ET.SubElement(element, "failure", message=message).text = clean("\n".join(case.story))
    elif case.state is State.KNOWN_FAILURE:
        ET.SubElement(element, "skipped", message=clean(f"{message}. {case.reason}".strip()))
    elif case.state is State.UNCLEAR:
        ET.SubElement(element, "skipped", message=message)
    attached = [] if case.picture is None else [f"[[ATTACHMENT|{case.picture}]]"]
    ET.SubElement(element, "system-out").text = clean("\n".join([message, *case.story, *attached]))
    return element
