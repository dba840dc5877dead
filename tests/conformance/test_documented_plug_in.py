"""The plug-in shown in the documentation passes the exam shown there, and the exam can be failed."""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from rvsg.cli import main
from rvsg.core import plugins

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "write-a-plug-in.md"


@pytest.fixture
def plug_in(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module of the first example, under the name by which the second imports it."""
    module = ModuleType("my_package.strategies")
    exec(blocks()[0], module.__dict__)
    monkeypatch.setitem(sys.modules, "my_package", ModuleType("my_package"))
    monkeypatch.setitem(sys.modules, "my_package.strategies", module)
    return module


def blocks() -> list[str]:
    """The Python examples of the page."""
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)


def exam() -> Callable[[], None]:
    """The test of the second example."""
    names: dict[str, Callable[[], None]] = {}
    exec(blocks()[1], names)
    return names["test_twice_keeps_the_promises_of_a_strategy"]


def test_the_documented_strategy_passes_the_documented_exam(plug_in: ModuleType) -> None:
    exam()()


def test_a_strategy_that_forgets_what_it_was_told_fails_the_documented_exam(
    plug_in: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plug_in.TwiceStrategy, "ask", lambda self: ())
    with pytest.raises(AssertionError, match="it asks for nothing at all"):
        exam()()


@pytest.mark.parametrize("kind", ["generator", "strategy", "simulator", "executor", "store"])
def test_the_help_of_run_names_what_ships_and_says_that_a_plug_in_counts(
    kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["run", "--help-all"])
    found = re.search(rf"^  --{kind} .*?(?=^  -)", capsys.readouterr().out, re.MULTILINE | re.DOTALL)
    assert found is not None
    option = " ".join(found[0].split())
    assert all(name in option for name in plugins.names(kind)), option
    assert "a plug-in" in option
