"""A job with its events, and the cases of a suite."""

from __future__ import annotations

from nicegui import ui

import rvsg
from rvsg.core.errors import RvsgError
from rvsg_studio.frame import address, chip, link, load, page, problem, tag
from rvsg_studio.pages.finding import JobLine
from rvsg_studio.workspace import Workspace


def add(workspace: Workspace) -> None:
    """Add the pages."""

    @ui.page("/job", response_timeout=60)
    async def job(job: str = "") -> None:
        try:
            found = await load(workspace.jobs.get, job)
        except RvsgError as error:
            problem(workspace, "Job", error)
            return
        with page(workspace, f"{found.title}: {found.target}") as made:
            with tag("ul", cls="st-list"):
                JobLine(made, found)
            with tag("p", cls="st-actions"):
                if found.kind == "matrix":
                    tag("a", "Open the campaigns", cls="st-button", href=address("/matrix", folder=found.target))
                if found.kind == "campaign":
                    tag("a", "Open the campaign", cls="st-button", href=address("/campaign", folder=found.target))
                if found.running:
                    made.button("Pause", lambda: workspace.jobs.pause(found.id))
                    made.button("Stop now", lambda: workspace.jobs.stop(found.id), cls="st-danger")
            made.command(found.title, found.command)

    @ui.page("/suite", response_timeout=60)
    async def suite(suite: str = "") -> None:
        try:
            found = await load(rvsg.Suite.open, workspace.existing(suite))
        except RvsgError as error:
            problem(workspace, "Suite", error)
            return
        with page(workspace, f"{found.head.title} ({suite})") as made:
            made.command("Run it", f"rvsg suite run {suite}")
            if not found.cases:
                tag("p", "This suite holds no case yet. Save a scenario in it from the scenario editor.", cls="soft")
            for case in found.cases:
                with tag("div", cls="st-row"):
                    with tag("span", cls="st-row-head"):
                        for expectation in case.expectations:
                            chip(f"{expectation.requirement}: {expectation.expected}")
                    link(case.title, "/scenario", suite=suite, case=case.name)
                    tag("span", f"{case.scenario.mission.world}, {case.scenario.mission.route.name}", cls="soft small")
