"""Bad input: exit code 2, one clear message on standard error, nothing on standard output, nothing written half."""

from __future__ import annotations

import json
import re
import shlex
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from tests.cli.commands import Terminal

from rvsg.app.folder import LEDGER
from rvsg.cli import main
from rvsg.core.errors import NewerStore, RvsgError, UnknownName
from rvsg.core.files import check_writable
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.store.sqlite import SqliteLedger

SMALL = ["--simulator", "kinematic", "--strategy", "random", "--scenarios", "1", "--refinements", "0", "--jobs", "1"]
SEVERAL = "--route route_1 --route route_2 "

FILES = {
    "file": "in the way",
    "mine/report.html": "of another program",
    "misspelt.yaml": "world: warehouse\nroute: route_1\nscenarois: 3\n",
    "wrong.yaml": "scenarios: 0\nrepeats: many\nsed: 3\n",
    "list.yaml": "- a list\n",
    "unclosed.yaml": "world: [unclosed\n",
    "twice.yaml": "world: a\nworld: b\n",
    "nul.yaml": "\x00",
    "empty.json": "",
    "brace.json": "{",
    "cut.json": '{"a": "b',
    "list.json": "[]",
    "object.json": "{}",
    "null.json": "null",
    "people.json": '{"people": 3}',
    "address.json": '{"address": 5}',
}


Refused = Callable[..., Terminal]


@pytest.fixture
def refused(terminal: Terminal) -> Refused:
    """Run a command that is refused and leaves the folder as it was; returns the terminal."""

    def run(*parts: object) -> Terminal:
        before = _content()
        terminal(*parts, code=2)
        assert terminal.out == "" and terminal.err.strip()
        assert _content() == before
        return terminal

    return run


def _content() -> dict[str, bytes]:
    return {str(path): path.read_bytes() if path.is_file() else b"" for path in Path().rglob("*")}


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("run @ --world warehous", {"kind": "world", "name": "warehous", "nearest": "warehouse"}),
        ("run @ --route route1", {"kind": "route", "name": "route1", "nearest": "route_1"}),
        ("run @ --requirement r1", {"kind": "requirement", "name": "r1", "nearest": "R1"}),
        ("run @ --generator heuristics", {"kind": "generator", "name": "heuristics", "nearest": "heuristic"}),
        ("run @ --strategy studdy", {"kind": "strategy", "name": "studdy", "nearest": "study"}),
        ("run @ --simulator embeded", {"kind": "simulator", "name": "embeded", "nearest": "embedded"}),
        ("run --simulator-option profile=published_study", {"nearest": "published-study"}),
        ("run --simulator-option profile=nosuch", {"kind": "simulator profile", "name": "nosuch"}),
        ("run misspelt.yaml", {"path": "misspelt.yaml", "line": 3}),
        ("run wrong.yaml", {"lines": [1, 2, 3]}),
        ("run list.yaml", {"path": "list.yaml"}),
        ("run unclosed.yaml", {"path": "unclosed.yaml"}),
        ("run twice.yaml", {"path": "twice.yaml"}),
        ("run nul.yaml", {"path": "nul.yaml"}),
        *(
            (f"run @ {several}--out {out}", {"code": "out-no-folder", "path": "file"})
            for several, out in product(("", SEVERAL), ("file", "file/below"))
        ),
        *((f"run @ {several}--out mine", {"code": "out-occupied"}) for several in ("", SEVERAL)),
        *((f"run @ {several}--junit file/junit.xml --out one", {"code": "not-writable"}) for several in ("", SEVERAL)),
        ("run @ --junit . --out one", {"code": "not-writable"}),
        ("run @ --out ''", {"keys": ("out",)}),
        ("run --generator vlm", {"code": "model-missing"}),
        ("report nowhere", {"code": "store-absent"}),
        ("scenario prompt --prompts nowhere", {"code": "prompts-folder"}),
        ("simulate empty.json", {"code": "file-empty", "path": "empty.json", "line": None}),
        ("simulate cut.json", {"code": "json", "path": "cut.json", "line": 1}),
        ("simulate list.json", {"code": "record-invalid", "path": "list.json", "line": None}),
        *((f"simulate {name}.json", {"path": f"{name}.json"}) for name in ("brace", "object", "null", "people")),
        *((f"run @ --{kind}-option warp", {"code": "option-form"}) for kind in ("generator", "simulator")),
        ("run --simulator-option lidar_ray=3", {"keys": ("lidar_ray",)}),
        ("run --simulator-option 'noise={lidr: 0}'", {"keys": ("noise.lidr",)}),
        ("run --simulator-option lidar_rays=many", {"keys": ("lidar_rays",)}),
        ("run --simulator-option lidar_range_m=.nan", {"keys": ("lidar_range_m",)}),
        *(
            (f"run @ --executor cluster --executor-option scheduler_file={name}.json", {"code": "plug-in-options"})
            for name in ("absent", "empty", "object", "address")
        ),
    ],
)
def test_bad_input_is_refused_with_what_and_where(refused: Refused, command: str, expected: dict[str, Any]) -> None:
    if "cluster" in command:
        pytest.importorskip("distributed")
    for name, text in FILES.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(text)
    error = refused([each for word in shlex.split(command) for each in (SMALL if word == "@" else [word])]).error
    found = {key: getattr(error, key) for key in expected if key != "lines"}
    if "path" in found:
        found["path"] = str(found["path"])
    if "lines" in expected:
        found["lines"] = [problem.line for problem in error.problems]
    assert found == expected


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--scenarios", "0"),
        ("--scenarios", "-3"),
        ("--scenarios", "many"),
        ("--repeats", "0"),
        ("--refinements", "-1"),
        ("--humans", "0"),
        ("--humans", "101"),
        ("--jobs", "0"),
        ("--seed", "-1"),
        ("--confirmations", "-1"),
        ("--budget-usd", "-1"),
        ("--budget-usd", "0"),
        ("--budget-tokens", "0"),
        ("--budget-calls", "0"),
        ("--budget-runs", "0"),
        ("--shrink-runs", "-1"),
        ("--conversation", "chat"),
        ("--realism", "80"),
        ("--realism", "-1"),
        ("--realism", "many"),
    ],
)
def test_a_number_or_word_that_makes_no_sense_is_refused(refused: Refused, option: str, value: str) -> None:
    told = refused("run", SMALL, option, value)
    assert option in told.err or option.removeprefix("--").replace("-", "_") in told.err


