from pathlib import Path

import pytest
from tests.coded import at_key

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


def test_a_file_of_one_requirement_is_loaded_by_its_path(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "berth:\n  title: Wide berth\n  text: Stay away.\n  metric: min_distance\n  worse: smaller\n  limit: 0.5\n"
    )
    assert load_requirement(path).limit == 0.5
    assert load_requirement(f"{path}:berth") == load_requirement(f"{path}#berth") == load_requirement(path)
    with pytest.raises(UnknownName) as caught:
        load_requirement(f"{path}:birth")
    assert (caught.value.name, caught.value.nearest) == ("birth", "berth")


def test_every_mistake_of_a_file_is_told_at_once_with_its_line(tmp_path):
    path = tmp_path / "wrong.yaml"
    path.write_text("a:\n  title: A\n  text: A\n  metric: dto\n  limt: 3\nb:\n  title: B\n  metric: dto\nc: 7\n")
    with pytest.raises(FileError) as caught:
        load_requirements(path)
    assert isinstance(caught.value, DocumentError)
    assert {5, 6, 9} <= {problem.line for problem in caught.value.problems}
    assert {problem.path for problem in caught.value.problems} == {path}


def test_metric_and_formula_together_are_refused(tmp_path):
    path = tmp_path / "wrong.yaml"
    path.write_text("a: {title: A, text: A, metric: dto, formula: always (speed < 1)}\n")
    with pytest.raises(DocumentError, check=at_key("a")):
        load_requirements(path)


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(UnknownName) as caught:
        load_requirement("clearence")
    assert caught.value.nearest == "clearance"


def test_a_missing_file_is_said_to_be_missing(tmp_path):
    with pytest.raises(FileError):
        load_requirement(tmp_path / "absent.yaml")


def test_r1_says_that_only_people_are_measured_in_words_that_no_prompt_holds():
    r1 = shipped_requirements()["R1"]
    assert "Only people are measured" in r1.note and "not the nearest approach" in r1.note
    assert r1.note not in "".join(str(value) for value in requirement_facts(r1).values())
    page = Path(__file__).parents[2] / "docs" / "reference" / "requirements.md"
    assert r1.note in page.read_text(encoding="utf-8")
