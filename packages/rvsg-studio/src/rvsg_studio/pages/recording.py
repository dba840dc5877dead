"""A recording of a real robot among people: what it holds, the scenario made of it, and both drives on one clock."""

from __future__ import annotations

import shlex
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from rvsg.app.reconstruction import SUFFIXES
from rvsg.app.settings import safe_name
from rvsg.core.errors import RvsgError
from rvsg.recording.inspection import Inspection, inspect
from rvsg.recording.intent import People
from rvsg.recording.tracks import load_recording
from rvsg.robots.robot import shipped_robots
from rvsg.scenario.scenario import ROBOT
from rvsg.scenario.world_lookup import as_world
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.answers import world_place
from rvsg_studio.frame import (
    PATIENT_S,
    Page,
    actions,
    address,
    field,
    link,
    load,
    page,
    route,
    section,
    select,
    tag,
    text_input,
)
from rvsg_studio.pages.finding import JobLine
from rvsg_studio.pages.new_campaign import REQUIREMENTS
from rvsg_studio.question import Question
from rvsg_studio.workspace import LARGEST_FILE, Job, Workspace

SHOWN = 50
DROP = f"Drop a recording here, or choose it ({', '.join(SUFFIXES)}, up to {LARGEST_FILE // 1_000_000} MB)"


def add(workspace: Workspace) -> None:
    """Add the page."""

    @route(workspace, "/recording", "Recording", patience_s=PATIENT_S)
    async def recording(file: str = "", world: str = "", people_topic: str = "") -> None:
        asked = {"file": file, "world": world, "people_topic": people_topic}
        listing, here = await load(workspace.listing), await load(recordings_in, workspace)
        inspection, wrong = None, ""
        try:
            inspection = await load(inspected, workspace, asked) if file else None
        except RvsgError as error:
            wrong = str(error)
        job = await load(workspace.jobs.of, _scenario_of(file))
        with page(workspace, f"Recording {file}".strip(), wide=True) as view:
            view.say(wrong, wrong=True)
            _choose(view, asked, here, (*shipped_worlds(), *listing.worlds))
            if inspection is not None:
                _show(inspection)
                _ask(view, asked, bare=inspection.recording.occupancy is None and not world)
                if job is not None:
                    _result(view, job)


def recordings_in(workspace: Workspace) -> list[str]:
    """Return the recordings in the folder of the studio and one level below: files, and folders of rosbag2."""
    paths = [path for pattern in ("*", "*/*") for path in sorted(workspace.folder.glob(pattern))]
    bags = [path for path in paths if (path / "metadata.yaml").is_file()]
    files = [path for path in paths if path.suffix in SUFFIXES and path.parent not in bags]
    return [workspace.relative(path) for path in (*bags, *files)][:SHOWN]


def inspected(workspace: Workspace, asked: dict[str, str]) -> Inspection:
    """Return what a recording of the folder holds."""
    path = workspace.existing(asked["file"])

    def compute() -> Inspection:
        world = as_world(world_place(workspace, Question(world=asked["world"]))) if asked["world"] else None
        return inspect(load_recording(path, world=world, people_topic=asked["people_topic"] or None), world)

    return workspace.cached(("recording", *asked.values()), path, compute)


def _scenario_of(file: str) -> str:
    return f"scenarios/{safe_name(Path(file).stem)}.json"


