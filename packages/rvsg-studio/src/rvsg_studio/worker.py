"""The process of a job, whose folder is its argument. It writes what happens as JSON lines."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, TextIO

import rvsg
from rvsg.app.matrix import CampaignEnded, Matrix
from rvsg.app.proposal import propose_as
from rvsg.app.reconstruction import rebuild, world_of_recording
from rvsg.app.saved_scenario import Rerun, rerun
from rvsg.app.settings import effective, safe_name
from rvsg.app.wiring import wire
from rvsg.cli.progress import CampaignProgress
from rvsg.core import permission
from rvsg.core.errors import RvsgError
from rvsg.core.files import write_whole
from rvsg.generation.environment import open_session, propose_names
from rvsg.generation.generator import proposal_json
from rvsg.generation.vlm.access import CallNews
from rvsg.recording.tracks import load_recording
from rvsg.report.terminal import describe_calls
from rvsg.scenario.builder import save_scenario
from rvsg.search.execution import (
    AttemptFinished,
    Event,
    Message,
    ModelCall,
)
from rvsg.simulation.archive import runs_text
from rvsg.tune.parameter_search import ParameterSearch
from rvsg.tune.tuner import Tuner
from rvsg.tune.tuning_page import front_row, headline, search_text
from rvsg.world.world import Description
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.workspace import BOTH, EVENTS, JOB, PAUSE, RESULT, holding


class JobWork:
    """The work of one job: its arguments, where its events go, and whether it was asked to pause."""

    def __init__(self, folder: Path, events: TextIO) -> None:
        job = json.loads((folder / JOB).read_text(encoding="utf-8"))
        self.kind: str = job["kind"]
        self.target: str = job["target"]
        self.arguments: dict[str, Any] = job["arguments"]
        self.folder = folder
        self._events = events
        self.pausing = False
        self.cancel: Callable[[], None] = lambda: None

    def tell(self, kind: str, **facts: Any) -> None:
        """Append an event to the file at once."""
        self._events.write(json.dumps({"at": time.time(), "kind": kind, **facts}) + "\n")
        self._events.flush()

    def say(self, text: str) -> None:
        """Append a message."""
        self.tell("message", text=text)

    def asked_to_end(self, *_: int | FrameType | None) -> None:
        """Pause at the first signal; end at once at the second."""
        if self.pausing:
            os._exit(3)
        self.pausing = True
        self.cancel()

    def campaign(self) -> rvsg.Campaign:
        """Return the campaign that the job is about."""
        machine = {key: value for key, value in self.arguments.get("machine", {}).items() if value is not None}
        return rvsg.Campaign.open(self.arguments["folder"], self.arguments.get("name"), **machine)

    def rerun(self) -> Rerun:
        """Return the scenario of the job, with what it was found with unless the job says otherwise."""
        arguments = self.arguments
        return rerun(arguments["scenario"], requirement=arguments.get("requirement"), on_message=self.say)


def run_campaign(work: JobWork) -> dict[str, Any]:
    """Do what is left of a campaign and write its report."""
    campaign = work.campaign()
    work.cancel = campaign.cancel
    if work.pausing:
        campaign.cancel()
    for _ in campaign.run(observe=partial(tell_event, work, CampaignProgress(campaign.plan, campaign.attempts()))):
        if work.pausing:
            campaign.cancel()
    with campaign.result() as result:
        campaign.report(result=result)
    return {"state": "finished" if result.complete else "paused", "violated": result.violated}


def run_matrix(work: JobWork) -> dict[str, Any]:
    """Do what is left of several campaigns in one folder, and write their reports."""
    matrix = Matrix.open(Path(work.arguments["folder"]))
    campaigns = matrix.create(work.say)
    campaigns[0].prepare(work.say)

    def cancel() -> None:
        for campaign in campaigns:
            campaign.cancel()

    work.cancel = cancel
    failed = []
    if work.pausing:
        cancel()
    progress = {c.folder: CampaignProgress(c.plan, c.attempts(), name=c.folder.name) for c in campaigns}
    for campaign, event in matrix.run(campaigns):
        if work.pausing:
            cancel()
        folder = Path(os.path.relpath(campaign.folder)).as_posix()
        if not isinstance(event, CampaignEnded):
            tell_event(work, progress[campaign.folder], event, folder=folder)
        elif isinstance(event.error, RvsgError):
            failed.append(f"{campaign.folder.name}: {event.error}")
        elif event.error is not None:
            raise event.error
        else:
            campaign.report()
    matrix.report()
    if failed:
        return {"state": "failed", "reason": "\n".join(failed)}
    return {"state": "finished" if all(campaign.finished for campaign in campaigns) else "paused"}


def tell_event(work: JobWork, progress: CampaignProgress, event: Event, **where: str) -> None:
    """Append what a page shows of an event of a campaign; `where` is its folder, where the job is about several."""
    tell: Callable[..., None] = partial(work.tell, **where)
    before = progress.text()
    progress(event)  # its lines are the log of the job
    match event:
        case Message():
            tell("message", text=event.text)
        case ModelCall():
            tell_call(work, event.news, **where)
        case AttemptFinished(attempt=attempt):
            tell("attempt", attempt=attempt.index, purpose=attempt.purpose)
    if (text := progress.text()) != before:
        tell("progress", text=text)


def confirm(work: JobWork) -> dict[str, Any]:
    """Confirm one more candidate of a campaign."""
    campaign = work.campaign()
    work.cancel = campaign.cancel
    observe = partial(tell_event, work, CampaignProgress(campaign.plan, campaign.attempts()))
    attempt = campaign.confirm(work.arguments["candidate"], observe=observe)
    campaign.report()
    return {"state": "finished", "attempt": attempt.index, "reason": attempt.verdict.reason if attempt.verdict else ""}


def make_runs(work: JobWork) -> dict[str, Any]:
    """Simulate a scenario with seeds one after the other, judge the runs and write them to a file."""
    arguments = work.arguments
    again = work.rerun()
    first, count = arguments["seed"], arguments["repeats"]
    runs = rvsg.simulate(
        again.scenario, range(first, first + count), jobs=os.cpu_count() or 1, simulator=again.simulator,
        world=again.world, on_run=lambda run: work.tell("run", seed=run.seed), on_message=work.say,
    )  # fmt: skip
    write_whole(Path(arguments["out"]), runs_text(runs))
    return {"state": "finished", "out": arguments["out"], "reason": str(rvsg.judge(runs, again.requirement))}


def shrink(work: JobWork) -> dict[str, Any]:
    """Find the smallest scenario that violates about as often, and write it to a file."""
    arguments = work.arguments
    again = work.rerun()
    shrunk = rvsg.shrink(
        again.scenario, again.requirement, jobs=os.cpu_count() or 1, simulator=again.simulator, world=again.world,
        on_message=work.say,
        on_step=lambda step: work.tell("step", what=step.what, kept=step.kept, violations=step.violations,
                                       runs=step.runs),
    )  # fmt: skip
    write_whole(Path(arguments["out"]), again.json(shrunk.smallest))
    before, after = shrunk.before, shrunk.after
    reason = (
        f"{len(shrunk.original.people.humans)} people become {len(shrunk.smallest.people.humans)}. The original "
        f"violates it in {before.violations} of {before.runs} fresh runs, the smallest in {after.violations} of "
        f"{after.runs}."
    )
    return {"state": "finished", "out": arguments["out"], "reason": reason}


def describe(work: JobWork) -> dict[str, Any]:
    """Have a model describe a world, or revise its description for the reasons that a person gives."""
    arguments = work.arguments
    world = rvsg.load_world(_world(arguments["world"]))
    session = open_session(world, record=None, prompts=None, **arguments["access"])
    assert session is not None, "a model is named"
    session.access.tell = partial(tell_call, work)
    start = Description(**arguments["start"]) if arguments["start"] is not None else None
    description = session.revised(start, arguments["reasons"])
    said = " ".join([describe_calls(session.calls), *session.notes()])
    return {"state": "finished", "layout": description.layout, "grid": description.grid, "said": said}


def name_areas(work: JobWork) -> dict[str, Any]:
    """Have a model propose names for the areas of a world, and its doors."""
    arguments = work.arguments
    photographs = [Path(path) for path in arguments.get("photographs", ())]
    world = rvsg.load_world(_world(arguments["world"]))
    proposed = propose_names(world, photographs=photographs, **arguments["access"])
    said = " ".join([describe_calls(proposed.calls), *proposed.unusable])
    return {"state": "finished", "said": said, **proposed.model_dump(mode="json", include={"names", "doors"})}


def _world(name: str) -> str | Path:
    return name if name in shipped_worlds() else Path(name)


def tell_call(work: JobWork, news: CallNews, **where: str) -> None:
    """Append what a page shows of a call of a model."""
    work.tell("model", what=news.what, model=news.model, purpose=news.purpose, why=news.why,
              usd=news.spent.cost_usd, calls=news.spent.calls, **where)  # fmt: skip


def make_proposals(work: JobWork) -> dict[str, Any]:
    """Ask a generator for scenarios with seeds one after the other, and write each to a file."""
    arguments = work.arguments
    settings, folder = arguments["settings"], Path(arguments["folder"])
    folder.mkdir(exist_ok=True)
    valid = 0
    for seed in range(settings["seed"], settings["seed"] + arguments["count"]):
        if work.pausing:
            return {"state": "paused", "reason": "Paused."}
        wired = wire(effective(None, {}, settings | {"seed": seed, "out": "runs/proposals"}))
        wired.generator.watch(partial(tell_call, work))
        proposal = propose_as(wired)
        parts = (settings["world"], settings["route"], settings["requirement"], settings["generator"], seed)
        name = safe_name("-".join(Path(str(part)).name for part in parts))
        write_whole(folder / f"{name}.json", proposal_json(proposal))
        valid += proposal.scenario is not None
        work.tell("proposal", name=name)
    return {"state": "finished", "reason": f"{valid} of {arguments['count']} proposals are valid."}


def rebuild_recording(work: JobWork) -> dict[str, Any]:
    """Make the scenario of a recording, run it, and write it with the page of both drives."""
    arguments, out = work.arguments, Path(work.target)
    place = rvsg.load_world(_world(arguments["world"])) if arguments["world"] else None
    recording = load_recording(arguments["file"], world=place, people_topic=arguments["people_topic"] or None)
    place = world_of_recording(recording, place, out.with_name(f"{out.stem}-world"), open_floor=arguments["open_floor"])
    options = {key: arguments[key] for key in ("robot", "people", "requirement")}
    rebuilt = rebuild(recording, place, jobs=os.cpu_count() or 1, on_message=work.say, **options)
    save_scenario(rebuilt.made.scenario, out, rebuilt.found)
    write_whole(out.with_suffix(".html"), rebuilt.page())
    write_whole(work.folder / BOTH, json.dumps(rebuilt.replay()))
    return {"state": "finished", "out": work.target, "reason": rebuilt.verdict, "lines": rebuilt.lines}


def tune(work: JobWork) -> dict[str, Any]:
    """Tune a stack on a suite; a pause ends it at once, and every run that was made is stored."""

    def interrupt() -> None:
        raise KeyboardInterrupt

    arguments, begun = work.arguments, time.monotonic()
    budget = arguments["budget_runs"]

    def show(search: ParameterSearch) -> None:
        before = search.before.score
        assert before is not None
        work.say(f"search: {search_text(search, budget, time.monotonic() - begun)}")
        rows = [front_row(s.number, s.score, before) for s in search.front() if s.score is not None]
        work.tell("front", rows=rows)

    tuner = Tuner(
        **{**arguments, "suite": Path(arguments["suite"])}, out=Path(work.target), jobs=os.cpu_count() or 1,
        on_message=work.say, on_search=show,
    )  # fmt: skip
    try:
        work.cancel = interrupt
        tuning = None if work.pausing else tuner.run()
    except KeyboardInterrupt:
        tuning = None
    finally:
        work.cancel = lambda: None
    if tuning is None:
        return {"state": "paused", "reason": "Paused. What was run is stored."}
    return {"state": "finished", "out": work.target, "reason": headline(tuning)}


KINDS: dict[str, Callable[[JobWork], dict[str, Any]]] = {
    "campaign": run_campaign,
    "matrix": run_matrix,
    "confirm": confirm,
    "runs": make_runs,
    "shrink": shrink,
    "describe": describe,
    "names": name_areas,
    "propose": make_proposals,
    "recording": rebuild_recording,
    "tuning": tune,
}


def main() -> None:
    """Do a job and write how it ended."""
    folder = Path(sys.argv[1])
    with holding(folder), (folder / EVENTS).open("a", encoding="utf-8") as events:
        work = JobWork(folder, events)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, work.asked_to_end)
        work.pausing = work.pausing or (folder / PAUSE).exists()
        try:
            # A key goes where its user allowed it on a command line: an address in a form may come from a file.
            with permission.only_in_process([work.arguments], without="base_url"):
                result = KINDS[work.kind](work)
        except RvsgError as error:
            result = {"state": "failed", "reason": str(error)}
        except Exception as unexpected:
            traceback.print_exc()  # into worker.log
            reason = f"Error in RVSG itself: {type(unexpected).__name__}: {unexpected}. The log lies in {folder}."
            result = {"state": "failed", "reason": reason}
        write_whole(folder / RESULT, json.dumps(result))
