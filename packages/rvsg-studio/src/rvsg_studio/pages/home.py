"""Home with failures, campaigns, worlds, suites and jobs; and a single job or suite."""

from __future__ import annotations

import posixpath
import time
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

import rvsg
from rvsg.app.suites import add_failures
from rvsg.app.view import SUFFIX
from rvsg.core.errors import InputError
from rvsg.evaluation.verdict import counted
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.frame import (
    PATIENT_S,
    Page,
    actions,
    address,
    chip,
    link,
    load,
    page,
    rate,
    route,
    section,
    select,
    table,
    tag,
    text_input,
)
from rvsg_studio.listing import Failure, FoundCampaign, Listing
from rvsg_studio.pages.finding import FOLLOW_S, JobLine, job_buttons
from rvsg_studio.workspace import LARGEST_FILE, STATES, FindingNote, Job, Notes, Workspace, note, notes_of

FAILURES = ("", "", "Failure", "Violated", "Contact", "Cause", "Status", "Age")
CAMPAIGNS = ("Campaign", "Answer", "Tried", "Runs", "Changed")
SHOWN = 200
STARTS = (
    ("New campaign", "/campaign/new", "Find failures on a world that ships with RVSG."),
    ("New world", "/world/new", "Bring your own Nav2 map or Gazebo world."),
    ("New scenario", "/scenario", "Say where people walk, and watch what the robot does."),
    ("Recording", "/recording", "Drop a bag of a real robot; its scenario repeats what happened."),
)


def add(workspace: Workspace) -> None:
    """Add the pages."""

    @route(workspace, "/", "Home", menu=1, patience_s=PATIENT_S)
    async def home() -> None:
        listing = await load(workspace.listing)
        jobs = await load(workspace.jobs.all)
        with page(workspace, workspace.folder.name or "Home", here="/", wide=True) as shown:
            Home(shown, listing, jobs)

    @route(workspace, "/job", "Job")
    async def job(job: str = "") -> None:
        opened = await load(workspace.jobs.get, job)
        with page(workspace, f"{opened.title}: {opened.target}") as view:
            with tag("ul", cls="st-list"):
                JobLine(view, opened)
            with actions():
                if opened.kind in ("matrix", "campaign"):
                    name = "Open the campaigns" if opened.kind == "matrix" else "Open the campaign"
                    link(name, f"/{opened.kind}", cls="st-button", folder=opened.target)
                if opened.kind == "recording":
                    asked = {key: opened.arguments[key] for key in ("file", "world", "people_topic")}
                    link("Open the recording", "/recording", cls="st-button", **asked)
                if opened.kind == "tuning":
                    link("Open the tuning", "/tuning", cls="st-button", folder=opened.target)
                if opened.running:
                    job_buttons(view, opened)
            view.command(opened.title, opened.command)

    @route(workspace, "/suite", "Suite")
    async def suite(suite: str = "") -> None:
        opened = await load(rvsg.Suite.open, workspace.existing(suite))
        with page(workspace, f"{opened.head.title} ({suite})") as view:
            view.command("Run it", f"rvsg suite run {suite}")
            if not opened.cases:
                tag("p", "This suite holds no case yet. Save a scenario in it from the scenario editor.", cls="soft")
            else:
                with actions():
                    link("Tune a stack on it", "/tune", cls="st-button", suite=suite)
            for note in opened.head.tunings:
                with tag("p"):
                    folder = posixpath.normpath(posixpath.join(suite, note.folder))
                    link(f"Tuning of {note.stack}, {note.date}", "/tuning", folder=folder)
                    tag("span", f" {note.result}", cls="soft small")
            for case in opened.cases:
                with tag("div", cls="st-row"):
                    with tag("span", cls="st-row-head"):
                        for expectation in case.expectations:
                            chip(f"{expectation.requirement}: {expectation.expected}")
                    link(case.title, "/scenario", suite=suite, case=case.name)
                    tag("span", f"{case.scenario.mission.world}, {case.scenario.mission.route.name}", cls="soft small")


