"""Inputs that no file system, map or record can hold are refused with one message, before anything is written."""

from __future__ import annotations

from pathlib import Path

import pytest

from rvsg.cli import main

LONG = "a" * 5000
WALLS = "".join(
    f"<model name='wall{y}'><static>1</static><pose>0 {y} 0.5 0 0 0</pose><link name='l'><collision name='c'><geometry>"
    "<box><size>10 0.2 1</size></box></geometry></collision></link></model>"
    for y in (-5, 5)
)


def sdf(geometry: str, name: str = "thing", pose: str = "0 0 0.5 0 0 0") -> str:
    thing = (
        f"<model name='{name}'><static>1</static><pose>{pose}</pose><link name='l'><collision name='c'>"
        f"<geometry>{geometry}</geometry></collision></link></model>"
    )
    return f"<?xml version='1.0'?><sdf version='1.7'><world name='w'>{WALLS}{thing}</world></sdf>"


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
@pytest.mark.slow
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


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="there is no /dev/zero here")
@pytest.mark.parametrize("verb", ["simulate", "shrink", "run", "prompt", "report", "evaluate"])
@pytest.mark.parametrize("device", ["/dev/zero", "/dev/full"])
def test_a_device_without_end_is_refused(verb: str, device: str) -> None:
    assert main([verb, device]) == 2
