"""A campaign while it runs, and the campaigns of several routes and requirements side by side."""

from __future__ import annotations

import shlex
import time
from pathlib import Path
from typing import Any

from nicegui import ui

import rvsg
from rvsg.app.commands import confirm_command, resume_command, runs_command
from rvsg.app.matrix import Matrix
from rvsg.campaign.attempt import Attempt
from rvsg.campaign.ranking import best_attempt, confirmations
from rvsg.core.errors import InputError
from rvsg.evaluation.verdict import counted, number, value_in_words
from rvsg.report.charts import search_chart
from rvsg.report.summary import Summary, tried_of
from rvsg.scenario.builder import save_scenario
from rvsg_studio.frame import Page, actions, address, chip, link, load, page, route, section, svg, table, tag
from rvsg_studio.listing import FoundCampaign
from rvsg_studio.pages.finding import FRESH_SEED, MORE, job_buttons
from rvsg_studio.workspace import Job, Workspace

EVERY_S = 1.0
PATIENCE = 6.0
"""Reading the store again may take this share of the time at most: one part in so many."""
SHOWN = 40


State = tuple[rvsg.Campaign, list[Attempt], Summary]
"""A campaign as it is stored now."""


def add(workspace: Workspace) -> None:
    """Add the page."""

    @route(workspace, "/campaign", "Campaign")
    async def campaign(folder: str = "", name: str = "") -> None:
        state = await load(read, workspace, folder, name)
        with page(workspace, folder, wide=True) as made:
            Live(made, workspace.relative(workspace.path(folder)), state)

    @route(workspace, "/matrix", "Campaigns")
    async def matrix(folder: str = "") -> None:
        found = await load(Matrix.open, workspace.existing(folder))
        name = workspace.relative(workspace.path(folder))
        with page(workspace, f"Campaigns in {name}", wide=True) as made:
            Cells(made, name, found)


def read(workspace: Workspace, folder: str, name: str) -> State:
    """Read a campaign; what was read is kept until its store changes."""
    path = workspace.existing(folder)
    if not path.is_dir():
        raise InputError(f"{folder}: this is a file; a campaign is a folder.")

    def made() -> State:
        opened = rvsg.Campaign.open(path, name or None)
        attempts = opened.attempts()  # read once: a running campaign has more a moment later
        return opened, attempts, opened.summary(attempts)

    return workspace.kept(("campaign", folder, name), path, made)


