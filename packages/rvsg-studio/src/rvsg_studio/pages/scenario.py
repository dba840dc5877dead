"""The editor of a scenario, and the replay of a file of runs."""

from __future__ import annotations

import json

from nicegui import ui

import rvsg
from rvsg.core.errors import RvsgError
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.answers import scenario_place
from rvsg_studio.frame import PATIENT_S, Page, address, field, load, page, problem, select, tag
from rvsg_studio.workspace import Workspace


def add(workspace: Workspace) -> None:
    """Add the pages."""

    @ui.page("/scenario", response_timeout=PATIENT_S)
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
        try:
            found, place, _ = await load(scenario_place, workspace, source)
        except RvsgError as error:
            problem(workspace, "Scenario", error)
            return
        requirement = "R1"
        if campaign:
            opened = await load(rvsg.Campaign.open, workspace.path(campaign), name or None)
            requirement = opened.requirement.name
        title = f"Scenario on {place.title}, {found.mission.route.name}"
        with page(workspace, title, wide=True) as made:
            if not (campaign or file or case):
                listing = await load(workspace.listing)
                _choose(made, (*shipped_worlds(), *listing.worlds), world or "warehouse", found, place)
            tag("p", "Drag a waypoint of the chosen person; the robot's run is simulated while you drag.", cls="soft")
            tag(
                "div", data_studio="scenario", data_source=json.dumps(source), data_requirement=requirement, id="editor"
            )
            made.command("Simulate", "rvsg simulate scenarios/edited.json --repeats 20 --out runs.jsonl")
            made.command("Judge", "rvsg evaluate runs.jsonl --scenario scenarios/edited.json")
            made.command("Add to a suite", "rvsg suite add scenarios/edited.json --suite suite")

    @ui.page("/runs", response_timeout=PATIENT_S)
    async def runs(file: str = "", scenario: str = "", campaign: str = "") -> None:
        with page(workspace, file or "Runs", wide=True) as made:
            where = address("/data/runs", file=file, scenario=scenario, campaign=campaign or None)
            traced = json.dumps({"file": file, "scenario": scenario})
            tag("div", data_studio="replay", data_url=where, data_keys="page", data_trace=traced, id="replay")
            made.command("Judge", f"rvsg evaluate {file} --scenario {scenario}")
            made.command("Trace a run", f"rvsg trace {file} --scenario {scenario} --run RUN --out RUN.trace.json")


def _choose(made: Page, names: tuple[str, ...], world: str, found: rvsg.Scenario, place: rvsg.World) -> None:
    """Lay out the choice of world and route; another world brings its own routes."""
    chosen: dict[str, str] = {"world": world, "route": found.mission.route.name}
    with tag("div", cls="st-form"):
        with field("World"):
            select({each: each for each in names}, world, lambda v: chosen.update(world=v, route=""))
        with field("Route"):
            routes = {each.name: each.name for each in place.routes}
            select(routes, chosen["route"], lambda v: chosen.update(route=v))
    with tag("p", cls="st-actions"):
        made.button("Open", lambda: ui.navigate.to(address("/scenario", **chosen)))
