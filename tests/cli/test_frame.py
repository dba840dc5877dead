import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
import typer

from rvsg.cli import main, verbs
from rvsg.cli.console import as_started
from rvsg.cli.frame import Verb, command_line, full_command, verb
from rvsg.core.errors import BudgetSpent, InputError, Interrupted

PROBE = {"probe": Verb("rvsg.cli._probe", "A verb for this test")}


@pytest.fixture
def probe(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A verb module whose behaviour the argument chooses."""
    module = ModuleType("rvsg.cli._probe")
    module.app = verb()

    @module.app.command()
    def probe(kind: str) -> None:
        """Probe."""
        if kind == "ok":
            return
        raise {
            "input": InputError("the file is empty"),
            "stopped": Interrupted("stopped by you"),
            "budget": BudgetSpent("no money left"),
            "keyboard": KeyboardInterrupt(),
            "defect": ZeroDivisionError("oops"),
            "violated": typer.Exit(1),
        }[kind]

    monkeypatch.setitem(sys.modules, "rvsg.cli._probe", module)
    return module


@pytest.mark.parametrize(
    ("kind", "code"),
    [("ok", 0), ("violated", 1), ("input", 2), ("stopped", 3), ("budget", 3), ("keyboard", 3), ("defect", 4)],
)
def test_every_end_has_its_exit_code(probe: ModuleType, kind: str, code: int) -> None:
    assert command_line(PROBE, ["probe", kind]) == code


def test_a_user_error_is_one_message_without_a_traceback(probe: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    command_line(PROBE, ["probe", "input"])
    captured = capsys.readouterr()
    assert captured.err == "Error: the file is empty\n"
    assert captured.out == ""


@pytest.mark.parametrize(
    ("program", "search_path", "typed"),
    [
        ("{here}/.venv/bin/rvsg", "/usr/bin", ".venv/bin/rvsg run --seed 0"),
        (".venv/bin/rvsg", "/usr/bin", ".venv/bin/rvsg run --seed 0"),
        ("{here}/.venv/bin/rvsg", "{here}/.venv/bin", "rvsg run --seed 0"),
        ("{here}/rvsg", "/usr/bin", "./rvsg run --seed 0"),
        ("/opt/my tools/rvsg", "/usr/bin", "'/opt/my tools/rvsg' run --seed 0"),
        ("{here}/src/rvsg/__main__.py", "/usr/bin", ".venv/bin/python -m rvsg run --seed 0"),
        ("{here}/src/rvsg/__main__.py", "{here}/.venv/bin", "python -m rvsg run --seed 0"),
        ("/usr/lib/pytest/__main__.py", "/usr/bin", "rvsg run --seed 0"),
    ],
)
def test_a_command_that_is_told_begins_as_this_one_was_begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, search_path: str, typed: str
) -> None:
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    for name in ("rvsg", "python"):
        (tmp_path / ".venv" / "bin" / name).symlink_to("/bin/sh")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", search_path.format(here=tmp_path))
    monkeypatch.setattr(sys, "argv", [program.format(here=tmp_path)])
    monkeypatch.setattr(sys, "executable", str(tmp_path / ".venv" / "bin" / "python"))
    assert as_started("rvsg run --seed 0") == typed


def test_debug_shows_the_traceback(probe: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    command_line(PROBE, ["--debug", "probe", "defect"])
    assert "Traceback" in capsys.readouterr().err


def test_a_defect_says_how_to_see_more_and_where_to_report(
    probe: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    command_line(PROBE, ["probe", "defect"])
    message = capsys.readouterr().err
    assert "Traceback" not in message
    assert "rvsg --debug probe defect" in message
    assert "report" in message


def test_a_misspelt_verb_is_a_usage_error_that_suggests(probe: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line(PROBE, ["prob"]) == 2
    assert "Did you mean 'probe'" in capsys.readouterr().err


def test_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    import rvsg

    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"{rvsg.__version__}\n"


@pytest.mark.parametrize("name", sorted(verbs()))
def test_every_verb_of_the_table_loads_and_helps(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert full_command(verbs(), name).name == name
    assert main([name, "--help"]) == 0
    assert "Usage: rvsg " + name in capsys.readouterr().out


@pytest.mark.slow
def test_help_answers_fast_and_loads_no_backend() -> None:
    """0.5 s is the promise; what is asserted is processor time, which a busy machine stretches less than a clock."""
    code = (
        "import sys; from rvsg.cli import main; main(['--help']);"
        "print([m for m in ('numpy', 'numba', 'sqlalchemy', 'pydantic_ai', 'scipy', 'pydantic') if m in sys.modules])"
    )
    times = []
    for _ in range(3):
        before = os.times()
        out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        after = os.times()
        times.append(after.children_user + after.children_system - before.children_user - before.children_system)
    assert out.splitlines()[-1] == "[]"
    assert min(times) < 1.0