class Live:
    """The page of a campaign, which follows it while it runs."""

    def __init__(self, made: Page, folder: str, state: State) -> None:
        self.page, self.folder = made, folder
        self.campaign, self.attempts, self.summary = state
        self.workspace = made.workspace
        self._at, self._next, self._shown_worst = 0, 0.0, -1
        self._following: str | None = None
        self._last = ""
        self._buttons_for: tuple[bool, bool] | None = None
        plan = self.campaign.plan
        tag("p", f"{plan.requirement.name}: {plan.requirement.title} · {plan.mission.world}, "
                 f"{plan.mission.route.name} · robot {plan.mission.robot_name}", cls="soft")  # fmt: skip
        with tag("div", cls="st-status"):
            self.chip = tag("span", "", cls="chip")
            self.progress = tag("span", "")
            self.spend = tag("span", "", cls="soft")
        self.bar = tag("progress", max="1", aria_label="Part of the planned runs that is made")
        self.actions = actions()
        self.news = tag("p", "", cls="soft small st-news")
        region = {"tabindex": "0", "role": "region", "aria_label": "Chart of the search"}
        with section("Course of the search", "course"), tag("div", cls="scroll", **region):
            self.course = tag("div", cls="chart-box")
        with tag("div", cls="st-two st-unequal"):
            with section("Worst so far", "worst"):
                self.about = tag("p", "", cls="small")
                self.replay = tag("div", data_studio="replay", data_play=True, id="worst-replay")
            with section("Latest reasoning", "thought"):
                self.reasoning = tag("p", "", cls="reasoning small")
        self.lists = tag("div")
        made.command("Start it again elsewhere", self.campaign.command)
        made.command("Resume", resume_command(self.campaign.config))
        made.command("Report", f"rvsg report {folder}")
        self._show(self._job())
        self.timer = ui.timer(EVERY_S, made.guarded(self._follow))

    def _job(self) -> Job | None:
        """The newest job on this campaign, or on the folder of campaigns that it stands in."""
        found = [self.workspace.jobs.of(self.folder), self.workspace.jobs.of(self.folder.rpartition("/")[0])]
        jobs = [job for job in found if job is not None and (job.target == self.folder or job.kind == "matrix")]
        return max(jobs, key=lambda job: (job.running, job.id), default=None)

    async def _follow(self) -> None:
        """Take in what happened, and read the store again where an attempt was finished."""
        job = await load(self._job)
        if job is None:
            return
        if job.id != self._following:
            self._following, self._at = job.id, 0
        events, self._at = await load(self.workspace.jobs.events, job.id, self._at)
        events = [event for event in events if event.get("folder", self.folder) == self.folder]
        for event in events:
            self._say(event)
        changed = any(event["kind"] in ("attempt", "run") for event in events) or not job.running
        if changed and time.monotonic() >= self._next and not (not events and not job.running):
            begun = time.monotonic()
            state = await load(read, self.workspace, self.folder, self.campaign.name)
            self.campaign, self.attempts, self.summary = state
            self._next = time.monotonic() + max(EVERY_S, PATIENCE * (time.monotonic() - begun))
            self._show(job)
        elif events or job.state != self._last:
            self._status(job)

    def _say(self, event: dict[str, Any]) -> None:
        match event:
            case {"kind": "message", "text": text}:
                said = text
            case {"kind": "proposing", "scenario": scenario, "configuration": configuration}:
                said = f"A scenario is being written: scenario {scenario + 1}, configuration {configuration + 1}."
            case {"kind": "model", "model": model, "purpose": purpose, "what": what, "why": why}:
                said = f"The model {model}, {purpose}: {what}{f' ({why})' if why else ''}."
            case {"kind": "confirming", "number": number, "of": of}:
                said = f"Confirming candidate {number} of {of}."
            case {"kind": "explaining", "without": without}:
                said = f"Running without {', '.join(without) or 'people'} to find the cause."
            case _:
                return
        self.news.set_text(said)

    def _show(self, job: Job | None) -> None:
        self._status(job)
        chart = search_chart(self.campaign.plan, self.attempts)
        self.course.clear()
        with self.course:
            if chart:
                svg(chart)
            else:
                tag("p", "No configuration is measured yet.", cls="soft")
        texts = [each.proposal.reasoning for each in self.attempts if each.purpose == "search"]
        self.reasoning.set_text(next((text for text in reversed(texts) if text), "No reasoning yet."))
        self._worst()
        self._lists()

    def _status(self, job: Job | None) -> None:
        self._last = job.state if job is not None else ""
        plan, account = self.campaign.plan, self.summary.accounting
        words = job.state if job is not None else "not finished"
        if self.summary.complete and not (job is not None and job.running):
            words = "finished"
        self.chip.set_text(words)
        if job is not None and job.state == "failed":
            self.chip.classes(replace="chip bad")
            self.page.say(job.result.get("reason", ""), wrong=True)
        else:
            self.chip.classes(replace=f"chip{' good' if words == 'finished' else ''}")
        made = account.search_runs
        tried = tried_of(account.search_attempts, plan.attempts)
        self.progress.set_text(f"{tried} configurations tried, {made} of {plan.search_runs} search runs, "
                               f"{account.confirmation_runs} of at most {plan.confirmations} to confirm")  # fmt: skip
        share = 1.0 if self.summary.complete else min(1.0, made / max(1, plan.search_runs)) * 0.9
        self.bar._props["value"] = f"{share:.3f}"
        self.bar.update()
        self.spend.set_text(self._spent(job))
        self._buttons(job)

    def _spent(self, job: Job | None) -> str:
        account = self.summary.accounting
        if not account.calls:
            return "no model called"
        cost = "cost unknown" if account.cost_usd is None else f"{account.cost_usd:.2f} USD"
        budget = (job.arguments.get("machine") or {}).get("budget_usd") if job is not None else None
        return f"{counted(account.calls, 'call')}, {cost}" + (f" of {budget:.2f} USD" if budget else "")

    def _buttons(self, job: Job | None) -> None:
        running = job is not None and job.running
        wanted = (running, self.summary.complete)
        if self._buttons_for == wanted:
            return
        self._buttons_for = wanted
        self.actions.clear()
        with self.actions:
            if running and job is not None:
                job_buttons(self.page, job, self.news.set_text, command="Ctrl-C in `rvsg run`")
            elif not self.summary.complete:
                self.page.button("Resume", self._resume, cls="st-primary",
                                 command=resume_command(self.campaign.config))  # fmt: skip
            if self.attempts:
                self.page.button("Write the report", self._report, command=f"rvsg report {self.folder}")

    def _resume(self) -> None:
        before = self.workspace.jobs.of(self.folder)
        machine = before.arguments.get("machine", {}) if before is not None else {}
        told = {"folder": self.folder, "name": self.campaign.name, "machine": machine}
        command = resume_command(self.campaign.config)
        self.workspace.jobs.start("campaign", title="Campaign", command=command, target=self.folder, **told)
        self.news.set_text("Resuming…")

    async def _report(self) -> None:
        written = await load(self.campaign.report)
        self.page.say(f"Written: {self.workspace.relative(Path(written))}")

    def _worst(self) -> None:
        worst = best_attempt(self.attempts, self.campaign.requirement)
        if worst is None:
            self.about.set_text("No run yet.")
            return
        verdict, requirement = worst.verdict, self.campaign.requirement
        if verdict is not None:
            scenario = f"Scenario {worst.brief.scenario_index + 1}"
            self.about.set_text(f"{scenario}: {value_in_words(verdict, requirement.unit)}, {verdict.violations} of "
                                f"{counted(verdict.runs, 'run')} violate it.")  # fmt: skip
        if worst.index != self._shown_worst:
            self._shown_worst = worst.index
            shown = {"campaign": self.folder, "name": self.campaign.name, "attempt": worst.index}
            self.replay._props["data-url"] = address("/data/replay", **shown, alone=1)
            self.replay.update()

    def _lists(self) -> None:
        self.lists.clear()
        with self.lists:
            confirmed = confirmations(self.attempts)
            if confirmed:
                tag("h2", "Findings")
                for attempt in confirmed:
                    self._line(attempt)
            done = {attempt.confirms for attempt in confirmed}
            open_ = [entry for entry in self.summary.ranking if entry.attempt not in done]
            if open_:
                tag("h2", "Candidates and other scenarios, the worst first")
                by_index = {attempt.index: attempt for attempt in self.attempts}
                for entry in open_[:SHOWN]:
                    self._line(by_index[entry.attempt])
                if len(open_) > SHOWN:
                    tag("p", f"and {len(open_) - SHOWN} more in the report.", cls="soft")

    def _line(self, attempt: Attempt) -> None:
        verdict, scenario = attempt.verdict, attempt.proposal.scenario
        if verdict is None or scenario is None:
            return
        with tag("div", cls="st-row"):
            with tag("span", cls="st-row-head"):
                chip(verdict.status.value, bad=verdict.violations > 0, good=verdict.status.value == "PASS")
                tag("span", f"{verdict.violations} of {verdict.runs}; mean "
                            f"{number(verdict.mean, self.campaign.requirement.unit)}", cls="small")  # fmt: skip
            link(scenario.description or "Without a description", "/finding", campaign=self.folder,
                 name=self.campaign.name, attempt=attempt.index, cls="st-clip")  # fmt: skip
            if attempt.purpose == "search" and verdict.violations:
                label = f"Confirm attempt {attempt.index} now"
                made = self.page.button("Confirm now", lambda: self._confirm(attempt), aria_label=label)
                made._props["title"] = confirm_command(Path(self.folder), attempt.index)

    def _confirm(self, attempt: Attempt) -> None:
        """Confirm a candidate; while the search runs, in fresh runs beside the campaign, whose records stay its own."""
        job, campaign = self._job(), self.campaign
        told: dict[str, Any] = {"folder": self.folder, "name": campaign.name}
        if self.summary.complete and not (job is not None and job.running):
            command = confirm_command(Path(self.folder), attempt.index)
            self.workspace.jobs.start("confirm", title="Confirm", command=command, target=self.folder,
                                      candidate=attempt.index, **told)  # fmt: skip
            self.page.command("Confirm", command)
            self.news.set_text("Confirming…")
            return
        scenario = attempt.proposal.scenario
        if scenario is None:
            raise InputError(f"Attempt {attempt.index} has no scenario.")
        file = f"{self.folder}/attempt-{attempt.index}.json"
        save_scenario(scenario, self.workspace.path(file))
        seeds: dict[str, Any] = {"seed": FRESH_SEED, "repeats": MORE, "out": file.replace(".json", "-runs.jsonl")}
        command, title = runs_command(file, campaign.config, **seeds), f"{MORE} fresh runs"
        self.workspace.jobs.start("runs", title=title, command=command, target=file, scenario=file, **seeds, **told)
        self.page.command("Confirm beside the search", command)
        ui.navigate.to(address("/finding", campaign=self.folder, name=campaign.name, attempt=attempt.index))


