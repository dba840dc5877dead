"""Code that only a file, a folder or a stored run names is not run, by any door and under any key."""

from __future__ import annotations

import json
import shlex
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

SMALL = {"scenarios": 1, "refinements": 0, "repeats": 1, "confirmations": 0, "search_anyway": True}
EVIL = """
from pathlib import Path
from rvsg.stacks import LocalPlanner

import helper

Path(__file__).parents[1].joinpath("ran").touch()


class Evil(LocalPlanner):
    def reset(self, task):
        pass

    def command(self, seen):
        return 0.2, 0.0
"""


@pytest.fixture
def evil(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A Python file of a stranger, named as a stack; `ran` in the folder above says that it was imported."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    clone = tmp_path / "clone"
    (clone / "data").mkdir(parents=True)
    (clone / "evil.py").write_text(EVIL)
    (clone / "helper.py").write_text("")
    (clone / "data" / "weights.txt").write_text("1")
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield f"{clone / 'evil.py'}:Evil"
    _forget()


def _forget() -> None:
    for name in [name for name in sys.modules if name == "helper" or name.startswith("_rvsg_stack_evil")]:
        del sys.modules[name]


def settings_that_run(evil: str) -> dict[str, dict[str, Any]]:
    """Settings of a campaign file that lead to code, each by another way."""
    ran = Path(evil).absolute().parents[1] / "ran"
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


def test_code_of_a_file_is_allowed_once_and_by_the_content_of_its_folder(
    evil: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clone, out = tmp_path / "clone", tmp_path / "out"
    file, other = clone / "campaign.yaml", clone / "other.yaml"
    for path in (file, other):
        path.write_text(yaml.safe_dump({"stack": "evil.py:Evil"} | SMALL))

    def run(path: Path, *options: str) -> int:
        _forget()
        return main(["run", str(path), "--jobs", "1", "--out", str(out), *options])

    assert run(file) == 2
    assert "--allow-code-from" in capsys.readouterr().err
    assert run(file, "--allow-code-from", str(tmp_path / "absent")) == 2
    assert run(file, "--allow-code-from", str(other)) == 0, "the class is the same, whichever file names it"
    assert run(file) == 2, "it is the other file that is allowed"
    assert run(file, "--allow-code-from", str(file)) == 0
    assert run(file) == 0, "the content is remembered"
    for changed in ("evil.py", "helper.py", "data/weights.txt", "campaign.yaml", "new.py", "evil.so"):
        path = clone / changed
        before = path.read_text() if path.exists() else None
        path.write_text((before or "") + "\n# changed\n")
        assert run(file) == 2, changed
        path.write_text(before) if before is not None else path.unlink()
    assert run(file) == 0
    (clone / "linked").symlink_to(tmp_path)
    assert run(file) == 2
    assert run(file, "--allow-code-from", str(file)) == 0
    assert run(file) == 2, "a link leads out of the folder"


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
    assert stored.finished
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
    for option in {*accepted, *permission.CODE_OPTIONS, "stack"} - {"base_url"}:
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
    named = ("exec", "command") if ".py:" not in code else (code, "stack")
    if allowed:
        permission.check("stack", *named, code)
    else:
        with pytest.raises(InputError, check=coded("code-not-allowed")):
            permission.check("stack", *named, code)


@pytest.mark.parametrize(
    ("words", "code", "allowed"),
    [
        ("--stack 'exec:./planner --fast'", "./planner --fast", True),
        ("--stack=exec:./planner", "./planner", True),
        ("--stack-option command=./planner", "./planner", True),
        ("--stack-option=command=./planner", "./planner", True),
        ("""--simulator-option 'stack={"name": "exec", "options": {"command": "./planner"}}'""", "./planner", True),
        ("compare --json nav2 embedded:runs=1,stack=./evil.py:Evil", "evil.py:Evil", True),
        ("--stack ./evil.py:Evil", "evil.py:Evil", True),
        ("--stack ./planner.yaml", "./planner", False),
        ("run ./planner", "./planner", False),
        ("run campaign.yaml", "campaign", False),
        ("--out evil.py:Evil", "evil.py:Evil", False),
        ("confirm evil.py:Evil 1", "evil.py:Evil", False),
        ("report stack=evil.py:Evil", "evil.py:Evil", False),
        ("--title exec:./planner", "./planner", False),
    ],
)
def test_code_is_named_by_a_setting_that_means_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, code: str, allowed: bool
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "stack=evil.py:Evil").mkdir()
    with permission.only_in_process(permission.typed(shlex.split(words))):
        _checks(code, allowed=allowed)


@pytest.mark.parametrize(
    ("text", "code", "allowed", "remembered"),
    [
        ("stack: evil.py:Evil", "{folder}/evil.py:Evil", True, True),
        ("stack: ./evil.py:Evil", "{folder}/evil.py:Evil", True, True),
        ("stack: evil.py:Evil", "{folder}/other/evil.py:Evil", False, False),
        ("stack: evil:Evil", "evil:Evil", True, False),
        ("stack: exec:./planner x", "./planner x", True, False),
        ("stack: {{name: exec, options: {{command: make}}}}", "make", True, False),
        ("stack: exec:python3 -m pkg", "python3 -m pkg", True, False),
        ("stack: exec:./planner x", "./planner", False, False),
        ("stack: exec:./planner x", "planner x", False, False),
        ("out: runs/planner", "./planner", False, False),
        ("out: evil.py:Evil", "{folder}/evil.py:Evil", False, False),
        ("name: evil.py:Evil", "{folder}/evil.py:Evil", False, False),
        ("# stack: exec:make", "make", False, False),
    ],
)
def test_a_trusted_file_allows_only_what_it_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, code: str, allowed: bool, remembered: bool
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    clone = tmp_path / "clone"
    clone.mkdir()
    (clone / "evil.py").write_text("")
    file, code = clone / "campaign.yaml", code.format(folder=clone)
    file.write_text(text.replace("{{", "{").replace("}}", "}"))
    for trusted, may in ((None, False), (file, allowed), (None, remembered)):
        with permission.only_in_process(["run", str(file)], trusted=trusted):
            _checks(code, allowed=may)


def test_a_damaged_memory_allows_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (tmp_path / "rvsg").mkdir(mode=0o700)
    for text in ("[", json.dumps(["x"]), json.dumps({"x": 1})):
        (tmp_path / "rvsg" / "allowed.json").write_text(text)
        with permission.only(), pytest.raises(InputError, check=coded("code-not-allowed")):
            permission.check("stack", "exec", "command", "./planner")


@pytest.mark.parametrize(
    "words", ["run campaign.yaml", "run --out http://his/v1", "run --model base_url=http://his/v1"]
)
def test_a_key_goes_only_where_its_user_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    address = "http://his/v1"
    with permission.only_in_process(permission.typed(words.split())):
        assert not permission.allows_key_for(address)
    with permission.only():
        assert not permission.allows_key_for(address)
    with permission.only_in_process(permission.typed(["--base-url", "http://other/v1"])):
        assert permission.allows_key_for("http://other/v1") and not permission.allows_key_for(address)
    permission.allow_key_for("HIS:8000")
    with permission.only():
        assert permission.allows_key_for("http://other:80/v2") and not permission.allows_key_for("http://other:81/v1")
        assert permission.allows_key_for("http://his:8000/v1") and not permission.allows_key_for("http://his.net:8000/")
