"""A finding: its runs, their replay, what is known of it, and what can be done with it."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nicegui import ui

import rvsg
from rvsg.app.commands import confirm_command, runs_command, shrink_command
from rvsg.core.errors import InputError, RvsgError
from rvsg.core.plugins import ignore
from rvsg.evaluation.verdict import how_sure
from rvsg.report.answer_row import AnswerRow
from rvsg.report.result import Result, answer_of_runs
from rvsg.report.words import shown_at
from rvsg.runs.attempt import Attempt
from rvsg.scenario.builder import save_scenario, without_people
from rvsg_exchange import formats as exchange
from rvsg_studio.frame import (
    Page,
    address,
    chip,
    field,
    link,
    load,
    page,
    rate,
    route,
    select,
    tag,
    text_area,
)
from rvsg_studio.listing import Failure
from rvsg_studio.workspace import STATES, FindingNote, Job, Workspace, note, notes_of

TABS = ("Events", "Cause", "People", "Certainty", "Notes")
MORE = 30
FOLLOW_S = 1.0
FRESH_SEED = 900_000
"""The first seed of further runs; campaigns draw theirs from all of 64 bits."""
FORMATS = {
    "mcap": "Foxglove, rosbag2 (.mcap)",
    "csv": "table (.csv)",
    "hunav": "HuNavSim agents (.yaml)",
    "nav2-goals": "Nav2 goals (.yaml)",
    "initial-pose": "initial pose (.yaml)",
    "sdf": "Gazebo world (.sdf)",
    "osc": "OpenSCENARIO DSL (.osc)",
}


@dataclass(frozen=True)
class Shown:
    """What the page shows: an attempt of a campaign, what the campaign says of it, and its note."""

    campaign: rvsg.Campaign
    folder: str
    attempt: Attempt
    row: AnswerRow
    note: FindingNote
    confirmed: bool
    changes: str
    """What has changed since the campaign ran."""

    @property
    def scenario(self) -> rvsg.Scenario:
        """Its scenario."""
        scenario = self.attempt.proposal.scenario
        if scenario is None:
            raise InputError(f"Attempt {self.attempt.index} has no valid scenario.")
        return scenario

    @property
    def file(self) -> str:
        """Where its scenario is written when another command needs it, relative to the folder of the studio."""
        return f"{self.folder}/attempt-{self.attempt.index}.json"

    @property
    def query(self) -> dict[str, Any]:
        """What names it in an address."""
        return {"campaign": self.folder, "name": self.campaign.name, "attempt": self.attempt.index}


def add(workspace: Workspace) -> None:
    """Add the page."""

    @route(workspace, "/finding", "Finding")
    async def finding(campaign: str = "", name: str = "", attempt: int = -1) -> None:
        shown = await load(read, workspace, campaign, name, attempt)
        listing = await load(workspace.listing)
        with page(workspace, shown.row.name, full=True) as view:
            lay_out(view, shown, listing.failures)


State = tuple[rvsg.Campaign, Result]
"""A campaign as it is stored now, with its answer."""


def current(workspace: Workspace, folder: str, name: str) -> State:
    """Read a campaign; what was read is kept until its store changes."""
    path = workspace.existing(folder)
    if not path.is_dir():
        raise InputError(f"{folder}: this is a file; a campaign is a folder.")

    def view() -> State:
        campaign = rvsg.Campaign.open(path, name or None)
        with campaign.result() as result:
            assert result.answer, "asked for while the store is open"
        return campaign, result

    return workspace.cached(("answer", folder, name), path, view)


def read(workspace: Workspace, folder: str, name: str, index: int) -> Shown:
    """Read an attempt of a campaign, with what its campaign says of it."""
    campaign, result = current(workspace, folder, name)
    attempt = next((a for a in result.attempts if a.index == index), None)
    if attempt is None or attempt.proposal.scenario is None or attempt.verdict is None:
        raise InputError(f"There is no attempt {index} with a valid scenario in {folder}.")
    row = next((r for r in result.answer.rows if index == r.shown_attempt), None)
    if row is None:  # another configuration of its scenario is more severe
        with campaign.reading() as ledger:
            row = answer_of_runs(campaign.plan, attempt, world=campaign.shown_world, run_of=ledger.run).rows[0]
    return Shown(
        campaign=campaign,
        folder=folder,
        attempt=attempt,
        row=row,
        note=notes_of(workspace.path(folder)).findings.get(attempt.proposal.scenario.id, FindingNote()),
        confirmed=any(a.scenario_id == attempt.scenario_id and a.purpose == "confirmation" for a in result.attempts),
        changes=result.changes,
    )


def lay_out(view: Page, shown: Shown, failures: Sequence[Failure]) -> None:
    """Lay out the page: what can be done, then runs, map, and what is known, beside each other."""
    with tag("div", cls="st-actions st-head"):
        _facts(shown, failures)
        _actions(view, shown)
        if any(campaign.folder == shown.folder and failure.row == shown.row for campaign, failure in failures):
            link("Tune", "/tune", cls="st-button", campaign=shown.folder, attempt=shown.attempt.index)
    if shown.changes:
        tag("p", shown.changes, cls="strip warn")
    with tag("div", cls="st-panes"):
        with tag("section", cls="st-runs", aria_label="Runs", tabindex="0"):
            tag("div", id="runs")
            _jobs(view, shown)
        tag("section", cls="st-stage", aria_label="Replay", id="stage")
        with tag("section", cls="st-known", aria_label="What is known", data_studio="tabs"):
            with tag("div", role="tablist", aria_label="What is known"):
                for name in TABS:
                    tag("button", name, role="tab", id=f"tab-{name}", type="button", aria_controls=f"panel-{name}")
            lays: dict[str, Callable[[], None]] = {
                "Events": lambda: _events(shown),
                "Cause": lambda: _list([shown.row.cause, shown.row.caused, shown.row.shrunk]),
                "People": lambda: _people(shown),
                "Certainty": lambda: _certainty(shown),
                "Notes": lambda: _note(view, shown),
            }
            for name, lay in lays.items():
                with tag("div", role="tabpanel", id=f"panel-{name}", aria_labelledby=f"tab-{name}", tabindex="0"):
                    lay()
    view.command("Trace a run", f"rvsg replay {shlex.quote(shown.folder)} --trace --run RUN")


def _facts(shown: Shown, failures: Sequence[Failure]) -> None:
    row, plan = shown.row, shown.campaign.plan
    chip(row.status, row.tone)
    with tag("span", cls="st-rate"):
        rate(row)
    tag("span", f"contact {row.contact}{f', {row.touch}' if row.touch else ''}", cls="st-wrong" if row.contacts else "")
    tag("span", f"{plan.requirement.name} on {plan.mission.world}, {plan.mission.route.name}", cls="soft")
    link(f"{shown.folder} {row.number}", "/campaign", folder=shown.folder, name=shown.campaign.name)
    here = [campaign.folder == shown.folder and failure.row == row for campaign, failure in failures]
    place = here.index(True) if True in here else -1
    for key, text, other in (("k", "Previous (k)", place - 1), ("j", "Next (j)", place + 1)):
        if place >= 0 and 0 <= other < len(failures):
            campaign, failure = failures[other]
            query = {"campaign": campaign.folder, "name": campaign.name, "attempt": failure.row.confirmation}
            tag("a", text, href=address("/finding", **query), data_key=key, cls="st-step", title=failure.row.name)


def _list(lines: Iterable[str]) -> None:
    for line in lines:
        if line:
            tag("p", line)


def _events(shown: Shown) -> None:
    traced = json.dumps({"campaign": shown.folder, "name": shown.campaign.name})
    first: dict[str, Any] = {"data_run": shown.row.run, "data_t": shown_at(shown.row.moment_s)}
    tag("div", data_studio="replay", data_url=address("/data/replay", **shown.query), data_keys="page", id="replay",
        data_trace=traced, data_stage="stage", data_runs="runs", **first)  # fmt: skip


def _certainty(shown: Shown) -> None:
    row, verdict = shown.row, shown.attempt.verdict
    assert verdict is not None
    limit = shown.campaign.requirement
    facts = {
        "Violated": f"{row.share} {row.interval and f'({row.interval})'}",
        limit.title: row.measured,
        "Contact": row.contact,
        "Closest gap": row.closest,
        "Arrived": row.arrived,
        "Others": row.others,
    }
    with tag("table"), tag("tbody"):
        for name, value in facts.items():
            if value:
                with tag("tr"):
                    tag("th", name, scope="row")
                    tag("td", value)
    tag("p", f"{how_sure(verdict)}.")


def _actions(view: Page, shown: Shown) -> None:
    workspace, config, file = view.workspace, shown.campaign.config, shown.file
    facts = {"folder": shown.folder, "name": shown.campaign.name}

    def offer(kind: str, text: str, title: str, scenario: rvsg.Scenario, path: str, command: str, **more: Any) -> None:
        """Add a button for a job on a scenario, which is written to a file first."""

        def start() -> None:
            save_scenario(scenario, workspace.path(path), shown.campaign.found_with)
            arguments = {**facts, "scenario": path, **more}
            workspace.jobs.start(kind, title=title, command=command, target=path, **arguments)
            ui.navigate.reload()

        view.button(text, start, command=command)

    def confirm() -> None:
        arguments = {**facts, "candidate": shown.attempt.index}
        workspace.jobs.start("confirm", title="Confirm", command=confirming, target=shown.folder, **arguments)
        ui.navigate.reload()

    small = file.replace(".json", "-smallest.json")
    shrinking = shrink_command(file, config, out=small)
    confirming = confirm_command(Path(shown.folder), shown.attempt.index)
    with tag("span", cls="st-group"):
        offer("shrink", "Shrink", "Shrink", shown.scenario, file, shrinking, out=small)
        alone = file.replace(".json", "-alone.json")
        for text, title, scenario, path in (
            (f"{MORE} more runs", f"{MORE} more runs", shown.scenario, file),
            ("Without people", "Runs without people", without_people(shown.scenario), alone),
        ):
            seeds: dict[str, Any] = {"seed": FRESH_SEED, "repeats": MORE, "out": path.replace(".json", "-runs.jsonl")}
            offer("runs", text, title, scenario, path, runs_command(path, config, **seeds), **seeds)
        if shown.attempt.purpose == "search" and not shown.confirmed:
            view.button("Confirm now", confirm, command=confirming, cls="st-primary")
        editor = {"data_edit": json.dumps({key: str(value) for key, value in shown.query.items()})}
        editor |= {"data_before": shown.row.share, "data_requirement": shown.campaign.requirement.name}
        tag("a", "Edit", cls="st-button", href=address("/scenario", **shown.query), data_key="e", title="e", **editor)
        _export(view, shown)


def _export(view: Page, shown: Shown) -> None:
    chosen = {"format": "mcap"}

    def out() -> str:
        suffix = FORMATS[chosen["format"]].rpartition("(")[2].rstrip(")")
        return shown.file.replace(".json", f"-{chosen['format']}{suffix}")

    async def export() -> None:
        path = view.workspace.path(out())
        simulator = shown.campaign.simulator
        notes = await load(exchange.export, shown.scenario, path, chosen["format"], simulator=simulator)
        view.say("\n".join([f"Written: {out()}", *notes]))

    with tag("span", cls="st-group"):
        choose = select(FORMATS, "mcap", lambda value: chosen.update(format=value), aria_label="Format of the export")
        choose.classes("st-inline")
        view.button("Export", export)
    view.command("Export", f"rvsg export {shown.file} --to {chosen['format']} --out {out()}")


def _jobs(view: Page, shown: Shown) -> None:
    """List what was made of this scenario, and follow what is under way."""
    stem = shown.file.removesuffix(".json")
    mine = [
        job
        for job in view.workspace.jobs.all()
        if job.target.removesuffix(".json") in (stem, f"{stem}-alone")
        or (job.kind == "confirm" and job.target == shown.folder and job.arguments["candidate"] == shown.attempt.index)
    ]
    if not mine:
        return
    with tag("ul", cls="st-list st-jobs", aria_label="Work on this scenario", aria_live="polite"):
        for job in mine[:6]:
            JobLine(view, job)


class JobLine:
    """A line on a job that follows it until it ends."""

    def __init__(self, view: Page, job: Job) -> None:
        self._made, self._job, self._at = view, job, 0
        with tag("li", cls="st-job"):
            tag("strong", job.title)
            self._state = tag("span", "", cls="soft")
            self._text = tag("div", "", cls="small")
            self._links = tag("span")
        self._show(job)
        if job.running:
            self._timer = ui.timer(1.0, self._follow)

    async def _follow(self) -> None:
        jobs = self._made.workspace.jobs
        job = await load(jobs.get, self._job.id)
        events, self._at = await load(jobs.events, job.id, self._at)
        for event in events:
            if event["kind"] == "step":
                effect = "kept" if event["kept"] else "needed"
                self._text.set_text(f"{effect}: {event['what']} ({event['violations']} of {event['runs']} violate)")
            elif event["kind"] == "message":
                self._text.set_text(event["text"])
        self._show(job)
        if not job.running:
            self._timer.deactivate()

    def _show(self, job: Job) -> None:
        self._state.set_text(f" {job.state}")
        if job.running:
            return
        self._text.set_text(job.result.get("reason", ""))
        self._links.clear()
        with self._links:
            out = job.result.get("out", "")
            if job.state != "finished":
                return
            if job.kind == "shrink":
                link("Open the smallest scenario", "/scenario", file=out)
            elif job.kind == "runs":
                link("Replay these runs", "/runs", file=out, scenario=job.arguments["scenario"],
                     campaign=job.arguments.get("folder"))  # fmt: skip
            elif job.kind == "confirm":
                link("Open the finding", "/finding", campaign=job.target, attempt=job.result["attempt"])


def job_buttons(view: Page, job: Job, said: Callable[[str], object] = ignore, *, command: str = "") -> None:
    """Add the button that pauses a job, and once pressed stops it at once; `said` gets what comes of it."""
    jobs, pausing = view.workspace.jobs, [False]

    def end() -> None:
        (jobs.stop if pausing[0] else jobs.pause)(job.id)
        said("Stopped." if pausing[0] else "Pausing when the runs in progress end…")
        pausing[0] = True
        button.set_text("Stop now")

    button = view.button("Pause", end, command=command)


def _note(view: Page, shown: Shown) -> None:
    """Lay out the note on a finding, which follows what another tab makes of it."""
    folder, scenario, latest = view.workspace.path(shown.folder), shown.scenario.id, [shown.note]
    fields, state = tag("div"), tag("p", "", cls="soft small", role="status")

    def keep(**change: Any) -> None:
        try:
            latest[0] = note(folder, scenario, **change)
            state.set_text("Kept in notes.yaml beside the campaign.")
        except RvsgError as error:
            view.say(str(error), wrong=True)

    def lay_out() -> None:
        fields.clear()
        with fields:
            with field("Status"):
                select(STATES, latest[0].status, lambda value: keep(status=value))
            with field("Comment"):
                text_area(latest[0].comment, lambda text: keep(comment=text), rows=4, maxlength=20_000)

    async def follow() -> None:
        mine = latest[0]
        stored = (await load(notes_of, folder)).findings.get(scenario, FindingNote())
        if stored != mine and latest[0] is mine:
            latest[0] = stored
            lay_out()

    lay_out()
    ui.timer(FOLLOW_S, view.guarded(follow))


def _people(shown: Shown) -> None:
    for human in shown.scenario.people.humans:
        tag("h2", human.name, cls="st-minor")
        delay = f", starts after {human.start_delay_s:g} s" if human.start_delay_s else ""
        tag("p", f"{human.behaviour.value}, {human.speed_m_s:g} m/s{delay}", cls="soft small")
        with tag("ul", cls="tasks"):
            for task in human.tasks:
                with tag("li"):
                    tag("span", task.name)
                    tag("div", " ".join(task.path), cls="path")
