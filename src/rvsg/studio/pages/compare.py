"""Compare two campaigns: what is fixed, broken or unchanged, as a table, a scatter and two replays on one clock."""

from __future__ import annotations

from collections import Counter

from nicegui import ui

import rvsg
from rvsg.api.errors import RvsgError
from rvsg.api.listing import FoundCampaign, Listing
from rvsg.api.pairing import Change, Pair, pairs_of
from rvsg.api.words import number
from rvsg.studio.frame import PATIENT_S, address, chip, field, link, load, page, problem, select, tag
from rvsg.studio.workspace import Workspace

SIZE = 320
SHOWN = 100


def add(workspace: Workspace) -> None:
    """Add the page."""

    @ui.page("/compare", response_timeout=PATIENT_S)
    async def compare(a: str = "", b: str = "") -> None:
        listing = await load(workspace.whole_listing if a and b else workspace.listing)
        first, second, pairs = None, None, ()
        try:
            if a and b:
                first = await load(rvsg.Campaign.open, workspace.existing(a))
                second = await load(rvsg.Campaign.open, workspace.existing(b))
                pairs = await load(pairs_of, first, second)
        except RvsgError as error:
            problem(workspace, "Compare", error)
            return
        with page(workspace, "Compare", here="/compare", wide=True) as made:
            _choose(listing, a, b)
            if first is not None and second is not None:
                _totals(listing, a, b)
                _pairs(a, b, pairs, first.requirement.unit)
            made.command("Compare methods at an equal number of runs", "rvsg compare --methods heuristic:study,random")
            tag("p", "", cls="soft")
            link("Compare two versions of the robot on a suite", "/compare/versions")


def _choose(listing: Listing, a: str, b: str) -> None:
    options = {"": "choose a campaign"} | {each.folder: each.folder for each in listing.campaigns if not each.problem}
    with tag("div", cls="st-form"):
        with field("First"):
            select(options, a, lambda value: ui.navigate.to(address("/compare", a=value, b=b)))
        with field("Second"):
            select(options, b, lambda value: ui.navigate.to(address("/compare", a=a, b=value)))


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
    counts = Counter(pair.change for pair in pairs)
    with tag("p", cls="st-actions"):
        for change in Change:
            if counts[change]:
                bad, good = change is Change.BROKEN, change is Change.FIXED
                chip(f"{counts[change]} {change.value}", bad=bad, good=good)
    with tag("div", cls="st-two"):
        _scatter(pairs, unit)
        with tag("div", cls="st-list"):
            for pair in pairs[:SHOWN]:
                with tag("div", cls="st-row"):
                    with tag("span", cls="st-row-head"):
                        chip(pair.change.value, bad=pair.change is Change.BROKEN, good=pair.change is Change.FIXED)
                        tag("span", f"{_share(pair.first_violations)} → {_share(pair.second_violations)}", cls="small")
                    tag("span", pair.description or "Without a description", cls="st-clip")
                    with tag("span"):
                        where = address("/compare/runs", a=a, b=b, first=pair.first, second=pair.second)
                        tag(
                            "a", "Replay both", href=where, aria_label=f"Replay attempts {pair.first} and {pair.second}"
                        )


def _share(violations: tuple[int, int]) -> str:
    return f"{violations[0]} of {violations[1]}"


def _scatter(pairs: tuple[Pair, ...], unit: str) -> None:
    """Draw the mean of each pair: on the line both are equal."""
    known = [(p.first_mean, p.second_mean) for p in pairs if p.first_mean is not None and p.second_mean is not None]
    if not known:
        return
    values = [value for pair in known for value in pair]
    low, high = min(values), max(values)
    air = 0.08 * (high - low) or 1.0
    low, high = low - air, high + air

    def at(value: float) -> float:
        return 40 + (value - low) / (high - low) * (SIZE - 50)

    said = f"Mean objective of {len(known)} pairs, first campaign across, second up, {unit}"
    with tag("svg", viewBox=f"0 0 {SIZE} {SIZE}", role="img", aria_label=said, cls="chart narrow", id="scatter"):
        tag("line", x1=40, y1=SIZE - 40, x2=SIZE - 10, y2=10, cls="grid")
        for x, y in known:
            tag("circle", cx=f"{at(x):.1f}", cy=f"{SIZE - at(y):.1f}", r=5, cls="new")
        tag("text", f"first, {number(low, unit)} to {number(high, unit)}", x=SIZE / 2, y=SIZE - 8, cls="axis",
            text_anchor="middle")  # fmt: skip
        tag("text", "second", x=4, y=20, cls="axis")


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
