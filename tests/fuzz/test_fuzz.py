"""Damaged and impossible inputs of every kind are refused with one message; `make fuzz MINUTES=10` tries many."""

from __future__ import annotations

import copy
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.fuzz.harness import BY_NAME, case, received, run_case
from tests.fuzz.kinds import model, person, scenario

from rvsg.cli import main

QUICK = ("answer", "option", "robot", "map", "scenario")
"""Kinds of which a case takes a tenth of a second."""
FOUND = [("answer", 10), ("answer", 18), ("study", 28), ("runs", 67)]
"""Kinds and seeds that once were findings."""
VALUES = (1e308, -1e308, 1e12, -1e12, -1, 0, 1e6, 1e-308, 10**19, float("nan"), None, [], {}, "a" * 5000, True)
WITH_VALUES = ("requirement", "campaign", "map", "scenario", "robot", "runs", "objects", "world")
HUGE = int("9" * 400)
LONE = "a\ud800b"
LONG = "a" * 5000
Key = tuple[str | int, ...]


def quick_first(names: Any, quick: tuple[str, ...]) -> pytest.MarkDecorator:
    marked = [pytest.param(name, marks=() if name in quick else pytest.mark.exhaustive) for name in names]
    return pytest.mark.parametrize("name", marked)


@quick_first(BY_NAME, QUICK)
def test_the_whole_example_is_accepted(name: str, tmp_path: Path) -> None:
    BY_NAME[name].write(tmp_path)
    outcome = received(BY_NAME[name], tmp_path)
    assert (outcome.code, outcome.finding) == (0, ""), outcome.messages


@quick_first(BY_NAME, QUICK)
def test_damaged_inputs_are_received(name: str) -> None:
    for seed in range(1000, 1006):
        outcome = run_case(name, seed)
        assert not outcome.finding, f"{name} {seed}: {outcome.finding}"


@pytest.mark.parametrize(("name", "seed"), FOUND)
def test_what_was_once_a_finding_is_none(name: str, seed: int) -> None:
    assert not run_case(name, seed).finding


def test_the_damage_follows_from_the_seed(tmp_path: Path) -> None:
    for folder in ("a", "b", "c"):
        case(BY_NAME["robot"], 7 if folder != "c" else 8, tmp_path / folder)
    one, other, third = ((tmp_path / folder / "r.yaml").read_bytes() for folder in ("a", "b", "c"))
    assert one == other != third


