"""The verdicts of a campaign as JUnit XML, for continuous integration."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable

from rvsg.campaign.attempt import Plan
from rvsg.evaluation.judge import violated
from rvsg.evaluation.verdict import Status
from rvsg.evaluation.wording import counted, how_sure, number, status_in_words
from rvsg.report.summary import Ranked, Summary, interval
from rvsg.report.words import metres


def junit_xml(plan: Plan, summary: Summary) -> str:
    """Return a test case for each scenario, and one for each further configuration that is confirmed.

    Where there is a confirmation, confirmations decide: a candidate is skipped with that reason, because the search
    selected it for being extreme. A verdict that needs more runs or has no limit is skipped with the reason.
    """
    return junit_of([(plan, summary)])


def junit_of(campaigns: Iterable[tuple[Plan, Summary]]) -> str:
    """Return the XML of several campaigns, a test suite for each."""
    suites = ET.Element("testsuites")
    suites.extend(_suite(plan, summary) for plan, summary in campaigns)
    ET.indent(suites, "")
    text = ET.tostring(suites, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _suite(plan: Plan, summary: Summary) -> ET.Element:
    name = clean(f"rvsg {plan.mission.world} {plan.mission.route.name} {plan.requirement.name}")
    suite = ET.Element("testsuite", name=name)
    alone = summary.confirmed is None
    for entry in sorted(summary.ranking, key=lambda entry: entry.scenario):
        suite.append(_case(name, f"scenario {entry.scenario + 1}", entry, plan, decides=alone))
    for entry in summary.further:
        case = f"scenario {entry.scenario + 1}, configuration {entry.configuration + 1}"
        suite.append(_case(name, case, entry, plan, decides=alone))
    counts = {"tests": len(suite), "failures": len(suite.findall("*/failure")), "errors": 0}
    counts["skipped"] = len(suite.findall("*/skipped"))
    suite.attrib.update({key: str(count) for key, count in counts.items()})
    return suite


def _properties(entry: Ranked) -> dict[str, str]:
    """Return the state of a scenario, and what its runs show beside the requirement."""
    seen = entry.seen
    found = {"state": entry.state, "attempt": str(entry.attempt)}
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
    said = f"{status_in_words(verdict)}: {interval(verdict, plan.requirement.unit)}"
    if plan.requirement.threshold is not None:
        said += f", limit {number(plan.requirement.threshold, plan.requirement.unit)}"
    whole = f"{said}. {how_sure(verdict)}"
    if "contacts" in properties and "arrived" in properties:
        whole += f". Contact with people in {properties['contacts']}; {properties['arrived']} arrived"
    case = ET.Element("testcase", classname=suite, name=clean(f"{name}: {entry.description[:120]}"))
    told = ET.SubElement(case, "properties")
    for key, value in properties.items():
        ET.SubElement(told, "property", name=key, value=clean(value))
    if violated(verdict) and (decides or entry.state == "confirmed"):
        ET.SubElement(case, "failure", message=clean(said)).text = clean(whole)
    elif entry.state == "candidate" and not decides:
        ET.SubElement(case, "skipped", message=clean(f"{whole}. A candidate of the search; the confirmation decides"))
    elif violated(verdict) or verdict.status in (Status.INCONCLUSIVE, Status.UNJUDGED):
        ET.SubElement(case, "skipped", message=clean(whole))
    else:
        ET.SubElement(case, "system-out").text = clean(whole)
    return case


def clean(text: str) -> str:
    """Replace the characters that XML 1.0 cannot hold."""
    return re.sub(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", text)
