"""Trajectories as tables: one row per sample, for CSV, Parquet and data frames."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError, how_to_install
from rvsg.core.files import write_whole
from rvsg.simulation.run import Run

Column = NDArray[Any]


def trajectory_table(runs: Iterable[Run]) -> dict[str, Column]:
    """Return the trajectories of runs as columns of equal length.

    Columns: `run` (content id), `seed`, `t` (s), `robot` or the name of a person as `who`, `x`, `y` (m, world frame),
    `yaw` (rad), `speed` (m/s), and for the robot `omega` (rad/s) and `acceleration` (m/s2); people have NaN there.
    Rows are ordered by run, then who, then time.
    """
    parts: list[dict[str, Column]] = []
    for run in runs:
        path = run.trajectory
        n = len(path)
        none = np.full(n, np.nan)
        same = {"run": np.full(n, run.id), "seed": np.full(n, run.seed), "t": path.t}
        parts.append(
            same
            | {"who": np.full(n, "robot"), "x": path.x, "y": path.y, "yaw": path.yaw, "speed": path.v}
            | {"omega": path.omega, "acceleration": path.acceleration}
        )
        for k, name in enumerate(run.human_names):
            human = {"x": path.human_x, "y": path.human_y, "yaw": path.human_yaw, "speed": path.human_speed}
            parts.append(
                same
                | {"who": np.full(n, name)}
                | {key: values[:, k] for key, values in human.items()}
                | {"omega": none, "acceleration": none}
            )
    if not parts:
        raise InputError("There are no runs to write a table of.")
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def write_csv(runs: Iterable[Run], path: Path) -> None:
    """Write trajectories as CSV with a header line. Numbers are written so that reading gives the same float."""
    table = trajectory_table(runs)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    columns = [values.tolist() for values in table.values()]
    for row in zip(*columns, strict=True):
        writer.writerow(["" if value != value else value for value in row])
    write_whole(path, text.getvalue())


def write_parquet(runs: Iterable[Run], path: Path) -> None:
    """Write trajectories as a Parquet file; needs pyarrow (extra `tables`)."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise InputError(f"Parquet needs pyarrow: {how_to_install('tables')}.") from None
    table = {key: pa.array(values.tolist(), from_pandas=True) for key, values in trajectory_table(runs).items()}
    sink = io.BytesIO()
    pq.write_table(pa.table(table), sink)
    write_whole(path, sink.getvalue())
