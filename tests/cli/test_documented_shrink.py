"""The example in docs/how-to/shrink-a-scenario.md: its commands print what the page shows."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from rvsg.cli import main

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "shrink-a-scenario.md"


@pytest.mark.exhaustive
def test_the_commands_print_what_the_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    block = re.search(r"```console\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert block is not None
    lines = block[1].splitlines()
    commands = [line.removeprefix("$ rvsg ") for line in lines if line.startswith("$ rvsg ")]
    shown = [line for line in lines if not line.startswith("$")]
    (tmp_path / "examples").symlink_to(PAGE.parents[2] / "examples")
    monkeypatch.chdir(tmp_path)
    for command in commands:
        capsys.readouterr()
        assert main(shlex.split(command)) == 0, command
    told = [line for line in capsys.readouterr().err.splitlines() if re.match(r"kept|no  |original|smallest", line)]
    assert told == shown, "the simulator changed: show on the page what the commands print now"
    assert len(shown) > 2
