"""Requirements that ship, and requirements of a user's file."""

from pathlib import Path

import pytest
from tests.coded import at_key, nearest

from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError, UnknownName
from rvsg.evaluation.signals import doubts_of
from rvsg.generation.facts import requirement_facts
from rvsg.scenario.requirement import load_requirement, load_requirements, shipped_requirements
from rvsg.scenario.scenario import Mission
from rvsg.world.world_folder import load_world, shipped_worlds


def test_the_study_requirements_and_more_are_shipped():
    shipped = shipped_requirements()
    assert [shipped[name].metric for name in ("R1", "R2", "R3")] == ["dto", "jerk", "trg"]
    assert len(shipped) >= 13
    assert all(r.source and r.for_time_limit(25.0).threshold is not None for r in shipped.values())
    assert shipped["R3"].for_time_limit(20.0).limit == 19.0


def test_a_file_of_one_requirement_is_loaded_by_its_path_and_by_its_name(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("berth: {title: Wide berth, text: Stay away., metric: min_distance, worse: smaller, limit: 0.5}")
    assert load_requirement(path).limit == 0.5
    assert load_requirement(f"{path}:berth") == load_requirement(f"{path}#berth") == load_requirement(path)
    with pytest.raises(UnknownName, check=nearest("berth")):
        load_requirement(f"{path}:birth")
    with pytest.raises(UnknownName, check=nearest("clearance")):
        load_requirement("clearence")
    with pytest.raises(FileError):
        load_requirement(tmp_path / "absent.yaml")


def test_every_mistake_of_a_file_is_told_at_once_with_its_line(tmp_path):
    path = tmp_path / "wrong.yaml"
    path.write_text("a:\n  title: A\n  text: A\n  metric: dto\n  limt: 3\nb:\n  title: B\n  metric: dto\nc: 7\n")
    with pytest.raises(DocumentError) as caught:
        load_requirements(path)
    assert {5, 6, 9} <= {problem.line for problem in caught.value.problems}
    assert {problem.path for problem in caught.value.problems} == {path}


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("a: {title: A, text: A, metric: dto, formula: always (speed < 1)}", ("a",)),
        # A guess of the direction could turn the verdict round.
        ("a: {title: A, text: A, metric: jerk, limit: 3}", ("a", "worse")),
    ],
)
def test_a_requirement_without_one_measure_or_its_direction_is_refused(text, key, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(DocumentError, check=at_key(*key)):
        load_requirement(path)


@pytest.mark.parametrize(
    ("measure", "bad"), [("metric: jerk, limit: 3, worse: larger", 4.0), ("formula: always speed < 1", -0.1)]
)
def test_a_direction_or_a_formula_says_what_violates(measure, bad, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(f"a: {{title: A, text: A, {measure}}}")
    assert load_requirement(path).violated_by(bad)


def test_r1_says_that_only_people_are_measured_in_words_that_no_prompt_holds():
    r1 = shipped_requirements()["R1"]
    assert "Only people are measured" in r1.note and "not the nearest approach" in r1.note
    assert r1.note not in "".join(str(value) for value in requirement_facts(r1).values())
    page = Path(__file__).parents[2] / "docs" / "reference" / "requirements.md"
    assert r1.note in page.read_text(encoding="utf-8")


def test_a_mistake_in_one_requirement_of_a_file_blocks_no_other(tmp_path):
    path = tmp_path / "mine.yaml"
    sound = "b: {title: B, text: B, metric: min_distance, worse: smaller, limit: 1}\n"
    path.write_text(f"a: {{title: A, text: A, metric: dto, limt: 3, worse: sideways}}\n{sound}c: 7\n")
    assert load_requirement(f"{path}#b").limit == 1
    with pytest.raises(DocumentError) as caught:
        load_requirement(f"{path}#a")
    assert {problem.line for problem in caught.value.problems} == {1}


@pytest.mark.parametrize(
    ("measure", "said"),
    [
        ("metric: min_distance, worse: smaller, limit: 500", "every run violates it"),
        ("metric: min_distance, worse: smaller, limit: -200", "no run can violate it"),
        ("metric: tnm, worse: larger, limit: 4000", "no run can violate it"),
        ("formula: always distance_to_person > -1000", "no run can violate it"),
        ("formula: always speed >= 0", "no run can violate it"),
        ("formula: always (distance_to_person < 400 or time > 3)", "no run can violate it"),
        ("formula: eventually distance_to_goal > 900", "every run violates it"),
        ("metric: min_distance, worse: smaller, limit: 0.5", ""),
        ("formula: always (x < 20 and acceleration > -4)", ""),
        ("formula: 'speed < 0.2 until distance_to_person > 1'", ""),
        ("formula: 'always abs(x - y) < 30 * max(speed, 1)'", ""),
    ],
)
def test_a_limit_that_map_robot_or_time_limit_rule_out_is_told(measure, said, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(f"a: {{title: A, text: A, {measure}}}")
    world = load_world("warehouse")
    doubts = list(doubts_of(load_requirement(path), Mission.of(world, world.routes[0]), world))
    assert [said in doubt for doubt in doubts] == [True] * bool(said), doubts


def test_the_shipped_requirements_can_be_violated_and_kept_everywhere():
    for name in shipped_worlds():
        world = load_world(name)
        for route in world.routes:
            for requirement in shipped_requirements().values():
                mission = Mission.of(world, route)
                limited = requirement.for_time_limit(route.time_limit_s)
                assert not list(doubts_of(limited, mission, world))