def test_a_realism_that_leaves_no_run_says_so_in_terminal_and_report(terminal: Terminal) -> None:
    terminal("run", SMALL, "--realism 20 --repeats 2 --seed 3 --confirmations 0 --out c", code=2)
    assert "does what fewer than 20 % of recorded people did. Choose a smaller --realism" in terminal.err
    assert re.search(r"Runs not judged.* of recorded people did</th><td>[12]<", Path("c/report.html").read_text())


def test_a_campaign_file_that_is_absent_is_named(refused: Refused) -> None:
    assert "nowhere.yaml" in refused("run nowhere.yaml").err


@pytest.mark.parametrize(
    ("kind", "name"), [("generator", "heuristic"), ("generator", "random"), ("simulator", "kinematic")]
)
def test_an_option_that_a_plug_in_does_not_take_is_told_without_python(refused: Refused, kind: str, name: str) -> None:
    told = refused("run", SMALL, f"--{kind}", name, f"--{kind}-option", "foo=1")
    assert told.error.code == "unknown-option" and "__init__" not in told.err


@pytest.mark.parametrize("option", [("--model", "openai-chat:x"), ("--replay", "r"), ("--conversation", "study")])
@pytest.mark.parametrize("generator", ["heuristic", "random"])
def test_an_option_of_a_model_that_nobody_asks_is_refused(
    refused: Refused, option: tuple[str, str], generator: str
) -> None:
    told = refused("run", SMALL, "--generator", generator, *option)
    assert told.error.code == "model-options-unused"
    assert option[0] in told.err and generator in told.err


@pytest.mark.parametrize("option", ["stop_gap_m=abc", "stop_gap_m=-5", "robot_speed_m_s=.inf", "robot_speed_m_s=nan"])
def test_options_of_the_kinematic_simulator_that_are_no_numbers_are_refused(refused: Refused, option: str) -> None:
    said = refused("run", SMALL, "--simulator-option", option)
    assert said.error.code == "plug-in-options" and option.split("=")[0] in said.err


