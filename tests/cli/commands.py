"""Commands as they are typed."""

from __future__ import annotations

import json
from typing import Any

import pytest

from rvsg.cli import main


def rvsg(*parts: object, code: int = 0) -> None:
    """Run a command and check its exit code; strings among its parts are split into words, lists taken as they are."""
    words: list[str] = []
    for part in parts:
        words += part.split() if isinstance(part, str) else part if isinstance(part, list) else [str(part)]
    assert main(words) == code, words


def printed(capsys: pytest.CaptureFixture[str], *parts: object) -> Any:
    """Run a command with `--json` and return what it prints on standard output."""
    capsys.readouterr()
    rvsg(*parts, "--json")
    return json.loads(capsys.readouterr().out)
