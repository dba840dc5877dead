"""Results of campaigns and suites as JUnit XML, for continuous integration."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping

from rvsg.evaluation.verdict import Status, counted, how_sure, metres, status_in_words, value_in_words, violated
from rvsg.report.answer_row import Ranked
from rvsg.report.result import Result
from rvsg.report.words import limit_in_words
from rvsg.runs.attempt import Plan
from rvsg.suites.suite import CaseResult, State, SuiteResult


def junit_of(results: Iterable[Result]) -> str:
    """Return a test suite for each campaign, with a case for each scenario and each further confirmed configuration.

    Where there is a confirmation, confirmations decide: a candidate is skipped with that reason, because the search
    selected it for being extreme. A verdict that needs more runs or has no limit is skipped with the reason.
    """
    return _document(_suite(result) for result in results)


def _document(elements: Iterable[ET.Element]) -> str:
    suites = ET.Element("testsuites")
    suites.extend(elements)
    for suite in suites:
        counts = {"tests": len(suite), "failures": len(suite.findall("*/failure")), "errors": 0}
        counts["skipped"] = len(suite.findall("*/skipped"))
        suite.attrib.update({key: str(count) for key, count in counts.items()})
    ET.indent(suites, "")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(suites, encoding="unicode")}\n'


def _suite(result: Result) -> ET.Element:
    plan, names = result.plan, {row.number: row.name for row in result.answer.rows}
    name = clean(f"rvsg {plan.mission.world} {plan.mission.route.name} {plan.requirement.name}")
    suite, alone = ET.Element("testsuite", name=name), result.confirmed is None
    for entry in sorted(result.entries, key=lambda entry: (entry.scenario, entry.configuration)):
        suite.append(_case(name, f"{entry.number} {names[entry.number]}", entry, plan, decides=alone))
    return suite


def _properties(entry: Ranked) -> dict[str, str]:
    """Return the state of a scenario, and what its runs show beside the requirement."""
    seen = entry.seen
    properties = {"state": entry.state, "attempt": str(entry.attempt)}
    properties["violated"] = f"{entry.verdict.violations}/{entry.verdict.runs}"
    if seen.contacts.of:
        properties["contacts"] = seen.contacts.in_words
    if seen.arrived.of:
        properties["arrived"] = f"{seen.arrived.runs} of {counted(seen.arrived.of, 'run')}"
    if seen.least_clearance_m is not None:
        properties["minimum clearance"] = metres(seen.least_clearance_m)
    return properties


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
