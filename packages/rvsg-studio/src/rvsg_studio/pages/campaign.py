"""A campaign while it runs, and the campaigns of several routes and requirements side by side."""

from __future__ import annotations

import shlex
import time
from pathlib import Path
from typing import Any

from nicegui import ui

from rvsg.app.commands import resume_command
from rvsg.app.folder import LOCK
from rvsg.app.matrix import Matrix
from rvsg.evaluation.verdict import counted
from rvsg.findings.ranking import best_attempt
from rvsg.report.charts import search_chart
from rvsg.report.words import tried_of
from rvsg_studio.frame import Page, actions, address, chip, link, load, page, rate, route, section, svg, table, tag
from rvsg_studio.listing import FoundCampaign
from rvsg_studio.pages.finding import State, current, job_buttons
from rvsg_studio.pages.home import ago
from rvsg_studio.workspace import LOG, Job, Workspace, is_held, stamp

EVERY_S = 1.0
LOGGED = 200  # lines
PATIENCE = 6.0
"""Reading the store again may take this share of the time at most: one part in so many."""
STAGES = {"search": "search", "confirmation": "confirm", "baseline": "cause", "removal": "cause", "shrinking": "shrink"}
"""The stage of a campaign by the purpose of its newest attempt."""


def add(workspace: Workspace) -> None:
    """Add the page."""

    @route(workspace, "/campaign", "Campaign")
    async def campaign(folder: str = "", name: str = "") -> None:
        state = await load(current, workspace, folder, name)
        with page(workspace, workspace.folder.name if folder == "." else folder, wide=True) as view:
            Live(view, workspace.relative(workspace.path(folder)), state)

    @route(workspace, "/matrix", "Campaigns")
    async def matrix(folder: str = "") -> None:
        opened = await load(Matrix.open, workspace.existing(folder))
        name = workspace.relative(workspace.path(folder))
        with page(workspace, f"Campaigns in {name}", wide=True) as view:
            Cells(view, name, opened)


