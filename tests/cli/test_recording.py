"""`rvsg recording` from a bag to a scenario."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import rvsg
from rvsg.cli import main

pytest.importorskip("rosbags", reason="the extra `bag` is not installed")


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from rvsg_exchange.bag import write_bag

    world = rvsg.load_world("warehouse")
    scenario = rvsg.propose(world, "route_1", "R1", humans=2, seed=5).scenario
    assert scenario is not None
    path = tmp_path_factory.mktemp("bag") / "run.mcap"
    write_bag(rvsg.simulate(scenario, [1], world=world)[0], world, path)
    return path


def test_a_bag_is_inspected(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recording", "inspect", str(bag), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["people"]) == len(found["usable"]) == 2
    assert {"/odom", "/human_states"} <= {each["name"] for each in found["streams"] if each["used_for"]}
    assert main(["recording", "inspect", str(bag)]) == 0
    assert main(["recording", "inspect", str(bag.with_name("absent.mcap"))]) == 2


def test_a_bag_becomes_a_scenario_without_a_world_at_hand(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert (
        main(["recording", "scenario", str(bag), "--out", "made.json", "--html", "page.html", "--runs", "1", "--json"])
        == 0
    )
    told = capsys.readouterr()
    assert "world: made-world" in told.err
    found = json.loads(told.out)
    assert found["fidelity"][0]["gap_m"] is not None
    assert (tmp_path / "page.html").is_file() and (tmp_path / "made-world" / "world.yaml").is_file()
    assert main(["simulate", "made.json", "--out", "runs.jsonl"]) == 0
    assert main(["suite", "add", "made.json", "--suite", "kept", "--expect", "pass"]) == 0
    assert main(["recording", "scenario", str(bag), "--people", "drunk"]) == 2


def test_a_folder_becomes_a_suite_without_a_world_at_hand(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    make = ["recording", "suite", str(bag.parent), "--suite", "kept", "--runs", "1", "--open-floor"]
    assert main(make) == 0
    assert "kept holds 1 case." in capsys.readouterr().err
    assert (tmp_path / "kept" / "worlds" / "run" / "world.yaml").is_file()
    assert main(["suite", "run", "kept", "--runs", "1"]) == 0


def test_a_folder_without_a_usable_recording_makes_no_suite(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bags").mkdir()
    Path("bags/bare.csv").write_text("id,t,x,y\nrobot,0,0,0\nrobot,9,4,0\n1,0,2,1\n1,9,2,2\n")
    assert main(["recording", "suite", "bags", "--suite", "kept"]) == 2
    said = capsys.readouterr().err
    assert "--open-floor" in said and "rvsg suite run" not in said and not Path("kept").exists()
