"""A campaign as JUnit XML, which continuous integration services read: one test case per scenario, one confirmation."""

from __future__ import annotations

import re
from collections.abc import Iterable
from xml.sax.saxutils import escape, quoteattr

from rvsg.campaign.plan import Plan
from rvsg.evaluation.judge import violated
from rvsg.evaluation.verdict import Status, Verdict
from rvsg.report.summary import Summary, interval, number, status_in_words


def junit_xml(plan: Plan, summary: Summary) -> str:
    """The XML. The verdict that decides is the confirmation's, as for the exit code: violated is a failure, also where
    FAIL or FLAKY is still open.

    The scenarios of the search are then passed, or skipped with what they measured: few runs, looked at because they
    were extreme, rank them and decide nothing. Without a confirmation their verdicts decide. A verdict that is not sure
    or that has no limit to go by is skipped with the reason.
    """
    return junit_of([(plan, summary)])


def junit_of(campaigns: Iterable[tuple[Plan, Summary]]) -> str:
    """The XML of several campaigns, a test suite for each."""
    suites = "".join(_suite(plan, summary) for plan, summary in campaigns)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<testsuites>{suites}</testsuites>\n'


def _suite(plan: Plan, summary: Summary) -> str:
    suite = f"rvsg {plan.mission.world} {plan.mission.route.name} {plan.requirement.name}"
    confirmed = summary.confirmed if summary.confirmed and summary.confirmed.verdict else None
    cases = [
        _case(suite, f"scenario {entry.scenario + 1}: {entry.description[:120]}", entry.verdict, plan, not confirmed)
        for entry in sorted(summary.ranking, key=lambda entry: entry.scenario)
    ]
    if confirmed and confirmed.verdict:
        index = confirmed.brief.scenario_index + 1
        cases.append(_case(suite, f"confirmation of scenario {index} in fresh runs", confirmed.verdict, plan, True))
    failures = sum("<failure" in case for case in cases)
    skipped = sum("<skipped" in case for case in cases)
    return (
        f'<testsuite name={_attribute(suite)} tests="{len(cases)}" failures="{failures}" errors="0" '
        f'skipped="{skipped}">\n' + "".join(cases) + "</testsuite>"
    )


def _case(suite: str, name: str, verdict: Verdict, plan: Plan, decides: bool) -> str:
    said = f"{status_in_words(verdict)}: {interval(verdict, plan.requirement.unit)}"
    if plan.requirement.threshold is not None:
        said += f", limit {number(plan.requirement.threshold, plan.requirement.unit)}"
    whole = f"{said}. {verdict.reason}"
    body = f"<system-out>{_text(whole)}</system-out>"
    if violated(verdict) and decides:
        body = f"<failure message={_attribute(said)}>{_text(verdict.reason)}</failure>"
    elif violated(verdict):
        body = f"<skipped message={_attribute(f'{whole}. In the search; the confirmation decides')}/>"
    elif verdict.status in (Status.INCONCLUSIVE, Status.UNJUDGED):
        body = f"<skipped message={_attribute(whole)}/>"
    return f"<testcase classname={_attribute(suite)} name={_attribute(name)}>{body}</testcase>\n"


def _clean(text: str) -> str:
    """Without the characters that XML 1.0 cannot hold."""
    return re.sub(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "�", text)


def _text(text: str) -> str:
    return escape(_clean(text))


def _attribute(text: str) -> str:
    return quoteattr(_clean(text))
