"""Requirements that ship, and requirements of a user's file."""

from pathlib import Path

import pytest
from tests.coded import at_key, nearest

from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError, UnknownName
from rvsg.generation.facts import requirement_facts
from rvsg.scenario.requirement import load_requirement, load_requirements, shipped_requirements


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
