"""Commands as they are typed."""

from __future__ import annotations

import json
from typing import Any

import pytest

from rvsg.cli import main
from rvsg.core.errors import RvsgError


def words_of(*parts: object) -> list[str]:
    """Return the words of a command; strings among its parts are split into words.

    Lists hold defaults: an option of one counts only where nothing gives it again.
    """
    words: list[str] = []
    for part in parts:
        words += part.split() if isinstance(part, str) else part if isinstance(part, list) else [str(part)]
    defaults = {word for part in parts if isinstance(part, list) for word in part if word.startswith("--")}
    for option in defaults - SEVERAL:
        while words.count(option) > 1:
            first = words.index(option)
            value = first + 1 < len(words) and not words[first + 1].startswith("--")
            del words[first : first + 1 + value]
    return words


SEVERAL = {"--route", "--requirement", "--vary", "--stack", "--robot", "--door", "--metric", "--also"}
"""Options that take several values in some verb."""


def rvsg(*parts: object, code: int = 0) -> None:
    """Run a command and check its exit code."""
    assert main(words_of(*parts)) == code, words_of(*parts)


class Terminal:
    """Runs commands in a folder of their own; holds what the last one printed."""

    def __init__(self, capsys: pytest.CaptureFixture[str], errors: list[RvsgError]) -> None:
        self._capsys, self._errors = capsys, errors
        self.out = self.err = ""

    def __call__(self, *parts: object, code: int = 0) -> str:
        """Run a command, check its exit code, and return what it says on standard error."""
        self._capsys.readouterr()
        self._errors.clear()
        ended = main(words_of(*parts))
        self.out, self.err = self._capsys.readouterr()
        assert ended == code, (words_of(*parts), self.err)
        assert "Traceback" not in self.err
        return self.err

    def json(self, *parts: object) -> Any:
        """Run a command with `--json` and return what it prints on standard output."""
        self(*parts, "--json")
        return json.loads(self.out)

    @property
    def error(self) -> Any:
        """The error that the last command ended with; None where its options could not be read."""
        return self._errors[-1] if self._errors else None

    def refused(self, *parts: object) -> Any:
        """Run a command that is refused, and return the error that it ends with."""
        self(*parts, code=2)
        return self.error
