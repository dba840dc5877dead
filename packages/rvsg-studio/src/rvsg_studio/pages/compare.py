"""Compare two campaigns: what is fixed, broken or unchanged, as a table, a scatter and two replays on one clock."""

from __future__ import annotations

from nicegui import ui

import rvsg
from rvsg.app.comparison import compare_campaigns
from rvsg.campaign.comparison import CaseChange
from rvsg.campaign.suite import CaseResult
from rvsg.core.errors import InputError, RvsgError
from rvsg_studio.frame import PATIENT_S, Page, address, field, link, load, page, problem, select, tag
from rvsg_studio.listing import FoundCampaign, Listing
from rvsg_studio.pages.changes import Compared, change_chip, matrix, scatter
from rvsg_studio.workspace import Workspace, stamp

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
