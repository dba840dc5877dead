"""A requirement of a user's file is read as it is meant, or refused at the line and key that is wrong."""

from pathlib import Path
from typing import Any

import pytest
from tests.coded import at_key

from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError
from rvsg.evaluation.metrics import METRICS
from rvsg.evaluation.verdict import check_requirement, load_requirement
from rvsg.scenario.requirement import shipped_requirements

WRONG = """wide:
  title: Wide
  text: Keep off.
  formula: >-
    always (distance_to_person > 0.5
      or sped < 0.1)
slow:
  title: Slow
  text: Be slow.
  metric: spped
  worse: larger
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    return path


def of(tmp_path: Path, said: str) -> str:
    """A requirement that says `key: value; key: value` besides its title and text."""
    lines = ["near:", "title: Near", "text: Keep away.", *said.split("; ")]
    path = written(tmp_path, "\n  ".join(lines))
    return f"{path}#near"


def test_a_wrong_formula_is_told_with_its_line_and_character(tmp_path: Path) -> None:
    with pytest.raises(DocumentError) as caught:
        load_requirement(f"{written(tmp_path, WRONG)}:wide")
    problems = caught.value.problems
    assert [(each.line, each.key) for each in problems] == [(4, ("wide", "formula"))]
    assert "(at character 37)" in problems[0].message


def test_a_mistake_blocks_what_it_is_about(tmp_path: Path) -> None:
    path = written(tmp_path, WRONG.replace("sped", "speed"))
    read = load_requirement(f"{path}:wide").formula
    assert read is not None and " ".join(read.split()) == "always (distance_to_person > 0.5 or speed < 0.1)"
    with pytest.raises(FileError) as caught:
        load_requirement(f"{path}#slow")
    assert [problem.line for problem in caught.value.problems] == [10]
    path.write_text(path.read_text().replace("spped", "speed") + "  limt: 3\n")
    assert load_requirement(f"{path}#wide").formula == read
    with pytest.raises(FileError):
        load_requirement(f"{path}#slow")


@pytest.mark.parametrize(
    ("said", "line", "key"),
    [
        ("metric: min_distance; worse: smaller; limit: 30; unit: cm", 7, "unit"),
        ("metric: min_distance; worse: larger; limit: 0.3; unit: m", 5, "worse"),
        ("metric: min_distance; worse: smaller; limit_share: 0.9", 6, "limit_share"),
    ],
)
def test_what_does_not_fit_the_metric_is_refused_at_its_line(tmp_path: Path, said: str, line: int, key: str) -> None:
    with pytest.raises(DocumentError) as caught:
        load_requirement(of(tmp_path, said))
    (problem,) = caught.value.problems
    assert (problem.path.name, problem.line, problem.key) == ("mine.yaml", line, ("near", key))


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ("metric: min_distance; worse: smaller; limit: 0.3", {"unit": "m"}),
        ("metric: jerk; worse: larger; limit: 3; unit: m/s3", {"unit": "m/s³"}),
        ("metric: jerk; worse: larger; limit: 3; unit: m/s^3", {"unit": "m/s³"}),
        ("metric: jerk; worse: larger; limit: 3; unit: m/s³", {"unit": "m/s³"}),
        ("metric: speed; worse: smaller; limit: 0.3", {"worse": "smaller"}),
        ("metric: speed; worse: larger; limit: 0.3", {"worse": "larger"}),
        ("metric: standstill; worse: larger; limit_share: 0.5", {"limit": 10.0}),
        ("formula: always speed < 1; unit: m/s", {"unit": "m/s"}),
    ],
)
def test_what_fits_the_metric_is_read(tmp_path: Path, said: str, expected: dict[str, Any]) -> None:
    read = load_requirement(of(tmp_path, said)).for_time_limit(20.0)
    assert {key: getattr(read, key) for key in expected} == expected


def test_every_shipped_requirement_fits_its_metric_as_it_stands() -> None:
    shipped = shipped_requirements()
    assert [check_requirement(each) for each in shipped.values()] == list(shipped.values())


def test_every_unit_can_be_written_as_the_message_says(tmp_path: Path) -> None:
    for info in METRICS.values():
        said = f"metric: {info.id}; worse: {'smaller' if info.worse == 'neither' else info.worse}; unit: "
        with pytest.raises(DocumentError, check=at_key("near", "unit")) as caught:
            load_requirement(of(tmp_path, f"{said}furlong"))
        unit = str(caught.value).split("`unit: ")[1].split("`")[0]
        assert load_requirement(of(tmp_path, f"{said}{unit}")).unit == info.unit
