"""Two campaigns, two sets of runs or two versions side by side: what is fixed, broken or unchanged."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from nicegui import ui

import rvsg
from rvsg.app.comparison import VersionComparison, compare_campaigns
from rvsg.core.errors import InputError
from rvsg.report.comparison_page import changes_markup
from rvsg.suites.suite import CaseChange
from rvsg_studio.answers import compared_versions
from rvsg_studio.frame import (
    PATIENT_S,
    Page,
    actions,
    address,
    field,
    link,
    load,
    page,
    route,
    select,
    svg,
    table,
    tag,
)
from rvsg_studio.listing import FoundCampaign, Listing, suite_results_in, why_not
from rvsg_studio.workspace import Workspace, stamp


def add(workspace: Workspace) -> None:
    """Add the pages."""

    @route(workspace, "/compare", "Compare", menu=4, patience_s=PATIENT_S)
    async def compare(a: str = "", b: str = "") -> None:
        listing = await load(workspace.whole_listing if a and b else workspace.listing)
        pairs = await load(_read, workspace, a, b) if a and b else None
        with page(workspace, "Compare", here="/compare", wide=True) as view:
            _choose_campaigns(view, [campaign for campaign in listing.campaigns if not campaign.problem], a, b)
            if pairs is not None:
                _totals(listing, a, b)
                _pairs(pairs)
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
        chosen = {"first": first, "second": second, "suite": suite}
        compared = await load(compared_versions, workspace, first, second, suite) if first and second else None
        with page(workspace, "Compare two versions", here="/compare", wide=True) as view:
            files = {"": "choose results"} | {name: name for name in results}
            suites = {"": "none"} | {name: name for name in listing.suites}
            choices = {
                "first": ("Version before", files),
                "second": ("Version now", files),
                "suite": ("Suite to replay", suites),
            }
            _choose(view, "/compare/versions", chosen, choices, "Choose two files of results.")
            if not results:
                tag("p", "No results of a suite are in this folder yet. `rvsg suite run` writes them.", cls="soft")
            if compared is not None:
                _changes(compared, chosen)
                if suite and case:
                    _replay(compared, chosen, case, requirement)
                both = shlex.join((first, second))
                view.command("Compare two versions", f"rvsg suite compare {both} --html versions.html")
            view.command("Run a suite", "rvsg suite run suite --runs 20 --version now --json > now.json")


def _read(workspace: Workspace, a: str, b: str) -> str:
    """Return what changed in the scenarios that two campaigns both ran, kept until one of their stores changes."""
    paths = workspace.existing(a), workspace.existing(b)

    def compared() -> str:
        first, second = (rvsg.Campaign.open(path) for path in paths)
        comparison = compare_campaigns(first, second)
        if not comparison.changes:
            return ""
        names: dict[int | None, str] = {row.attempt: f"{row.number} {row.name}" for row in first.answer.rows}
        one, two = ({case.key: case for case in variant.cases} for variant in comparison.variants)

        def links(change: CaseChange) -> dict[str, Any]:
            mine, theirs = (side[change.case, change.requirement] for side in (one, two))
            both = address("/compare/runs", a=a, b=b, first=mine.attempt, second=theirs.attempt)
            label = f"Replay attempts {mine.attempt} and {theirs.attempt}"
            second = address("/finding", campaign=b, attempt=theirs.attempt)
            return {
                "title": names.get(mine.attempt, mine.title),
                "address": address("/finding", campaign=a, attempt=mine.attempt),
                "more": [("in the second", second, ""), ("Replay both", both, label)],
            }

        pairs = [(mine.verdict.mean, two[key].verdict.mean) for key, mine in one.items() if key in two]
        places = [(x, y) for x, y in pairs if x is not None and y is not None]
        quantity = f"mean, {first.requirement.unit}" if first.requirement.unit else "mean"
        return changes_markup(
            comparison, sides=("the first", "the second"), quantity=quantity, places=places, links=links
        )

    return workspace.cached(("pairs", a, b, stamp(paths[1])), paths[0], compared)


def _choose_campaigns(view: Page, campaigns: Sequence[FoundCampaign], a: str, b: str) -> None:
    """Lay out the choice of two campaigns; what cannot be compared says why, and cannot be chosen."""
    chosen = {"a": a, "b": b}
    mates = {campaign.folder: any(not why_not(campaign, other) for other in campaigns) for campaign in campaigns}
    firsts = {name: name if mates[name] else f"{name}: no campaign ran the same scenarios" for name in mates}

    def compare() -> None:
        if not all(chosen.values()):
            raise InputError("Choose two campaigns.")
        ui.navigate.to(address("/compare", **chosen))

    def lay_second(folder: str, second_folder: str = "") -> None:
        chosen.update(a=folder, b=second_folder)
        first = next((campaign for campaign in campaigns if campaign.folder == folder), None)
        why = {
            campaign.folder: why_not(first, campaign) if first is not None else "choose the first"
            for campaign in campaigns
        }
        texts = {name: f"{name}: {why[name]}" if why[name] else name for name in sorted(why, key=why.__getitem__)}
        second.clear()
        with second, field("Second"):
            unfit = {name for name in why if why[name]}
            select({"": "choose a campaign"} | texts, second_folder, partial(chosen.__setitem__, "b"), disabled=unfit)

    with tag("div", cls="st-form"):
        with field("First"):
            unfit = {name for name, mate in mates.items() if not mate}
            select({"": "choose a campaign"} | firsts, a, lay_second, disabled=unfit)
        second = tag("div")
    lay_second(a, b)
    if campaigns and not any(mates.values()):
        none = "No two campaigns here ran the same scenarios: repeat one with another stack and the same seed."
        tag("p", none, cls="soft")
    with actions():
        view.button("Compare", compare, cls="st-primary")


def _choose(
    view: Page, path: str, values: Mapping[str, str], choices: Mapping[str, tuple[str, dict[str, str]]], missing: str
) -> None:
    """Lay out what can be chosen, and the button that opens the page on it; the first two must be chosen."""
    chosen = dict(values)

    def compare() -> None:
        if not all(chosen[key] for key in [*chosen][:2]):
            raise InputError(missing)
        ui.navigate.to(address(path, **chosen))

    with tag("div", cls="st-form"):
        for key, (label, options) in choices.items():
            with field(label):
                select(options, values[key], partial(chosen.__setitem__, key))
    with actions():
        view.button("Compare", compare, cls="st-primary")


def _totals(listing: Listing, a: str, b: str) -> None:
    campaigns = {campaign.folder: campaign for campaign in listing.campaigns}
    shown = [campaigns[name] for name in (a, b) if name in campaigns]
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


def _pairs(shown: str) -> None:
    tag("h2", "The same scenarios in both")
    if shown:
        svg(shown)
        return
    none = "The two campaigns ran no scenario in common. Campaigns that replay the same scenarios, such as one with "
    tag("p", none + "another stack and the same seed, can be compared scenario by scenario.", cls="soft")


def _changes(compared: VersionComparison, chosen: dict[str, str]) -> None:
    names = [variant.version for variant in compared.found.variants]
    tag("h2", f"{names[1]} against {names[0]}")

    def links(change: CaseChange) -> dict[str, Any]:
        case = {"case": change.case, "requirement": change.requirement}
        shown = tuple(case.values()) in compared.replayable
        return {"address": address("/compare/versions", **chosen, **case) + "#replay" if shown else ""}

    svg(changes_markup(compared.found, links=links))


def _replay(compared: VersionComparison, chosen: dict[str, str], case: str, requirement: str) -> None:
    first, second = (variant.version for variant in compared.found.variants)
    names = f"{first}, and over it {second}"
    with tag("section", id="replay", aria_label="Both versions on one clock"):
        tag("h2", f"{case}, {requirement}: both versions on one clock")
        tag("p", f"The first seed on which they differ, run again with {names}.", cls="soft")
        where = address("/data/versions", **chosen, case=case, requirement=requirement)
        tag("div", data_studio="replay", data_url=where, data_both="")
