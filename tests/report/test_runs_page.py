from __future__ import annotations

from pathlib import Path

import pytest
from tests.coded import coded
from tests.report.test_page import NASTY, Reader, data_of

import rvsg
from rvsg.core.errors import InputError
from rvsg.generation.random_search import RandomGenerator
from rvsg.report.page import write_runs_page
from rvsg.report.run_facts import EDGES
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Mission
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.world.world_folder import load_world


@pytest.mark.parametrize("named", [True, False])
def test_runs_of_no_campaign_have_a_page_with_verdict_story_and_replay(tmp_path: Path, named: bool) -> None:
    world = load_world("warehouse")
    mission = Mission.of(world, world.route("route_1"))
    scenario = RandomGenerator().propose(Brief(mission=mission, requirement=None, seed=3), world).scenario
    assert scenario is not None
    runs = rvsg.RunSet(tuple(KinematicSimulator().run(scenario, world, seed=seed) for seed in (1, 2)))
    judged = rvsg.judge(runs, "R1", world=world)
    page = tmp_path / "page.html"
    with pytest.raises(InputError, check=coded("no-world")):
        write_runs_page(page, judged, runs)
    write_runs_page(page, judged, runs, scenario=scenario if named else None, world=world, notes=[NASTY])
    text = page.read_text(encoding="utf-8")
    reader = Reader()
    reader.feed(text)
    assert reader.open == [] and reader.tags.count("script") == 2 and "img" not in reader.tags
    assert {run["id"] for run in data_of(text)["groups"][0]["runs"]} == {run.id for run in runs}
    assert all(target.startswith("#") for target in reader.refers)
    assert judged.outcome.value in text and text.count("<figure") > 2
    assert ("asked to do" in text) is named
    corners = data_of(text)["groups"][0]["robot"]["outline"]
    assert (len(corners) == EDGES) is not named  # a robot that nobody names is drawn as the disc that measures the gaps
