"""A metric of a user's requirement says itself in which direction it is worse."""

from pathlib import Path

import pytest

from rvsg.core.errors import FileError
from rvsg.scenario.requirements import load_requirement

SMOOTH = "smooth: {title: Smooth, text: No jerks., metric: jerk, limit: 3%s}\n"


def test_a_metric_without_a_direction_is_refused_because_a_guess_could_turn_the_verdict_round(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(SMOOTH % "")
    with pytest.raises(FileError, match=r"mine\.yaml:1: smooth\.worse: is missing; say .* smaller or larger"):
        load_requirement(path)
    path.write_text(SMOOTH % ", worse: larger")
    assert load_requirement(path).violated_by(4.0)


def test_a_formula_needs_no_direction(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("slow: {title: Slow, text: Be slow., formula: always speed < 1}\n")
    assert load_requirement(path).violated_by(-0.1)
