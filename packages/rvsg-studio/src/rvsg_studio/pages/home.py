"""Home with worlds, campaigns, suites, jobs and newest findings; and a single job or suite."""

from __future__ import annotations

import time

from nicegui import ui

import rvsg
from rvsg.evaluation.verdict import counted
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.frame import PATIENT_S, Page, actions, chip, link, load, page, route, section, table, tag
from rvsg_studio.listing import FoundCampaign, Listing
from rvsg_studio.pages.finding import JobLine, job_buttons
from rvsg_studio.workspace import Job, Workspace

COLUMNS = ("Campaign", "World, route", "Requirement", "Tried", "Runs", "Result", "Cost", "Changed")
NEWEST = 8
FOLLOW_S = 2.0
SHOWN = 200


def add(workspace: Workspace) -> None:
    """Add the pages."""

    @route(workspace, "/", "Home", patience_s=PATIENT_S)
    async def home() -> None:
        listing = await load(workspace.listing)
        jobs = await load(workspace.jobs.all)
        with page(workspace, workspace.folder.name or "Home", here="/") as shown:
            Home(shown, listing, jobs)

    @route(workspace, "/job", "Job")
    async def job(job: str = "") -> None:
        found = await load(workspace.jobs.get, job)
        with page(workspace, f"{found.title}: {found.target}") as made:
            with tag("ul", cls="st-list"):
                JobLine(made, found)
            with actions():
                if found.kind in ("matrix", "campaign"):
                    name = "Open the campaigns" if found.kind == "matrix" else "Open the campaign"
                    link(name, f"/{found.kind}", cls="st-button", folder=found.target)
                if found.running:
                    job_buttons(made, found)
            made.command(found.title, found.command)

    @route(workspace, "/suite", "Suite")
    async def suite(suite: str = "") -> None:
        found = await load(rvsg.Suite.open, workspace.existing(suite))
        with page(workspace, f"{found.head.title} ({suite})") as made:
            made.command("Run it", f"rvsg suite run {suite}")
            if not found.cases:
                tag("p", "This suite holds no case yet. Save a scenario in it from the scenario editor.", cls="soft")
            for case in found.cases:
                with tag("div", cls="st-row"):
                    with tag("span", cls="st-row-head"):
                        for expectation in case.expectations:
                            chip(f"{expectation.requirement}: {expectation.expected}")
                    link(case.title, "/scenario", suite=suite, case=case.name)
                    tag("span", f"{case.scenario.mission.world}, {case.scenario.mission.route.name}", cls="soft small")


class Home:
    """What lies in the folder; it follows campaigns that are still being read, and jobs until they end."""

    def __init__(self, shown: Page, listing: Listing, jobs: list[Job]) -> None:
        self.page, self.shown = shown, _followed(listing, jobs)
        self.body = tag("div")
        with self.body:
            lay_out(shown, listing, jobs)
        if self.shown:
            self.timer = ui.timer(FOLLOW_S, shown.guarded(self._follow))

    async def _follow(self) -> None:
        listing, jobs = await load(self.page.workspace.listing), await load(self.page.workspace.jobs.all)
        if (followed := _followed(listing, jobs)) != self.shown:
            self.shown = followed
            self.body.clear()
            with self.body:
                lay_out(self.page, listing, jobs)
        if not self.shown:
            self.timer.deactivate()


def _followed(listing: Listing, jobs: list[Job]) -> tuple[object, ...]:
    """Return what the page waits for: it is laid out anew when that changes, and not while somebody reads it."""
    running = tuple(job.id for job in jobs if job.running)
    return (listing.unread, running) if listing.unread or running else ()


