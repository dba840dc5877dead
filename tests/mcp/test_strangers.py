"""What an assistant may send: each wrong call says why, none overwrites a file, none runs anything."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp.server.mcpserver.exceptions import ToolError

from rvsg_mcp.tools import server

PLACE = {"world": "warehouse", "route": "route_1"}
PERSON = {"name": "Anna", "waypoints": ["E19", "E21"]}
SCENARIO = {"file": "a.json", "people": [PERSON]} | PLACE
BASE: dict[str, dict[str, Any]] = {
    "catalogue": {}, "show_world": {"world": "warehouse"}, "new_world": {"map_file": "a.yaml", "name": "hall"},
    "write_scenario": SCENARIO, "simulate": {"scenario": "a.json", "runs": 1}, "campaigns": {},
    "run_campaign": {"out": "first", "world": "warehouse", "route": "no"}, "findings": {"campaign": "first"},
    "keep": {"suite": "suite", "scenario": "a.json", "requirement": "R1"}, "run_suite": {"suite": "suite"},
}  # fmt: skip
WRONG = ("a\0b", "../..", "loop", "z" * 5000, "\ud800", {}, "ledger.sqlite")


def refusal(folder: Path, name: str, arguments: dict[str, Any]) -> str:
    """Return why a tool refuses a call; empty where it does not."""
    try:
        anyio.run(server(folder).call_tool, name, arguments)
    except ToolError as error:
        return str(error)
    return ""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "ledger.sqlite").write_bytes(b"kept")
    (tmp_path / "notes.json").write_text("{}")
    (tmp_path / "loop").symlink_to("loop")
    return tmp_path


@pytest.mark.parametrize("name", BASE)
def test_every_wrong_call_says_why(folder: Path, name: str) -> None:
    assert "has no argument 'colour'" in refusal(folder, name, BASE[name] | {"colour": "red"})
    for key in BASE[name]:
        for value in WRONG:
            if (name, key) == ("write_scenario", "people") and value == {}:
                continue
            said = refusal(folder, name, BASE[name] | {key: value})
            assert said and not said.endswith(f"executing tool {name}") and "in RVSG itself" not in said, (key, value)
    assert (folder / "ledger.sqlite").read_bytes() == b"kept" and not (folder / "here").exists()


def test_a_scenario_overwrites_nothing_but_a_scenario(folder: Path) -> None:
    for file in ("ledger.sqlite", "notes.json", "new.yaml"):
        assert refusal(folder, "write_scenario", SCENARIO | {"file": file})
    assert (folder / "notes.json").read_text() == "{}" and (folder / "ledger.sqlite").read_bytes() == b"kept"
    assert not refusal(folder, "write_scenario", SCENARIO) and not refusal(folder, "write_scenario", SCENARIO)


def test_a_stack_that_waits_for_other_programs_is_refused_at_once(folder: Path) -> None:
    assert not refusal(folder, "write_scenario", SCENARIO)
    assert "outside of RVSG" in refusal(folder, "simulate", {"scenario": "a.json", "stack": "ros2"})
