"""The public functions: what they check wherever they are called from."""

from __future__ import annotations

import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from tests.coded import coded

import rvsg
from rvsg.core.errors import InputError
from rvsg.evaluation.verdict import Status, judge
from rvsg.scenario import world_lookup
from rvsg.scenario.builder import save_scenario
from rvsg.scenario.scenario import Human, Task
from rvsg.world.world_folder import SHIPPED

ANNA = rvsg.walk("Anna", "E15", "H15")


@pytest.fixture(scope="module")
def scenario() -> rvsg.Scenario:
    return rvsg.scenario("warehouse", "route_1", [ANNA])


def test_a_public_name_has_a_home_and_a_type() -> None:
    declared = (Path(rvsg.__file__).parent / "__init__.pyi").read_text(encoding="utf-8")
    for name in rvsg.__all__:
        assert getattr(rvsg, name) is not None
        assert name in declared
    assert len(rvsg.__all__) <= 26


def test_a_scenario_of_another_world_is_refused(scenario: rvsg.Scenario) -> None:
    bogus = scenario.replace(mission=scenario.mission.replace(world_id="world-0000000000000000", parts=None))
    for world, code in ((None, "world-changed"), ("warehouse", "world-other")):
        with pytest.raises(InputError, check=coded(code)):
            rvsg.simulate(bogus, 1, simulator="kinematic", world=world)


def test_a_scenario_with_a_jump_is_refused_with_the_finding() -> None:
    ways = (("A1", "M20"), ("M20", "A1"))
    jump = Human(name="Ben", tasks=tuple(Task(name=" → ".join(way), path=way) for way in ways))
    with pytest.raises(rvsg.InvalidScenario) as error:
        rvsg.scenario("warehouse", "route_1", [jump])
    assert any("A1" in finding and "M20" in finding for finding in error.value.findings)


def test_a_limit_that_depends_on_the_route_is_worked_out_for_the_runs(scenario: rvsg.Scenario) -> None:
    runs = rvsg.simulate(scenario, 2, simulator="kinematic")
    judged = rvsg.judge(runs, "R3")
    assert judged.outcome is not Status.UNJUDGED
    assert judged.requirement.limit == pytest.approx(rvsg.load_requirement("R3", scenario.mission.route).limit or 0.0)


def test_a_limit_that_is_not_worked_out_is_never_unjudged_in_silence() -> None:
    with pytest.raises(InputError, check=coded("limit-open")):
        judge(rvsg.load_requirement("R3"), [10.0, 20.0])


def test_a_metric_of_obstacles_is_judged_where_the_world_is_known(scenario: rvsg.Scenario, tmp_path: Path) -> None:
    words = {"title": "Walls", "text": "Keep off.", "worse": "smaller", "limit": 0.1}
    walls = rvsg.Requirement(name="walls", metric="obstacle_distance", **words)
    rvsg.simulate(scenario, 2, simulator="kinematic").save(tmp_path / "runs.jsonl")
    assert rvsg.judge(rvsg.load_runs(tmp_path / "runs.jsonl"), walls).verdict.undefined == 2
    judged = rvsg.judge(rvsg.load_runs(tmp_path / "runs.jsonl", scenario=scenario), walls)
    assert judged.verdict.undefined == 0 and judged.verdict.runs == 2


def test_a_world_gives_one_scenario_however_it_is_named(
    scenario: rvsg.Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(SHIPPED / "warehouse", tmp_path / "warehouse")
    monkeypatch.chdir(tmp_path)
    named = [rvsg.scenario(name, "route_1", [ANNA]).id for name in ("./warehouse", tmp_path / "warehouse")]
    assert named == [scenario.id, scenario.id]


def test_a_saved_scenario_finds_its_world(tmp_path: Path) -> None:
    shutil.copytree(SHIPPED / "warehouse", tmp_path / "mine")
    made = rvsg.scenario(tmp_path / "mine", "route_1", [ANNA])
    save_scenario(made, tmp_path / "s.json")
    world_lookup._worlds.clear()
    world_lookup._folders.clear()
    assert rvsg.load_scenario(tmp_path / "s.json").id == made.id
    assert world_lookup.folder_of(made.mission.world_id) == (tmp_path / "mine").resolve()


def test_the_mission_without_people_is_a_scenario() -> None:
    alone = rvsg.scenario("warehouse", "route_1")
    runs = rvsg.simulate(alone, 2, simulator="kinematic")
    assert all(run.human_names == () for run in runs)
    assert rvsg.judge(runs, "R1").verdict.violations == 0


def test_runs_are_a_set_with_a_picture_and_a_table(scenario: rvsg.Scenario) -> None:
    runs = rvsg.simulate(scenario, seeds=[5, 9], simulator="kinematic")
    assert len(runs) == 2 and [run.seed for run in runs] == [5, 9] and len(runs[:1]) == 1
    picture = ET.fromstring(runs.picture().svg)
    assert runs.picture().svg.count("<polyline") == 4
    _, _, wide, high = map(float, picture.attrib["viewBox"].split())
    assert float(picture.attrib["width"]) / float(picture.attrib["height"]) == pytest.approx(wide / high, abs=0.01)
    assert {"start", "goal"} <= {each.text for each in picture.iter("{http://www.w3.org/2000/svg}title")}
    assert "2 runs" in runs._repr_html_()
    pandas = pytest.importorskip("pandas")
    table = runs.to_dataframe()
    assert isinstance(table, pandas.DataFrame)
    assert list(table["seed"]) == [5, 9] and "dto" in table


@pytest.mark.slow
def test_calling_the_sub_package_makes_a_scenario_whatever_was_imported_before() -> None:
    code = (
        "import rvsg.scenario.scenario, rvsg\n"
        "made = rvsg.scenario('warehouse', 'route_1', [rvsg.walk('A', 'E15', 'H15')])\n"
        "assert isinstance(made, rvsg.scenario.scenario.Scenario)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
