"""Versions that differ in a parameter of the robot: what is fixed, what is broken, and the page that shows it."""

from __future__ import annotations

import json
import re
import shutil
from importlib import resources
from pathlib import Path

import pytest
from tests.app.parts import suite_of
from tests.cli.commands import Terminal

import rvsg
from rvsg.app.comparison import compare_versions
from rvsg.core.errors import InputError
from rvsg.suites.suite import Change, compare

EXAMPLE = Path(__file__).parents[2] / "examples" / "suites" / "warehouse"


def robot_file(path: Path, *, speed: float = 0.5, inflation: float = 0.55) -> Path:
    """Write a robot that differs from the TIAGo in these parameters alone."""
    text = (resources.files("rvsg.robots") / "data" / "tiago_omni.yaml").read_text(encoding="utf-8")
    changed = text.replace("max_speed_m_s: 0.5, max_rev", f"max_speed_m_s: {speed}, max_rev")
    costmaps = f"  costmaps: {{local_inflation_m: {inflation}, global_inflation_m: {inflation}}}\n"
    changed = changed.replace("  smoother:", costmaps + "  smoother:")
    assert changed != text
    path.write_text(changed, encoding="utf-8")
    return path


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    """Three cases of the example, and one that the robot masters in time."""
    folder = tmp_path / "suite"
    folder.mkdir()
    for name in ("suite", "route_1-r1", "route_1-r2", "route_1-clearance"):
        shutil.copy(EXAMPLE / f"{name}.yaml", folder)
    alone = rvsg.scenario("warehouse", "route_1", [rvsg.walk("Anna", "D9", "B9")], description="nobody is in the way")
    rvsg.Suite.open(folder).add(alone, "R3", name="alone", expected="pass")
    return folder


@pytest.mark.exhaustive
def test_a_slower_robot_fixes_jerk_and_breaks_arriving_in_time(suite: Path, tmp_path: Path) -> None:
    slow = f"embedded:robot={robot_file(tmp_path / 'slow.yaml', speed=0.3)}"
    there = compare_versions("embedded", slow, suite=suite, runs=10)
    changes = {(each.case, each.requirement): each.change for each in there.found.changes}
    late = {key: change for key, change in changes.items() if key[1] == "R3"}
    assert ("alone", "R3") in late and set(late.values()) == {Change.BROKEN}
    assert {case: change for (case, requirement), change in changes.items() if requirement != "R3"} == {
        "route_1-r1": Change.FIXED,
        "route_1-r2": Change.FIXED,
        "route_1-clearance": Change.UNCHANGED,
    }
    back = compare_versions(*reversed(there.found.variants))
    turned = {Change.BROKEN: Change.FIXED, Change.FIXED: Change.BROKEN, Change.UNCHANGED: Change.UNCHANGED}
    assert {(each.case, each.requirement): each.change for each in back.found.changes} == {
        key: turned[change] for key, change in changes.items()
    }
    page = there.page()
    assert page.count('class="replay"') == sum(change is not Change.UNCHANGED for change in changes.values())


@pytest.mark.exhaustive
def test_a_wider_inflation_fixes_two_cases_of_the_example_and_breaks_one(tmp_path: Path) -> None:
    for name in ("suite", "route_1-clearance", "route_2-r1", "route_2-r3", "route_5-r1"):
        shutil.copy(EXAMPLE / f"{name}.yaml", tmp_path)
    wide = EXAMPLE.parents[1] / "stacks" / "wide_inflation.yaml"
    found = compare_versions("embedded", f"embedded:stack={wide}", suite=tmp_path, runs=20)
    changes = {(each.case, each.requirement): each.change for each in found.found.changes}
    assert changes[("route_1-clearance", "R3")] is Change.BROKEN
    assert changes[("route_2-r3", "R3")] is Change.FIXED
    assert changes[("route_5-r1", "R1")] is Change.FIXED
    assert changes[("route_1-clearance", "clearance")] is Change.UNCHANGED
    assert changes[("route_2-r1", "R1")] is Change.UNCHANGED
    assert [each.case for each in found.found.broken] == ["route_1-clearance"]


@pytest.mark.slow
def test_the_same_parameters_in_a_file_change_nothing(suite: Path, tmp_path: Path) -> None:
    same = f"embedded:robot={robot_file(tmp_path / 'same.yaml')}"
    found = compare_versions("embedded", same, suite=suite, runs=6)
    assert {each.change for each in found.found.changes} == {Change.UNCHANGED}


def test_a_page_replays_both_runs_of_a_seed_that_differs(tmp_path: Path) -> None:
    hostile = rvsg.scenario("warehouse", "route_1", [rvsg.walk("</script>Anna", "E15", "H15")])
    suite = rvsg.Suite.create(tmp_path / "suite").add(hostile, "R3", name="aisle", expected="pass")
    result = suite.run(simulator="kinematic", version="kinematic", runs=2)
    (case,) = result.cases
    # A version that reaches the goal on no seed, as if it had been slower: the page runs the seed again to show it.
    worse = result.replace(cases=(case.replace(violations=(True, True)),))
    found = compare_versions(result, worse)
    assert 'class="replay"' not in found.page()  # without the suite there is nothing to run
    shown = type(found)(found=compare([result, worse]), suite=suite)
    page = shown.page()
    (data,) = re.findall(r'id="data-1">(.*?)</script>', page)
    (ids,) = re.findall(r'id="ids-1">(.*?)</script>', page)
    runs = json.loads(data)["groups"][0]["runs"]
    assert [run["id"] for run in runs] == json.loads(ids)
    assert {run["seed"] for run in runs} == {0}
    assert "</script>Anna" not in page


def test_the_verb_writes_a_page(terminal: Terminal) -> None:
    suite_of(Path("suite"))
    wanted = "suite compare kinematic kinematic --suite suite --runs 2 --html"
    terminal(wanted, "versions.html")
    assert "1 unchanged" in Path("versions.html").read_text()
    terminal(wanted, ".", code=2)


def test_a_version_that_cannot_be_made_is_refused_before_the_other_runs(tmp_path: Path) -> None:
    suite = suite_of(tmp_path / "suite").folder
    said: list[str] = []
    for wrong in ("kinematic:robot=missing.yaml", "embedded:stack=nav2-rrp", "kinemtic"):
        with pytest.raises(InputError):
            compare_versions("kinematic", wrong, suite=suite, runs=1, on_message=said.append)
    assert said == []
