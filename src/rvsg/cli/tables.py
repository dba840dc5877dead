"""The results of a campaign as tables for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from rvsg.app.commands import confirm_command
from rvsg.campaign.attempt import Plan
from rvsg.cli.console import as_started, say
from rvsg.evaluation.verdict import OPEN, Status, Verdict, counted, number, still_open, value_in_words
from rvsg.report.summary import Ranked, Summary
from rvsg.report.terminal import describe_failure, describe_finding

if TYPE_CHECKING:
    from rvsg.app.campaign import Campaign
    from rvsg.campaign.feedback import MapCell
    from rvsg.campaign.ranking import Front

WITHOUT_TEXT = 35
"""Characters of a row without the scenario's description and the objective."""
OBJECTIVE = 21
"""Characters that an objective usually takes at most."""

STYLES = {
    Status.PASS: "green",
    Status.FAIL: "bold red",
    Status.FLAKY: "red",
    Status.INCONCLUSIVE: "dim",
    Status.UNJUDGED: "dim",
}


MARK_OPEN = f"† violated; {OPEN}."


CANDIDATE = "candidate"
TOUCHED = "‡ robot and person touch in at least one of these runs."


def _marked(verdict: Verdict) -> str:
    return verdict.status.value + ("†" if still_open(verdict) else "")


def _shown_verdict(entry: Ranked) -> str:
    """Return the verdict of a confirmed scenario, or whether the search made it a candidate."""
    said = _marked(entry.verdict) if entry.state == "confirmed" else CANDIDATE if entry.state == CANDIDATE else "–"
    return said + ("‡" if entry.seen.contacts.runs else "")


def _style(verdict: Verdict) -> str:
    return STYLES[Status.FLAKY] if still_open(verdict) else STYLES[verdict.status]


def _objective(verdict: Verdict, unit: str) -> str:
    """Return the mean with its interval; where runs did not arrive in time the median and their number, in lines."""
    if not verdict.censored:
        return value_in_words(verdict, unit)
    late = f"{verdict.censored}/{verdict.runs} did not arrive"
    return f"median {number(verdict.median, unit)}\n{late}" if verdict.median is not None else late


def ranked_table(plan: Plan, summary: Summary, *, width: int = 80, rows: int = 10) -> Table:
    """Return the table of scenarios, worst first, in `width` characters."""
    requirement = plan.requirement
    worse = f"{requirement.worse} is worse".replace("smaller", "lower").replace("larger", "higher")
    limit = f", limit {number(requirement.limit, requirement.unit)}" if requirement.limit is not None else ""
    measured = requirement.metric or "robustness"
    title = f"{requirement.name} {requirement.title}: {measured} ({worse}{limit})"
    table = Table(
        title=title,
        title_justify="left",
        caption=_legend(summary, rows),
        caption_justify="left",
        box=SIMPLE_HEAD,
        pad_edge=False,
    )
    table.add_column("#", justify="right", no_wrap=True)
    shown = summary.ranking[:rows]
    objectives = [_objective(entry.verdict, requirement.unit) for entry in shown]
    longest = max([OBJECTIVE, *(len(line) for each in objectives for line in each.splitlines())])
    room = max(12, width - WITHOUT_TEXT - longest)
    table.add_column("scenario", overflow="ellipsis", no_wrap=True, max_width=room)
    table.add_column("objective [95 %]", justify="right", no_wrap=True)
    table.add_column("verdict, violated runs", no_wrap=True)
    names = without_common_beginning([" ".join(entry.description.split()) for entry in shown])
    for entry, name, objective in zip(shown, names, objectives, strict=True):
        verdict = entry.verdict
        counted = f" {verdict.violations}/{verdict.runs}" if requirement.threshold is not None else ""
        style = _style(verdict) if entry.state == "confirmed" else STYLES[Status.INCONCLUSIVE]
        table.add_row(
            str(entry.rank),
            Text(f"{entry.scenario + 1}. {name}"),
            Text(objective),
            Text(_shown_verdict(entry) + counted, style=style),
        )
    return table


def _legend(summary: Summary, rows: int) -> str:
    """Return how many scenarios the table leaves out, and what the words and marks in the rows mean."""
    shown, more = summary.ranking[:rows], len(summary.ranking) - rows
    confirmed = [entry.verdict for entry in shown if entry.state == "confirmed"]
    said = [f"{counted(more, 'more scenario')} in the report."] if more > 0 else []
    if confirmed:
        said.append("Verdicts are those of the confirmation runs.")
    if any(entry.state == CANDIDATE for entry in shown):
        said.append("A candidate violated in the search and is not confirmed.")
    if any(map(still_open, confirmed)):
        said.append(MARK_OPEN)
    if any(verdict.status is Status.INCONCLUSIVE and not still_open(verdict) for verdict in confirmed):
        said.append("INCONCLUSIVE: too few runs for a verdict.")
    if any(entry.seen.contacts.runs for entry in shown):
        said.append(TOUCHED)
    return " ".join(said)


