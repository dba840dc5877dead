"""Compare two versions of the robot by results of a suite: what is fixed or broken, both runs on one clock."""

from __future__ import annotations

import shlex
from functools import partial

from nicegui import ui

from rvsg.app.comparison import VersionComparison
from rvsg.campaign.comparison import Change
from rvsg.core.errors import InputError, RvsgError
from rvsg.report.comparison import change_rows
from rvsg_studio.answers import compared_versions
from rvsg_studio.frame import PATIENT_S, Page, address, chip, field, load, page, problem, select, tag
from rvsg_studio.listing import suite_results_in
from rvsg_studio.pages.changes import Compared, matrix, scatter
from rvsg_studio.workspace import Workspace

TITLE = "Compare two versions"
COLUMNS = ("Case", "Requirement", "Change", "Violated before", "Violated now", "Difference (95 % interval)", "p (Holm)")


def add(workspace: Workspace) -> None:
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
            _choose(made, given, results, listing.suites)
            if not results:
                tag("p", "No results of a suite are in this folder yet. `rvsg suite run` writes them.", cls="soft")
            if compared is not None:
                _changes(compared, given)
                if suite and case:
                    _replay(compared, given, case, requirement)
                files = " ".join(shlex.quote(each) for each in (first, second))
                made.command("Compare two versions", f"rvsg compare-versions {files} --html versions.html")
            made.command("Run a suite", "rvsg suite run suite --runs 20 --version now --json > now.json")


def _choose(made: Page, given: dict[str, str], results: tuple[str, ...], suites: tuple[str, ...]) -> None:
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
