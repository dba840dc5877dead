"""`rvsg import study` as its user meets it."""

from __future__ import annotations

import json
from pathlib import Path

from tests.cli.commands import Terminal
from tests.study.study_files import lines_of, put, write_scenario

SCENARIO = Path("results/distance/route_1/0")
IMPORT = "import study results --out store"


def test_an_import_that_adds_to_a_store_keeps_what_was_found_before(terminal: Terminal) -> None:
    write_scenario(SCENARIO)
    (SCENARIO / "log.csv").unlink()
    terminal(IMPORT)
    first = Path("store/findings.csv").read_text()
    assert "log.csv" in first
    write_scenario(Path("results/jerk/route_1/0"))
    Path("results/notes").mkdir()
    terminal(IMPORT)
    again = Path("store/findings.csv").read_text()
    assert again.startswith(first)
    assert again.count("notes,layout") == 1
    terminal(IMPORT)
    assert Path("store/findings.csv").read_text() == again


def test_a_store_made_anew_does_not_take_over_findings_of_another(terminal: Terminal) -> None:
    write_scenario(SCENARIO)
    Path("store").mkdir()
    Path("store/findings.csv").write_text("file,kind,message\nold,log,gone\n")
    terminal(IMPORT)
    assert "old,log,gone" not in Path("store/findings.csv").read_text()


def test_a_folder_of_another_layout_leaves_no_store_behind(terminal: Terminal) -> None:
    Path("results/x").mkdir(parents=True)
    assert terminal.refused(IMPORT).code == "study-layout"
    assert not Path("store").exists()


def test_a_logged_metric_that_is_missing_is_a_finding_but_no_difference(terminal: Terminal) -> None:
    write_scenario(SCENARIO, configurations=3)
    log = SCENARIO / "log.csv"
    lines = lines_of(log)
    lines[1][lines[0].index("path_length")] = "nan"
    put(log, lines)
    terminal("import study results --out a")
    done = json.loads(terminal.out)
    assert done["findings_by_kind"] == {"metrics": 1}
    assert done["compared"] and not done["differing"]
    lines[2][lines[0].index("path_length")] = "9.5"
    put(log, lines)
    terminal("import study results --out b")
    assert json.loads(terminal.out)["differing"] == 1