def matrix_table(found: Sequence[tuple[Plan, Summary]]) -> Table:
    """Return the table of several campaigns, with the worst confirmed scenario of each."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, caption_justify="left")
    table.add_column("campaign", overflow="fold", min_width=len("campaign"))
    table.add_column("worst [95 %]", justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("violated", no_wrap=True)
    opened = unconfirmed = touched = False
    for plan, summary in found:
        confirmed = summary.confirmed.verdict if summary.confirmed else None
        verdict = confirmed or (summary.ranking[0].verdict if summary.ranking else None)
        requirement, unit = plan.requirement, plan.requirement.unit
        name = f"{plan.mission.route.name} {requirement.name}"
        if verdict is None:
            table.add_row(name, "–", Text("no scenario" if summary.complete else "unfinished", style="dim"), "")
            continue
        often = ""
        if verdict.violation_probability is not None and verdict.violation_interval is not None:
            low, high = verdict.violation_interval
            often = f"{verdict.violation_probability:.2f} [{low:.2f}, {high:.2f}]"
        unconfirmed = unconfirmed or not confirmed
        seen = summary.seen is not None and summary.seen.contacts.runs > 0
        touched = touched or seen
        said = _marked(verdict) + ("" if confirmed else "*") + ("‡" if seen else "")
        table.add_row(name, _objective(verdict, unit), Text(said, style=_style(verdict)), often)
        opened = opened or still_open(verdict)
    notes = [MARK_OPEN] if opened else []
    notes += ["* from the search only, not confirmed"] if unconfirmed else []
    notes += [TOUCHED] if touched else []
    table.caption = "\n".join(notes) or None
    return table


def without_common_beginning(texts: list[str]) -> list[str]:
    """Return the texts without the words that all of them begin with, if there are two or more."""
    words = [text.split(" ") for text in texts]
    same = 0
    if len(words) > 1:
        columns = takewhile(lambda column: len(set(column)) == 1, zip(*words, strict=False))
        same = min(len(list(columns)), min(len(each) for each in words) - 1)
    return [" ".join(each[same:]) for each in words]


def how_far(plan: Plan, summary: Summary) -> str:
    """Return how far an unfinished campaign came."""
    done = summary.accounting.search_attempts
    if done >= plan.attempts:
        return f"all {counted(done, 'attempt')} of the search, the confirmation is not finished"
    return f"{done} of {counted(plan.attempts, 'attempt')} of the search"


def show_findings(campaign: Campaign, summary: Summary) -> None:
    """Print the worst finding in full, one line for each other finding, and the candidates."""
    if not summary.ranking:
        say("No valid scenario was measured, so nothing is known of the robot.")
        return
    found = campaign.findings
    if not found:
        say("The best scenario was not confirmed.")
    for finding in found:
        for line in describe_finding(finding, campaign.requirement, brief=finding is not found[0]):
            say(line)
    distinct = campaign.distinct_failures
    if len(distinct) > 1 or any(failure.smallest for failure in distinct):
        say(f"{counted(len(distinct), 'distinct failure')}:")
        for failure in distinct:
            for line in describe_failure(failure):
                say(f"  {line}")
    if (front := campaign.front) is not None:
        show_front(front)
    if campaign.fills_a_map:
        show_map(campaign.failure_map)
    if left := campaign.candidates():
        command = as_started(confirm_command(campaign.folder, left[0].index))
        many = counted(len(left), "configuration")
        say(
            f"{many} violated in the search and {'is' if len(left) == 1 else 'are'} not confirmed; the worst: {command}"
        )


def show_front(front: Front) -> None:
    """Print the configurations that no other one beats on every requirement."""
    title = (
        f"{counted(len(front.points), 'configuration')} on the Pareto front, hypervolume {number(front.hypervolume)}"
    )
    table = Table(title=title, title_justify="left", caption="Mean, and how many runs violate", caption_justify="left")
    table.add_column("attempt", justify="right")
    for tried in front.points[0].tried if front.points else ():
        table.add_column(tried.requirement, justify="right")
    for point in front.points:
        cells = [f"{number(each.mean)} ({each.violations} of {each.runs})" for each in point.tried]
        table.add_row(str(point.attempt), *cells)
    say(table)


def show_map(cells: Sequence[MapCell]) -> None:
    """Print the kinds of encounters in which the requirement was violated."""
    broken = [cell for cell in cells if cell.violations]
    table = Table(title=f"{len(broken)} of {counted(len(cells), 'kind')} of encounters violate", title_justify="left")
    for name in ("way", "place", "who", "encounter", "mean", "violations", "attempt"):
        table.add_column(name, justify="right" if name in ("mean", "violations", "attempt") else "left")
    for cell in broken:
        met = cell.encounter
        shares = (number(cell.mean), f"{cell.violations} of {cell.runs}", str(cell.attempt))
        table.add_row(met.stretch, met.place, met.who, met.kind, *shares)
    say(table)