def places(value: Any, at: Key = ()) -> Iterator[Key]:
    """Yield the path to every value; of a long list the first, the middle and the last."""
    if at:
        yield at
    if isinstance(value, dict):
        for name, each in value.items():
            yield from places(each, (*at, name))
    elif isinstance(value, list):
        for index in sorted({0, len(value) // 2, len(value) - 1} if value else ()):
            yield from places(value[index], (*at, index))


def replaced(document: Any, at: Key, value: object) -> Any:
    """Return a copy of the document with another value at this place."""
    whole = copy.deepcopy(document)
    around = whole
    for key in at[:-1]:
        around = around[key]
    around[at[-1]] = value
    return whole


@quick_first(WITH_VALUES, ("requirement",))
def test_a_value_out_of_range_is_received(name: str, tmp_path: Path) -> None:
    findings = []
    for file in BY_NAME[name].write(tmp_path / "whole"):
        if file.suffix not in (".yaml", ".json", ".jsonl"):
            continue
        load, dump = (yaml.safe_load, yaml.safe_dump) if file.suffix == ".yaml" else (json.loads, json.dumps)
        document = load(file.read_text())
        for at in places(document):
            for value in VALUES:
                folder = tmp_path / "damaged"
                shutil.copytree(tmp_path / "whole", folder)
                (folder / file.relative_to(tmp_path / "whole")).write_text(dump(replaced(document, at, value)) + "\n")
                outcome = received(BY_NAME[name], folder)
                if outcome.finding:
                    findings.append(f"{at} {str(value)[:20]}: {outcome.finding.strip().splitlines()[-1]}")
                shutil.rmtree(folder)
    assert not findings, findings[:10]


@pytest.mark.parametrize(
    "changes",
    [
        *({"speed_m_s": HUGE}, {"speed_m_s": 1e300}, {"start_delay_s": -HUGE}, {"group": HUGE}),
        *({"name": LONE}, {"behaviour": LONE}, {LONE: 1}, {"description": LONE}),
        {"tasks": [{"task": "a", "path": ["G7", "G9"], "pauses": [{"at": "G9", "duration_s": HUGE}]}]},
        {"tasks": [{"task": LONE, "path": ["G7", LONE], "pauses": []}]},
    ],
    ids=["speed", "float", "delay", "group", "name", "behaviour", "key", "description", "pause", "task"],
)
def test_an_answer_that_no_record_can_hold_is_received(changes: dict[str, Any], tmp_path: Path) -> None:
    description = changes.get("description", "x")
    answer = {"description": description, "humans": [person("Human 1", **changes), person("Human 2")]}
    (tmp_path / "answer.txt").write_text(json.dumps(answer))
    assert received(BY_NAME["answer"], tmp_path).finding == ""


def sdf(geometry: str, name: str = "thing", pose: str = "0 0 0.5 0 0 0") -> str:
    walls = [model("<box><size>10 0.2 1</size></box>", f"0 {y} 0.5 0 0 0", f"wall{y}") for y in (-5, 5)]
    inside = "".join([*walls, model(geometry, pose, name)])
    return f"<?xml version='1.0'?><sdf version='1.7'><world name='w'>{inside}</world></sdf>"


@pytest.mark.slow
@pytest.mark.parametrize(
    "world",
    [
        sdf("<box><size>1 1 1</size></box>", name="x" * 121),
        sdf("<box><size>1 1 100000</size></box>"),
        sdf("<box><size>1 1 1</size></box>", pose="1e7 0 0 0 0 0"),
        sdf("<polyline><point>0 0</point><point>1 0</point><point>2 0</point><height>1</height></polyline>"),
        sdf("<mesh><uri>http://[::1</uri></mesh>"),
        sdf("<mesh><uri>/dev/zero</uri></mesh>"),
        sdf(f"<mesh><uri>model://{'a/' * 3000}</uri></mesh>"),
    ],
    ids=["long name", "100 km high", "far away", "a line", "uri", "device", "long uri"],
)
def test_a_world_that_cannot_be_is_refused_before_a_file_is_written(tmp_path: Path, world: str) -> None:
    (tmp_path / "a.sdf").write_text(world)
    assert main(["world", "new", str(tmp_path / "w"), "--sdf", str(tmp_path / "a.sdf")]) == 2
    assert not (tmp_path / "w").exists()


@pytest.mark.parametrize("ring", ["[[0, 0], [0, 0], [0, 0]]", "[[0, 0], [1, 0], [2, 0]]", "[[0, 0], [1, 0], [0, 0]]"])
def test_an_outline_without_area_is_refused_with_its_line(
    tmp_path: Path, ring: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "o.yaml").write_text(f"objects:\n- {{name: a, footprint: {ring}, height: 1}}\n")
    assert main(["world", "new", str(tmp_path / "w"), "--objects", str(tmp_path / "o.yaml")]) == 2
    assert "o.yaml:2: " in capsys.readouterr().err
    assert not (tmp_path / "w").exists()


@pytest.mark.parametrize(
    "argv",
    [
        *(["simulate", LONG], ["world", "check", LONG], ["run", "--world", LONG], ["report", "a/" * 4000]),
        *(["evaluate", LONG], ["run", "--requirement", LONG], ["run", "--robot", LONG], ["run", LONG]),
        ["run", "--simulator", "kinematic", "--generator", "random", "--scenarios", "1", "--out", LONG],
        ["scenario", "propose", "--generator", "random", "--out", LONG],
        ["run", "--generator", "vlm", "--replay", LONG],
        ["simulate", "x", "--simulator-option", "a=" + "[" * 5000],
        ["simulate", "x", "--simulator-option", "a=" + "9" * 5000],
    ],
    ids=lambda argv: " ".join(argv)[:40],
)
def test_a_name_no_file_system_can_hold_is_an_input_error(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(argv) == 2
    said = capsys.readouterr().err
    assert "Traceback" not in said and 0 < len(said) < 3000


def test_a_scenario_whose_world_has_an_endless_name_is_an_input_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    value = json.loads(scenario().to_json())
    value["mission"]["world"], value["mission"]["world_id"] = LONG, "world-0000000000000000"
    (tmp_path / "s.json").write_text(json.dumps(value))
    assert main(["simulate", str(tmp_path / "s.json")]) == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="there is no /dev/zero here")
@pytest.mark.parametrize("verb", ["simulate", "scenario shrink", "run", "scenario prompt", "report", "evaluate"])
@pytest.mark.parametrize("device", ["/dev/zero", "/dev/full"])
def test_a_device_without_end_is_refused(verb: str, device: str) -> None:
    assert main([*verb.split(), device]) == 2


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("sh") is None, reason="needs a shell")
@pytest.mark.parametrize("closed", [">&- 2>&-", "<&- >&-"])
def test_a_stream_that_is_closed_at_the_start_is_no_defect(closed: str) -> None:
    command = f"{sys.executable} -m rvsg robots {closed}"
    done = subprocess.run(["sh", "-c", command], capture_output=True, timeout=300)
    assert done.returncode in (0, 2) and b"Traceback" not in done.stderr
