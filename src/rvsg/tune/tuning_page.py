"""A tuning in words, and its page: before and after on every check, what changes and why, what stays unsolved."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from markupsafe import Markup

from rvsg.evaluation.verdict import counted, number, percent
from rvsg.report.charts import Scale, ticks
from rvsg.report.comparison_page import ReplayedChange, change_replay
from rvsg.report.renderer import component, render, script_safe
from rvsg.tune.parameter_search import ParameterSearch, Score, Unsolved
from rvsg.tune.tuning import Check, ProposalCheck, Sweep, Tuning, ValueChange

NAMES = ("before", "proposal")
ABOUT: Mapping[Check, str] = {
    "tuned": "cases it was tuned on, with other seeds",
    "held out": "cases of other kinds of failure",
    "attacked": "scenarios of a new search against each, with the same budget",
    "ordinary": "people on random errands",
    "empty": "the routes without people",
}


def headline(found: Tuning) -> str:
    """Return what came of a tuning, with the checks that decide it."""
    if found.proposal is None:
        none = f"None of the {found.settings} settings tried fails less and holds the limits."
        return f"No zone helps. {none}" if found.zones else none
    rows = [f"{part.name} {_shares(part)}" for part in found.parts if part.name in ("tuned", "held out")]
    said = f"{'Shown to help' if found.helps else 'Not shown to help'}. Runs that violate: {'; '.join(rows)}."
    attacked = found.part("attacked")
    if attacked and attacked.difference and attacked.difference.is_clear and attacked.difference.difference > 0:
        said += " A new search finds more violations of the proposal than of the stack before."
    return said


def _shares(part: ProposalCheck) -> str:
    """Return the shares of violating runs before and after, with their difference."""
    difference = part_row(part)["difference"]
    return f"{percent(part.before.share)} to {percent(part.after.share)}, {difference}" if difference else "not judged"


def part_row(part: ProposalCheck) -> dict[str, str]:
    """Return a check as text."""
    cases = len({case.case for case in part.before.cases})
    row = {"name": part.name, "about": ABOUT[part.name], "cases": str(cases), "difference": "", "tone": ""}
    for key, each in (("before", part.before), ("after", part.after)):
        low, high = each.interval
        row[key] = f"{each.violated} of {each.judged}: {percent(each.share)} ({percent(low)} to {percent(high)})"
        if not each.judged:
            row[key] = f"not judged; {each.arrived} of {each.runs} arrive"
    row["contacts"] = f"{part.before.contacts} to {part.after.contacts}"
    row["time"] = f"{100 * part.more_time:+.1f} %"
    if part.difference is not None:
        low, high = (100 * bound for bound in part.difference.interval)
        row["difference"] = f"{100 * part.difference.difference:+.0f} points ({low:+.0f} to {high:+.0f})"
        if part.difference.is_clear:
            row["tone"] = "good" if part.difference.difference < 0 else "bad"
    if part.failures is not None:
        row["about"] += f"; {part.failures[0]} failures confirmed before, {part.failures[1]} after"
        row["cases"] = f"{len(part.before.cases)}, {len(part.after.cases)}"
    return row


def part_text(part: ProposalCheck) -> str:
    """Return a check as a line."""
    row = part_row(part)
    shares = f"{row['before']} before, {row['after']} after"
    if row["difference"]:
        shares = f"{percent(part.before.share)} to {percent(part.after.share)} of runs violate, {row['difference']}"
    contacts = f"contact {row['contacts']} of {part.after.runs}"
    return f"{row['name']} ({row['cases']} cases): {shares}; {contacts}; time {row['time']}"


def search_text(search: ParameterSearch, budget: int, took_s: float) -> str:
    """Return how far a search is, and the best setting so far."""
    left = took_s * (budget - search.spent) / search.spent / 60.0
    before, best = search.before.score, search.best.score
    assert before is not None and best is not None
    return (
        f"{search.spent} of {budget} runs, about {left:.0f} min of it left; {len(search.candidates)} settings, "
        f"violations {before.violated} to {best.violated} of {best.runs}, contact {before.contacts} to "
        f"{best.contacts}, time {100 * (best.time - 1.0):+.0f} %"
    )


def trade(score: Score, before: Score) -> str:
    """Return what a setting trades, as its name."""
    said, more = [], score.violated - before.violated
    said.append(f"{counted(abs(more), 'violation')} {_more(more)}" if more else "as many violations")
    if before.contacts or score.contacts:
        said.append(f"contact in {score.contacts} of {score.runs} runs" if score.contacts else "no contact")
    for share, least, words in ((score.time, 0.5, ("longer", "shorter")), (score.jerk, 5.0, ("rougher", "smoother"))):
        if abs(change := 100 * (share - 1.0)) >= least:
            said.append(f"{abs(change):.0f} % {words[change < 0]}")
    if broken := sorted({*score.broken_cases, *score.new_contacts}):
        said.append(f"{', '.join(broken)} breaks")
    return ", ".join(said)


def front_row(number: int, score: Score, before: Score) -> dict[str, Any]:
    """Return a setting of a front: its number, what it trades, and the figures of that."""
    return {
        "number": number,
        "trade": "as it is" if number == 0 else trade(score, before),
        "violated": f"{score.violated} of {score.runs}",
        "contact": f"{score.contacts} of {score.runs}",
        "time": f"{100 * (score.time - 1.0):+.1f} %",
    }


def reason(change: ValueChange, score: Score | None) -> str:
    """Return why a value changes: what happens without the change."""
    without = change.without
    if without is None or score is None:
        return "fixed by you"
    violations, contacts = without.violated - score.violated, without.contacts - score.contacts
    said = [f"{counted(abs(violations), 'violation')} {_more(violations)}"] if violations else []
    said += [f"contact in {counted(abs(contacts), 'run')} {_more(contacts)}"] if contacts else []
    said += [f"time {100 * (without.time / score.time - 1.0):+.1f} %"]
    said += [f"{', '.join(broken)} breaks"] if (broken := (*without.broken_cases, *without.new_contacts)) else []
    return f"without it, in {score.runs} runs: {', '.join(said)}"


def _more(difference: int) -> str:
    return "fewer" if difference < 0 else "more"


def unsolved_text(each: Unsolved, found: Tuning) -> str:
    """Return what no setting removed, and what limits it where enough settings were tried to tell."""
    text = (
        f"{each.case}: none of the {counted(each.settings, 'setting')} tried with each of its seeds removes this "
        f"failure; the best still violates in {each.least} of {each.of} runs."
    )
    if found.zones:
        return text
    if each.settings < each.needed:
        return f"{text} What limits it can be told from {each.needed} settings on."
    if each.limited_by is None or each.end is None:
        return f"{text} The best values of no parameter lie at the end of its range, so no range is seen to limit it."
    unit = next(parameter.unit for parameter in found.parameters if parameter.name == each.limited_by)
    return (
        f"{text} {each.limited_by} may limit it: the best values lie at the end of its range, {number(each.end, unit)}."
    )


def result_lines(found: Tuning) -> Iterator[str]:
    """Yield the checks, the zones, the changes with their reasons, what no setting removes, and what failed."""
    yield from (f"zone {k}: {text}" for k, text in enumerate(found.zones.sources if found.zones else (), 1))
    for choice in found.tried:
        values = ", ".join(f"{name} {value:g}" for name, value in choice.values.items())
        yield f"{values}: {trade(choice.score, found.before)}"
    yield from map(part_text, found.parts)
    for change in found.changes:
        before = "" if change.before is None else f"{change.before:g} to "
        yield f"{change.key or change.name}: {before}{change.after:g} {change.unit}; {reason(change, found.score)}"
    for each in found.unsolved:
        yield unsolved_text(each, found)
    if found.failed:
        yield f"The stack failed in, or refused, {counted(len(found.failed), 'setting')}, e.g. {found.failed[0]}"


def tuning_page(found: Tuning, replayed: ReplayedChange | None = None) -> str:
    """Return a tuning as an HTML page that loads nothing.

    Args:
        replayed: the run that gets better the most; before and after move on one clock.
    """
    shown = replayed and {
        "of": replayed,
        "data": script_safe(change_replay(replayed, NAMES)),
        "ids": script_safe([run.run.id for run in replayed.runs]),
        "stories": list(zip(NAMES, [[said.text for said in run.story] for run in replayed.runs], strict=True)),
    }
    worse = [f"{each.case} ({part.name})" for part in found.parts for each in part.comparison.broken]
    return render(
        "tuning.html",
        found=found,
        headline=headline(found),
        front=[(each, front_row(each.number, each.score, found.before)["trade"]) for each in found.front],
        tried=[(each, trade(each.score, found.before)) for each in found.tried],
        changes=[(each, reason(each, found.score)) for each in found.changes],
        parts=[part_row(each) for each in found.parts],
        sweeps=[sweep_chart(each) for each in found.sweeps],
        unsolved=[unsolved_text(each, found) for each in found.unsolved],
        worse=worse,
        shown=shown,
        component=Markup(component()),  # noqa: S704  (our own files)
    )


def sweep_chart(sweep: Sweep) -> Markup:
    """Return the share of violating runs (line) and the time (dashes) over the range of a parameter."""
    width, height = 340, 200
    x = Scale(sweep.parameter.low, sweep.parameter.high, 44, width - 40)
    y = Scale(0.0, 1.0, height - 34, 24)
    points = [
        (x(value), y(score.violated / score.runs), y(min(2.0, score.time) / 2.0), value, score)
        for value, score in sweep.points
    ]
    found = ticks(x.low, x.high, 4)
    return render("sweep.svg", width=width, height=height, sweep=sweep, x=x, y=y, points=points, ticks=found)
