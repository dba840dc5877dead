import pytest

from rvsg.api.requirements import load_requirement
from rvsg.core.errors import FileError

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
    with pytest.raises(FileError) as caught:
        load_requirement(f"{path}:wide")
    told = str(caught.value)
    assert f'{path}:4: wide.formula: there is no signal "sped". Did you mean "speed"?' in told
    assert "(at character 37)" in told
    assert f'{path}:10: slow.metric: There is no metric "spped"' in told


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
