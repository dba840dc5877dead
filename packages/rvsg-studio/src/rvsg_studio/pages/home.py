"""Home with worlds, campaigns, suites, jobs and newest findings; and a single job or suite."""

from __future__ import annotations

import time

from nicegui import ui

import rvsg
from rvsg.core.errors import RvsgError
from rvsg.evaluation.verdict import counted
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.frame import PATIENT_S, Page, address, chip, link, load, page, problem, tag
from rvsg_studio.listing import FoundCampaign, FoundFinding, Listing
from rvsg_studio.pages.finding import JobLine
from rvsg_studio.workspace import Job, Workspace

NEWEST = 8
FOLLOW_S = 2.0
SHOWN = 200


def add(workspace: Workspace) -> None:
    """Add the page."""

    @ui.page("/", response_timeout=PATIENT_S)
    async def home() -> None:
        listing = await load(workspace.listing)
        jobs = await load(workspace.jobs.all)
        with page(workspace, workspace.folder.name or "Home", here="/") as shown:
            Home(shown, listing, jobs)


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
    with tag("p", cls="st-actions"):
        link("New campaign", "/campaign/new", cls="st-button st-primary")
        link("New world", "/world/new", cls="st-button")
        link("New scenario", "/scenario", cls="st-button")
    if listing.cut:
        tag("p", "The folder holds very many folders; only the first of them are shown.", cls="soft")
    running = [job for job in jobs if job.running]
    if running:
        _jobs(running)
    _findings(listing)
    _campaigns(listing)
    _worlds(listing)
    if listing.suites:
        _suites(listing)


def _jobs(jobs: list[Job]) -> None:
    with tag("section", aria_labelledby="jobs"):
        tag("h2", "Running", id="jobs")
        with tag("ul", cls="st-list"):
            for job in jobs:
                with tag("li"):
                    link(job.title, "/job", job=job.id)
                    tag("span", f" {job.target} · for {ago(job.begun_s, since=True)}", cls="soft small")


def _findings(listing: Listing) -> None:
    found = [(campaign, finding) for campaign in listing.campaigns for finding in campaign.findings]
    with tag("section", aria_labelledby="findings"):
        tag("h2", "Newest findings", id="findings")
        if not found:
            tag("p", "Nothing is confirmed yet. A campaign confirms what its search finds.", cls="soft")
            return
        with tag("ul", cls="st-cards"):
            for campaign, finding in found[:NEWEST]:
                _finding(campaign, finding)


def _finding(campaign: FoundCampaign, finding: FoundFinding) -> None:
    with tag("li", cls="st-card"):
        with tag("p", cls="st-card-head"):
            chip(finding.status, bad=finding.violated, good=finding.status == "PASS")
            tag("span", f"{campaign.requirement} · {campaign.world}, {campaign.route}", cls="soft small")
        with tag("p", cls="st-clip"):
            link(
                finding.description or "Without a description",
                "/finding",
                campaign=campaign.folder,
                name=campaign.name,
                attempt=finding.attempt,
            )
        tag("p", f"{finding.violations} of {finding.runs} runs violate it", cls="small")


def _campaigns(listing: Listing) -> None:
    with tag("section", aria_labelledby="campaigns"):
        tag("h2", f"Campaigns ({len(listing.campaigns)})", id="campaigns")
        if not listing.campaigns:
            tag("p", "No campaign lies in this folder.", cls="soft")
            return
        if new := sum(not (each.name or each.problem) for each in listing.campaigns):
            tag("p", f"Reading {counted(new, 'campaign')}…", cls="soft", role="status")
        with tag("div", cls="scroll"), tag("table", cls="st-table"):
            with tag("thead"), tag("tr"):
                for name in ("Campaign", "World, route", "Requirement", "Tried", "Runs", "Result", "Cost", "Changed"):
                    tag("th", name, scope="col")
            with tag("tbody"):
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
    bad = sum(finding.violated for finding in campaign.findings)
    if bad:
        chip(f"{bad} violation{'s' if bad > 1 else ''}", bad=True)
    elif campaign.findings:
        chip("none confirmed", good=True)
    elif not campaign.complete:
        chip("not finished")
    else:
        chip("not confirmed" if campaign.violated else "nothing found")


def _worlds(listing: Listing) -> None:
    with tag("section", aria_labelledby="worlds"):
        tag("h2", "Worlds", id="worlds")
        with tag("ul", cls="st-list st-columns"):
            for name in listing.worlds:
                with tag("li"):
                    link(name, "/world", world=name)
            for name in shipped_worlds():
                with tag("li"):
                    link(name, "/world", world=name)
                    tag("span", " ships with RVSG", cls="soft small")


def _suites(listing: Listing) -> None:
    with tag("section", aria_labelledby="suites"):
        tag("h2", "Suites", id="suites")
        with tag("ul", cls="st-list"):
            for name in listing.suites:
                with tag("li"):
                    link(name, "/suite", suite=name)


def ago(moment_s: float, *, since: bool = False) -> str:
    """Return how long ago a moment was, in words."""
    seconds = max(0.0, time.time() - moment_s)
    for size, unit in ((86_400, "day"), (3600, "hour"), (60, "minute")):
        if seconds >= size:
            count = int(seconds // size)
            return f"{count} {unit}{'s' if count > 1 else ''}{'' if since else ' ago'}"
    return "less than a minute" if since else "just now"


def add_others(workspace: Workspace) -> None:
    """Add the pages."""

    @ui.page("/job", response_timeout=60)
    async def job(job: str = "") -> None:
        try:
            found = await load(workspace.jobs.get, job)
        except RvsgError as error:
            problem(workspace, "Job", error)
            return
        with page(workspace, f"{found.title}: {found.target}") as made:
            with tag("ul", cls="st-list"):
                JobLine(made, found)
            with tag("p", cls="st-actions"):
                if found.kind == "matrix":
                    tag("a", "Open the campaigns", cls="st-button", href=address("/matrix", folder=found.target))
                if found.kind == "campaign":
                    tag("a", "Open the campaign", cls="st-button", href=address("/campaign", folder=found.target))
                if found.running:
                    made.button("Pause", lambda: workspace.jobs.pause(found.id))
                    made.button("Stop now", lambda: workspace.jobs.stop(found.id), cls="st-danger")
            made.command(found.title, found.command)

    @ui.page("/suite", response_timeout=60)
    async def suite(suite: str = "") -> None:
        try:
            found = await load(rvsg.Suite.open, workspace.existing(suite))
        except RvsgError as error:
            problem(workspace, "Suite", error)
            return
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
