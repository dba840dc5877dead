"""`rvsg import study` as its user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.study.study_files import lines_of, put, write_scenario

from rvsg.cli import main
from rvsg.core.errors import RvsgError


def test_an_import_that_adds_to_a_store_keeps_what_was_found_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results, out = tmp_path / "results", tmp_path / "store"
    write_scenario(results / "distance" / "route_1" / "0")
    (results / "distance" / "route_1" / "0" / "log.csv").unlink()
    command = ["import", "study", str(results), "--out", str(out)]
    assert main(command) == 0
    first = (out / "findings.csv").read_text()
    assert "log.csv" in first
    write_scenario(results / "jerk" / "route_1" / "0")
    (results / "notes").mkdir()
    assert main(command) == 0
    again = (out / "findings.csv").read_text()
    assert again.startswith(first)
    assert again.count("notes,layout") == 1
    assert main(command) == 0
    assert (out / "findings.csv").read_text() == again


def test_a_store_made_anew_does_not_take_over_findings_of_another(tmp_path: Path) -> None:
    results, out = tmp_path / "results", tmp_path / "store"
    write_scenario(results / "distance" / "route_1" / "0")
    out.mkdir()
    (out / "findings.csv").write_text("file,kind,message\nold,log,gone\n")
    assert main(["import", "study", str(results), "--out", str(out)]) == 0
    assert "old,log,gone" not in (out / "findings.csv").read_text()


def test_a_folder_of_another_layout_leaves_no_store_behind(tmp_path: Path, errors: list[RvsgError]) -> None:
    (tmp_path / "other" / "x").mkdir(parents=True)
    assert main(["import", "study", str(tmp_path / "other"), "--out", str(tmp_path / "store")]) == 2
    assert errors[-1].code == "study-layout"
    assert not (tmp_path / "store").exists()


def test_a_logged_metric_that_is_missing_is_a_finding_but_no_difference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "results" / "distance" / "route_1" / "0" / "log.csv"
    write_scenario(log.parent, configurations=3)
    lines = lines_of(log)
    lines[1][lines[0].index("path_length")] = "nan"
    put(log, lines)
    assert main(["import", "study", str(tmp_path / "results"), "--out", str(tmp_path / "a")]) == 0
    done = json.loads(capsys.readouterr().out)
    assert done["findings_by_kind"] == {"metrics": 1}
    assert done["compared"] and not done["differing"]
    lines[2][lines[0].index("path_length")] = "9.5"
    put(log, lines)
    assert main(["import", "study", str(tmp_path / "results"), "--out", str(tmp_path / "b")]) == 0
    assert json.loads(capsys.readouterr().out)["differing"] == 1