class Cells:
    """The table of routes and requirements, which follows the campaigns."""

    def __init__(self, made: Page, folder: str, matrix: Matrix) -> None:
        self.page, self.folder, self.matrix = made, folder, matrix
        self.workspace = made.workspace
        with tag("div", cls="st-status"):
            self.chip = tag("span", "", cls="chip")
            self.news = tag("span", "", cls="soft", role="status")
        self.actions = actions()
        self.table = tag("div")
        made.command("Run or resume", f"rvsg run --out {shlex.quote(folder)}")
        made.command("Begin elsewhere", matrix.commands())
        self._shown: tuple[object, ...] = ()
        self._buttons: tuple[bool, bool] | None = None
        self._update(self._found(), self.workspace.jobs.of(folder))
        self.timer = ui.timer(EVERY_S, made.guarded(self._follow))

    def _found(self) -> dict[tuple[str, str], FoundCampaign]:
        """The campaigns of the folder by route and requirement, as they are known now."""
        inside = [each for each in self.workspace.listing().campaigns if each.folder.rpartition("/")[0] == self.folder]
        return {(each.route, each.requirement): each for each in inside if each.name}

    async def _follow(self) -> None:
        self._update(await load(self._found), await load(self.workspace.jobs.of, self.folder))

    def _update(self, found: dict[tuple[str, str], FoundCampaign], job: Job | None) -> None:
        running = job is not None and job.running
        finished = len(found) == len(self.matrix.all_pairs) and all(each.complete for each in found.values())
        state = job.state if job is not None and (running or not finished) else "finished" if finished else "not run"
        self.chip.set_text(state)
        if job is not None and job.state == "failed":
            self.news.set_text(job.result.get("reason", ""))
        if (running, finished) != self._buttons:
            self._buttons = (running, finished)
            self.actions.clear()
            with self.actions:
                if running and job is not None:
                    job_buttons(self.page, job)
                elif not finished:
                    self.page.button("Resume", self._resume, cls="st-primary")
        if (shown := (tuple(found.items()), finished)) != self._shown:
            self._shown = shown
            self._table(found)

    def _resume(self) -> None:
        command = self.matrix.resume_command
        self.workspace.jobs.start("matrix", title="Campaigns", command=command, target=self.folder, folder=self.folder)
        self.news.set_text("")

    def _table(self, found: dict[tuple[str, str], FoundCampaign]) -> None:
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
                                self._cell(found.get((name, requirement)))

    def _cell(self, campaign: FoundCampaign | None) -> None:
        if campaign is None:
            tag("span", "not begun", cls="soft")
            return
        chip(campaign.status, campaign.tone)
        link(f"{campaign.tried} tried", "/campaign", folder=campaign.folder, name=campaign.name)