def lay_out(shown: Page, listing: Listing, jobs: list[Job]) -> None:
    """Lay out what lies in the folder."""
    tag("p", str(shown.workspace.folder), cls="soft small st-path")
    with actions():
        link("New campaign", "/campaign/new", cls="st-button st-primary")
        link("New world", "/world/new", cls="st-button")
        link("New scenario", "/scenario", cls="st-button")
    if listing.cut:
        tag("p", "The folder holds very many folders; only the first of them are shown.", cls="soft")
    running = [job for job in jobs if job.running]
    if running:
        with section("Running", "jobs"), tag("ul", cls="st-list"):
            for job in running:
                with tag("li"):
                    link(job.title, "/job", job=job.id)
                    tag("span", f" {job.target} · for {ago(job.begun_s, since=True)}", cls="soft small")
    _findings(listing)
    _campaigns(listing)
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


def _findings(listing: Listing) -> None:
    found = [(campaign, finding) for campaign in listing.campaigns for finding in campaign.findings]
    with section("Newest findings", "findings"):
        if not found:
            tag("p", "Nothing is confirmed yet. A campaign confirms what its search finds.", cls="soft")
            return
        with tag("ul", cls="st-cards"):
            for campaign, finding in found[:NEWEST]:
                with tag("li", cls="st-card"):
                    with tag("p", cls="st-card-head"):
                        chip(finding.status, bad=finding.violated, good=finding.status == "PASS")
                        tag("span", f"{campaign.requirement} · {campaign.world}, {campaign.route}", cls="soft small")
                    with tag("p", cls="st-clip"):
                        said = finding.description or "Without a description"
                        link(said, "/finding", campaign=campaign.folder, name=campaign.name, attempt=finding.attempt)
                    tag("p", f"{finding.violations} of {finding.runs} runs violate it", cls="small")


def _campaigns(listing: Listing) -> None:
    with section(f"Campaigns ({len(listing.campaigns)})", "campaigns"):
        if not listing.campaigns:
            tag("p", "No campaign lies in this folder.", cls="soft")
            return
        if new := sum(not (each.name or each.problem) for each in listing.campaigns):
            tag("p", f"Reading {counted(new, 'campaign')}…", cls="soft", role="status")
        with table(COLUMNS, cls="st-table"):
            for campaign in listing.campaigns[:SHOWN]:
                _row(campaign)


def _row(campaign: FoundCampaign) -> None:
    with tag("tr"):
        with tag("td", data_label="Campaign"):
            if campaign.problem:
                tag("span", campaign.folder)
            else:
                link(campaign.folder, "/campaign", folder=campaign.folder, name=campaign.name or None)
        if campaign.problem:
            tag("td", campaign.problem, cls="st-wrong", colspan="7")
            return
        if not campaign.name:
            tag("td", "is being read", cls="soft", colspan="7")
            return
        tag("td", f"{campaign.world}, {campaign.route}", data_label="World, route")
        tag("td", campaign.requirement, data_label="Requirement")
        tag("td", campaign.tried, data_label="Tried")
        tag("td", str(campaign.runs), data_label="Runs")
        with tag("td", data_label="Result"):
            _result(campaign)
        cost = "?" if campaign.cost_usd is None else f"{campaign.cost_usd:.2f} USD" if campaign.calls else "–"
        tag("td", cost, data_label="Cost")
        tag("td", ago(campaign.changed_s), data_label="Changed")


def _result(campaign: FoundCampaign) -> None:
    if bad := campaign.violations:
        chip(counted(bad, "violation"), bad=True)
    elif campaign.findings:
        chip("none confirmed", good=True)
    elif not campaign.complete:
        chip("not finished")
    else:
        chip("not confirmed" if campaign.violated else "nothing found")


def ago(moment_s: float, *, since: bool = False) -> str:
    """Return how long ago a moment was, in words."""
    seconds = max(0.0, time.time() - moment_s)
    for size, unit in ((86_400, "day"), (3600, "hour"), (60, "minute")):
        if seconds >= size:
            return counted(int(seconds // size), unit) + ("" if since else " ago")
    return "less than a minute" if since else "just now"
