"""Results of suites for continuous integration and pull requests: JUnit XML and Markdown."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from rvsg.campaign.suite import CaseResult, State, SuiteResult
from rvsg.report.junit import clean


def suite_junit(result: SuiteResult) -> str:
    """Return JUnit XML with one test case for each case and requirement, under stable names.

    A broken case is a failure. A known failure and an unclear case are skipped with the reason; a fixed one passes
    and says in `system-out` that the expectation can be updated. A picture is named there in the notation of Jenkins
    and GitLab, `[[ATTACHMENT|path]]`.
    """
    suite = ET.Element("testsuite", name=clean(f"rvsg {result.suite}"))
    suite.extend(_case(result, case) for case in result.cases)
    totals = {
        "tests": len(result.cases),
        "failures": len(result.broken),
        "errors": 0,
        "skipped": sum(case.state in (State.KNOWN_FAILURE, State.UNCLEAR) for case in result.cases),
    }
    suite.attrib.update({key: str(value) for key, value in totals.items()})
    suite.set("time", f"{sum(case.seconds for case in result.cases):.1f}")
    suites = ET.Element("testsuites")
    suites.append(suite)
    ET.indent(suites, "")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(suites, encoding="unicode")}\n'


def _case(result: SuiteResult, case: CaseResult) -> ET.Element:
    element = ET.Element(
        "testcase",
        classname=clean(f"rvsg.{result.suite}.{case.requirement}"),
        name=clean(case.case),
        time=f"{case.seconds:.1f}",
    )
    properties = ET.SubElement(element, "properties")
    probability = case.verdict.violation_probability
    facts = {
        "title": case.title,
        "version": result.version,
        "state": case.state.value,
        "verdict": case.verdict.status.value,
        "runs": str(case.verdict.runs),
        "violation_probability": "" if probability is None else f"{probability:.3f}",
        "runs_with_contact": str(case.contacts),
        "runs_that_arrived": str(case.arrived),
    }
    for name, value in facts.items():
        ET.SubElement(properties, "property", name=name, value=clean(value))
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