@pytest.mark.parametrize("verb", ["simulate", "evaluate", "scenario shrink", "report", "run"])
@pytest.mark.parametrize("what", ["absent", "empty", "folder", "binary"])
def test_a_file_that_is_none_is_named_and_left_as_it_is(refused: Refused, tmp_path: Path, verb: str, what: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "empty").write_bytes(b"nonsense: 1" if verb == "run" else b"")
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x01binary")
    told = refused(*verb.split(), what)
    assert what in told.err or "no run in the files" in told.err


def test_a_store_of_a_newer_version_is_left_alone(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    SqliteLedger(tmp_path / "old" / LEDGER).close()
    connection = sqlite3.connect(tmp_path / "old" / LEDGER)
    connection.execute("PRAGMA user_version=99")
    connection.commit()
    connection.close()
    assert isinstance(refused("run", SMALL, "--out", "old").error, NewerStore)
    assert isinstance(refused("report", "old").error, NewerStore)


def test_a_report_of_imported_results_names_the_tables(refused: Refused, tmp_path: Path) -> None:
    with SqliteLedger(tmp_path / "ledger.sqlite") as ledger:
        ledger.begin("distance/route_1/0", {"imported": "here"})
    assert refused("report", ".").error.code == "imported-results"


@pytest.mark.parametrize(
    ("content", "told"), [(None, "calls.jsonl does not exist"), ("{br", "holds no whole recorded call")]
)
def test_a_replay_folder_without_a_call_says_whether_the_file_is_missing_or_broken(
    refused: Refused, tmp_path: Path, content: str | None, told: str
) -> None:
    if content is not None:
        (tmp_path / "calls.jsonl").write_text(content, encoding="utf-8")
    assert told in refused("run", SMALL[:2], "--replay . --out out").err


def test_templates_and_recorded_calls_may_be_there_before_a_campaign(terminal: Terminal) -> None:
    for name in ("prompts", "vlm"):
        Path("one", name).mkdir(parents=True)
    Path("one/.hidden").touch()
    number = "--simulator-option stop_gap_m=5e-1"  # a word for YAML
    terminal("run", SMALL, number, "--confirmations 0 --out one")


def test_other_settings_are_listed_once_and_as_options(terminal: Terminal) -> None:
    terminal("run", SMALL, "--repeats 1 --confirmations 0 --out c")
    error = terminal.refused("run", SMALL, "--out c --route route_2 --seed 3")
    assert (error.code, error.keys) == ("other-settings", ("route", "seed"))


@pytest.fixture(scope="module")
def _proposed(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("proposed") / "proposal.json"
    assert main(["scenario", "propose", "--generator", "random", "--seed", "1", "--out", str(path)]) == 0
    return path.read_text()


@pytest.fixture
def scenario(_proposed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A scenario, also in `s.json` in the current folder."""
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = json.loads(_proposed)["scenario"]
    Path("s.json").write_text(json.dumps(found))
    return found


TASK = ("people", "humans", 0, "tasks", 0)
HUMAN = ("people", "humans", 0)


@pytest.mark.parametrize(
    ("place", "value", "code", "said"),
    [
        ((*TASK, "path", 1), "Z99", "invalid-scenario", "Z99"),
        ((*TASK, "path"), lambda path: [path[0], path[-1]], "invalid-scenario", ""),  # through an obstacle
        (("mission", "route", "start"), {"x": -5.79, "y": -0.96, "yaw": 0.0}, "pose-blocked", ""),
        ((*HUMAN, "speed_m_s"), float("nan"), "json", ""),
        (("mission", "route", "time_limit_s"), -1, "record-invalid", ""),
        (("mission",), lambda of: of | {"world_id": "world-0", "parts": None}, "world-changed", ""),
        ((*HUMAN, "attention"), "asleep", "record-invalid",
         "expected 'attentive', 'distracted' or 'unseeing', got 'asleep'"),
        ((*HUMAN, "radius_m"), 0.95, "invalid-scenario", "The person is 1.90 m wide; the way from"),
        (HUMAN, lambda of: of | {"speed": 1.0}, "record-invalid",
         'there is no key "speed" in people.humans[0]. Did you mean "speed_m_s"? Known: name, tasks,'),
        (HUMAN, lambda of: of | {"speed_m_s": "fast", "moods": []}, "record-invalid",
         "expected a number, got 'fast'; there is no key \"moods\""),
    ],
)  # fmt: skip
def test_a_scenario_that_cannot_be_simulated_is_refused(
    refused: Refused, scenario: dict[str, Any], place: tuple[str | int, ...], value: Any, code: str, said: str
) -> None:
    inside: Any = scenario
    for key in place[:-1]:
        inside = inside[key]
    inside[place[-1]] = value(inside[place[-1]]) if callable(value) else value
    Path("s.json").write_text(json.dumps(scenario))
    told = refused("simulate", "s.json", "--out", "runs.jsonl")
    assert told.error.code == code and said in told.err
    if code == "record-invalid":
        assert told.err.endswith(".\n") and ".." not in told.err and ".;" not in told.err


def test_a_scenario_of_another_world_is_refused(refused: Refused, scenario: dict[str, Any]) -> None:
    assert refused("simulate", "s.json", "--world", "office", "--out", "runs.jsonl").error.code == "world-other"


@pytest.mark.parametrize("verb", ["simulate", "scenario shrink"])
def test_a_robot_that_the_simulator_does_not_drive_is_refused(
    refused: Refused, scenario: dict[str, Any], monkeypatch: pytest.MonkeyPatch, errors: list[RvsgError], verb: str
) -> None:
    scenario["mission"]["robot"] = "nope"
    Path("s.json").write_text(json.dumps(scenario))
    asked = [*verb.split(), "s.json", "--simulator", "kinematic", "--out", "out"]
    error = refused(asked).error
    assert (error.kind, error.name, error.known) == ("robot", "nope", ["tiago_omni"])
    monkeypatch.setattr(KinematicSimulator, "robots", ("nope",), raising=False)
    errors.clear()
    main(asked)
    assert not any(isinstance(each, UnknownName) for each in errors)


@pytest.mark.parametrize("metric", [(), ("--metric", "all")])
def test_a_proposal_in_the_place_of_runs_is_not_called_broken_json(
    refused: Refused, _proposed: str, metric: tuple[str, ...]
) -> None:
    Path("p.json").write_text(_proposed)
    assert refused("evaluate", *metric, "p.json").error.code == "no-runs"


@pytest.fixture
def a_run(scenario: dict[str, Any]) -> dict[str, Any]:
    """A run, also in `r.jsonl`."""
    assert main(["simulate", "s.json", "--simulator", "kinematic", "--out", "r.jsonl"]) == 0
    found: dict[str, Any] = json.loads(Path("r.jsonl").read_text())
    return found


def test_runs_in_the_place_of_a_scenario_are_called_runs(refused: Refused, a_run: dict[str, Any]) -> None:
    assert refused("simulate", "r.jsonl").error.code == "runs-not-scenario"


def test_a_truncated_run_is_found_at_its_line(refused: Refused, terminal: Terminal, scenario: dict[str, Any]) -> None:
    runs = Path("runs.jsonl")
    terminal("simulate s.json --simulator kinematic --repeats 2 --out runs.jsonl")
    assert terminal.json("evaluate runs.jsonl")["verdict"]["runs"] == 2
    runs.write_text(runs.read_text()[:-500])
    error = refused("evaluate runs.jsonl").error
    assert (error.path.name, error.line) == ("runs.jsonl", 2)


@pytest.mark.parametrize(
    ("change", "code", "told"),
    [
        ({"outcome": "x"}, "run-invalid", "outcome"),
        ({"seed": "many"}, "run-invalid", "seed"),
        ({"mood": 1}, "run-invalid", "mood"),
        ({"time_limit_s": -1.0}, "run-invalid", "time_limit_s"),
        ({"arrays": {}}, "run-invalid", "array"),
        ({"robot_radius_m": -0.3}, "run-invalid", "robot_radius_m"),
        ({"human_radius_m": [0.3, -0.3]}, "run-invalid", "human_radius_m"),
        ({"clock_ratio": 0.0}, "run-invalid", "clock_ratio"),
        ({"robot_radius_m": 0.0}, "run-impossible", "robot_radius_m"),
        ("empty", "run-impossible", ""),
        *(
            ((array, at, value), "run-impossible", array)
            for array in ("trajectory.t", "log.t")
            for at, value in ((0, -1.0), (3, 0.0), (1, 0.0))  # time does not pass
        ),
    ],
)
def test_a_run_that_is_wrong_is_told_with_its_key_and_line(
    refused: Refused, a_run: dict[str, Any], change: Any, code: str, told: str
) -> None:
    if isinstance(change, tuple):
        array, at, value = change
        a_run["arrays"][array][at] = value
    else:
        a_run |= {"arrays": {name: [] for name in a_run["arrays"]}} if change == "empty" else change
    Path("wrong.jsonl").write_text(json.dumps(a_run) + "\n")
    refusal = refused("evaluate", "wrong.jsonl")
    error: Any = refusal.error
    assert (error.code, error.line) == (code, 1)
    assert told in refusal.err and "pydantic" not in refusal.err
    assert not isinstance(change, tuple) or error.reason.startswith(told)


def test_a_run_that_is_given_twice_counts_once(terminal: Terminal, a_run: dict[str, Any]) -> None:
    told = terminal.json("evaluate r.jsonl r.jsonl")
    assert told["verdict"]["runs"] == 1 and len(told["notes"]) == 1


@pytest.mark.parametrize("out", ["folder", "file/below.json"])
@pytest.mark.parametrize("verb", ["simulate s.json", "scenario shrink s.json", "scenario propose"])
def test_a_result_that_could_not_be_written_is_refused_before_the_work(
    refused: Refused, scenario: dict[str, Any], out: str, verb: str
) -> None:
    Path("folder").mkdir()
    Path("file").write_text("")
    told = refused(*verb.split(), *(SMALL[:2] if "s.json" in verb else ()), "--out", out)
    assert out.split("/")[0] in told.err and "seed" not in told.err and "valid" not in told.err


@pytest.mark.parametrize(
    "asked",
    [
        "report one --tables file",
        "scenario prompt --pictures file",
        "scenario prompt --copy compact-new --to file",
        "world draw warehouse --what labels --width 400 --out file",
    ],
)
def test_a_file_in_the_place_of_a_folder_for_output_is_told_with_the_option(
    refused: Refused, tmp_path: Path, asked: str
) -> None:
    (tmp_path / "file").write_text("")
    told = refused(*asked.split())
    assert told.error.code == "not-writable" and asked.split()[-2] in told.err


def test_every_verb_makes_the_folders_of_its_output(terminal: Terminal, a_run: dict[str, Any]) -> None:
    for asked in (
        "scenario propose --out a/b/proposal.json",
        "simulate s.json --simulator kinematic --out c/d/runs.jsonl",
        "evaluate r.jsonl --scenario s.json --feedback e/f/feedback.json",
        f"run {' '.join(SMALL)} --confirmations 0 --out g/h --junit i/j/junit.xml",
        "report g/h --html k/l/page.html",
        "scenario prompt --copy compact-new --to m/n",
    ):
        terminal(asked)
        assert Path(asked.split()[-1]).exists()


def test_a_device_that_is_no_file_of_ours_may_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda *_: False)  # as for a user who may not write into /dev
    check_writable(Path("/dev/null"))


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder that takes no file, whatever its rights")
def test_a_junit_file_that_cannot_be_made_is_told_before_the_campaign(refused: Refused) -> None:
    assert refused("run", SMALL, "--out", "new", "--junit", "/proc/x.xml").error.code == "not-writable"


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs a device that is always full")
@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_full_disk_is_no_defect_of_the_program(tmp_path: Path, a_run: dict[str, Any], stream: str) -> None:
    with Path("/dev/full").open("w") as full:
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | {stream: full}
        command = [sys.executable, "-m", "rvsg", "evaluate", "r.jsonl", "--json"]
        done = subprocess.run(command, **streams, text=True, cwd=tmp_path)
    assert done.returncode == 2
    if stream == "stdout":
        assert "No space left on device" in done.stderr and "defect" not in done.stderr


@pytest.mark.slow
def test_a_reader_that_goes_away_is_no_violation(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "rvsg", "run", *SMALL, "--out", str(tmp_path / "one")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as process:
        assert process.stderr is not None
        process.stderr.close()
        assert process.wait(timeout=300) == 3