class Home:
    """What lies in the folder; it follows campaigns, jobs, and what other tabs say of failures."""

    def __init__(self, shown: Page, listing: Listing, jobs: list[Job]) -> None:
        self.page, self.workspace, self.shown = shown, shown.workspace, _followed(listing, jobs)
        self.chosen = dict.fromkeys(("world", "requirement", "status", "contact", "search"), "")
        """What the failures are filtered by."""
        self.selected: set[tuple[str, str, int]] = set()
        self.failures: list[Failure] = []
        self.notes: dict[str, Notes] = {}
        self.body = tag("div")
        self._lay_out(listing, jobs)
        ui.timer(FOLLOW_S, shown.guarded(self._follow))

    async def _follow(self) -> None:
        listing, jobs = await load(self.workspace.listing), await load(self.workspace.jobs.all)
        if (followed := _followed(listing, jobs)) != self.shown:
            self.shown = followed
            self.body.clear()
            self._lay_out(listing, jobs)
        elif (notes := await load(self._read_notes)) != self.notes:
            self.notes = notes
            self._rows()

    def _lay_out(self, listing: Listing, jobs: list[Job]) -> None:
        self.failures = listing.failures
        self.notes = self._read_notes()
        with self.body:
            if listing.cut:
                tag("p", "The folder holds very many folders; only the first of them are shown.", cls="soft")
            _starts(self.workspace.folder, listing)
            label = "Open a .rvsg file, or drop it here"
            tag(
                "div",
                data_studio="view",
                data_accept=SUFFIX,
                data_label=label,
                data_most=str(LARGEST_FILE),
                cls="small soft",
            )
            _running([job for job in jobs if job.running])
            if listing.campaigns:
                new = sum(self._status(failure) == "new" for failure in self.failures)
                title = f"{counted(len(self.failures), 'failure')}, {new} new"
                with section(title, "failures"):
                    self._filters(listing)
                    self.bar = tag("div", cls="st-actions")
                    self.rows = tag("div")
                    self._rows()
                _campaigns(listing)
            _places(listing)

    def _read_notes(self) -> dict[str, Notes]:
        folders = {campaign.folder for campaign, _ in self.failures}
        return {folder: notes_of(self.workspace.path(folder)) for folder in folders}

    def _status(self, failure: Failure) -> str:
        return self.notes[failure[0].folder].findings.get(failure[1].scenario_id, FindingNote()).status

    def _filters(self, listing: Listing) -> None:
        filters: dict[str, Iterable[str]] = {
            "world": sorted({campaign.world for campaign, _ in self.failures}),
            "requirement": sorted({campaign.requirement for campaign, _ in self.failures}),
            "status": STATES,
            "contact": ("contact", "no contact"),
        }

        def choose(key: str, value: str) -> None:
            self.chosen[key] = value
            self._rows()

        if not self.failures:
            return
        with tag("div", cls="st-filters"):
            for key, values in filters.items():
                options = {"": f"any {key}"} | {value: value for value in values}
                select(options, self.chosen[key], partial(choose, key), aria_label=key.capitalize())
            text_input(self.chosen["search"], partial(choose, "search"), kind="search", data_key="/",
                       placeholder="Search ( / )", aria_label="Search failures")  # fmt: skip

    def _is_shown(self, pair: Failure) -> bool:
        campaign, failure = pair
        row, chosen = failure.row, self.chosen
        touched = "contact" if row.contacts else "no contact"
        facts = {"world": campaign.world, "requirement": campaign.requirement, "contact": touched}
        facts["status"] = self._status(pair)
        text = f"{row.name} {row.cause} {campaign.folder} {campaign.route}".lower()
        return all(chosen[key] in ("", fact) for key, fact in facts.items()) and chosen["search"].lower() in text

    def _rows(self) -> None:
        """Lay out the failures that the filters leave."""
        self.rows.clear()
        rows = [failure for failure in self.failures if self._is_shown(failure)]
        with self.rows:
            if not rows:
                none = "No failure is confirmed." if not self.failures else "No failure has all of this."
                tag("p", none, cls="soft", role="status")
            else:
                with table(FAILURES, cls="st-table st-failures"):
                    for failure in rows[:SHOWN]:
                        self._row(failure)
            if len(rows) > SHOWN:
                tag("p", f"and {len(rows) - SHOWN} more: filter or search.", cls="soft")
        self._bar()

    def _row(self, pair: Failure) -> None:
        campaign, failure = pair
        row, key = failure.row, _key(pair)
        query: dict[str, Any] = {"campaign": campaign.folder, "name": campaign.name, "attempt": row.confirmation}

        def select_it(on: bool) -> None:
            self.selected ^= {key} if on != (key in self.selected) else set()
            self._bar()

        with tag("tr"):
            with tag("td"):
                box = tag("input", type="checkbox", aria_label=f"Select {row.name}, {campaign.shown}")
                if key in self.selected:
                    box._props["^checked"] = True
                box.on("change", lambda event: select_it(bool(event.args)), js_handler="(e) => emit(e.target.checked)")
            with tag("td", cls="st-thumb"):
                tag("img", src=address("/data/still", **query, run=row.run, t=row.moment_s), alt="", loading="lazy")
            with tag("td", data_label="Failure"), tag("div"):
                link(row.name, "/finding", **query)
                where = f"{campaign.requirement} · {campaign.world}, {campaign.route} · {campaign.shown} {row.number}"
                tag("div", where, cls="soft small")
            with tag("td", data_label="Violated", cls="st-rate"):
                rate(row)
            touch = f"{row.contact} {row.touch}" if row.contacts else row.contact
            tag("td", touch, data_label="Contact", cls="st-wrong" if row.contacts else "")
            with tag("td", data_label="Cause"), tag("div", row.cause):
                tag("div", row.caused, cls="soft small")
            tag("td", self._status(pair), data_label="Status")
            tag("td", ago(campaign.changed_s, since=True), data_label="Age")

    def _bar(self) -> None:
        """Lay out what can be done with the selection."""
        self.bar.clear()
        chosen = [failure for failure in self.failures if _key(failure) in self.selected]
        if not chosen:
            return
        suite = {"folder": "suite"}

        def mark(status: str) -> None:
            for campaign, failure in chosen:
                chosen_state = next(state for state in STATES if state == status)
                note(self.workspace.path(campaign.folder), failure.scenario_id, status=chosen_state)
                self.notes[campaign.folder] = notes_of(self.workspace.path(campaign.folder))
            self._rows()

        async def keep() -> None:
            self.page.say(await load(add_to_suite, self.workspace, chosen, suite["folder"]))

        def compare() -> None:
            folders = list(dict.fromkeys(campaign.folder for campaign, _ in chosen))
            if len(folders) != 2:
                raise InputError(f"Select failures of two campaigns to compare these; this is {len(folders)}.")
            ui.navigate.to(address("/compare", a=folders[0], b=folders[1]))

        with self.bar:
            tag("strong", f"{len(chosen)} selected", role="status")
            select(
                {"": "set status"} | {state: state for state in STATES}, "", mark, aria_label="Status of the selection"
            )
            text_input("suite", partial(suite.__setitem__, "folder"), cls="st-inline", aria_label="Folder of the suite")
            self.page.button("Add to suite", keep)
            self.page.button("Compare", compare)


