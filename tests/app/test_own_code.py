"""Code that only a file, a folder or a stored run names is not run, by any door and under any key."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.coded import coded

import rvsg
from rvsg.app.settings import read_campaign_file
from rvsg.cli import main
from rvsg.core import permission, plugins
from rvsg.core.errors import InputError, RvsgError
from rvsg.simulation.stacks.stack_choice import StackChoice

SMALL = {"scenarios": 1, "refinements": 0, "repeats": 1, "confirmations": 0}
EVIL = """
from pathlib import Path
from rvsg.stacks import LocalPlanner

Path(__file__).with_name("ran").touch()


class Evil(LocalPlanner):
    def reset(self, task):
        pass

    def command(self, seen):
        return 0.2, 0.0
"""


@pytest.fixture
def evil(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A Python file of a stranger, named as a stack; `ran` beside it says that it was imported."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "evil.py").write_text(EVIL)
    yield f"{tmp_path / 'evil.py'}:Evil"
    _forget()


def _forget() -> None:
    for name in [name for name in sys.modules if name.startswith("_rvsg_stack_evil")]:
        del sys.modules[name]


def settings_that_run(evil: str) -> dict[str, dict[str, Any]]:
    """Settings of a campaign file that lead to code, each by another way."""
    ran = Path(evil.rpartition(":")[0]).with_name("ran")
    command = f"touch {ran}"
    return {
        "class": {"stack": evil},
        "command": {"stack": f"exec:{command}"},
        "whole stack": {"stack": "exec-stack", "stack_options": {"command": command}},
        "class in an option": {"simulator_options": {"stack": evil}},
        "command in an option": {"simulator_options": {"stack": {"name": "exec", "options": {"command": command}}}},
        "launch": {"stack": "ros2", "stack_options": {"launch": command}},
        "launch of a world": {"simulator": "ros2-world", "simulator_options": {"launch": f"{command} {{agents}}"}},
        "cluster": {"executor": "cluster", "executor_options": {"address": "tcp://127.0.0.1:1"}},
    }


WAYS = tuple(settings_that_run("evil.py:Evil"))


@pytest.mark.parametrize("way", WAYS)
def test_a_campaign_file_runs_no_code(evil: str, tmp_path: Path, way: str) -> None:
    file = tmp_path / "campaign.yaml"
    file.write_text(yaml.safe_dump(settings_that_run(evil)[way] | SMALL))
    with pytest.raises(InputError, check=coded("code-not-allowed")):
        rvsg.Campaign.create(tmp_path / "out", file=read_campaign_file(file))
    assert main(["run", str(file), "--out", str(tmp_path / "out")]) == 2
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("way", [way for way in WAYS if way.startswith("class")])
def test_who_names_the_code_runs_it(evil: str, tmp_path: Path, way: str) -> None:
    rvsg.Campaign.create(tmp_path / "out", **settings_that_run(evil)[way], **SMALL)
    assert (tmp_path / "ran").exists()


def test_a_command_line_that_names_the_code_allows_it(evil: str, tmp_path: Path) -> None:
    file = tmp_path / "campaign.yaml"
    file.write_text(yaml.safe_dump({"stack": evil} | SMALL))
    assert main(["run", str(file), "--stack", evil, "--jobs", "1", "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "ran").exists()


def test_code_of_a_file_is_allowed_once_and_by_its_content(
    evil: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, source = tmp_path / "campaign.yaml", Path(evil.rpartition(":")[0])
    file.write_text(yaml.safe_dump({"stack": evil} | SMALL))

    def run(*options: str) -> int:
        _forget()
        return main(["run", str(file), "--jobs", "1", "--out", str(tmp_path / "out"), *options])

    assert run() == 2
    assert "--allow-code-from" in capsys.readouterr().err
    assert run("--allow-code-from", str(tmp_path / "absent")) == 2
    assert run("--allow-code-from", str(file)) == 0
    assert run() == 0, "the content is remembered"
    source.write_text(EVIL + "\n# changed\n")
    assert run() == 2


def test_reading_a_stored_campaign_runs_no_code(evil: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    made = rvsg.Campaign.create(out, simulator=rvsg.Spec("embedded", {"stack": evil}), **SMALL)
    for _ in made.run(jobs=1):
        pass
    runs = tmp_path / "runs.jsonl"
    assert main(["export", str(out), "--out", str(runs)]) in (0, 2)
    _forget()
    (tmp_path / "ran").unlink()
    for verb in ("report", "suite coverage", "knowledge list"):
        main([*verb.split(), str(out)])
        assert not (tmp_path / "ran").exists(), verb
    assert (out / "report.html").exists()
    stored = rvsg.Campaign.open(out)
    assert stored.summary().complete and isinstance(stored.fills_a_map, bool)
    for verb in (f"run --out {out}", f"confirm {out}", f"trace {out} --out {runs}.trace.json"):
        main(verb.split())
        assert not (tmp_path / "ran").exists(), verb
    with pytest.raises(InputError, check=coded("code-not-allowed")):
        rvsg.Campaign.open(out).prepare()


KINDS = ("generator", "simulator", "strategy", "executor", "store", "stack", "exporter")


@pytest.mark.parametrize(
    ("kind", "name"),
    [(kind, point.name) for kind in KINDS for point in entry_points(group=plugins.KINDS[kind])],
)
def test_no_option_of_a_plug_in_leads_to_code(evil: str, tmp_path: Path, kind: str, name: str) -> None:
    command = f"touch {tmp_path / 'ran'}"
    accepted = plugins._accepted(plugins.find(kind, name))
    for option in {*accepted, *permission.CODE_OPTIONS, "stack"}:
        for value in (evil, command, f"exec:{command}", {"name": "exec", "options": {"command": command}}, [evil]):
            with permission.only():
                _make(kind, name, {option: value})
            assert not (tmp_path / "ran").exists(), (option, value)


def _make(kind: str, name: str, options: dict[str, Any]) -> None:
    make: Callable[[], Any] = lambda: plugins.make(kind, name, options)  # noqa: E731
    if kind == "stack":
        make = lambda: StackChoice.of(rvsg.Spec(name, options)).driver.prepare(lambda _: None)  # noqa: E731
    try:
        make()
    except (RvsgError, TypeError, KeyError, ValueError):  # an option that means something else
        return


def _checks(code: str, *, allowed: bool) -> None:
    if allowed:
        permission.check("stack", "exec", code)
    else:
        with pytest.raises(InputError, check=coded("code-not-allowed")):
            permission.check("stack", "exec", code)


@pytest.mark.parametrize(
    ("named", "code", "allowed"),
    [
        (["--stack", "exec:./planner --fast"], "./planner --fast", True),
        (["--stack-option", "command=./planner"], "./planner", True),
        (["--stack-option=command=./planner"], "./planner", True),
        (["--simulator-option", 'stack={"name": "exec", "options": {"command": "./planner"}}'], "./planner", True),
        ([{"stack": Path("evil.py:Evil")}], "./evil.py:Evil", True),
        (["./planner.yaml"], "./planner", False),
        (["run", "campaign.yaml"], "campaign", False),
    ],
)
def test_code_is_named_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: list[Any], code: str, allowed: bool
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with permission.only(named):
        _checks(code, allowed=allowed)


@pytest.mark.parametrize(
    ("text", "code", "allowed"),
    [
        ("stack: evil.py:Evil", "{folder}/evil.py:Evil", True),
        ("stack: ./evil.py:Evil", "{folder}/evil.py:Evil", True),
        ("stack: evil.py:Evil", "{folder}/other/evil.py:Evil", False),
        ("stack: exec:./planner x", "./planner x", True),
        ("out: runs/planner", "./planner", False),
        ("out: runs/x", "touch /x", False),
    ],
)
def test_a_trusted_file_allows_only_what_it_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, code: str, allowed: bool
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    file = tmp_path / "campaign.yaml"
    file.write_text(text)
    with permission.only_in_process([], trusted=file):
        _checks(code.format(folder=tmp_path), allowed=allowed)


def test_a_damaged_memory_allows_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (tmp_path / "rvsg").mkdir()
    for text in ("[", json.dumps(["x"]), json.dumps({"x": 1})):
        (tmp_path / "rvsg" / "allowed-code.json").write_text(text)
        with permission.only(), pytest.raises(InputError, check=coded("code-not-allowed")):
            permission.check("stack", "exec", "./planner")