class Live:
    """The page of a campaign, which follows it while it runs."""

    def __init__(self, view: Page, folder: str, state: State) -> None:
        self.page, self.folder = view, folder
        self._take(state)
        self.workspace = view.workspace
        self._seen, self._held = self._stored()
        self._at, self._next, self._shown_worst = 0, 0.0, -1
        self._following: str | None = None
        self._last = ""
        self._buttons_for: tuple[bool, bool, bool] | None = None
        tag("p", " · ".join((self.result.answer.title, *self.result.answer.setup)), cls="soft")
        self.said = tag("div")
        with tag("div", cls="st-status"):
            self.chip = tag("span", "", cls="chip")
            self.elapsed = tag("span", "", cls="soft")
            self.progress = tag("span", "")
            self.spend = tag("span", "", cls="soft")
        self.bar = tag("progress", max="1", aria_label="Part of the planned runs that is made")
        self.actions = actions()
        self.stage = tag("p", "", cls="st-news", role="status")
        self.news = tag("p", "", cls="soft small st-news")
        with tag("details") as self.folded:
            tag("summary", "Log")
            self.log = tag("pre", "", tabindex="0", aria_label="Log")
        self.folded.set_visibility(False)
        with section("Scenarios", "scenarios"):
            self.rows = tag("div")
        region = {"tabindex": "0", "role": "region", "aria_label": "Chart of the search"}
        with section("Course of the search", "course"), tag("div", cls="scroll", **region):
            self.course = tag("div", cls="chart-box")
        with tag("div", cls="st-two st-unequal"):
            with section("Worst so far", "worst"):
                self.replay = tag("div", data_studio="replay", data_play=True, id="worst-replay")
            with section("Latest reasoning", "thought"):
                self.reasoning = tag("p", "", cls="reasoning small")
        view.command("Start it again elsewhere", self.campaign.command)
        view.command("Resume", resume_command(self.campaign.config))
        view.command("Report", f"rvsg report {folder}")
        self._show(self._job())
        self.timer = ui.timer(EVERY_S, view.guarded(self._follow))

    def _take(self, state: State) -> None:
        self.campaign, self.result = state

    def _job(self) -> Job | None:
        """The newest job on this campaign, or on the folder of campaigns that it stands in."""
        newest = [self.workspace.jobs.of(self.folder), self.workspace.jobs.of(self.folder.rpartition("/")[0])]
        jobs = [job for job in newest if job is not None and (job.target == self.folder or job.kind == "matrix")]
        return max(jobs, key=lambda job: (job.running, job.id), default=None)

    def _stored(self) -> tuple[object, bool]:
        """What changes when any process writes to the store, and whether one runs the campaign."""
        folder = self.workspace.path(self.folder)
        return stamp(folder), is_held(folder / LOCK)

    async def _follow(self) -> None:
        """Take in what happened, and read the store again where it changed."""
        job, events = await load(self._job), list[dict[str, Any]]()
        if job is not None:
            if job.id != self._following:
                self._following, self._at = job.id, 0
            events, self._at = await load(self.workspace.jobs.events, job.id, self._at)
        for event in events:
            if event.get("folder", self.folder) == self.folder:
                self._say(event)
        was, (stored, self._held) = self._held, await load(self._stored)
        if stored != self._seen and time.monotonic() >= self._next:
            begun = time.monotonic()
            self._take(await load(current, self.workspace, self.folder, self.campaign.name))
            self._next = time.monotonic() + max(EVERY_S, PATIENCE * (time.monotonic() - begun))
            self._seen = stored
            self._show(job)
        elif events or self._held != was or (job is not None and job.state != self._last):
            self._status(job)

    def _say(self, event: dict[str, Any]) -> None:
        match event:
            case {"kind": "progress", "text": text}:
                self.stage.set_text(text)
            case {"kind": "message", "text": text}:
                self.news.set_text(text)
            case {"kind": "model", "model": model, "purpose": purpose, "what": what, "why": why}:
                self.news.set_text(f"The model {model}, {purpose}: {what}{f' ({why})' if why else ''}.")

    def _show(self, job: Job | None) -> None:
        self._status(job)
        chart = search_chart(self.campaign.plan, self.result.attempts)
        self.course.clear()
        with self.course:
            if chart:
                svg(chart)
            else:
                tag("p", "No configuration is measured yet.", cls="soft")
        texts = [attempt.proposal.reasoning for attempt in self.result.attempts if attempt.purpose == "search"]
        self.reasoning.set_text(next((text for text in reversed(texts) if text), "No reasoning yet."))
        self._worst()
        self._answer()
        self._rows()

    def _status(self, job: Job | None) -> None:
        self._last = job.state if job is not None else ""
        plan, account = self.campaign.plan, self.result.accounting
        running = job is not None and job.running
        words = job.state if job is not None else "not finished"
        if not running:
            words = "running" if self._held else "finished" if self.result.complete else words
            where = "another process, such as `rvsg run`, runs this campaign; Ctrl-C there pauses it"
            newest = STAGES[self.result.attempts[-1].purpose] if self.result.attempts else "prepare"
            self.stage.set_text(f"{newest} · {where}" if self._held else "")
        self.chip.set_text(words)
        self.chip.classes(replace=f"chip{' bad' if words == 'failed' else ''}")
        if job is not None and words == "failed":
            self.page.say(job.result.get("reason", ""), wrong=True)
        done = account.search_runs
        tried = tried_of(account.search_attempts, plan.attempts)
        self.progress.set_text(f"{tried} configurations tried, {done} of {plan.search_runs} search runs, "
                               f"{account.confirmation_runs} of at most {plan.confirmations} to confirm")  # fmt: skip
        share = 1.0 if self.result.complete else min(1.0, done / max(1, plan.search_runs)) * 0.9
        self.bar._props["value"] = f"{share:.3f}"
        self.bar.update()
        self.spend.set_text(self._spent(job))
        if job is not None:
            self.elapsed.set_text(f"for {ago(job.begun_s, since=True)}" if job.running else "")
            log = job.folder / LOG  # a job that was stopped before its worker began has none
            lines = log.read_text(errors="replace").splitlines() if log.exists() else []
            self.log.set_text("\n".join(lines[-LOGGED:]))
            self.folded.set_visibility(bool(lines))
        self._buttons(job)

    def _spent(self, job: Job | None) -> str:
        account = self.result.accounting
        if not account.calls:
            return "no model called"
        cost = "cost unknown" if account.cost_usd is None else f"{account.cost_usd:.2f} USD"
        budget = (job.arguments.get("machine") or {}).get("budget_usd") if job is not None else None
        return f"{counted(account.calls, 'call')}, {cost}" + (f" of {budget:.2f} USD" if budget else "")

    def _buttons(self, job: Job | None) -> None:
        running = job is not None and job.running
        wanted = (running, self.result.complete, self._held)
        if self._buttons_for == wanted:
            return
        self._buttons_for = wanted
        self.actions.clear()
        with self.actions:
            if running and job is not None:
                job_buttons(self.page, job, self.news.set_text, command="Ctrl-C in `rvsg run`")
            elif not self.result.complete and not self._held:
                self.page.button("Resume", self._resume, cls="st-primary",
                                 command=resume_command(self.campaign.config))  # fmt: skip
            if self.result.attempts:
                self.page.button("Write the report", self._report, command=f"rvsg report {self.folder}")

    def _resume(self) -> None:
        before = self.workspace.jobs.of(self.folder)
        machine = before.arguments.get("machine", {}) if before is not None else {}
        arguments = {"folder": self.folder, "name": self.campaign.name, "machine": machine}
        command = resume_command(self.campaign.config)
        self.workspace.jobs.start("campaign", title="Campaign", command=command, target=self.folder, **arguments)
        self.news.set_text("Resuming…")

    async def _report(self) -> None:
        written = await load(self.campaign.report)
        self.page.say(f"Written: {self.workspace.relative(Path(written))}")

    def _worst(self) -> None:
        worst = best_attempt(self.result.attempts, self.campaign.requirement)
        if worst is not None and worst.index != self._shown_worst:
            self._shown_worst = worst.index
            shown = {"campaign": self.folder, "name": self.campaign.name, "attempt": worst.index}
            self.replay._props["data-url"] = address("/data/replay", **shown, alone=1)
            self.replay.update()

    def _answer(self) -> None:
        """Show what the campaign says: its headline, the robot alone, and contact in other configurations."""
        alone, elsewhere = self.result.answer.alone, self.result.answer.elsewhere
        self.said.clear()
        with self.said:
            with tag("p"):
                chip(self.result.answer.status, self.result.answer.tone)
                tag("strong", f" {self.result.answer.headline}")
            if self.result.answer.changes:
                tag("p", self.result.answer.changes, cls="strip warn")
            if alone is not None:
                tag("p", f"Alone: {alone.warning or alone.text}", cls=f"strip{' warn' if alone.warning else ''}")
            if elsewhere is not None:
                tag("p", elsewhere.text, cls="strip warn")

    def _rows(self) -> None:
        """List the failures, what else is confirmed, and the candidates; each can be confirmed on its own page."""
        self.rows.clear()
        with self.rows:
            for row in self.result.answer.shown:
                with tag("div", cls="st-row"):
                    with tag("span", cls="st-row-head"):
                        chip(row.status, row.tone)
                        rate(row)
                    link(f"{row.number} {row.name}", "/finding", campaign=self.folder, name=self.campaign.name,
                         attempt=str(row.shown_attempt))  # fmt: skip
                    touch = f"contact {row.contact}"
                    tag("span", touch, cls=f"small{' st-wrong' if row.contacts else ''}")
            tag("p", self.result.answer.rest, cls="soft small")


