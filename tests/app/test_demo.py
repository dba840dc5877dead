from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from rvsg.app.cli import main
from rvsg.app.demos import CAMPAIGN, demo_folder, demos


def test_a_recorded_campaign_runs_without_a_model_and_says_what_differs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RVSG_DATA_DIR", str(tmp_path / "data"))
    out = tmp_path / "demo"
    code = main(
        [
            "demo",
            "warehouse-route_1-R1-draws",
            "--out",
            str(out),
            "--repeats",
            "1",
            "--confirmations",
            "0",
            "--jobs",
            "1",
            "--json",
        ]
    )
    captured = capsys.readouterr()
    assert code == 0, captured.err
    result = json.loads(captured.out)
    assert result["accounting"]["calls"] == 3
    assert len(result["ranking"]) == 3
    assert not (out / "vlm").exists()


def test_demos_are_listed_and_a_wrong_name_is_answered(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--list"]) == 0
    assert capsys.readouterr().out.split() == list(demos())
    assert main(["demo", "warehouse-route_1-R7"]) == 2
    assert "Did you mean" in capsys.readouterr().err


def test_recorded_campaigns_hold_no_pictures_keys_or_paths_of_a_machine() -> None:
    for name in demos():
        folder = demo_folder(name)
        assert {path.name for path in folder.iterdir()} == {CAMPAIGN, "calls.jsonl", "messages.jsonl"} | (
            {"histories.jsonl"} & {path.name for path in folder.iterdir()}
        )
        text = "".join(path.read_text() for path in folder.iterdir())
        assert not re.search(r"sk-|/home/|/root/|/work|127\.0\.0\.1", text)
        assert len(text) < 400_000
