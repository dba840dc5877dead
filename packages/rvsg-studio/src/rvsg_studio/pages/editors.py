"""The editors of a world and of a scenario; worlds from a map or a Gazebo file."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from nicegui import ui

import rvsg
from rvsg.core.errors import InputError
from rvsg.world.creation import save_created, world_from
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.answers import scenario_place, world_place
from rvsg_studio.frame import PATIENT_S, Page, actions, address, field, load, page, route, select, tag, text_input
from rvsg_studio.question import Question, question_of
from rvsg_studio.workspace import KINDS, Typed, Workspace, forget, received
from rvsg_studio.world_editor import editable_world, folder_of_world


def add(workspace: Workspace) -> None:
    """Add the pages."""

    @route(workspace, "/world", "World")
    async def world(world: str = "") -> None:
        editable = await load(editable_world, world_place(workspace, Question(world=world)))
        with page(workspace, editable["title"], wide=True) as view:
            _lay_out(view, world, editable)

    @route(workspace, "/world/new", "New world")
    async def new_world() -> None:
        with page(workspace, "New world") as view:
            NewWorld(view)

    _add_scenario(workspace)


def _lay_out(view: Page, name: str, editable: dict[str, Any]) -> None:
    async def copy() -> None:
        target = view.workspace.path(name)
        if target.exists():
            raise InputError(f"{name}: this folder exists already.")
        await load(shutil.copytree, folder_of_world(name), target)
        ui.navigate.to(address("/world", world=f"./{name}"))

    with actions():
        where = "shipped with RVSG" if not editable["editable"] else name
        tag("span", where, cls="soft")
        if not editable["editable"]:
            view.button("Copy into this folder to edit it", copy, cls="st-primary")
        tag("a", "Review its description", cls="st-button", href=address("/describe", world=name))
        tag("a", "New scenario here", cls="st-button", href=address("/scenario", world=name))
        tag("a", "New campaign here", cls="st-button", href=address("/campaign/new", world=name))
    tag("div", data_studio="world", data_world=name, id="world-editor")
    view.command("Check", f"rvsg world check {name}")
    view.command("Draw", f"rvsg world draw {name}")
    view.command("Let a model propose names of areas", f"rvsg world label {name} --model PROVIDER:NAME")
    view.command("Edit", "edit labels.yaml, routes.yaml and world.yaml in the folder")


class NewWorld:
    """The form for a new world from dropped files."""

    def __init__(self, view: Page) -> None:
        self.page = view
        self.typed = Typed(view.workspace, "world/new")
        self.name = str(self.typed.fields.get("folder", ""))
        tag("p", "Drop a Nav2 map (its .yaml with the picture beside it) or a Gazebo world (.sdf, .world). Labels and "
                 "routes are proposed; you correct them on the map.")  # fmt: skip
        with field("Folder", help="Where the world is made, in the folder of the studio"):
            text_input(self.name, self._named, autocomplete="off", required=True, id="folder", aria_describedby="wrong")
        self.wrong = tag("p", "", cls="st-wrong small", role="alert", id="wrong")
        tag("div", data_studio="drop", data_accept=",".join(KINDS), id="files")
        with actions():
            view.button("Make the world", self._make, cls="st-primary")
        view.command("From a Nav2 map", "rvsg world new DIR --map map.yaml")
        view.command("From a Gazebo world", "rvsg world new DIR --sdf FILE")

    def _named(self, text: str) -> None:
        self.name = text.strip()
        self.wrong.set_text("")
        self.typed.keep({"folder": text})

    async def _make(self) -> None:
        folder = self.page.workspace.path(self.name or ".")
        if folder.exists() and any(folder.iterdir()):
            self.wrong.set_text(f"{self.name}: this folder is not empty. Choose a new one." if self.name else
                                "Give the new world a folder.")  # fmt: skip
            return
        self.page.say("Making the world…")
        await load(make_world, received(self.page.workspace), folder)
        forget(self.page.workspace)
        self.typed.keep({"folder": None})
        ui.navigate.to(address("/world", world=self.name))


def make_world(files: list[Path], folder: Path) -> None:
    """Make a world folder of received files: a Nav2 map or a Gazebo world."""
    maps = [path for path in files if path.suffix.lower() in (".yaml", ".yml")]
    gazebo = [path for path in files if path.suffix.lower() in (".sdf", ".world")]
    if len(maps) + len(gazebo) != 1:
        raise InputError("Give exactly one map .yaml (with its picture) or one .sdf or .world file.")
    name = folder.name
    created = world_from("map", maps[0], name=name) if maps else world_from("sdf", gazebo[0], name=name, lenient=True)
    save_created(created, folder)


def _add_scenario(workspace: Workspace) -> None:
    @route(workspace, "/scenario", "Scenario", patience_s=PATIENT_S)
    async def scenario(
        campaign: str = "",
        name: str = "",
        attempt: str = "",
        file: str = "",
        world: str = "",
        route: str = "",
        suite: str = "",
        case: str = "",
    ) -> None:
        source = {"campaign": campaign, "name": name, "attempt": attempt, "file": file, "world": world, "route": route}
        source = {key: value for key, value in {**source, "suite": suite, "case": case}.items() if value}
        shown, place, _ = await load(scenario_place, workspace, question_of(source))
        requirement = "R1"
        if campaign:
            opened = await load(rvsg.Campaign.open, workspace.path(campaign), name or None)
            requirement = opened.requirement.name
        title = f"Scenario on {place.title}, {shown.mission.route.name}"
        with page(workspace, title, wide=True) as view:
            if not (campaign or file or case):
                listing = await load(workspace.listing)
                _choose(view, (*shipped_worlds(), *listing.worlds), world or "warehouse", shown, place)
            tag("p", "Drag a waypoint of the chosen person; the robot's run is simulated while you drag.", cls="soft")
            tag(
                "div", data_studio="scenario", data_source=json.dumps(source), data_requirement=requirement, id="editor"
            )
            view.command("Simulate", "rvsg simulate scenarios/edited.json --repeats 20 --out runs.jsonl")
            view.command("Judge", "rvsg evaluate runs.jsonl --scenario scenarios/edited.json")
            view.command("Add to a suite", "rvsg suite add scenarios/edited.json --suite suite")

    @route(workspace, "/runs", "Runs", patience_s=PATIENT_S)
    async def runs(file: str = "", scenario: str = "", campaign: str = "") -> None:
        with page(workspace, file or "Runs", wide=True) as view:
            where = address("/data/runs", file=file, scenario=scenario, campaign=campaign or None)
            traced = json.dumps({"file": file, "scenario": scenario})
            tag("div", data_studio="replay", data_url=where, data_keys="page", data_trace=traced, id="replay")
            view.command("Judge", f"rvsg evaluate {file} --scenario {scenario}")
            view.command(
                "Trace a run", f"rvsg replay {file} --trace --scenario {scenario} --run RUN --out RUN.trace.json"
            )


def _choose(view: Page, names: tuple[str, ...], world: str, opened: rvsg.Scenario, place: rvsg.World) -> None:
    """Lay out the choice of world and route; another world brings its own routes."""
    chosen: dict[str, str] = {"world": world, "route": opened.mission.route.name}
    with tag("div", cls="st-form"):
        with field("World"):
            select(names, world, lambda name: chosen.update(world=name, route=""))
        with field("Route"):
            select([way.name for way in place.routes], chosen["route"], lambda name: chosen.update(route=name))
    with actions():
        view.button("Open", lambda: ui.navigate.to(address("/scenario", **chosen)))
