"""Several campaigns in one folder: every route with every requirement, how each stands, and one job for all."""

from __future__ import annotations

import shlex

from nicegui import ui

from rvsg.app.matrix import Matrix
from rvsg.core.errors import RvsgError
from rvsg_studio.frame import Page, chip, link, load, page, problem, tag
from rvsg_studio.jobs import Job
from rvsg_studio.listing import FoundCampaign
from rvsg_studio.workspace import Workspace

EVERY_S = 1.0


def add(workspace: Workspace) -> None:
    """Add the page."""

    @ui.page("/matrix", response_timeout=60)
    async def matrix(folder: str = "") -> None:
        try:
            found = await load(Matrix.open, workspace.existing(folder))
        except RvsgError as error:
            problem(workspace, "Campaigns", error)
            return
        name = workspace.relative(workspace.path(folder))
        with page(workspace, f"Campaigns in {name}", wide=True) as made:
            Cells(made, name, found)


class Cells:
    """The table of routes and requirements, which follows the campaigns."""

    def __init__(self, made: Page, folder: str, matrix: Matrix) -> None:
        self.page, self.folder, self.matrix = made, folder, matrix
        self.workspace = made.workspace
        with tag("div", cls="st-status"):
            self.chip = tag("span", "", cls="chip")
            self.news = tag("span", "", cls="soft", role="status")
        self.actions = tag("p", cls="st-actions")
        self.table = tag("div", cls="scroll", tabindex="0", role="region", aria_label="Campaigns")
        made.command("Run or resume", f"rvsg run --out {shlex.quote(folder)}")
        made.command("Begin elsewhere", matrix.commands())
        self._shown: tuple[object, ...] = ()
        self._buttons: tuple[bool, bool] | None = None
        self._update(self._found(), self._job())
        self.timer = ui.timer(EVERY_S, made.guarded(self._follow))

    def _job(self) -> Job | None:
        return self.workspace.jobs.of(self.folder)

    def _found(self) -> dict[tuple[str, str], FoundCampaign]:
        """The campaigns of the folder by route and requirement, as they are known now."""
        inside = [each for each in self.workspace.listing().campaigns if each.folder.rpartition("/")[0] == self.folder]
        return {(each.route, each.requirement): each for each in inside if each.name}

    async def _follow(self) -> None:
        self._update(await load(self._found), await load(self._job))

    def _update(self, found: dict[tuple[str, str], FoundCampaign], job: Job | None) -> None:
        running = job is not None and job.running
        finished = len(found) == len(self.matrix.all_pairs) and all(each.complete for each in found.values())
        state = job.state if job is not None and (running or not finished) else "finished" if finished else "not run"
        self.chip.set_text(state)
        if job is not None and job.state == "failed":
            self.news.set_text(job.result.get("reason", ""))
        if (running, finished) != self._buttons:
            self._buttons = (running, finished)
            self._offer(job if running else None, finished=finished)
        shown = (tuple(found.items()), finished)
        if shown != self._shown:
            self._shown = shown
            self._table(found)

    def _offer(self, job: Job | None, *, finished: bool) -> None:
        self.actions.clear()
        with self.actions:
            if job is not None:
                self.page.button("Pause", lambda: self.workspace.jobs.pause(job.id))
                self.page.button("Stop now", lambda: self.workspace.jobs.stop(job.id), cls="st-danger")
            elif not finished:
                self.page.button("Resume", self._resume, cls="st-primary")

    def _resume(self) -> None:
        command = self.matrix.resume_command
        self.workspace.jobs.start("matrix", title="Campaigns", command=command, target=self.folder, folder=self.folder)
        self.news.set_text("")

    def _table(self, found: dict[tuple[str, str], FoundCampaign]) -> None:
        self.table.clear()
        pairs = self.matrix.all_pairs
        requirements = list(dict.fromkeys(requirement for _, requirement in pairs))
        with self.table, tag("table", cls="st-plain"):
            with tag("thead"), tag("tr"):
                tag("td", "")
                for requirement in requirements:
                    tag("th", requirement, scope="col")
            with tag("tbody"):
                for route in dict.fromkeys(route for route, _ in pairs):
                    with tag("tr"):
                        tag("th", route, scope="row")
                        for requirement in requirements:
                            with tag("td"):
                                if (route, requirement) in pairs:
                                    self._cell(found.get((route, requirement)))

    def _cell(self, campaign: FoundCampaign | None) -> None:
        if campaign is None:
            tag("span", "not begun", cls="soft")
            return
        bad = sum(finding.violated for finding in campaign.findings)
        if bad:
            chip(f"{bad} violation{'s' if bad > 1 else ''}", bad=True)
        elif campaign.complete:
            chip("not confirmed" if campaign.violated else "nothing found", good=not campaign.violated)
        link(f"{campaign.tried} tried", "/campaign", folder=campaign.folder,
             name=campaign.name)  # fmt: skip
