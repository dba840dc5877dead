"""The verdicts of a campaign as JUnit XML, for continuous integration."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.plan import Plan
from rvsg.evaluation.judge import violated
from rvsg.evaluation.safety_summary import summarise_safety
from rvsg.evaluation.verdict import Status, Verdict
from rvsg.report.summary import Summary, counted, interval, number, status_in_words


def junit_xml(plan: Plan, summary: Summary) -> str:
    """Return a test case for each scenario of the search and one for the confirmation.

    Where there is a confirmation, it decides: a scenario that violated the limit in the search is skipped with that
    reason, because the search selected it for being extreme. A verdict that needs more runs or has no limit is
    skipped with the reason.
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
    confirmed = summary.confirmed if summary.confirmed and summary.confirmed.verdict else None
    for entry in sorted(summary.ranking, key=lambda entry: entry.scenario):
        case = f"scenario {entry.scenario + 1}: {entry.description[:120]}"
        suite.append(_case(name, case, entry.verdict, plan, decides=not confirmed))
    if confirmed and confirmed.verdict:
        case = f"confirmation of scenario {confirmed.brief.scenario_index + 1}"
        suite.append(_case(name, case, confirmed.verdict, plan, decides=True, seen=_seen(confirmed)))
    counts = {"tests": len(suite), "failures": len(suite.findall("*/failure")), "errors": 0}
    counts["skipped"] = len(suite.findall("*/skipped"))
    suite.attrib.update({key: str(count) for key, count in counts.items()})
    return suite


def _seen(confirmed: Attempt) -> dict[str, str]:
    """What the confirmation runs show beside the requirement."""
    safety = summarise_safety([measured.values for measured in confirmed.measurements])
    found = {
        "contacts": f"{safety.contacts.runs} of {counted(safety.contacts.of, 'run')}",
        "arrived": f"{safety.arrived.runs} of {counted(safety.arrived.of, 'run')}",
    }
    if safety.least_clearance_m is not None:
        found["minimum clearance"] = number(safety.least_clearance_m, "m")
    return found


def _case(
    suite: str, name: str, verdict: Verdict, plan: Plan, *, decides: bool, seen: Mapping[str, str] | None = None
) -> ET.Element:
    said = f"{status_in_words(verdict)}: {interval(verdict, plan.requirement.unit)}"
    if plan.requirement.threshold is not None:
        said += f", limit {number(plan.requirement.threshold, plan.requirement.unit)}"
    whole = f"{said}. {verdict.reason}"
    if seen:
        whole += f". Contact with people in {seen['contacts']}; {seen['arrived']} arrived"
    case = ET.Element("testcase", classname=suite, name=clean(name))
    if seen:
        properties = ET.SubElement(case, "properties")
        for key, value in seen.items():
            ET.SubElement(properties, "property", name=key, value=clean(value))
    if violated(verdict) and decides:
        ET.SubElement(case, "failure", message=clean(said)).text = clean(verdict.reason)
    elif violated(verdict):
        ET.SubElement(case, "skipped", message=clean(f"{whole}. In the search; the confirmation decides"))
    elif verdict.status in (Status.INCONCLUSIVE, Status.UNJUDGED):
        ET.SubElement(case, "skipped", message=clean(whole))
    else:
        ET.SubElement(case, "system-out").text = clean(whole)
    return case


def clean(text: str) -> str:
    """Replace the characters that XML 1.0 cannot hold."""
    return re.sub(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", text)
