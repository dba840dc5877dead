"""A finding: what happens, the replay, what people say of it, and what can be done with it."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nicegui import ui

import rvsg
from rvsg.app.commands import confirm_command, runs_command, shrink_command
from rvsg.campaign.attempt import Attempt
from rvsg.core.errors import InputError, RvsgError
from rvsg.core.plugins import ignore
from rvsg.evaluation.verdict import counted, how_sure, status_in_words
from rvsg.report.terminal import describe_finding
from rvsg.scenario.builder import save_scenario, without_people
from rvsg_exchange import formats as exchange
from rvsg_studio.frame import (
    Page,
    actions,
    address,
    chip,
    field,
    link,
    load,
    page,
    route,
    section,
    select,
    tag,
    text_area,
)
from rvsg_studio.workspace import STATES, Job, Note, Workspace, note, notes_of

MORE = 30
FRESH_SEED = 900_000
"""The first seed of further runs; campaigns draw theirs from all of 64 bits."""
FORMATS = {
    "mcap": "Foxglove, rosbag2 (.mcap)",
    "csv": "table (.csv)",
    "hunav": "HuNavSim agents (.yaml)",
    "nav2-goals": "Nav2 goals (.py)",
    "initial-pose": "initial pose (.yaml)",
    "sdf": "Gazebo world (.sdf)",
    "osc": "OpenSCENARIO DSL (.osc)",
}


@dataclass(frozen=True)
class Shown:
    """What the page shows: an attempt of a campaign, what it means where it is a confirmation, and its note."""

    campaign: rvsg.Campaign
    folder: str
    attempt: Attempt
    finding: Any
    note: Note
    confirmed: bool

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
        plan = shown.campaign.plan
        what = "confirmed" if shown.attempt.purpose == "confirmation" else shown.attempt.purpose
        number = shown.attempt.brief.scenario_index + 1
        where = f"{plan.requirement.name} on {plan.mission.world}, {plan.mission.route.name}"
        with page(workspace, f"{where}: scenario {number}, {what}", wide=True) as made:
            lay_out(made, shown)


def read(workspace: Workspace, folder: str, name: str, index: int) -> Shown:
    """Read an attempt of a campaign, with what its confirmation means."""
    path = workspace.existing(folder)

    def made() -> tuple[rvsg.Campaign, list[Attempt], tuple[Any, ...]]:
        campaign = rvsg.Campaign.open(path, name or None)
        return campaign, campaign.attempts(), campaign.findings

    campaign, attempts, findings = workspace.kept(("findings", folder, name), path, made)
    attempt = next((a for a in attempts if a.index == index), None)
    if attempt is None or attempt.proposal.scenario is None:
        raise InputError(f"There is no attempt {index} with a scenario in {folder}.")
    return Shown(
        campaign=campaign,
        folder=folder,
        attempt=attempt,
        finding=next((f for f in findings if f.confirmation == index), None),
        note=notes_of(path).findings.get(attempt.proposal.scenario.id, Note()),
        confirmed=any(a.confirms == index and a.purpose == "confirmation" for a in attempts),
    )


def lay_out(made: Page, shown: Shown) -> None:
    """Lay out the page."""
    with tag("p", cls="small"):
        link(shown.folder, "/campaign", folder=shown.folder, name=shown.campaign.name)
        tag("span", f" · attempt {shown.attempt.index}", cls="soft")
    _verdict(shown)
    tag("p", shown.scenario.description or "This scenario has no description.")
    _actions(made, shown)
    _jobs(made, shown)
    with section("Replay", "replay-title"):
        where = address("/data/replay", **shown.query)
        traced = json.dumps({"campaign": shown.folder, "name": shown.campaign.name})
        tag("div", data_studio="replay", data_url=where, data_keys="page", data_trace=traced, id="replay")
        made.command("Trace a run", f"rvsg replay {shlex.quote(shown.folder)} --trace --run RUN")
    with tag("div", cls="st-two"):
        _happened(shown)
        _note(made, shown)
    _people(shown)


def _verdict(shown: Shown) -> None:
    verdict = shown.attempt.verdict
    if verdict is None:
        return
    bad = shown.finding.violated if shown.finding is not None else verdict.violations > 0
    with tag("div", cls=f"verdict{' bad' if bad else ''}"):
        with tag("p", cls="said"):
            chip(verdict.status.value, bad=bad, good=verdict.status.value == "PASS")
            runs = counted(verdict.runs, "run")
            tag("strong", f"{verdict.violations} of {runs} violate {shown.campaign.requirement.name}")
        if shown.finding is not None:
            told = " ".join(shown.finding.story)
            for line in describe_finding(shown.finding, shown.campaign.requirement):
                if line.strip() != told:  # it has a section of its own
                    tag("p", line.strip())
        else:
            tag("p", f"{status_in_words(verdict)}. {how_sure(verdict)}.")


def _actions(made: Page, shown: Shown) -> None:
    workspace, config, file = made.workspace, shown.campaign.config, shown.file
    told = {"folder": shown.folder, "name": shown.campaign.name}

    def offer(kind: str, text: str, title: str, scenario: rvsg.Scenario, path: str, command: str, **more: Any) -> None:
        """Add a button for a job on a scenario, which is written to a file first."""

        def start() -> None:
            save_scenario(scenario, workspace.path(path))
            given = {**told, "scenario": path, **more}
            workspace.jobs.start(kind, title=title, command=command, target=path, **given)
            ui.navigate.reload()

        made.button(text, start, command=command)

    def confirm() -> None:
        given = {**told, "candidate": shown.attempt.index}
        workspace.jobs.start("confirm", title="Confirm", command=confirming, target=shown.folder, **given)
        ui.navigate.reload()

    small = file.replace(".json", "-smallest.json")
    requirement = str(shown.campaign.record.config["requirement"])
    shrinking = shrink_command(file, config, requirement=requirement, out=small)
    confirming = confirm_command(Path(shown.folder), shown.attempt.index)
    with actions():
        offer("shrink", "Shrink", "Shrink", shown.scenario, file, shrinking, out=small)
        alone = file.replace(".json", "-alone.json")
        for text, title, scenario, path in (
            (f"{MORE} more runs", f"{MORE} more runs", shown.scenario, file),
            ("Without people", "Runs without people", without_people(shown.scenario), alone),
        ):
            seeds: dict[str, Any] = {"seed": FRESH_SEED, "repeats": MORE, "out": path.replace(".json", "-runs.jsonl")}
            offer("runs", text, title, scenario, path, runs_command(path, config, **seeds), **seeds)
        if shown.attempt.purpose == "search" and not shown.confirmed:
            made.button("Confirm now", confirm, command=confirming, cls="st-primary")
        tag("a", "Edit the scenario", cls="st-button", href=address("/scenario", **shown.query))
        _export(made, shown)


def _export(made: Page, shown: Shown) -> None:
    chosen = {"format": "mcap"}

    def out() -> str:
        suffix = FORMATS[chosen["format"]].rpartition("(")[2].rstrip(")")
        return shown.file.replace(".json", f"-{chosen['format']}{suffix}")

    async def export() -> None:
        path = made.workspace.path(out())
        simulator = shown.campaign.simulator
        notes = await load(exchange.export, shown.scenario, path, chosen["format"], simulator=simulator)
        made.say("\n".join([f"Written: {out()}", *notes]))

    with tag("span", cls="st-group"):
        choose = select(FORMATS, "mcap", lambda value: chosen.update(format=value), aria_label="Format of the export")
        choose.classes("st-inline")
        made.button("Export", export)
    made.command("Export", f"rvsg export {shown.file} --to {chosen['format']} --out {out()}")


def _jobs(made: Page, shown: Shown) -> None:
    """List what was made of this scenario, and follow what is under way."""
    stem = shown.file.removesuffix(".json")
    mine = [
        job
        for job in made.workspace.jobs.all()
        if job.target.removesuffix(".json") in (stem, f"{stem}-alone")
        or (job.kind == "confirm" and job.target == shown.folder and job.arguments["candidate"] == shown.attempt.index)
    ]
    if not mine:
        return
    with tag("ul", cls="st-list st-jobs", aria_label="Work on this scenario", aria_live="polite"):
        for job in mine[:6]:
            JobLine(made, job)


class JobLine:
    """A line on a job that follows it until it ends."""

    def __init__(self, made: Page, job: Job) -> None:
        self._made, self._job, self._at = made, job, 0
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
                kept = "kept" if event["kept"] else "needed"
                self._text.set_text(f"{kept}: {event['what']} ({event['violations']} of {event['runs']} violate)")
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


def job_buttons(made: Page, job: Job, said: Callable[[str], object] = ignore, *, command: str = "") -> None:
    """Add the buttons that pause and stop a job; `said` gets what comes of it."""

    def end(stop: Callable[[str], None], text: str) -> None:
        stop(job.id)
        said(text)

    jobs = made.workspace.jobs
    made.button("Pause", lambda: end(jobs.pause, "Pausing when the runs in progress end…"), command=command)
    made.button("Stop now", lambda: end(jobs.stop, "Stopped."), cls="st-danger")


def _happened(shown: Shown) -> None:
    with section("What happens in the worst run", "story"):
        story = shown.finding.story if shown.finding is not None else ()
        if not story:
            tag("p", "The replay lists the moments of each run.", cls="soft")
        with tag("ul", cls="st-list"):
            for sentence in story:
                tag("li", sentence)


def _note(made: Page, shown: Shown) -> None:
    folder, scenario = made.workspace.path(shown.folder), shown.scenario.id

    def kept(**change: Any) -> None:
        try:
            note(folder, scenario, **change)
            state.set_text("Kept in notes.yaml beside the campaign.")
        except RvsgError as error:
            made.say(str(error), wrong=True)

    with section("Note", "note"):
        with field("Status"):
            select(STATES, shown.note.status, lambda value: kept(status=value))
        with field("Comment"):
            text_area(shown.note.comment, lambda text: kept(comment=text), rows=4, maxlength=20_000)
        state = tag("p", "", cls="soft small", role="status")


def _people(shown: Shown) -> None:
    with section("What the people are asked to do", "people"), tag("div", cls="people"):
        for human in shown.scenario.people.humans:
            with tag("div"):
                tag("h3", human.name)
                delay = f", starts after {human.start_delay_s:g} s" if human.start_delay_s else ""
                tag("p", f"{human.behaviour.value}, {human.speed_m_s:g} m/s{delay}", cls="soft small")
                with tag("ul", cls="tasks"):
                    for task in human.tasks[:8]:
                        with tag("li"):
                            tag("span", task.name)
                            tag("div", " ".join(task.path), cls="path")
                    if len(human.tasks) > 8:
                        tag("li", f"and {len(human.tasks) - 8} more", cls="soft")
