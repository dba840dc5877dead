"""Answers of a model, names and streams that no record, file system or terminal can hold."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from tests.fuzz.harness import received
from tests.fuzz.kinds import Kind, _answers, _read_answer, _scenario

HUGE = int("9" * 400)
LONE = "a\ud800b"


def answer(**changes: Any) -> dict[str, Any]:
    person = {
        "name": "Human 1",
        "speed_m_s": 1.2,
        "start_delay_s": 2,
        "group": 1,
        "behaviour": "regular",
        "tasks": [{"task": "a → b", "path": ["G7", "G8", "G9"], "pauses": [{"at": "G9", "duration_s": 3}]}],
    }
    return {"description": "x", "humans": [person | changes, {**person, "name": "Human 2"}]}


@pytest.mark.parametrize(
    "given",
    [
        *(answer(speed_m_s=HUGE), answer(start_delay_s=-HUGE), answer(group=HUGE), answer(speed_m_s=float("1e300"))),
        answer(tasks=[{"task": "a", "path": ["G7", "G9"], "pauses": [{"at": "G9", "duration_s": HUGE}]}]),
        *(answer(name=LONE), answer(behaviour=LONE), answer(**{LONE: 1}), answer() | {"description": LONE}),
        answer(tasks=[{"task": LONE, "path": ["G7", LONE], "pauses": []}]),
    ],
    ids=["speed", "delay", "group", "float", "pause", "name", "behaviour", "key", "description", "task"],
)
def test_an_answer_that_no_record_can_hold_is_received(given: dict[str, Any], tmp_path: Path) -> None:
    kind = Kind("answer", _answers, call=_read_answer)
    (tmp_path / "answer.txt").write_text(json.dumps(given))
    assert received(kind, tmp_path).finding == ""


def test_a_scenario_whose_world_has_an_endless_name_is_an_input_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from rvsg.cli import main

    value = json.loads(_scenario().to_json())
    value["mission"]["world"], value["mission"]["world_id"] = "w" * 5000, "world-0000000000000000"
    (tmp_path / "s.json").write_text(json.dumps(value))
    assert main(["simulate", str(tmp_path / "s.json")]) == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("sh") is None, reason="needs a shell")
@pytest.mark.parametrize("closed", [">&- 2>&-", "<&- >&-"])
def test_a_stream_that_is_closed_at_the_start_is_no_defect(closed: str) -> None:
    done = subprocess.run(
        ["sh", "-c", f"{sys.executable} -m rvsg evaluate --metric all {closed}"], capture_output=True, timeout=300
    )
    assert done.returncode in (0, 2) and b"Traceback" not in done.stderr
