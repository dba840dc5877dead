"""Runs as recordings of Rerun, read back by Rerun's own reader."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest

from rvsg.core.errors import FileError, InputError
from rvsg.simulation.exporter import Exportable
from rvsg.simulation.run import Run
from rvsg.world.world import World
from rvsg_exchange.formats import Mcap
from rvsg_exchange.rerun import Rerun

chunk = pytest.importorskip("rerun.chunk", reason="the extra `rerun` is not installed")


def test_robot_and_people_are_read_back_where_they_were(run: Run, world: World, tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    assert Rerun().write(Exportable(world=world, runs=(run,)), path) == ()
    found = {each.entity_path: each for each in chunk.RrdReader(path).store().stream().to_chunks()}
    people = {f"/people/{name}".replace(" ", "\\ ") for name in run.human_names}
    assert {"/robot", "/robot/outline", "/speed/robot", "/world", *people} <= found.keys()
    batch = found["/robot"].to_record_batch()
    column = next(name for name in batch.schema.names if name.endswith("translation"))
    at = np.array([row[0] for row in batch.column(column).to_pylist()])
    assert at[:, :2] == pytest.approx(np.column_stack([run.trajectory.x, run.trajectory.y]), abs=1e-5)
    times = np.array([each.total_seconds() for each in batch.column("simulated").to_pylist()])
    assert times == pytest.approx(run.trajectory.t, abs=1e-6)


def test_a_full_disk_leaves_no_part_of_a_recording(
    run: Run, world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, data: bytes) -> int:
        with path.open("wb") as file:
            file.write(data[:100])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    for name, write in {"run.rrd": Rerun().write, "run.mcap": Mcap().write}.items():
        with pytest.raises(FileError, match="No space left"):
            write(Exportable(world=world, runs=(run,)), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_recording_holds_one_run(run: Run, world: World, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="one run, and 2 are given"):
        Rerun().write(Exportable(world=world, runs=(run, run)), tmp_path / "run.rrd")
    assert not (tmp_path / "run.rrd").exists()
