from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.campaign.parts import warehouse
from tests.cli.commands import Terminal
from tests.conformance.test_campaign_parts import answered

from rvsg.app.proposal import draft_requirement
from rvsg.core.errors import GenerationError
from rvsg.evaluation.metrics import measure
from rvsg.evaluation.verdict import load_requirement
from rvsg.generation.vlm.access import ModelAccess
from rvsg.generation.vlm.call_log import CallLog
from rvsg.generation.vlm.model import Scripted
from rvsg.simulation.archive import run_to_json
from rvsg.simulation.kinematic import KinematicSimulator

WORDS = "It arrives in time"


def said(**changes: object) -> str:
    answer = {"name": "In time!", "title": "In time", "text": "The robot arrives.", "metric": "trg", "formula": ""}
    return json.dumps({**answer, "worse": "larger", "limit": 20, "source": "the words", **changes})


def test_what_cannot_be_measured_goes_back_and_is_corrected() -> None:
    wrong = said(metric="time"), said(worse="smaller")
    model = Scripted([*wrong, said()])
    made = draft_requirement(WORDS, model)
    assert (made.name, made.metric, made.worse, made.limit, made.unit) == ("in_time", "trg", "larger", 20.0, "s")
    asked = [request.messages[-1].text for request in model.asked]
    assert WORDS in asked[0] and "distance_to_person" in asked[0]
    assert "time" in asked[1] and "trg is worse when larger" in asked[2]
    made = draft_requirement(WORDS, Scripted([said(metric="", formula="always speed < 2", limit=None)]))
    assert made.formula == "always speed < 2" and made.violated_by(-0.1)
    with pytest.raises(GenerationError, match="no requirement in 3 answers"):
        draft_requirement(WORDS, Scripted([said(limit=None)] * 3))
    with pytest.raises(GenerationError, match="Nothing measures this requirement: no door is known"):
        draft_requirement(WORDS, Scripted([said(metric="", text="no door is known")]))


@pytest.mark.parametrize("accepts", [False, True])
def test_it_is_judged_over_stored_runs_and_nothing_is_written_before_it_is_accepted(
    accepts: bool, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = KinematicSimulator().run(answered(0)[2], warehouse(), seed=1)
    time_s = measure(run, ["trg"])["trg"]
    assert time_s is not None
    Path("runs.jsonl").write_text(run_to_json(run) + "\n")
    answers: Iterator[bool] = iter([accepts])
    monkeypatch.setattr("typer.confirm", lambda *_, **__: next(answers))
    access = ModelAccess(Scripted([said(limit=time_s - 1.0)]), recording=CallLog("record"))
    draft_requirement(WORDS, access)
    told = terminal(["scenario", "requirement", WORDS, "--replay", "record", "--runs", "runs.jsonl"])
    assert f"{run.id}: " in told and ", fails" in told and "No runs show both" in told
    assert Path("drafted.yaml").exists() == accepts
    plot = Path("drafted.svg").read_text()
    assert "Plot: drafted.svg" in told and f"{run.id}: {time_s:.3g}" in plot.replace("\N{NO-BREAK SPACE}", " ")
    if accepts:
        assert load_requirement("drafted.yaml#in_time").limit == pytest.approx(time_s - 1.0)
