"""Suites in a folder: cases that are added, run, updated, compared and reported."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from tests.app.parts import RPP, crossing

import rvsg
from rvsg.app.comparison import compare_versions
from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.report.comparison_page import changes_markdown
from rvsg.report.junit import suite_junit
from rvsg.suites.suite import State, compare

FAST = "kinematic"


@pytest.fixture(scope="module")
def scenario() -> rvsg.Scenario:
    return crossing()


@pytest.fixture
def suite(tmp_path: Path, scenario: rvsg.Scenario) -> rvsg.Suite:
    """R3 is never violated without physics; a limit of 100 m on the distance always is."""
    folder = tmp_path / "suite"
    made = rvsg.Suite.create(folder, title="Aisle")
    (folder / "requirements").mkdir()
    (folder / "requirements" / "far.yaml").write_text(
        "far:\n  title: Far away\n  text: The robot stays far away.\n"
        "  metric: min_distance\n  worse: smaller\n  limit: 100\n  unit: m\n"
    )
    made = made.add(scenario, "R3", name="aisle", expected="pass")
    return made.add(scenario, "requirements/far.yaml#far", expected="violation", reason="nobody can")


def test_one_scenario_with_two_requirements_is_one_case(suite: rvsg.Suite, scenario: rvsg.Scenario) -> None:
    (case,) = suite.cases
    assert case.scenario == scenario
    assert [each.requirement for each in case.expectations] == ["R3", "requirements/far.yaml#far"]
    assert rvsg.Suite.open(suite.folder).cases == suite.cases


def test_a_title_from_a_long_description_ends_with_a_whole_word(tmp_path: Path, scenario: rvsg.Scenario) -> None:
    told = scenario.replace(description="somebody walks " * 30)
    (case,) = rvsg.Suite.create(tmp_path / "long").add(told).cases
    assert case.title.endswith(("somebody…", "walks…")) and len(case.title) <= 200


def test_a_run_spends_runs_until_every_verdict_is_sure(suite: rvsg.Suite) -> None:
    result = suite.run(simulator=FAST, version="1")
    assert [case.state for case in result.cases] == [State.PASSED, State.KNOWN_FAILURE]
    assert result.broken == ()
    assert all(case.verdict.runs == 15 for case in result.cases)  # 15 clean runs pass, 15 violations fail
    assert result == suite.run(simulator=FAST, version="1")


def test_what_changed_is_written_into_the_suite_and_then_expected(suite: rvsg.Suite, scenario: rvsg.Scenario) -> None:
    suite = suite.add(scenario, "R3", expected="violation", reason="slow")
    suite = suite.add(scenario, "requirements/far.yaml#far", expected="pass")
    result = suite.run(simulator=FAST)
    assert {case.requirement: case.state for case in result.cases} == {
        "R3": State.FIXED,
        "requirements/far.yaml#far": State.BROKEN,
    }
    assert len(suite.update(result)) == 2
    again = rvsg.Suite.open(suite.folder).run(simulator=FAST)
    assert {case.state for case in again.cases} == {State.PASSED, State.KNOWN_FAILURE}


def test_junit_has_a_case_with_a_stable_name_for_each_requirement(suite: rvsg.Suite) -> None:
    root = ET.fromstring(suite_junit(suite.run(simulator=FAST)))
    (made,) = root
    assert [made.get(key) for key in ("tests", "failures", "skipped")] == ["2", "0", "1"]
    assert [case.get("name") for case in made] == ["aisle", "aisle"]
    assert all(case.get("time") is None for case in made), "simulated seconds are no time of the test"


def test_results_without_a_common_case_are_refused(suite: rvsg.Suite) -> None:
    result = suite.run(simulator=FAST, runs=1)
    other = result.replace(cases=tuple(case.replace(case="other") for case in result.cases))
    with pytest.raises(InputError):
        compare_versions(result, other)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda text: text.replace("expectations:", "expects:"), 1),
        (lambda text: text.replace("E15", "Z99"), None),
        (lambda text: text.replace("requirement: R3", "requirement: R33"), None),
        (lambda text: text.replace("max_runs: 30", "max_runs: many"), None),
        (lambda text: "- a\n- b\n", None),
    ],
)
def test_a_file_that_was_edited_wrongly_is_refused_by_name(suite: rvsg.Suite, change, line) -> None:  # type: ignore[no-untyped-def]
    path = suite.folder / "aisle.yaml"
    path.write_text(change(path.read_text()))
    with pytest.raises(FileError) as raised:
        rvsg.Suite.open(suite.folder)
    assert raised.value.path == path
    assert line is None or raised.value.line == line


def test_a_name_that_is_no_file_name_of_ours_is_refused(suite: rvsg.Suite) -> None:
    (suite.folder / "aisle.yaml").rename(suite.folder / "Aisle (2).yaml")
    with pytest.raises(FileError):
        rvsg.Suite.open(suite.folder)


def test_an_unknown_case_and_a_folder_without_a_suite_are_refused(suite: rvsg.Suite, tmp_path: Path) -> None:
    with pytest.raises(UnknownName):
        suite.run(simulator=FAST, only=("aisel",))
    with pytest.raises(FileError):
        rvsg.Suite.open(tmp_path)


def test_pytest_runs_the_cases_of_a_suite_or_ones_own_test_of_each(
    suite: rvsg.Suite, pytester: pytest.Pytester
) -> None:
    result = pytester.runpytest_inprocess("--rvsg-suite", str(suite.folder), "--rvsg-simulator", FAST, "-q")
    result.assert_outcomes(passed=1, skipped=1)
    pytester.makepyfile(
        "def test_robot(rvsg_scenario):\n"
        "    result = rvsg_scenario.run(simulator='kinematic', runs=2)\n"
        "    assert result.requirement == rvsg_scenario.requirement\n"
    )
    result = pytester.runpytest_inprocess("--rvsg-suite", str(suite.folder), "-q")
    result.assert_outcomes(passed=2)
    result = pytester.runpytest_inprocess("--rvsg-suite", "nowhere", "-q")
    assert result.ret == pytest.ExitCode.USAGE_ERROR


def test_suites_that_are_opened_at_once_lose_no_expectation(tmp_path: Path, scenario: rvsg.Scenario) -> None:
    folder = tmp_path / "suite"
    opened = {name: rvsg.Suite.create(folder) for name in ("R1", "R2", "R3")}
    with ThreadPoolExecutor() as pool:
        list(pool.map(lambda name: opened[name].add(scenario, name, name="same"), opened))
    [case] = rvsg.Suite.open(folder).cases
    assert {each.requirement for each in case.expectations} == {"R1", "R2", "R3"}


def test_a_case_keeps_stack_robot_and_requirement_by_content(tmp_path: Path, scenario: rvsg.Scenario) -> None:
    parameters = tmp_path / "nav2_params.yaml"
    parameters.write_text(RPP)
    campaign = rvsg.Campaign.create(
        tmp_path / "run", stack=str(parameters), robot="turtlebot3_waffle", humans=1, scenarios=1, refinements=0,
        repeats=1, confirmations=0, shrink_runs=0,
    )  # fmt: skip
    list(campaign.run(jobs=1))
    campaign.report()
    suite = rvsg.Suite.create(tmp_path / "suite")
    limits = suite.folder / "limits" / "far.yaml"
    limits.parent.mkdir()
    limits.write_text("far: {title: Far, text: Far away., metric: min_distance, worse: smaller, limit: 100}\n")
    suite = suite.add(tmp_path / "run" / "best_scenario.json", "limits/far.yaml#far", name="mine")
    parameters.unlink()
    limits.write_text(limits.read_text().replace("100", "0.001"))
    said: list[str] = []
    result = rvsg.Suite.open(suite.folder).run(runs=2, on_message=said.append)
    [case] = result.cases
    assert case.stack.startswith("nav2-rpp ") and case.robot.startswith("turtlebot3_waffle (robot-")
    assert case.simulator is not None and case.simulator.options["stack"]["options"]["desired_linear_vel"] == 0.31
    assert case.verdict.violations == 2, "the case keeps the limit of 100 m"
    assert any("limits/far.yaml#far is defined otherwise today" in text for text in said)
    properties = {each.get("name"): each.get("value") for each in ET.fromstring(suite_junit(result)).iter("property")}
    assert (properties["stack"], properties["robot"], properties["version"]) == (case.stack, case.robot, case.stack)
    other = rvsg.Suite.open(suite.folder).run(runs=2, stack="nav2-dwb", on_message=said.append)
    assert other.cases[0].stack.startswith("nav2-dwb ")
    assert f"mine was found with {case.stack}; this run tests {other.cases[0].stack}." in said
    table = changes_markdown(compare([result, other]))
    assert case.stack in table and other.cases[0].stack in table and case.robot in table
    again = compare_versions("embedded", "embedded:stack=nav2-dwb", suite=suite.folder, runs=1)
    assert [each.cases[0].stack for each in again.found.variants] == [case.stack, other.cases[0].stack]
    assert again.found.variants[0].tested in again.page()


def test_code_that_a_case_names_is_not_run_by_itself(suite: rvsg.Suite) -> None:
    path = suite.folder / "aisle.yaml"
    stack = "simulator:\n  name: embedded\n  options: {stack: {name: '/x/evil.py:Evil'}}\n"
    path.write_text(stack + path.read_text())
    with pytest.raises(InputError) as refused:
        rvsg.Suite.open(suite.folder).run(runs=1)
    assert refused.value.code == "code-not-allowed"


def test_a_case_that_is_added_again_keeps_its_reason_and_its_name(suite: rvsg.Suite, scenario: rvsg.Scenario) -> None:
    again = suite.add(scenario, "requirements/far.yaml#far", expected="violation")
    assert [each.reason for each in again.cases[0].expectations] == ["", "nobody can"]
    with pytest.raises(InputError) as refused:
        suite.add(scenario, "R1", name="another")
    assert refused.value.code == "case-known"
