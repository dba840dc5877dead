"""`rvsg --explain CODE`: every code of an error or finding has an explanation, read from the source."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from tests.architecture.size import sources as files

from rvsg.cli import main
from rvsg.cli.codes import explanation, sources
from rvsg.core import errors


def test_an_error_shows_its_code_and_the_code_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--route", "route_99"]) == 2
    shown = re.match(r"Error \[([a-z-]+)\]: ", capsys.readouterr().err)
    assert shown and shown[1] == "unknown-name"
    assert main(["--explain", shown[1]]) == 0
    told = capsys.readouterr().out
    assert told.startswith("# `unknown-name`\n\n`UnknownName`: A name that is not among those known")


def test_an_explanation_holds_message_check_and_next_step() -> None:
    told = explanation("out-occupied")
    assert "> this folder holds no campaign but other files (…)" in told
    assert "Reported by `rvsg.app.folder." in told
    assert told.endswith("## What to do\n\n- Choose a new or an empty folder as --out.\n")


def test_a_mistyped_code_is_refused_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--explain", "out-ocupied"]) == 2
    assert 'Did you mean "out-occupied"?' in capsys.readouterr().err


def test_every_code_is_found() -> None:
    written = {code for path in files() for code in re.findall(r'\bcode="([a-z0-9-]+)"', path.read_text("utf-8"))}
    classes = {each.code for each in vars(errors).values() if isinstance(each, type) and hasattr(each, "code")}
    assert len(written) > 100
    assert written | classes <= sources().keys()
    assert {"unknown-waypoint", "areas-none", "pose-outside", "formula-signal", "sdf-size"} <= sources().keys()


def test_explaining_needs_no_simulator() -> None:
    program = (
        "import sys; from rvsg.cli import main; main(['--explain', 'yaml']); print(sorted({'numba'} & {*sys.modules}))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("[]\n")
