"""A metric of a user's requirement says itself in which direction it is worse."""

from pathlib import Path

import pytest
from tests.coded import at_key

from rvsg.core.documents import DocumentError
from rvsg.scenario.requirement import load_requirement

SMOOTH = "smooth: {title: Smooth, text: No jerks., metric: jerk, limit: 3%s}\n"


def test_a_metric_without_a_direction_is_refused_because_a_guess_could_turn_the_verdict_round(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(SMOOTH % "")
    with pytest.raises(DocumentError, check=at_key("smooth", "worse")):
        load_requirement(path)
    path.write_text(SMOOTH % ", worse: larger")
    assert load_requirement(path).violated_by(4.0)


def test_a_formula_needs_no_direction(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("slow: {title: Slow, text: Be slow., formula: always speed < 1}\n")
    assert load_requirement(path).violated_by(-0.1)
