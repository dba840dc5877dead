"""Bad input: exit code 2, one clear message on standard error, nothing on standard output, nothing written half."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from rvsg.app.folder import LEDGER
from rvsg.cli import main
from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError, InvalidOptions, NewerStore, RvsgError, UnknownName
from rvsg.core.outputs import check_writable
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.store.sqlite import SqliteLedger

SMALL = ["--simulator", "kinematic", "--strategy", "random", "--scenarios", "1", "--refinements", "0", "--jobs", "1"]


class Refusal(str):
    """The message of a refused command, with the error it stands for; None where the options could not be read."""

    error: RvsgError | None = None

    @property
    def code(self) -> str | None:
        """The code of the error."""
        return self.error.code if self.error is not None else None


@pytest.fixture
def refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], errors: list[RvsgError]
):
    """Run a command in an empty folder that it must leave as it was; returns the message."""

    def run(*arguments: str) -> Refusal:
        errors.clear()
        monkeypatch.chdir(tmp_path)
        before = _content(tmp_path)
        assert main(list(arguments)) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert "Traceback" not in captured.err
        assert captured.err.strip()
        assert _content(tmp_path) == before
        refusal = Refusal(captured.err)
        refusal.error = errors[-1] if errors else None
        return refusal

    return run


def _content(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}


@pytest.mark.parametrize(
    ("option", "value", "meant"),
    [
        ("--world", "warehous", "warehouse"),
        ("--route", "route1", "route_1"),
        ("--requirement", "r1", "R1"),
        ("--generator", "heuristics", "heuristic"),
        ("--strategy", "studdy", "study"),
        ("--simulator", "embeded", "embedded"),
    ],
)
def test_an_unknown_name_is_answered_with_the_nearest(refused, option: str, value: str, meant: str) -> None:
    error = refused("run", *SMALL, option, value).error
    assert isinstance(error, UnknownName)
    assert (error.kind, error.name, error.nearest) == (option.removeprefix("--"), value, meant)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--scenarios", "0"),
        ("--scenarios", "-3"),
        ("--repeats", "0"),
        ("--refinements", "-1"),
        ("--humans", "0"),
        ("--humans", "101"),
        ("--jobs", "0"),
        ("--seed", "-1"),
        ("--confirmations", "-1"),
        ("--scenarios", "many"),
        ("--budget-usd", "-1"),
        ("--budget-usd", "0"),
        ("--budget-tokens", "0"),
        ("--budget-calls", "0"),
        ("--budget-runs", "0"),
        ("--shrink-runs", "-1"),
        ("--conversation", "chat"),
    ],
)
def test_a_number_or_word_that_makes_no_sense_is_refused(refused, option: str, value: str) -> None:
    told = refused("run", *SMALL, option, value)
    assert option in told or option.removeprefix("--").replace("-", "_") in told


def test_a_misspelt_key_of_the_campaign_file_is_found_at_its_line(refused, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("world: warehouse\nroute: route_1\nscenarois: 3\n")
    error = refused("run", "c.yaml").error
    assert isinstance(error, FileError)
    assert (error.path.name, error.line) == ("c.yaml", 3)


def test_every_mistake_of_the_campaign_file_is_told_at_once(refused, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("scenarios: 0\nrepeats: many\nsed: 3\n")
    error = refused("run", "c.yaml").error
    assert isinstance(error, DocumentError)
    assert [problem.line for problem in error.problems] == [1, 2, 3]


@pytest.mark.parametrize("text", ["- a list\n", "world: [unclosed\n", "world: a\nworld: b\n", "\x00"])
def test_a_campaign_file_that_is_none_is_refused_with_its_name(refused, tmp_path: Path, text: str) -> None:
    (tmp_path / "c.yaml").write_text(text)
    error = refused("run", "c.yaml").error
    assert isinstance(error, FileError) and error.path.name == "c.yaml"


def test_a_campaign_file_that_is_absent_is_named(refused) -> None:
    assert "nowhere.yaml" in refused("run", "nowhere.yaml")


SEVERAL = ["--route", "route_1", "--route", "route_2"]


@pytest.mark.parametrize("several", [[], SEVERAL])
def test_a_file_in_the_place_of_the_output_folder_is_called_one(refused, tmp_path: Path, several: list[str]) -> None:
    (tmp_path / "file").write_text("in the way")
    for out in ("file", "file/below"):
        error = refused("run", *SMALL, *several, "--out", out).error
        assert isinstance(error, FileError)
        assert (error.code, error.path) == ("out-no-folder", Path("file"))


@pytest.mark.parametrize("several", [[], SEVERAL])
def test_a_folder_of_other_files_is_not_written_into(refused, tmp_path: Path, several: list[str]) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "report.html").write_text("of another program")
    assert refused("run", *SMALL, *several, "--out", "mine").code == "out-occupied"


def test_templates_and_recorded_calls_may_be_there_before_a_campaign(tmp_path: Path) -> None:
    for name in ("prompts", "vlm"):
        (tmp_path / "one" / name).mkdir(parents=True)
    (tmp_path / "one" / ".hidden").touch()
    assert main(["run", *SMALL, "--confirmations", "0", "--out", str(tmp_path / "one")]) == 0


def test_a_vlm_without_a_model_says_what_to_give(refused) -> None:
    assert refused("run", "--generator", "vlm").code == "model-missing"


def test_a_store_of_a_newer_version_is_left_alone(refused, tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    SqliteLedger(tmp_path / "old" / LEDGER).close()
    connection = sqlite3.connect(tmp_path / "old" / LEDGER)
    connection.execute("PRAGMA user_version=99")
    connection.commit()
    connection.close()
    assert isinstance(refused("run", *SMALL, "--out", "old").error, NewerStore)
    assert isinstance(refused("report", "old").error, NewerStore)


def test_a_report_of_nothing_says_so(refused) -> None:
    assert refused("report", "nowhere").code == "store-absent"


@pytest.fixture(scope="module")
def _proposed(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("proposed") / "proposal.json"
    assert main(["scenario", "propose", "--generator", "random", "--seed", "1", "--out", str(path)]) == 0
    return path.read_text()


@pytest.fixture
def scenario(_proposed: str) -> dict:
    found = json.loads(_proposed)["scenario"]
    assert isinstance(found, dict)
    return found


def simulate(refused, tmp_path: Path, scenario: dict) -> Refusal:
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    return refused("simulate", "s.json", "--out", "runs.jsonl")


TASK = ("people", "humans", 0, "tasks", 0)


@pytest.mark.parametrize(
    ("place", "value", "code", "said"),
    [
        ((*TASK, "path", 1), "Z99", "invalid-scenario", "Z99"),
        ((*TASK, "path"), lambda path: [path[0], path[-1]], "invalid-scenario", ""),  # through an obstacle
        (("mission", "route", "start"), {"x": -5.79, "y": -0.96, "yaw": 0.0}, "pose-blocked", ""),
        (("people", "humans", 0, "speed_m_s"), float("nan"), "json", ""),
        (("mission", "route", "time_limit_s"), -1, "record-invalid", ""),
        (("mission",), lambda of: of | {"world_id": "world-0", "parts": None}, "world-changed", ""),
    ],
)
def test_a_scenario_that_cannot_be_simulated_is_refused(
    refused, tmp_path: Path, scenario: dict, place: tuple[str | int, ...], value: Any, code: str, said: str
) -> None:
    inside: Any = scenario
    for key in place[:-1]:
        inside = inside[key]
    inside[place[-1]] = value(inside[place[-1]]) if callable(value) else value
    told = simulate(refused, tmp_path, scenario)
    assert told.code == code and said in told


@pytest.mark.parametrize("verb", [["simulate"], ["scenario", "shrink"]])
def test_a_robot_that_the_simulator_does_not_drive_is_refused(
    refused, tmp_path: Path, scenario: dict, monkeypatch: pytest.MonkeyPatch, errors: list[RvsgError], verb: list[str]
) -> None:
    scenario["mission"]["robot"] = "nope"
    path = tmp_path / "scenario.json"
    path.write_text(json.dumps(scenario))
    asked = [*verb, str(path), "--simulator", "kinematic", "--out", str(tmp_path / "out")]
    error = refused(*asked).error
    assert isinstance(error, UnknownName)
    assert (error.kind, error.name, error.known) == ("robot", "nope", ["tiago_omni"])
    monkeypatch.setattr(KinematicSimulator, "robots", ("nope",), raising=False)
    errors.clear()
    main(asked)
    assert not any(isinstance(each, UnknownName) for each in errors)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"speed": 1.0}, 'there is no key "speed" in people.humans[0]. Did you mean "speed_m_s"? Known: name, tasks,'),
        ({"speed_m_s": "fast", "moods": []}, "expected a number, got 'fast'; there is no key \"moods\""),
    ],
)
def test_what_is_wrong_with_a_scenario_ends_with_one_full_stop(
    refused, tmp_path: Path, scenario: dict, change: dict, said: str
) -> None:
    scenario["people"]["humans"][0] |= change
    told = simulate(refused, tmp_path, scenario)
    assert said in told
    assert told.endswith(".\n") and ".." not in told and ".;" not in told


def test_a_scenario_of_another_world_is_refused(refused, tmp_path: Path, scenario: dict) -> None:
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    assert refused("simulate", "s.json", "--world", "office", "--out", "runs.jsonl").code == "world-other"


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", "null", '{"people": 3}'])
def test_a_file_that_holds_no_scenario_is_named(refused, tmp_path: Path, text: str) -> None:
    (tmp_path / "s.json").write_text(text)
    error = refused("simulate", "s.json").error
    assert isinstance(error, FileError) and error.path.name == "s.json"


def test_a_truncated_run_is_found_at_its_line(
    refused, tmp_path: Path, scenario: dict, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    runs = tmp_path / "runs.jsonl"
    asked = ["simulate", str(tmp_path / "s.json"), "--simulator", "kinematic", "--repeats", "2", "--out", str(runs)]
    assert main(asked) == 0
    assert main(["evaluate", str(runs), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"]["runs"] == 2
    runs.write_text(runs.read_text()[:-500])
    error = refused("evaluate", "runs.jsonl").error
    assert isinstance(error, FileError)
    assert (error.path.name, error.line) == ("runs.jsonl", 2)


@pytest.mark.parametrize(
    ("kind", "name"), [("generator", "heuristic"), ("generator", "random"), ("simulator", "kinematic")]
)
def test_an_option_that_a_plug_in_does_not_take_is_told_without_python(refused, kind: str, name: str) -> None:
    told = refused("run", *SMALL, f"--{kind}", name, f"--{kind}-option", "foo=1")
    assert told.code == "unknown-option" and "__init__" not in told
    assert refused("run", *SMALL, f"--{kind}-option", "warp").code == "option-form"


@pytest.mark.parametrize(
    ("option", "key"),
    [
        ("lidar_ray=3", "lidar_ray"),
        ("noise={lidr: 0}", "noise.lidr"),
        ("lidar_rays=many", "lidar_rays"),
        ("lidar_range_m=.nan", "lidar_range_m"),
    ],
)
def test_a_wrong_option_of_the_simulator_is_told_by_its_key(refused, option: str, key: str) -> None:
    error = refused("run", "--simulator-option", option).error
    assert isinstance(error, InvalidOptions) and error.keys == (key,)


def test_a_wrong_profile_of_the_simulator_is_answered_with_the_nearest(refused) -> None:
    error = refused("run", "--simulator-option", "profile=published_study").error
    assert isinstance(error, UnknownName) and error.nearest == "published-study"


@pytest.mark.parametrize("option", [("--model", "openai-chat:x"), ("--replay", "r"), ("--conversation", "study")])
@pytest.mark.parametrize("generator", ["heuristic", "random"])
def test_an_option_of_a_model_that_nobody_asks_is_refused(refused, option: tuple[str, str], generator: str) -> None:
    told = refused("run", *SMALL, "--generator", generator, *option)
    assert told.code == "model-options-unused"
    assert option[0] in told and generator in told


def test_a_folder_of_prompts_that_does_not_exist_is_told(refused) -> None:
    assert refused("scenario", "prompt", "--prompts", "nowhere").code == "prompts-folder"


def test_other_settings_are_listed_once_and_as_options(tmp_path: Path, monkeypatch, errors) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", *SMALL, "--repeats", "1", "--confirmations", "0", "--out", "c"]) == 0
    assert main(["run", *SMALL, "--out", "c", "--route", "route_2", "--seed", "3"]) == 2
    assert isinstance(errors[-1], InvalidOptions)
    assert (errors[-1].code, errors[-1].keys) == ("other-settings", ("route", "seed"))


@pytest.mark.parametrize("verb", [("evaluate",), ("evaluate", "--metric", "all")])
def test_a_proposal_in_the_place_of_runs_is_not_called_broken_json(
    tmp_path: Path, monkeypatch, errors: list[RvsgError], verb: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["scenario", "propose", "--out", "p.json"]) == 0
    assert main([*verb, "p.json"]) == 2
    assert errors[-1].code == "no-runs"


def test_an_empty_name_of_the_output_folder_is_refused(refused) -> None:
    error = refused("run", *SMALL, "--out", "").error
    assert isinstance(error, InvalidOptions) and error.keys == ("out",)


@pytest.mark.parametrize(
    ("content", "code", "line"), [('{"a": "b', "json", 1), ("", "file-empty", None), ("[]", "record-invalid", None)]
)
def test_a_broken_scenario_file_is_told_with_what_and_where(
    refused, tmp_path: Path, content: str, code: str, line: int | None
) -> None:
    (tmp_path / "s.json").write_text(content, encoding="utf-8")
    error = refused("simulate", "s.json").error
    assert isinstance(error, FileError) and (error.code, error.line) == (code, line)


@pytest.mark.parametrize(
    ("content", "told"), [(None, "calls.jsonl does not exist"), ("{br", "holds no whole recorded call")]
)
def test_a_replay_folder_without_a_call_says_whether_the_file_is_missing_or_broken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str | None, told: str
) -> None:
    if content is not None:
        (tmp_path / "calls.jsonl").write_text(content, encoding="utf-8")
    assert main(["run", *SMALL[:2], "--replay", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_report_of_imported_results_names_the_tables(refused, tmp_path: Path) -> None:
    with SqliteLedger(tmp_path / "ledger.sqlite") as ledger:
        ledger.begin("distance/route_1/0", {"imported": "here"})
    assert refused("report", ".").code == "imported-results"


@pytest.mark.parametrize("verb", ["simulate", "evaluate", "scenario shrink", "report", "run"])
@pytest.mark.parametrize("what", ["absent", "empty", "folder", "binary"])
def test_a_file_that_is_none_is_named_and_left_as_it_is(refused, tmp_path: Path, verb: str, what: str) -> None:
    path = tmp_path / what
    if what == "folder":
        path.mkdir()
    elif what != "absent":
        path.write_bytes(b"" if what == "empty" else b"\xff\xfe\x00\x01binary")
    before = path.read_bytes() if path.is_file() else None
    if verb == "run" and what == "empty":
        path.write_bytes(b"nonsense: 1")
        before = path.read_bytes()
    told = refused(*verb.split(), what)
    assert what in told or "no run in the files" in told
    assert "Traceback" not in told
    assert (path.read_bytes() if path.is_file() else None) == before


def test_runs_in_the_place_of_a_scenario_are_called_runs(refused, a_run: dict) -> None:
    assert refused("simulate", "r.jsonl").code == "runs-not-scenario"


@pytest.fixture
def a_run(tmp_path: Path, scenario: dict, monkeypatch: pytest.MonkeyPatch) -> dict:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    assert main(["simulate", "s.json", "--simulator", "kinematic", "--out", "r.jsonl"]) == 0
    return json.loads((tmp_path / "r.jsonl").read_text())


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"outcome": "x"}, "run-invalid"),
        ({"seed": "many"}, "run-invalid"),
        ({"mood": 1}, "run-invalid"),
        ({"time_limit_s": -1.0}, "run-invalid"),
        ({"arrays": {}}, "run-invalid"),
        ({"robot_radius_m": -0.3}, "run-invalid"),
        ({"human_radius_m": [0.3, -0.3]}, "run-invalid"),
        ({"clock_ratio": 0.0}, "run-invalid"),
        ({"robot_radius_m": 0.0}, "run-impossible"),
    ],
)
def test_a_run_that_is_wrong_is_told_with_its_key_and_line(
    refused, tmp_path: Path, a_run: dict, change: dict, code: str
) -> None:
    (tmp_path / "wrong.jsonl").write_text(json.dumps(a_run | change) + "\n")
    told = refused("evaluate", "wrong.jsonl")
    assert isinstance(told.error, FileError) and (told.error.code, told.error.line) == (code, 1)
    assert (next(iter(change)) if change != {"arrays": {}} else "array") in told and "pydantic" not in told


def test_a_run_without_a_moment_is_refused(refused, tmp_path: Path, a_run: dict) -> None:
    empty = {name: [] for name in a_run["arrays"]}
    (tmp_path / "wrong.jsonl").write_text(json.dumps(a_run | {"arrays": empty}) + "\n")
    assert refused("evaluate", "wrong.jsonl").code == "run-impossible"


@pytest.mark.parametrize("array", ["trajectory.t", "log.t"])
@pytest.mark.parametrize(
    ("at", "value"),
    [(0, -1.0), (3, 0.0), (1, 0.0)],
)
def test_a_run_in_which_time_does_not_pass_is_refused(
    refused, tmp_path: Path, a_run: dict, array: str, at: int, value: float
) -> None:
    a_run["arrays"][array][at] = value
    (tmp_path / "wrong.jsonl").write_text(json.dumps(a_run) + "\n")
    told = refused("evaluate", "wrong.jsonl")
    assert isinstance(told.error, FileError) and (told.error.code, told.error.line) == ("run-impossible", 1)
    assert told.error.reason.startswith(array)


def test_a_run_that_is_given_twice_counts_once(a_run: dict, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "r.jsonl", "r.jsonl", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["verdict"]["runs"] == 1 and len(told["notes"]) == 1


@pytest.mark.parametrize("out", ["folder", "file/below.json"])
def test_a_result_that_could_not_be_written_is_refused_before_the_work(
    tmp_path: Path, a_run: dict, capsys: pytest.CaptureFixture[str], out: str
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("")
    capsys.readouterr()
    for asked in (
        ["simulate", "s.json", *SMALL[:2]],
        ["scenario", "shrink", "s.json", *SMALL[:2]],
        ["scenario", "propose"],
    ):
        assert main([*asked, "--out", out]) == 2
        told = capsys.readouterr().err
        assert out.split("/")[0] in told and "seed" not in told and "valid" not in told


@pytest.mark.parametrize("several", [[], SEVERAL])
def test_junit_below_a_file_is_refused_before_the_work(refused, tmp_path: Path, several: list[str]) -> None:
    (tmp_path / "file").write_text("")
    assert refused("run", *SMALL, *several, "--junit", "file/junit.xml", "--out", "one").code == "not-writable"


@pytest.mark.parametrize(
    "asked",
    [
        ("report", "one", "--tables", "file"),
        ("scenario", "prompt", "--pictures", "file"),
        ("scenario", "prompt", "--copy", "compact-new", "--to", "file"),
        ("world", "draw", "warehouse", "--what", "labels", "--width", "400", "--out", "file"),
    ],
)
def test_a_file_in_the_place_of_a_folder_for_output_is_told_with_the_option(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, errors: list[RvsgError], asked: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    assert main(list(asked)) == 2
    assert errors[-1].code == "not-writable" and asked[-2] in str(errors[-1])


def test_every_verb_makes_the_folders_of_its_output(a_run: dict) -> None:
    for asked in (
        ["scenario", "propose", "--out", "a/b/proposal.json"],
        ["simulate", "s.json", *SMALL[:2], "--out", "c/d/runs.jsonl"],
        ["evaluate", "r.jsonl", "--scenario", "s.json", "--feedback", "e/f/feedback.json"],
        ["run", *SMALL, "--confirmations", "0", "--out", "g/h", "--junit", "i/j/junit.xml"],
        ["report", "g/h", "--html", "k/l/page.html"],
        ["scenario", "prompt", "--copy", "compact-new", "--to", "m/n"],
    ):
        assert main(asked) == 0
        assert Path(asked[-1]).exists()


def test_a_device_that_is_no_file_of_ours_may_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda *_: False)  # as for a user who may not write into /dev
    check_writable(Path("/dev/null"))


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder that takes no file, whatever its rights")
def test_a_junit_file_that_cannot_be_made_is_told_before_the_campaign(tmp_path: Path, errors: list[RvsgError]) -> None:
    assert main(["run", *SMALL, "--out", str(tmp_path / "new"), "--junit", "/proc/x.xml"]) == 2
    assert errors[-1].code == "not-writable"
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs a device that is always full")
@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_full_disk_is_no_defect_of_the_program(tmp_path: Path, a_run: dict, stream: str) -> None:
    with Path("/dev/full").open("w") as full:
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | {stream: full}
        command = [sys.executable, "-m", "rvsg", "evaluate", "r.jsonl", "--json"]
        done = subprocess.run(command, **streams, text=True, cwd=tmp_path)
    assert done.returncode == 2
    if stream == "stdout":
        assert "No space left on device" in done.stderr and "defect" not in done.stderr


@pytest.mark.parametrize("option", ["stop_gap_m=abc", "stop_gap_m=-5", "robot_speed_m_s=.inf", "robot_speed_m_s=nan"])
def test_options_of_the_kinematic_simulator_that_are_no_numbers_are_refused(refused, option: str) -> None:
    said = refused("run", *SMALL, "--simulator-option", option)
    assert said.code == "plug-in-options" and option.split("=")[0] in said


def test_a_number_that_yaml_takes_for_a_word_is_a_number(tmp_path: Path) -> None:
    arguments = ["--simulator-option", "stop_gap_m=5e-1", "--confirmations", "0", "--out", str(tmp_path / "one")]
    assert main(["run", *SMALL, *arguments]) == 0


@pytest.mark.parametrize("content", [None, "", "{}", '{"address": 5}'])
def test_a_scheduler_file_without_a_scheduler_is_refused_at_once(refused, tmp_path: Path, content: str | None) -> None:
    pytest.importorskip("distributed")
    if content is not None:
        (tmp_path / "s.json").write_text(content)
    said = refused("run", *SMALL, "--executor", "cluster", "--executor-option", "scheduler_file=s.json")
    assert said.code == "plug-in-options"


def test_junit_into_a_folder_is_refused_before_the_work(refused) -> None:
    assert refused("run", *SMALL, "--junit", ".", "--out", "one").code == "not-writable"


@pytest.mark.slow
def test_a_reader_that_goes_away_is_no_violation(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "rvsg", "run", *SMALL, "--out", str(tmp_path / "one")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as process:
        assert process.stderr is not None
        process.stderr.close()
        assert process.wait(timeout=300) == 3
