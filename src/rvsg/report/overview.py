"""The overview of several campaigns as one HTML page that leads to the report of each.

As with a report, the page is a function of the records, and of where the reports are.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

import rvsg
from rvsg.campaign.plan import Plan
from rvsg.core.files import write_whole
from rvsg.evaluation.judge import violated
from rvsg.evaluation.verdict import Status
from rvsg.report.page import environment, headline
from rvsg.report.summary import Summary, counted, interval, number
from rvsg.scenario.requirement import Requirement

Reported = tuple[str, Plan, Summary]
"""Where the report of a campaign is, seen from the overview's folder, and what it is of."""


def write_overview(path: Path, reported: Sequence[Reported], *, command: str, missing: int = 0) -> None:
    """Write the page to a file, whole or not at all; the rest as for `render_overview`."""
    write_whole(path, render_overview(reported, command=command, missing=missing))


def render_overview(reported: Sequence[Reported], *, command: str, missing: int = 0) -> str:
    """The page of one or more campaigns of one command, finished or not; `missing` more have not begun.

    `command` repeats them all.
    """
    template = environment().get_template("overview.html")
    mission = reported[0][1].mission
    return template.render(
        version=rvsg.__version__,
        title=f"{counted(len(reported), 'campaign')} in {Path(mission.world).name}",
        robot=mission.robot_name,
        missing=missing,
        headline=_headline(reported),
        tiles=_tiles(reported),
        rows=[_row(*each) for each in reported],
        command=command,
    )


def _ends(reported: Sequence[Reported]) -> tuple[int, int]:
    """How many campaigns ended with a violation in fresh runs, and how many with none."""
    confirmed = [summary.confirmed for *_, summary in reported if summary.confirmed]
    verdicts = [attempt.verdict for attempt in confirmed if attempt.verdict]
    return sum(map(violated, verdicts)), sum(verdict.status is Status.PASS for verdict in verdicts)


def _headline(reported: Sequence[Reported]) -> dict[str, str]:
    """What all campaigns together found, as `headline` says it of one."""
    bad, good = _ends(reported)
    campaigns = counted(len(reported), "campaign")
    if bad:
        text = f"In {bad} of {campaigns} the worst scenario found violates its requirement."
        return {"tone": "bad", "chip": "violated", "text": text}
    if good == len(reported):
        text = f"In {campaigns} no worst scenario found violates its requirement."
        return {"tone": "good", "chip": "kept", "text": text}
    return {"tone": "quiet", "chip": "not decided", "text": f"{good} of {campaigns} passed; no other is decided."}


def _tiles(reported: Sequence[Reported]) -> list[dict[str, str]]:
    """How many campaigns ended how, and what they took."""
    bad, good = _ends(reported)
    accounts = [summary.accounting for *_, summary in reported]
    search, fresh = sum(a.search_runs for a in accounts), sum(a.confirmation_runs for a in accounts)
    rest = len(reported) - bad - good
    return [
        {
            "name": "Requirement violated",
            "value": str(bad),
            "note": "always (FAIL), sometimes (FLAKY), or which is open",
        },
        {"name": "Requirement kept", "value": str(good), "note": "by the worst scenario found (PASS)"},
        {"name": "Not decided", "value": str(rest), "note": "too few fresh runs, or no limit"},
        {"name": "Simulated runs", "value": str(search + fresh), "note": f"{search} to search, {fresh} to confirm"},
    ]


def _row(link: str, plan: Plan, summary: Summary) -> dict[str, str]:
    """A campaign as the table shows it: by the fresh runs of its worst scenario, or those of the search."""
    requirement, account = plan.requirement, summary.accounting
    confirmed = summary.confirmed.verdict if summary.confirmed else None
    verdict = confirmed or (summary.ranking[0].verdict if summary.ranking else None)
    violated = "–"
    if verdict and verdict.violation_probability is not None and verdict.violation_interval is not None:
        low, high = verdict.violation_interval
        violated = f"{verdict.violation_probability:.0%} [{low:.0%}, {high:.0%}]"
    return {
        "link": quote(link),
        "route": plan.mission.route.name,
        "requirement": requirement.name,
        "title": requirement.title,
        "description": summary.ranking[0].description if summary.ranking else "",
        "violated": violated,
        "value": interval(verdict, requirement.unit) if verdict else "–",
        "limit": _limit(requirement),
        "runs": f"{account.search_runs} + {account.confirmation_runs}",
        **headline(plan, summary),
    }


def _limit(requirement: Requirement) -> str:
    """What keeps the requirement, e.g. `≥ 1.2 m`."""
    if requirement.threshold is None:
        return "–"
    return f"{'≥' if requirement.worse == 'smaller' else '≤'} {number(requirement.threshold, requirement.unit)}"
