"""Two campaigns, two sets of runs or two versions side by side: what is fixed, broken or unchanged."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from nicegui import ui

import rvsg
from rvsg.app.comparison import VersionComparison, compare_campaigns
from rvsg.core.errors import InputError
from rvsg.report.comparison_page import TONES, change_rows
from rvsg.suites.suite import CaseChange, CaseResult, Change
from rvsg_studio.answers import compared_versions
from rvsg_studio.frame import (
    PATIENT_S,
    Page,
    actions,
    address,
    chip,
    field,
    link,
    load,
    page,
    route,
    select,
    table,
    tag,
)
from rvsg_studio.listing import FoundCampaign, Listing, suite_results_in, why_not
from rvsg_studio.workspace import Workspace, stamp

SIZE = 320
LEFT, BELOW, AIR = 46, 40, 10
"""Free space around the scatter, in its own units."""
SHOWN = 100
COLUMNS = ("Case", "Requirement", "Change", "Violated before", "Violated now", "Difference (95 % interval)", "p (Holm)")
Pair = tuple[CaseResult, CaseResult, CaseChange]
"""A configuration that both campaigns ran, as each of them found it, and what changed."""
Place = tuple[float, float]
"""The value of a pair on the first side, and on the second."""


def matrix(found: Iterable[tuple[tuple[int, int], Change]], sides: Sequence[str]) -> None:
    """Lay out how many were violated before and after, and what that is worth.

    Args:
        found: violating runs of both sides, and what changed, of each pair.
        sides: what both sides are called.
    """
    cells: dict[tuple[bool, bool], Counter[Change]] = {}
    for (first, second), change in found:
        cells.setdefault((first > 0, second > 0), Counter())[change] += 1
    words = {True: "violated in", False: "kept in"}
    with table(["", *(f"{words[after]} {sides[1]}" for after in words)], label="Before and after", id="matrix"):
        for before in words:
            with tag("tr"):
                tag("th", f"{words[before]} {sides[0]}", scope="row")
                for after in words:
                    with tag("td"):
                        counts = cells.get((before, after), Counter())
                        if not counts:
                            tag("span", "none", cls="soft")
                        for change in Change:
                            if counts[change]:
                                chip(f"{counts[change]} {change.value}", TONES[change])


def scatter(places: Iterable[Place], said: str, across: str, up: str) -> None:
    """Draw the value of each pair; on the line both sides are equal. A larger circle holds several pairs.

    Args:
        said: what the axes are, for those who do not see the drawing.
    """
    known = Counter(places)
    if not known:
        return
    values = [value for pair in known for value in pair]
    air = 0.08 * (max(values) - min(values)) or 0.5
    low, high = min(values) - air, max(values) + air

    def at(value: float) -> float:
        return (value - low) / (high - low) * (SIZE - LEFT - AIR)

    with tag("svg", viewBox=f"0 0 {SIZE} {SIZE}", role="img", aria_label=said, cls="chart narrow", id="scatter"):
        base = SIZE - BELOW
        for x2, y2 in ((LEFT + at(high), base - at(high)), (SIZE - AIR, base), (LEFT, AIR)):
            tag("line", x1=LEFT, y1=base, x2=x2, y2=y2, cls="grid")
        for (x, y), count in known.items():
            r = 4 + math.sqrt(count)
            tag("circle", cx=f"{LEFT + at(x):.1f}", cy=f"{base - at(y):.1f}", r=f"{r:.1f}", cls="new")
        middle = (SIZE + LEFT) / 2
        tag("text", across, x=middle, y=SIZE - 12, cls="axis", text_anchor="middle")
        turned = f"rotate(-90 18 {base / 2})"
        tag("text", up, x=18, y=base / 2, cls="axis", text_anchor="middle", transform=turned)


def add(workspace: Workspace) -> None:
    """Add the pages."""

    @route(workspace, "/compare", "Compare", menu=4, patience_s=PATIENT_S)
    async def compare(a: str = "", b: str = "") -> None:
        listing = await load(workspace.whole_listing if a and b else workspace.listing)
        found = await load(_read, workspace, a, b) if a and b else None
        with page(workspace, "Compare", here="/compare", wide=True) as made:
            _choose_campaigns(made, [each for each in listing.campaigns if not each.problem], a, b)
            if found is not None:
                _totals(listing, a, b)
                _pairs(a, b, *found)
            tag("p", "", cls="soft")
            link("Compare two versions of the robot on a suite", "/compare/versions")

    @route(workspace, "/compare/runs", "Two replays on one clock", patience_s=PATIENT_S)
    async def runs(a: str = "", b: str = "", first: int = -1, second: int = -1) -> None:
        with page(workspace, "Two replays on one clock", wide=True):
            tag("div", data_studio="together", cls="st-actions", id="together")
            with tag("div", cls="st-two st-pair"):
                for name, attempt in ((a, first), (b, second)):
                    with tag("section", aria_label=name):
                        tag("h2", name)
                        where = address("/data/replay", campaign=name, attempt=attempt, alone=1)
                        tag("div", data_studio="replay", data_url=where)

    @route(workspace, "/compare/versions", "Compare two versions", patience_s=PATIENT_S)
    async def versions(
        first: str = "", second: str = "", suite: str = "", case: str = "", requirement: str = ""
    ) -> None:
        listing, results = await load(workspace.listing), await load(suite_results_in, workspace.folder)
        given = {"first": first, "second": second, "suite": suite}
        compared = await load(compared_versions, workspace, first, second, suite) if first and second else None
        with page(workspace, "Compare two versions", here="/compare", wide=True) as made:
            files = {"": "choose results"} | {each: each for each in results}
            suites = {"": "none"} | {each: each for each in listing.suites}
            choices = {
                "first": ("Version before", files),
                "second": ("Version now", files),
                "suite": ("Suite to replay", suites),
            }
            _choose(made, "/compare/versions", given, choices, "Choose two files of results.")
            if not results:
                tag("p", "No results of a suite are in this folder yet. `rvsg suite run` writes them.", cls="soft")
            if compared is not None:
                _changes(compared, given)
                if suite and case:
                    _replay(compared, given, case, requirement)
                both = shlex.join((first, second))
                made.command("Compare two versions", f"rvsg suite compare {both} --html versions.html")
            made.command("Run a suite", "rvsg suite run suite --runs 20 --version now --json > now.json")


Paired = tuple[tuple[Pair, ...], Mapping[int | None, str], str]
"""The scenarios that two campaigns both ran, the names that the answer of the first gives attempts, and the unit."""


def _read(workspace: Workspace, a: str, b: str) -> Paired:
    """Pair the scenarios of two campaigns; what was read is kept until one of their stores changes."""
    paths = workspace.existing(a), workspace.existing(b)

    def made() -> Paired:
        first, second = (rvsg.Campaign.open(path) for path in paths)
        found = compare_campaigns(first, second)
        one, two = found.variants
        names: dict[int | None, str] = {row.attempt: f"{row.number} {row.name}" for row in first.answer.rows}
        return tuple(zip(one.cases, two.cases, found.changes, strict=True)), names, first.requirement.unit

    return workspace.kept(("pairs", a, b, stamp(paths[1])), paths[0], made)


def _choose_campaigns(made: Page, known: Sequence[FoundCampaign], a: str, b: str) -> None:
    """Lay out the choice of two campaigns; what cannot be compared says why, and cannot be chosen."""
    chosen = {"a": a, "b": b}
    mates = {each.folder: any(not why_not(each, other) for other in known) for each in known}
    firsts = {name: name if mates[name] else f"{name}: no campaign ran the same scenarios" for name in mates}

    def compare() -> None:
        if not all(chosen.values()):
            raise InputError("Choose two campaigns.")
        ui.navigate.to(address("/compare", **chosen))

    def lay_second(folder: str, kept: str = "") -> None:
        chosen.update(a=folder, b=kept)
        first = next((each for each in known if each.folder == folder), None)
        why = {each.folder: why_not(first, each) if first is not None else "choose the first" for each in known}
        texts = {name: f"{name}: {why[name]}" if why[name] else name for name in sorted(why, key=why.__getitem__)}
        second.clear()
        with second, field("Second"):
            unfit = {name for name in why if why[name]}
            select({"": "choose a campaign"} | texts, kept, partial(chosen.__setitem__, "b"), disabled=unfit)

    with tag("div", cls="st-form"):
        with field("First"):
            unfit = {name for name, mate in mates.items() if not mate}
            select({"": "choose a campaign"} | firsts, a, lay_second, disabled=unfit)
        second = tag("div")
    lay_second(a, b)
    if known and not any(mates.values()):
        none = "No two campaigns here ran the same scenarios: repeat one with another stack and the same seed."
        tag("p", none, cls="soft")
    with actions():
        made.button("Compare", compare, cls="st-primary")


def _choose(
    made: Page, path: str, given: Mapping[str, str], choices: Mapping[str, tuple[str, dict[str, str]]], missing: str
) -> None:
    """Lay out what can be chosen, and the button that opens the page on it; the first two must be chosen."""
    chosen = dict(given)

    def compare() -> None:
        if not all(chosen[key] for key in [*chosen][:2]):
            raise InputError(missing)
        ui.navigate.to(address(path, **chosen))

    with tag("div", cls="st-form"):
        for key, (label, options) in choices.items():
            with field(label):
                select(options, given[key], partial(chosen.__setitem__, key))
    with actions():
        made.button("Compare", compare, cls="st-primary")


def _totals(listing: Listing, a: str, b: str) -> None:
    known = {each.folder: each for each in listing.campaigns}
    shown = [known[name] for name in (a, b) if name in known]
    rows: dict[str, Callable[[FoundCampaign], Any]] = {
        "World, route": lambda c: f"{c.world}, {c.route}",
        "Requirement": lambda c: c.requirement,
        "Generator": lambda c: c.generator,
        "Configurations tried": lambda c: c.attempts,
        "Runs": lambda c: c.runs,
        "Failures": lambda c: len(c.failures),
        "Most severe": lambda c: f"{c.failures[0].row.name}, {c.failures[0].row.share}" if c.failures else "none",
        "Cost": lambda c: "unknown" if c.cost_usd is None else f"{c.cost_usd:.2f} USD",
    }
    with table(["", *(campaign.folder for campaign in shown)], label="Totals"):
        for label, value in rows.items():
            with tag("tr"):
                tag("th", label, scope="row")
                for campaign in shown:
                    tag("td", str(value(campaign)))


def _pairs(a: str, b: str, pairs: tuple[Pair, ...], names: Mapping[int | None, str], unit: str) -> None:
    tag("h2", "The same scenarios in both")
    if not pairs:
        tag(
            "p",
            "The two campaigns ran no scenario in common. Campaigns that replay the same scenarios, such as one with "
            "another stack and the same seed, can be compared scenario by scenario.",
            cls="soft",
        )
        return
    verdicts = [(one.verdict, two.verdict) for one, two, _ in pairs]
    with tag("div", cls="st-two"):
        with tag("div"):
            counts = [(one.violations, two.violations) for one, two in verdicts]
            matrix(zip(counts, (each.change for _, _, each in pairs), strict=True), ("the first", "the second"))
            means = [(x.mean, y.mean) for x, y in verdicts if x.mean is not None and y.mean is not None]
            said = f"Mean objective of each scenario, first campaign across, second up, {unit}"
            scatter(means, said, *(f"mean in the {which}, {unit}" for which in ("first", "second")))
        with tag("div", cls="st-list"):
            for one, two, change in pairs[:SHOWN]:
                with tag("div", cls="st-row"):
                    with tag("span", cls="st-row-head"):
                        chip(change.change.value, TONES[change.change])
                        shares = (f"{each.verdict.violations} of {each.verdict.runs}" for each in (one, two))
                        tag("span", " → ".join(shares), cls="small")
                    with tag("span", cls="st-clip"):
                        link(names.get(one.attempt, one.title), "/finding", campaign=a, attempt=one.attempt)
                        tag("span", " · ")
                        link("in the second", "/finding", campaign=b, attempt=two.attempt)
                    with tag("span"):
                        where = address("/compare/runs", a=a, b=b, first=one.attempt, second=two.attempt)
                        label = f"Replay attempts {one.attempt} and {two.attempt}"
                        tag("a", "Replay both", href=where, aria_label=label)


def _changes(compared: VersionComparison, given: dict[str, str]) -> None:
    names = [each.version for each in compared.found.variants]
    tag("h2", f"{names[1]} against {names[0]}")
    found = [each for each in compared.found.changes if each.change is not Change.MISSING]
    with tag("div", cls="st-two"):
        matrix([(each.violations, each.change) for each in found], names)
        shares = [(each.violations[0] / each.seeds, each.violations[1] / each.seeds) for each in found if each.seeds]
        said = f"Share of violating runs of each case, {names[0]} across, {names[1]} up"
        scatter(shares, said, *(f"violating share, {name}" for name in names))
    with table(COLUMNS, label="Every case"):
        for row in change_rows(compared.found.changes):
            case = {"case": row["case"], "requirement": row["requirement"]}
            can_replay = tuple(case.values()) in compared.replayable
            replay = address("/compare/versions", **given, **case) + "#replay" if can_replay else None
            with tag("tr"):
                with tag("td"):
                    tag("a" if replay else "span", row["title"], href=replay)
                tag("td", row["requirement"])
                with tag("td"):
                    chip(row["change"], row["tone"])
                for key in ("before", "now", "difference", "p"):
                    tag("td", row[key], cls="n")


def _replay(compared: VersionComparison, given: dict[str, str], case: str, requirement: str) -> None:
    first, second = (each.version for each in compared.found.variants)
    names = f"{first}, and over it {second}"
    with tag("section", id="replay", aria_label="Both versions on one clock"):
        tag("h2", f"{case}, {requirement}: both versions on one clock")
        tag("p", f"The first seed on which they differ, run again with {names}.", cls="soft")
        where = address("/data/versions", **given, case=case, requirement=requirement)
        tag("div", data_studio="replay", data_url=where, data_both="")