def _choose(view: Page, asked: dict[str, str], here: list[str], worlds: tuple[str, ...]) -> None:
    """Lay out the choice of a recording, its world, and its people where several topics hold some."""
    chosen = dict(asked)
    most = str(LARGEST_FILE)
    tag("div", data_studio="view", data_accept=",".join(SUFFIXES), data_label=DROP, data_most=most, cls="small soft")
    with tag("datalist", id="recordings"):
        for name in here:
            tag("option", value=name)
    with tag("div", cls="st-form"):
        with field("Recording", help="A file or a folder in the folder of the studio; large bags are copied there"):
            text_input(asked["file"], partial(chosen.__setitem__, "file"), list="recordings", autocomplete="off")
        with field("World", help="The map that the robot drove with"):
            options = {"": "the map of the recording"} | {name: name for name in worlds}
            select(options, asked["world"], partial(chosen.__setitem__, "world"))
        with field("Topic of the people", help="Where several hold people; one of laser scans finds them in all"):
            text_input(asked["people_topic"], partial(chosen.__setitem__, "people_topic"), autocomplete="off")
    with actions():
        view.button("Inspect", lambda: ui.navigate.to(address("/recording", **chosen)))
    view.command("Inspect", f"rvsg recording inspect {_options(asked)}")


def _options(asked: dict[str, Any]) -> str:
    named = [
        f"--{key.replace('_', '-')}" + ("" if value is True else f" {shlex.quote(value)}")
        for key, value in asked.items()
        if value and key != "file"
    ]
    return " ".join([shlex.quote(asked["file"] or "FILE"), *named])


def _show(inspection: Inspection) -> None:
    with section("What it holds", "holds"), tag("ul", cls="small"):
        for line in (*inspection.lines, *inspection.notes):
            tag("li", str(line))


def _ask(view: Page, asked: dict[str, str], *, bare: bool) -> None:
    """Lay out how the scenario is made, and the button that begins it; a `bare` recording has no map and no world."""
    chosen: dict[str, Any] = {"robot": ROBOT, "people": People.BLENDED.value, "requirement": "R1", "open_floor": False}
    choices = {
        "robot": {name: name for name in shipped_robots()},
        "people": {
            "as-recorded": "as recorded, whatever the robot does",
            "intent": "with their intent: they react",
            "blended": "blended: recorded until the robot differs, then with intent",
        },
        "requirement": {name: f"{name}: {requirement.title}" for name, requirement in REQUIREMENTS.items()},
    }
    out = _scenario_of(asked["file"])

    def start() -> None:
        options = _options(asked | chosen)
        command = f"rvsg recording scenario {options} --out {out} --html {Path(out).with_suffix('.html')}"
        view.workspace.jobs.start(
            "recording", title="Scenario of a recording", command=command, target=out, **asked, **chosen
        )
        ui.navigate.reload()

    with section("Make its scenario", "make"):
        with tag("div", cls="st-form"):
            for key, options in choices.items():
                with field(key.capitalize()):
                    select(options, chosen[key], partial(chosen.__setitem__, key))
            if bare:
                with field("Floor", help="The recording holds no map"):
                    floors = {"": "not known", "open": "open: no obstacle was near"}
                    select(floors, "", lambda value: chosen.update(open_floor=bool(value)))
        with actions():
            view.button("Make the scenario", start, cls="st-primary")
    view.command("Make the scenario", f"rvsg recording scenario {_options(asked | chosen)} --out {out}")


def _result(view: Page, job: Job) -> None:
    """Lay out the newest job on this recording, and once it has ended, the verdict and both drives."""
    view.command(job.title, job.command)
    with section("Does it repeat what happened?", "verdict"):
        if job.state != "finished":
            with tag("ul", cls="st-list"):
                JobLine(view, job)
            if job.running:
                ui.timer(1.0, view.guarded(partial(_follow, view.workspace, job)))
            return
        tag("p", job.result["reason"])
        with tag("ul", cls="small"):
            for line in job.result["lines"]:
                tag("li", line)
        with actions():
            link("Open in the editor", "/scenario", cls="st-button", file=job.target)
        tag("p", "The recorded drive, and over it the nearest simulated one.", cls="soft")
        tag("div", data_studio="replay", data_url=address("/data/recording", job=job.id), data_both="")


async def _follow(workspace: Workspace, job: Job) -> None:
    if not (await load(workspace.jobs.get, job.id)).running:
        ui.navigate.reload()
