from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.coded import coded
from tests.evaluation.runs import run_of, trajectory

from rvsg.core import plugins
from rvsg.core.errors import InputError, UnknownName
from rvsg.evaluation.metrics.metric import Metric
from rvsg.evaluation.metrics.registry import BUILT_IN, METRICS, measure
from rvsg.evaluation.signals import SIGNALS, RunSignal, formula, robustness

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "metrics.md"
T = np.arange(0.0, 2.001, 0.05)
REVERSING = trajectory(T, 0.0, v=np.where(T > 1.0, -0.2, 0.2))


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Any]]:
    """Plug-ins by name; the registries read them anew."""
    known: dict[str, Any] = {}
    monkeypatch.setattr(plugins, "names", lambda kind: tuple(sorted(known)))
    monkeypatch.setattr(plugins, "find", lambda kind, name: known[name])
    for registry in (METRICS, SIGNALS):
        monkeypatch.setattr(registry, "_all", None)
    formula.cache_clear()
    yield known
    formula.cache_clear()


def documented() -> Metric:
    names: dict[str, Any] = {}
    exec(re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1], names)  # type: ignore[index]
    return names["REVERSING"]


def test_the_documented_metric_measures_as_a_plug_in(installed: dict[str, Any]) -> None:
    installed["reversing"] = documented()
    assert list(METRICS)[-1] == "reversing"
    assert measure(run_of(REVERSING), ["reversing"])["reversing"] == pytest.approx(1.0, abs=0.06)


def test_a_plug_in_may_give_several_metrics(installed: dict[str, Any]) -> None:
    one = documented()
    installed["pack"] = (one, Metric(**{**vars(one), "id": "other"}))
    assert {"reversing", "other"} <= set(METRICS)


@pytest.mark.parametrize("wrong", ["text", 7, [object()]])
def test_a_plug_in_that_is_no_metric_is_named(wrong: object, installed: dict[str, Any]) -> None:
    installed["wrong"] = wrong
    with pytest.raises(InputError, check=coded("plug-in-kind")):
        list(METRICS)


def test_a_plug_in_cannot_take_the_id_of_another(installed: dict[str, Any]) -> None:
    installed["mine"] = Metric(**{**vars(documented()), "id": "dto"})
    with pytest.raises(InputError, check=coded("plug-in-name-taken")):
        list(METRICS)


def test_what_ships_needs_no_plug_in_and_an_unknown_id_is_answered(installed: dict[str, Any]) -> None:
    assert METRICS["dto"] is BUILT_IN[0]
    with pytest.raises(UnknownName):
        METRICS.find("dtoo")


def test_a_signal_of_a_plug_in_can_be_named_in_a_formula(installed: dict[str, Any]) -> None:
    installed["backwards"] = RunSignal(id="backwards", title="speed in reverse", unit="m/s", of=lambda s: -s.series.v)
    assert robustness(run_of(REVERSING), "always backwards < 0.5") == pytest.approx(0.3)


def test_the_metrics_of_the_study_are_a_plug_in() -> None:
    assert "dto_logged" in METRICS and "dto_logged" not in {metric.id for metric in BUILT_IN}
