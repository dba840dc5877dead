"""Two campaigns, two sets of runs or two versions side by side: what is fixed, broken or unchanged."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from nicegui import ui

import rvsg
from rvsg.app.comparison import VersionComparison, compare_campaigns
from rvsg.campaign.comparison import CaseChange, Change
from rvsg.campaign.suite import CaseResult
from rvsg.core.errors import InputError, RvsgError
from rvsg.report.comparison_page import change_rows
from rvsg_studio.answers import compared_versions
from rvsg_studio.frame import PATIENT_S, Page, address, chip, field, link, load, page, problem, select, tag
from rvsg_studio.listing import FoundCampaign, Listing, suite_results_in
from rvsg_studio.workspace import Workspace, stamp

SIZE = 320
LEFT, BELOW, AIR = 46, 40, 10
"""Free space around the scatter, in its own units."""


@dataclass(frozen=True, kw_only=True)
class Compared:
    """A scenario or case on both sides."""

    violations: tuple[int, int]
    """Violating runs of the first and of the second side."""
    place: tuple[float, float] | None
    """Where it is in the scatter: the value on the first side, and on the second."""
    change: Change


def matrix(found: Sequence[Compared], sides: tuple[str, str]) -> None:
    """Lay out how many were violated before and after, and what that is worth."""
    cells: dict[tuple[bool, bool], Counter[Change]] = {}
    for each in found:
        violated = (each.violations[0] > 0, each.violations[1] > 0)
        cells.setdefault(violated, Counter())[each.change] += 1
    words = {True: "violated in", False: "kept in"}
    holder = tag("div", cls="scroll", tabindex="0", role="region", aria_label="Before and after")
    with holder, tag("table", cls="st-plain", id="matrix"):
        with tag("thead"), tag("tr"):
            tag("td", "")
            for after in (True, False):
                tag("th", f"{words[after]} {sides[1]}", scope="col")
        with tag("tbody"):
            for before in (True, False):
                with tag("tr"):
                    tag("th", f"{words[before]} {sides[0]}", scope="row")
                    for after in (True, False):
                        with tag("td"):
                            _counts(cells.get((before, after), Counter()))


def _counts(found: Counter[Change]) -> None:
    if not found:
        tag("span", "none", cls="soft")
    for change in Change:
        if found[change]:
            change_chip(change, f"{found[change]} {change.value}")


def change_chip(change: Change, text: str = "") -> None:
    """Add a chip with a change in its colour."""
    chip(text or change.value, bad=change is Change.BROKEN, good=change is Change.FIXED)


def scatter(found: Sequence[Compared], said: str, across: str, up: str) -> None:
    """Draw the value of each pair; on the line both sides are equal. A larger circle holds several pairs.

    Args:
        said: what the axes are, for those who do not see the drawing.
    """
    known = Counter(each.place for each in found if each.place is not None)
    if not known:
        return
    values = [value for pair in known for value in pair]
    low, high = min(values), max(values)
    air = 0.08 * (high - low) or 0.5
    low, high = low - air, high + air

    def at(value: float) -> float:
        return (value - low) / (high - low) * (SIZE - LEFT - AIR)

    with tag("svg", viewBox=f"0 0 {SIZE} {SIZE}", role="img", aria_label=said, cls="chart narrow", id="scatter"):
        base = SIZE - BELOW
        tag("line", x1=LEFT, y1=base, x2=LEFT + at(high), y2=base - at(high), cls="grid")
        tag("line", x1=LEFT, y1=base, x2=SIZE - AIR, y2=base, cls="grid")
        tag("line", x1=LEFT, y1=base, x2=LEFT, y2=AIR, cls="grid")
        for (x, y), count in known.items():
            r = 4 + math.sqrt(count)
            tag("circle", cx=f"{LEFT + at(x):.1f}", cy=f"{base - at(y):.1f}", r=f"{r:.1f}", cls="new")
        middle = (SIZE + LEFT) / 2
        tag("text", across, x=middle, y=SIZE - 12, cls="axis", text_anchor="middle")
        turned = f"rotate(-90 18 {base / 2})"
        tag("text", up, x=18, y=base / 2, cls="axis", text_anchor="middle", transform=turned)


SHOWN = 100
Pair = tuple[CaseResult, CaseResult, CaseChange]
"""A configuration that both campaigns ran, as each of them found it, and what changed."""


def add(workspace: Workspace) -> None:
    """Add the page."""

    @ui.page("/compare", response_timeout=PATIENT_S)
    async def compare(a: str = "", b: str = "") -> None:
        listing = await load(workspace.whole_listing if a and b else workspace.listing)
        first, second, pairs = None, None, ()
        try:
            if a and b:
                first, second, pairs = await load(_read, workspace, a, b)
        except RvsgError as error:
            problem(workspace, "Compare", error)
            return
        with page(workspace, "Compare", here="/compare", wide=True) as made:
            _choose(made, listing, a, b)
            if first is not None and second is not None:
                _totals(listing, a, b)
                _pairs(a, b, pairs, first.requirement.unit)
            made.command("Compare methods at an equal number of runs", "rvsg compare --methods heuristic:study,random")
            tag("p", "", cls="soft")
            link("Compare two versions of the robot on a suite", "/compare/versions")


def _read(workspace: Workspace, a: str, b: str) -> tuple[rvsg.Campaign, rvsg.Campaign, tuple[Pair, ...]]:
    """Read and pair two campaigns; what was read is kept until one of their stores changes."""
    paths = workspace.existing(a), workspace.existing(b)

    def made() -> tuple[rvsg.Campaign, rvsg.Campaign, tuple[Pair, ...]]:
        first, second = (rvsg.Campaign.open(path) for path in paths)
        return first, second, _common(first, second)

    key = ("pairs", a, b, stamp(paths[1]))
    found: tuple[rvsg.Campaign, rvsg.Campaign, tuple[Pair, ...]] = workspace.kept(key, paths[0], made)
    return found


def _common(first: rvsg.Campaign, second: rvsg.Campaign) -> tuple[Pair, ...]:
    found = compare_campaigns(first, second)
    one, two = found.variants
    return tuple(zip(one.cases, two.cases, found.changes, strict=True))


def _choose(made: Page, listing: Listing, a: str, b: str) -> None:
    options = {"": "choose a campaign"} | {each.folder: each.folder for each in listing.campaigns if not each.problem}
    chosen = {"a": a, "b": b}

    def compare() -> None:
        if not all(chosen.values()):
            raise InputError("Choose two campaigns.")
        ui.navigate.to(address("/compare", **chosen))

    with tag("div", cls="st-form"):
        with field("First"):
            select(options, a, lambda value: chosen.update(a=value))
        with field("Second"):
            select(options, b, lambda value: chosen.update(b=value))
    with tag("p", cls="st-actions"):
        made.button("Compare", compare, cls="st-primary")


def _totals(listing: Listing, a: str, b: str) -> None:
    known = {each.folder: each for each in listing.campaigns}
    shown = [known[name] for name in (a, b) if name in known]
    rows = (
        ("World, route", lambda c: f"{c.world}, {c.route}"),
        ("Requirement", lambda c: c.requirement),
        ("Generator", lambda c: c.generator),
        ("Configurations tried", lambda c: str(c.attempts)),
        ("Runs", lambda c: str(c.runs)),
        ("Confirmed violations", lambda c: str(sum(f.violated for f in c.findings))),
        ("Worst confirmed", _worst),
        ("Cost", lambda c: "unknown" if c.cost_usd is None else f"{c.cost_usd:.2f} USD"),
    )
    with tag("div", cls="scroll", tabindex="0", role="region", aria_label="Totals"), tag("table", cls="st-plain"):
        with tag("thead"), tag("tr"):
            tag("td", "")
            for campaign in shown:
                tag("th", campaign.folder, scope="col")
        with tag("tbody"):
            for label, value in rows:
                with tag("tr"):
                    tag("th", label, scope="row")
                    for campaign in shown:
                        tag("td", value(campaign))


def _worst(campaign: FoundCampaign) -> str:
    worst = max(campaign.findings, key=lambda f: f.violations / max(1, f.runs), default=None)
    return f"{worst.status}, {worst.violations} of {worst.runs}" if worst else "none"


def _pairs(a: str, b: str, pairs: tuple[Pair, ...], unit: str) -> None:
    tag("h2", "The same scenarios in both")
    if not pairs:
        tag(
            "p",
            "The two campaigns ran no scenario in common. Campaigns that replay the same scenarios, such as one with "
            "another stack and the same seed, can be compared scenario by scenario.",
            cls="soft",
        )
        return
    found = [_compared(pair) for pair in pairs]
    with tag("div", cls="st-two"):
        with tag("div"):
            matrix(found, ("the first", "the second"))
            said = f"Mean objective of each scenario, first campaign across, second up, {unit}"
            scatter(found, said, *(f"mean in the {which}, {unit}" for which in ("first", "second")))
        with tag("div", cls="st-list"):
            for one, two, change in pairs[:SHOWN]:
                with tag("div", cls="st-row"):
                    with tag("span", cls="st-row-head"):
                        change_chip(change.change)
                        tag("span", f"{_share(one)} → {_share(two)}", cls="small")
                    tag("span", one.title, cls="st-clip")
                    with tag("span"):
                        where = address("/compare/runs", a=a, b=b, first=one.attempt, second=two.attempt)
                        tag(
                            "a",
                            "Replay both",
                            href=where,
                            aria_label=f"Replay attempts {one.attempt} and {two.attempt}",
                        )


def _compared(pair: Pair) -> Compared:
    first, second = pair[0].verdict, pair[1].verdict
    place = None if first.mean is None or second.mean is None else (first.mean, second.mean)
    return Compared(violations=(first.violations, second.violations), place=place, change=pair[2].change)


def _share(result: CaseResult) -> str:
    return f"{result.verdict.violations} of {result.verdict.runs}"


def add_runs(workspace: Workspace) -> None:
    """Add the page with two replays on one clock."""

    @ui.page("/compare/runs", response_timeout=PATIENT_S)
    async def runs(a: str = "", b: str = "", first: int = -1, second: int = -1) -> None:
        with page(workspace, "Two replays on one clock", wide=True):
            tag("div", data_studio="together", cls="st-actions", id="together")
            with tag("div", cls="st-two st-pair"):
                for name, attempt in ((a, first), (b, second)):
                    with tag("section", aria_label=name):
                        tag("h2", name)
                        where = address("/data/replay", campaign=name, attempt=attempt, alone=1)
                        tag("div", data_studio="replay", data_url=where)


TITLE = "Compare two versions"
COLUMNS = ("Case", "Requirement", "Change", "Violated before", "Violated now", "Difference (95 % interval)", "p (Holm)")


def add_versions(workspace: Workspace) -> None:
    """Add the page."""

    @ui.page("/compare/versions", response_timeout=PATIENT_S)
    async def versions(
        first: str = "", second: str = "", suite: str = "", case: str = "", requirement: str = ""
    ) -> None:
        listing, results = await load(workspace.listing), await load(suite_results_in, workspace.folder)
        given = {"first": first, "second": second, "suite": suite}
        compared = None
        try:
            if first and second:
                compared = await load(compared_versions, workspace, first, second, suite)
        except RvsgError as error:
            problem(workspace, TITLE, error)
            return
        with page(workspace, TITLE, here="/compare", wide=True) as made:
            _choose_versions(made, given, results, listing.suites)
            if not results:
                tag("p", "No results of a suite are in this folder yet. `rvsg suite run` writes them.", cls="soft")
            if compared is not None:
                _changes(compared, given)
                if suite and case:
                    _replay(compared, given, case, requirement)
                files = " ".join(shlex.quote(each) for each in (first, second))
                made.command("Compare two versions", f"rvsg suite compare {files} --html versions.html")
            made.command("Run a suite", "rvsg suite run suite --runs 20 --version now --json > now.json")


def _choose_versions(made: Page, given: dict[str, str], results: tuple[str, ...], suites: tuple[str, ...]) -> None:
    chosen = dict(given)

    def compare() -> None:
        if not (chosen["first"] and chosen["second"]):
            raise InputError("Choose two files of results.")
        ui.navigate.to(_here(chosen))

    files = {"": "choose results"} | {each: each for each in results}
    with tag("div", cls="st-form"):
        for key, label, options in (
            ("first", "Version before", files),
            ("second", "Version now", files),
            ("suite", "Suite to replay", {"": "none"} | {each: each for each in suites}),
        ):
            with field(label):
                select(options, given[key], partial(chosen.__setitem__, key))
    with tag("p", cls="st-actions"):
        made.button("Compare", compare, cls="st-primary")


def _here(given: dict[str, str], **more: str) -> str:
    return address("/compare/versions", **given, **more)


def _changes(compared: VersionComparison, given: dict[str, str]) -> None:
    names = compared.found.variants[0].version, compared.found.variants[1].version
    tag("h2", f"{names[1]} against {names[0]}")
    rows, replayable = change_rows(compared.found.changes), compared.replayable
    found = [
        Compared(
            violations=each.violations,
            place=(each.violations[0] / each.seeds, each.violations[1] / each.seeds) if each.seeds else None,
            change=each.change,
        )
        for each in compared.found.changes
        if each.change is not Change.MISSING
    ]
    with tag("div", cls="st-two"):
        matrix(found, names)
        said = f"Share of violating runs of each case, {names[0]} across, {names[1]} up"
        scatter(found, said, *(f"violating share, {name}" for name in names))
    with tag("div", cls="scroll", tabindex="0", role="region", aria_label="Every case"), tag("table", cls="st-plain"):
        with tag("thead"), tag("tr"):
            for column in COLUMNS:
                tag("th", column, scope="col")
        with tag("tbody"):
            for row in rows:
                case = {"case": row["case"], "requirement": row["requirement"]}
                _row(row, _here(given, **case) + "#replay" if tuple(case.values()) in replayable else None)


def _row(row: dict[str, str], replay: str | None) -> None:
    with tag("tr"):
        with tag("td"):
            tag("a" if replay else "span", row["title"], href=replay)
        tag("td", row["requirement"])
        with tag("td"):
            chip(row["change"], bad=row["tone"] == "bad", good=row["tone"] == "good")
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
