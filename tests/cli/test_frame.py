import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer

import rvsg.cli
from rvsg.cli import MOVED, main, verbs
from rvsg.cli.console import as_started
from rvsg.cli.frame import GROUPS, MOST_OPTIONS, Verb, command_line, full_command, options_of, verb
from rvsg.core.errors import BudgetSpent, InputError, Interrupted

PROBE = {"probe": (Verb("rvsg.cli._probe", "A verb for this test"),)}


@pytest.mark.parametrize(
    "command",
    [
        "run --robot a --robot b",
        "evaluate --metric=dto --metric tnm x.jsonl",
        "scenario propose --seed 3 --seed 4",
        "export --to csv --to mcap --out x x.json",
        "--allow-code-from a run --allow-code-from b",
    ],
)
def test_an_option_of_one_value_is_given_once(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(command.split()) == 2
    assert "Error [option-twice]" in capsys.readouterr().err


def test_a_verb_of_an_absent_package_names_that_package(capsys: pytest.CaptureFixture[str]) -> None:
    some = {name: each for name, each in verbs().items() if name != "import"}
    some["import"] = (Verb("rvsg_exchange.verb:import_app", "Import"),)
    assert command_line(some, ["import", "study", "x"]) == 2
    assert "rvsg-study" in capsys.readouterr().err


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
    assert captured.err == "Error [input]: the file is empty\n"
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


def test_a_defect_says_how_to_see_more_and_where_to_report(
    probe: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    command_line(PROBE, ["probe", "defect"])
    message = capsys.readouterr().err
    assert "Traceback" not in message
    assert "rvsg --debug probe defect" in message and "report" in message
    command_line(PROBE, ["--debug", "probe", "defect"])
    assert "Traceback" in capsys.readouterr().err


def test_a_misspelt_verb_is_a_usage_error_that_suggests(probe: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line(PROBE, ["prob"]) == 2
    assert "Did you mean 'probe'" in capsys.readouterr().err


def test_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"{rvsg.__version__}\n"


@pytest.mark.parametrize("name", sorted(verbs()))
def test_every_verb_of_the_table_loads_and_helps(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert full_command(name, verbs()[name]).name == name
    assert main([name, "--help"]) == 0
    assert "Usage: rvsg " + name in capsys.readouterr().out


def test_the_verbs_fit_on_one_screen_in_their_groups(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    assert len(verbs()) <= 20
    assert {found[0].group for found in verbs().values()} == set(GROUPS) - {"Other"}
    assert len(shown.splitlines()) <= 48


@pytest.mark.parametrize("name", sorted(verbs()))
def test_the_help_of_a_command_shows_at_most_twelve_options(name: str) -> None:
    shown, every = (full_command(name, verbs()[name], everything=everything) for everything in (False, True))
    for command, whole in ((shown, every), *zip(_sub_commands(shown), _sub_commands(every), strict=True)):
        assert sum(not option.hidden for option in options_of(command)) <= MOST_OPTIONS, command.name
        assert not any(option.hidden for option in options_of(whole))


def _sub_commands(command: Any) -> list[Any]:
    return list(getattr(command, "commands", {}).values())


def test_help_all_shows_the_rarer_options(capsys: pytest.CaptureFixture[str]) -> None:
    for asked, shown in (("--help", False), ("--help-all", True)):
        assert main(["run", asked]) == 0
        assert ("--budget-usd" in capsys.readouterr().out) is shown


@pytest.mark.parametrize(("name", "place"), MOVED.items())
def test_an_earlier_name_of_a_verb_is_refused_with_its_new_place(
    name: str, place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([name, "--help"]) == 2
    assert f"`rvsg {name}` is now `rvsg {place}`." in capsys.readouterr().err
    assert place.split()[0] in verbs() and name not in verbs()


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


@pytest.mark.parametrize("name", ["export", "import", "ros2", "studio"])
def test_a_verb_of_an_absent_package_says_how_to_install_it(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(rvsg.cli, "installed_verbs", lambda known: {name: (verb,) for name, verb in known.items()})
    assert rvsg.cli.main([name, "--help"]) == 2
    assert "-e ./packages/rvsg-" in capsys.readouterr().err
