import pytest

from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError
from rvsg.evaluation.verdict import load_requirement

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


def test_a_wrong_formula_is_told_with_its_line_and_character(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(WRONG)
    with pytest.raises(DocumentError) as caught:
        load_requirement(f"{path}:wide")
    problems = caught.value.problems
    assert [(each.line, each.key) for each in problems] == [(4, ("wide", "formula")), (10, ("slow", "metric"))]
    assert "(at character 37)" in problems[0].message


def test_a_sound_formula_of_a_file_is_read(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(WRONG.replace("sped", "speed").replace("spped", "speed"))
    read = load_requirement(f"{path}:wide").formula
    assert read is not None and read.split() == [
        "always",
        "(distance_to_person",
        ">",
        "0.5",
        "or",
        "speed",
        "<",
        "0.1)",
    ]


def test_an_unknown_metric_blocks_the_requirement_that_asks_for_it_alone(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(WRONG.replace("sped", "speed"))
    assert load_requirement(f"{path}#wide").name == "wide"
    with pytest.raises(FileError) as caught:
        load_requirement(f"{path}#slow")
    assert [problem.line for problem in caught.value.problems] == [10]


def test_a_mistake_that_is_not_about_measuring_blocks_the_whole_file(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(WRONG.replace("sped", "speed").replace("spped", "speed") + "  limt: 3\n")
    with pytest.raises(FileError):
        load_requirement(f"{path}#wide")
