"""What the tests of the command line share."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from tests.cli.commands import Terminal

from rvsg.cli import frame
from rvsg.core.errors import RvsgError


@pytest.fixture
def errors(monkeypatch: pytest.MonkeyPatch) -> list[RvsgError]:
    """The errors that commands end with, in order: their code and fields are what a test asserts."""
    tell, found = frame._tell, []

    def noted(text: str) -> None:
        error = sys.exc_info()[1]
        found.extend([error] if isinstance(error, RvsgError) else [])
        tell(text)

    monkeypatch.setattr(frame, "_tell", noted)
    return found


@pytest.fixture
def terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], errors: list[RvsgError]
) -> Terminal:
    """A terminal in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return Terminal(capsys, errors)