def _key(failure: Failure) -> tuple[str, str, int]:
    return failure[0].folder, failure[0].name, failure[1].row.confirmation or 0


def add_to_suite(workspace: Workspace, chosen: Iterable[Failure], name: str) -> str:
    """Add failures as cases; return what the suite holds then."""
    suite = rvsg.Suite.create(workspace.path(name))
    for campaign, failure in chosen:
        opened = rvsg.Campaign.open(workspace.existing(campaign.folder), campaign.name)
        suite = add_failures(suite, opened, [failure.row])
    return f"{name} holds {counted(len(suite.cases), 'case')}."


def _followed(listing: Listing, jobs: list[Job]) -> tuple[object, ...]:
    """Return what the page is laid out anew for; the counts of a campaign that runs are not among it."""
    shown = tuple((c.folder, c.name, c.status, len(c.failures)) for c in listing.campaigns)
    return listing.unread, tuple(job.id for job in jobs if job.running), shown, listing.worlds, listing.suites


def _starts(folder: Path, listing: Listing) -> None:
    """Lay out what can be begun; an empty folder says what each is for."""
    empty = not (listing.campaigns or listing.worlds or listing.suites)
    with tag("ul", cls="st-cards") if empty else actions():
        for place, (name, path, what) in enumerate(STARTS):
            style = f"st-button{'' if place else ' st-primary'}"
            if empty:
                with tag("li", cls="st-card"):
                    tag("p", what)
                    link(name, path, cls=style)
            else:
                link(name, path, cls=style)
        if not empty:
            tag("span", str(folder), cls="soft small st-path")


