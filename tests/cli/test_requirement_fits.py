"""A requirement of a user's file speaks of its metric: in its unit, in its direction."""

from pathlib import Path

import pytest
from tests.coded import at_key

from rvsg.core.documents import DocumentError
from rvsg.evaluation.metrics.registry import METRICS
from rvsg.evaluation.verdict import check_requirement, load_requirement
from rvsg.scenario.requirement import shipped_requirements


def of(tmp_path: Path, said: str) -> str:
    path = tmp_path / "mine.yaml"
    path.write_text(f"near:\n  title: Near\n  text: Keep away.\n{said}")
    return f"{path}#near"


def test_a_limit_in_another_unit_than_the_metrics_is_refused_at_its_line(tmp_path: Path) -> None:
    asked = of(tmp_path, "  metric: min_distance\n  worse: smaller\n  limit: 30\n  unit: cm\n")
    with pytest.raises(DocumentError) as caught:
        load_requirement(asked)
    (problem,) = caught.value.problems
    assert (problem.path.name, problem.line, problem.key) == ("mine.yaml", 7, ("near", "unit"))


def test_a_missing_unit_is_that_of_the_metric(tmp_path: Path) -> None:
    assert load_requirement(of(tmp_path, "  metric: min_distance\n  worse: smaller\n  limit: 0.3\n")).unit == "m"


@pytest.mark.parametrize("unit", ["m/s3", "m/s^3", "m/s³"])
def test_a_unit_may_be_typed_without_superscripts(tmp_path: Path, unit: str) -> None:
    asked = of(tmp_path, f"  metric: jerk\n  worse: larger\n  limit: 3\n  unit: {unit}\n")
    assert load_requirement(asked).unit == "m/s³"


def test_a_direction_against_that_of_the_metric_is_refused(tmp_path: Path) -> None:
    asked = of(tmp_path, "  metric: min_distance\n  worse: larger\n  limit: 0.3\n  unit: m\n")
    with pytest.raises(DocumentError, check=at_key("near", "worse")):
        load_requirement(asked)


def test_a_metric_without_a_direction_of_its_own_takes_both(tmp_path: Path) -> None:
    for worse in ("smaller", "larger"):
        asked = of(tmp_path, f"  metric: speed\n  worse: {worse}\n  limit: 0.3\n")
        assert load_requirement(asked).worse == worse


def test_a_share_of_the_time_limit_is_for_seconds(tmp_path: Path) -> None:
    asked = of(tmp_path, "  metric: min_distance\n  worse: smaller\n  limit_share: 0.9\n")
    with pytest.raises(DocumentError, check=at_key("near", "limit_share")):
        load_requirement(asked)
    timely = of(tmp_path, "  metric: standstill\n  worse: larger\n  limit_share: 0.5\n")
    assert load_requirement(timely).for_time_limit(20.0).limit == 10.0


def test_a_formula_keeps_the_unit_it_is_given(tmp_path: Path) -> None:
    assert load_requirement(of(tmp_path, "  formula: always speed < 1\n  unit: m/s\n")).unit == "m/s"


def test_every_shipped_requirement_fits_its_metric_as_it_stands() -> None:
    shipped = shipped_requirements()
    assert [check_requirement(each) for each in shipped.values()] == list(shipped.values())


def test_every_unit_can_be_written_as_the_message_says(tmp_path: Path) -> None:
    for info in METRICS.values():
        worse = "smaller" if info.worse == "neither" else info.worse
        said = f"  metric: {info.id}\n  worse: {worse}\n  unit: "
        with pytest.raises(DocumentError, check=at_key("near", "unit")) as caught:
            load_requirement(of(tmp_path, f"{said}furlong\n"))
        unit = str(caught.value).split("`unit: ")[1].split("`")[0]
        assert load_requirement(of(tmp_path, f"{said}{unit}\n")).unit == info.unit
