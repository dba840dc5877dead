"""A campaign as JUnit XML, which continuous integration services read: one test case per scenario, one confirmation."""

from __future__ import annotations

import re
from xml.sax.saxutils import escape, quoteattr

from rvsg.campaign.plan import Plan
from rvsg.evaluation.verdict import Status, Verdict
from rvsg.report.summary import VIOLATED, Summary, interval, number


def junit_xml(plan: Plan, summary: Summary) -> str:
    """The XML. A violated requirement is a failure, a verdict that is not sure or not judged is skipped."""
    suite = f"rvsg {plan.mission.world} {plan.mission.route.name} {plan.requirement.name}"
    cases = [
        _case(suite, f"scenario {entry.scenario + 1}: {entry.description[:120]}", entry.verdict, plan)
        for entry in sorted(summary.ranking, key=lambda entry: entry.scenario)
    ]
    if summary.confirmed and summary.confirmed.verdict:
        index = summary.confirmed.brief.scenario_index + 1
        cases.append(_case(suite, f"confirmation of scenario {index} in fresh runs", summary.confirmed.verdict, plan))
    failures = sum("<failure" in case for case in cases)
    skipped = sum("<skipped" in case for case in cases)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<testsuites><testsuite name={_attribute(suite)} tests="{len(cases)}" failures="{failures}" errors="0" '
        f'skipped="{skipped}">\n' + "".join(cases) + "</testsuite></testsuites>\n"
    )


def _case(suite: str, name: str, verdict: Verdict, plan: Plan) -> str:
    said = f"{verdict.status.value}: {interval(verdict, plan.requirement.unit)}"
    if plan.requirement.limit is not None:
        said += f", limit {number(plan.requirement.limit, plan.requirement.unit)}"
    body = f"<system-out>{_text(f'{said}. {verdict.reason}')}</system-out>"
    if verdict.status in VIOLATED:
        body = f"<failure message={_attribute(said)}>{_text(verdict.reason)}</failure>"
    elif verdict.status in (Status.INCONCLUSIVE, Status.UNJUDGED):
        body = f"<skipped message={_attribute(f'{said}. {verdict.reason}')}/>"
    return f"<testcase classname={_attribute(suite)} name={_attribute(name)}>{body}</testcase>\n"


def _clean(text: str) -> str:
    """Without the characters that XML 1.0 cannot hold."""
    return re.sub(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "�", text)


def _text(text: str) -> str:
    return escape(_clean(text))


def _attribute(text: str) -> str:
    return quoteattr(_clean(text))