class Cells:
    """The table of routes and requirements, which follows the campaigns."""

    def __init__(self, view: Page, folder: str, matrix: Matrix) -> None:
        self.page, self.folder, self.matrix = view, folder, matrix
        self.workspace = view.workspace
        with tag("div", cls="st-status"):
            self.chip = tag("span", "", cls="chip")
            self.news = tag("span", "", cls="soft", role="status")
        self.actions = actions()
        self.table = tag("div")
        view.command("Run or resume", f"rvsg run --out {shlex.quote(folder)}")
        view.command("Begin elsewhere", matrix.commands())
        self._shown: tuple[object, ...] = ()
        self._buttons: tuple[bool, bool] | None = None
        self._update(self._found(), self.workspace.jobs.of(folder))
        self.timer = ui.timer(EVERY_S, view.guarded(self._follow))

    def _found(self) -> dict[tuple[str, str], FoundCampaign]:
        """The campaigns of the folder by route and requirement, as they are known now."""
        inside = [c for c in self.workspace.listing().campaigns if c.folder.rpartition("/")[0] == self.folder]
        return {(c.route, c.requirement): c for c in inside if c.name}

    async def _follow(self) -> None:
        self._update(await load(self._found), await load(self.workspace.jobs.of, self.folder))

    def _update(self, campaigns: dict[tuple[str, str], FoundCampaign], job: Job | None) -> None:
        running = job is not None and job.running
        finished = len(campaigns) == len(self.matrix.all_pairs) and all(c.complete for c in campaigns.values())
        state = job.state if job is not None and (running or not finished) else "finished" if finished else "not run"
        elsewhere = not running and is_held(self.workspace.path(self.folder) / LOCK)
        self.chip.set_text("running" if elsewhere else state)
        if job is not None and job.state == "failed":
            self.news.set_text(job.result.get("reason", ""))
        if (running, finished or elsewhere) != self._buttons:
            self._buttons = (running, finished or elsewhere)
            self.actions.clear()
            with self.actions:
                if running and job is not None:
                    job_buttons(self.page, job)
                elif not finished and not elsewhere:
                    self.page.button("Resume", self._resume, cls="st-primary")
        if (shown := (tuple(campaigns.items()), finished)) != self._shown:
            self._shown = shown
            self._table(campaigns)

    def _resume(self) -> None:
        command = self.matrix.resume_command
        self.workspace.jobs.start("matrix", title="Campaigns", command=command, target=self.folder, folder=self.folder)
        self.news.set_text("")

    def _table(self, campaigns: dict[tuple[str, str], FoundCampaign]) -> None:
        self.table.clear()
        pairs = self.matrix.all_pairs
        requirements = list(dict.fromkeys(requirement for _, requirement in pairs))
        with self.table, table(["", *requirements], label="Campaigns"):
            for name in dict.fromkeys(name for name, _ in pairs):
                with tag("tr"):
                    tag("th", name, scope="row")
                    for requirement in requirements:
                        with tag("td"):
                            if (name, requirement) in pairs:
                                self._cell(campaigns.get((name, requirement)))

    def _cell(self, campaign: FoundCampaign | None) -> None:
        if campaign is None:
            tag("span", "not begun", cls="soft")
            return
        chip(campaign.status, campaign.tone)
        link(f"{campaign.tried} tried", "/campaign", folder=campaign.folder, name=campaign.name)
        tag("div", campaign.headline, cls="soft small")
