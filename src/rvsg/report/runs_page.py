"""The page of runs that belong to no campaign: simulated ones of one scenario, or recordings of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

import rvsg
from rvsg.campaign.attempt import Attempt, Measurement, Plan
from rvsg.core.files import write_whole
from rvsg.evaluation.verdict import Verdict
from rvsg.evaluation.wording import counted, how_sure
from rvsg.generation.generator import Proposal
from rvsg.report.answer import answer_of_runs
from rvsg.report.facts import AttemptFacts, run_facts
from rvsg.report.floors import area_colours
from rvsg.report.happened import what_happens
from rvsg.report.names import narrow_names
from rvsg.report.page import SHOWN_TASKS, environment, script_safe
from rvsg.report.replay import component, data_of
from rvsg.report.robot import robot_words
from rvsg.report.shown import Shown
from rvsg.report.summary import summarise
from rvsg.report.tables import people_rows, run_rows_of
from rvsg.report.under_test import under_test
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.simulation.run import Run
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.world import World


def write_runs_page(
    path: Path,
    runs: Sequence[Run],
    measurements: Sequence[Measurement],
    verdict: Verdict,
    *,
    requirement: Requirement,
    mission: Mission,
    world: World,
    scenario: Scenario | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write the page of runs and their verdict, whole or not at all.

    Args:
        mission: What the robot was to do.
        scenario: What the people were asked to do, where that is known.
        notes: What the runs rest on, and what recordings lack.
    """
    brief = Brief(mission=mission, requirement=requirement, seed=0, humans=max(1, len(runs[0].human_names)))
    attempt = Attempt(
        campaign="by hand",
        index=0,
        strategy="by hand",
        brief=brief,
        proposal=Proposal(generator="by hand", scenario=scenario),
        measurements=tuple(measurements),
        verdict=verdict,
    )
    told = tuple(run_facts(run, m, requirement, world, scenario) for run, m in zip(runs, measurements, strict=True))
    facts = AttemptFacts(attempt=attempt, runs=told)
    plan = Plan(name="by hand", mission=mission, requirement=requirement)
    floor = floor_plan(world, tooltips=False)
    shown = Shown(
        plan=plan, world=world, attempts=[attempt], summary=summarise(plan, []), facts=[facts], findings=(), floor=floor
    )
    data = data_of([facts], mission=mission, requirement=requirement, world=world, floor=floor)
    data["groups"][0]["label"] = counted(len(runs), "run")
    data["groups"][0]["purpose"] = "given"
    page = environment().get_template("runs.html")
    text = page.render(
        version=rvsg.__version__,
        requirement=requirement,
        place=f"{world.title}, {mission.route.name}",
        robot=robot_words(mission) if scenario is not None else "",
        answer=answer_of_runs(plan, facts),
        notes=[*notes, *(f"{label}: {text}." for label, text in under_test(runs).rows)],
        happened=what_happens(shown, facts),
        people=people_rows(facts),
        shown_tasks=SHOWN_TASKS,
        doors=mission.doors,
        box=floor.view_box,
        floor=Markup(floor.shapes),  # noqa: S704 - made by us, its words escaped
        names=Markup(narrow_names(floor)),  # noqa: S704
        look=Markup(area_colours(world, floor)),  # noqa: S704
        replay=script_safe(data),
        component=Markup(component()),  # noqa: S704
        traces=(),
        sure=how_sure(verdict),
        runs=run_rows_of(facts, requirement.unit),
    )
    write_whole(path, text)