def _running(running: list[Job]) -> None:
    if running:
        with section("Running", "jobs"), tag("ul", cls="st-list"):
            for job in running:
                with tag("li"):
                    link(job.title, "/job", job=job.id)
                    tag("span", f" {job.target} · for {ago(job.begun_s, since=True)}", cls="soft small")


def _places(listing: Listing) -> None:
    with section("Worlds", "worlds"), tag("ul", cls="st-list st-columns"):
        for name in (*listing.worlds, *shipped_worlds()):
            with tag("li"):
                link(name, "/world", world=name)
                if name not in listing.worlds:
                    tag("span", " ships with RVSG", cls="soft small")
    if listing.suites:
        with section("Suites", "suites"), tag("ul", cls="st-list"):
            for name in listing.suites:
                with tag("li"):
                    link(name, "/suite", suite=name)


def _campaigns(listing: Listing) -> None:
    together: dict[str, list[FoundCampaign]] = {}
    for campaign in listing.campaigns:
        above = campaign.folder.rpartition("/")[0]
        together.setdefault(above if above in listing.matrices else campaign.folder, []).append(campaign)
    with section(counted(len(listing.campaigns), "campaign"), "campaigns"):
        if new := sum(not (campaign.name or campaign.problem) for campaign in listing.campaigns):
            tag("p", f"Reading {counted(new, 'campaign')}…", cls="soft", role="status")
        with table(CAMPAIGNS, cls="st-table"):
            for folder, alike in list(together.items())[:SHOWN]:
                with tag("tr"):
                    if folder in listing.matrices:
                        _matrix(folder, alike)
                    else:
                        _campaign(alike[0])


def _campaign(campaign: FoundCampaign) -> None:
    with tag("td", data_label="Campaign"), tag("div"):
        if campaign.problem and not campaign.name:
            tag("span", campaign.shown)
        else:
            link(campaign.shown, "/campaign", folder=campaign.folder, name=campaign.name or None)
        if campaign.name:
            where = f"{campaign.requirement} · {campaign.world}, {campaign.route}"
            tag("div", where, cls="soft small")
    if not campaign.name:
        tag("td", campaign.problem or "is being read", cls="st-wrong" if campaign.problem else "soft", colspan="4")
        return
    with tag("td", data_label="Answer"), tag("div"):
        if campaign.problem:
            tag("span", campaign.problem, cls="st-wrong")
        else:
            chip(campaign.status, campaign.tone)
            tag("span", f" {campaign.headline} {campaign.elsewhere}", cls="small")
    _amounts([campaign], campaign.tried)


def _matrix(folder: str, campaigns: list[FoundCampaign]) -> None:
    """Lay out campaigns of several routes and requirements as one row with a chip for each."""
    with tag("td", data_label="Campaign"), tag("div"):
        link(folder, "/matrix", folder=folder)
        tag("div", f"{counted(len(campaigns), 'campaign')}, {campaigns[0].world}", cls="soft small")
    with tag("td", data_label="Answer"), tag("div"):
        for campaign in sorted(campaigns, key=lambda campaign: (campaign.route, campaign.requirement)):
            text = f"{campaign.route} {campaign.requirement}: {campaign.status or 'is being read'}"
            where = {"folder": campaign.folder, "name": campaign.name or None}
            element = link(text, "/campaign", **where, cls=f"chip {campaign.tone}")
            element._props["title"] = campaign.headline
    _amounts(campaigns, str(sum(campaign.attempts for campaign in campaigns)))


def _amounts(campaigns: list[FoundCampaign], tried: str) -> None:
    changed = ago(max(campaign.changed_s for campaign in campaigns))
    for name, text in (("Tried", tried), ("Runs", str(sum(c.runs for c in campaigns))), ("Changed", changed)):
        tag("td", text, data_label=name, cls="whole")


def ago(moment_s: float, *, since: bool = False) -> str:
    """Return how long ago a moment was, in words."""
    seconds = max(0.0, time.time() - moment_s)
    for size, unit in ((86_400, "day"), (3600, "hour"), (60, "minute")):
        if seconds >= size:
            return counted(int(seconds // size), unit) + ("" if since else " ago")
    return "less than a minute" if since else "just now"
