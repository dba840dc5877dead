"""Coverage of a suite and of a campaign: what is exercised, what is not, and how it is written."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.app.parts import crossing
from tests.cli.commands import Terminal

import rvsg
from rvsg.app.coverage import coverage
from rvsg.core.errors import InputError
from rvsg.report.overview import write_coverage
from rvsg.search.exploration import Exercise

FAST = "kinematic"


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> rvsg.Suite:
    folder = tmp_path_factory.mktemp("suite") / "suite"
    scared = crossing(behaviour="scared")
    made = rvsg.Suite.create(folder).add(scared, "R1", name="crossing").add(scared, "R3")
    return made.add(crossing("route_2", ("E15", "E12")), "R3", name="along")


def test_what_the_scenarios_ask_for_is_counted_once_per_scenario(suite: rvsg.Suite) -> None:
    ((found, world),) = [(each.coverage, each.world) for each in coverage(suite, suite.folder, runs=0)]
    assert (found.scenarios, found.runs) == (2, 0)
    routes = {each.route: each for each in found.routes}
    assert routes["route_1"].requirements["R1"] == routes["route_1"].requirements["R3"] == 1
    assert routes["route_3"].scenarios == 0
    assert {each.name: each.scenarios for each in found.behaviours}["scared"] == 1
    assert found.waypoints["E15"] == 2 and found.waypoints["H15"] == 1
    assert set(found.waypoints) == {each.name for each in world.grid.waypoints if each.human}


def test_the_untested_is_named(suite: rvsg.Suite) -> None:
    (found,) = coverage(suite, runs=0)
    untested = found.coverage.untested
    assert untested["routes"] == ("route_3", "route_4", "route_5")
    assert untested["pairs"] == ("route_2 with R1",)
    assert "scared" not in untested["behaviours"] and "curious" in untested["behaviours"]
    assert "encounters" not in untested  # no run was made, so nothing is known of them
    assert "clearance" in untested["requirements"]


def test_runs_show_encounters_and_count_once(suite: rvsg.Suite) -> None:
    (found,) = coverage(suite, runs=2, simulator=FAST)
    assert found.coverage.runs == 4
    met = sum(each.runs for each in found.coverage.encounters)
    assert met == sum(sum(route.encounters.values()) for route in found.coverage.routes)
    world = rvsg.load_world("warehouse")
    scenario = suite.cases[0].scenario
    (run,) = rvsg.simulate(scenario, 1, simulator=FAST)
    exercise = Exercise(world)
    exercise.add_run(run)  # of a scenario that is not known
    assert exercise.coverage().runs == 0
    exercise.add(scenario, ["R1"])
    exercise.add_run(run)
    exercise.add_run(run)
    assert exercise.coverage().runs == 1


def test_a_campaign_counts_with_its_stored_runs(tmp_path: Path) -> None:
    settings = {"simulator": FAST, "scenarios": 2, "refinements": 0, "repeats": 2, "confirmations": 0}
    campaign = rvsg.Campaign.create(tmp_path / "c", generator="random", route="route_3", **settings)
    list(campaign.run(jobs=1))
    (found,) = coverage(tmp_path / "c")
    route = next(each for each in found.coverage.routes if each.route == "route_3")
    assert (route.scenarios, route.runs, route.requirements["R1"]) == (2, 4, 2)


def test_the_map_the_page_and_the_numbers_are_written(suite: rvsg.Suite, tmp_path: Path) -> None:
    found = coverage(suite, runs=1, simulator=FAST)
    for ending in ("png", "html", "json"):
        write_coverage(tmp_path / f"coverage.{ending}", found)
    picture = np.asarray(Image.open(tmp_path / "coverage.png").convert("RGB"))
    assert (picture == (179, 38, 30)).all(axis=2).sum() > 200  # dashes of what is untested
    page = (tmp_path / "coverage.html").read_text()
    assert "route_2 with R1" in page and 'src="data:image/png;base64,' in page
    (values,) = json.loads((tmp_path / "coverage.json").read_text())
    assert values == found[0].coverage.model_dump(mode="json")


def test_the_verb_prints_json_and_refuses_bad_input(terminal: Terminal, suite: rvsg.Suite) -> None:
    (values,) = terminal.json("suite coverage", suite.folder, "--runs 0")
    assert values["scenarios"] == 2
    with pytest.raises(InputError):
        write_coverage(Path("coverage.pdf"), coverage(suite, runs=0))
    terminal("coverage nowhere", code=2)
    terminal("suite coverage", suite.folder, "--out x.gif", code=2)
