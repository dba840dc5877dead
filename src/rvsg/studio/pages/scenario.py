"""The editor of a scenario, and the replay of a file of runs."""

from __future__ import annotations

import json

from nicegui import ui

import rvsg
from rvsg.api.authoring import shipped_worlds
from rvsg.api.errors import RvsgError
from rvsg.studio.answers import scenario_place
from rvsg.studio.frame import PATIENT_S, address, field, load, page, problem, select, tag
from rvsg.studio.workspace import Workspace


def add(workspace: Workspace) -> None:
    """Add the pages."""

    @ui.page("/scenario", response_timeout=PATIENT_S)
    async def scenario(
        campaign: str = "", name: str = "", attempt: str = "", file: str = "", world: str = "", route: str = ""
    ) -> None:
        source = {"campaign": campaign, "name": name, "attempt": attempt, "file": file, "world": world, "route": route}
        source = {key: value for key, value in source.items() if value}
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
            if not campaign and not file:
                listing = await load(workspace.listing)
                with tag("div", cls="st-form"):
                    with field("World"):
                        worlds = {each: each for each in (*shipped_worlds(), *listing.worlds)}
                        select(worlds, world or "warehouse", lambda v: ui.navigate.to(address("/scenario", world=v)))
                    with field("Route"):
                        routes = {each.name: each.name for each in place.routes}
                        shown = found.mission.route.name
                        go = address("/scenario", world=world or "warehouse")
                        select(routes, shown, lambda v: ui.navigate.to(f"{go}&route={v}"))
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
