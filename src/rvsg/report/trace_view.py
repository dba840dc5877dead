"""A trace as a file that the replay shows: what the robot saw, planned and tried, 5 times a second.

The file is JSON. Numbers over time stand in blobs like those of the replay (`rvsg.report.payload`): base64 of a zlib
stream of channels, or of plain bytes for costmaps. `static/trace.js` documents and reads the same layout. It is a view:
ranges are in centimetres and only every few rays are kept; the bag of the same trace holds all of it.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import FileError
from rvsg.core.inputs import parse_json, read_text
from rvsg.report.payload import varints
from rvsg.world.world import World

if TYPE_CHECKING:
    from rvsg.simulation.embedded.trace import Evaluation, Frame, Trace

FORMAT = "rvsg-trace"
VERSION = 1
EVERY = 2
"""Of the frames of a trace, 10 a second, every n-th is kept."""
MOST_RAYS = 181
"""Rays of a lidar that are kept at most."""
MOST_SAMPLES = 150
"""Samples of the local planner that are kept at most: evenly, and always the chosen one."""
PLAN_STEP = 6
"""Of the poses of a plan, 0.025 m apart, every n-th is kept."""


def trace_view(trace: Trace, world: World) -> dict[str, Any]:
    """Return the data of the file."""
    frames = trace.frames[::EVERY]
    return {
        "format": FORMAT,
        "version": VERSION,
        "run": trace.run.id,
        "scenario": trace.run.scenario_id,
        "seed": trace.run.seed,
        "frames": [round(frame.t, 2) for frame in frames],
        "lidars": [_lidar(trace, frames, k) for k in range(len(trace.robot.lidars))],
        "local": _local(trace, frames),
        "global": _global(trace, world),
        "plans": _plans(trace),
        "tried": _tried(frames),
        "phases": _changes((frame.t, frame.phase) for frame in trace.frames),
        "nodes": [[change.t, change.node, change.before, change.after] for change in trace.nodes],
    }


def trace_json(trace: Trace, world: World) -> str:
    """Return the text of the file."""
    return json.dumps(trace_view(trace, world), ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"


def _lidar(trace: Trace, frames: Sequence[Frame], number: int) -> dict[str, Any]:
    """Channels: x, y (cm) and yaw (0.01 rad) of the robot at the scan of each frame; then its ranges (cm, 0: none)."""
    lidar = trace.robot.lidars[number]
    step = -(-lidar.rays // MOST_RAYS)
    kept = np.arange(0, lidar.rays, step)
    poses = np.array([frame.seen_from[number] for frame in frames]).reshape(-1, 3)
    ranges = np.array([frame.scans[number][kept] for frame in frames]).reshape(len(frames), len(kept))
    channels = [poses[:, 0] * 100, poses[:, 1] * 100, np.unwrap(poses[:, 2]) * 100]
    channels += list(np.where(np.isfinite(ranges), np.maximum(1.0, ranges * 100), 0.0))
    return {
        "x": lidar.x,
        "y": lidar.y,
        "first": round(lidar.yaw - lidar.field_of_view_rad / 2, 5),
        "step": round(step * lidar.field_of_view_rad / (lidar.rays - 1), 6),
        "rays": len(kept),
        "blob": _channels(channels),
    }


def _local(trace: Trace, frames: Sequence[Frame]) -> dict[str, Any]:
    """`origins`: channels of the corner's x and y in cells; `blob`: the bytes of each frame, row by row."""
    cells = np.array([frame.costmap for frame in frames], np.uint8)
    corners = np.array([frame.costmap_origin for frame in frames]).reshape(-1, 2) / trace.resolution
    return {
        "rows": cells.shape[1] if cells.ndim == 3 else 0,
        "columns": cells.shape[2] if cells.ndim == 3 else 0,
        "resolution": trace.resolution,
        "origins": _channels([corners[:, 0], corners[:, 1]]),
        "blob": _packed(cells.tobytes()),
    }


def _global(trace: Trace, world: World) -> dict[str, Any]:
    """`patches`: time, row, column, rows and columns of each change, the first is the whole; `blob`: their bytes."""
    new = [(frame.t, frame.global_costmap) for frame in trace.frames if frame.global_costmap is not None]
    x, y = trace.global_origin
    return {
        "x": round(x + world.map_offset[0], 4),
        "y": round(y + world.map_offset[1], 4),
        "resolution": trace.global_resolution,
        "patches": [[round(t, 2), p.row, p.column, *p.cells.shape] for t, p in new],
        "blob": _packed(b"".join(p.cells.tobytes() for _, p in new)),
    }


def _plans(trace: Trace) -> dict[str, Any]:
    """`plans`: time and number of points of each plan; `blob`: for each the channels x and y (cm)."""
    new = [(frame.t, _thinned(frame.plan)) for frame in trace.frames if frame.plan is not None]
    channels = [points[:, axis] * 100 for _, points in new for axis in (0, 1)]
    return {"plans": [[round(t, 2), len(points)] for t, points in new], "blob": _channels(channels)}


def _tried(frames: Sequence[Frame]) -> dict[str, Any]:
    """`asked`: time, number of samples, the chosen one (-1: none) and x, y, yaw of the robot at each answer.

    `blob`: for each answer the channels forward speed (mm/s), yaw rate (mrad/s), with `sideways` the speed to the left
    (mm/s), x and y of the end from the robot (cm), and score (tenths; -1: forbidden). `shares`: for each answer what
    each of `critics` adds to the total of the chosen sample; empty where none is chosen.
    """
    asked, channels, shares = [], [], []
    critics: tuple[str, ...] = ()
    answers = [frame.evaluation for frame in frames if frame.evaluation is not None]
    for tried in answers:
        kept = _spread(tried)
        best = int(np.flatnonzero(kept == tried.best)[0]) if tried.best >= 0 else -1
        x, y, yaw = tried.pose
        asked.append([round(tried.t, 2), len(kept), best, round(x, 2), round(y, 2), round(yaw, 3)])
        critics = tried.critics
        shares.append((tried.raw[tried.best] * tried.scales).round(2).tolist() if critics and tried.best >= 0 else [])
        score = tried.score[kept]
        channels += [
            *(tried.velocity[kept] * 1000).T,
            (tried.end[kept, 0] - x) * 100,
            (tried.end[kept, 1] - y) * 100,
            np.where(np.isfinite(score), score * 10, -1.0),
        ]
    sideways = any(tried.velocity.shape[1] == 3 for tried in answers)
    return {
        "asked": asked,
        "critics": critics,
        "shares": shares,
        **({"sideways": True} if sideways else {}),
        "blob": _channels(channels),
    }


def _spread(tried: Evaluation) -> NDArray[np.intp]:
    kept = np.arange(0, len(tried.score), max(1, -(-len(tried.score) // MOST_SAMPLES)))
    return np.union1d(kept, [tried.best]) if tried.best >= 0 else kept


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.vstack([points[:-1:PLAN_STEP], points[-1:]])


def _changes(values: Iterable[tuple[float, str]]) -> list[list[Any]]:
    """Keep the first of equal values that follow each other."""
    found: list[list[Any]] = []
    for t, value in values:
        if not found or found[-1][1] != value:
            found.append([round(t, 2), value])
    return found


def _channels(channels: Iterable[NDArray[np.float64]]) -> str:
    return _packed(b"".join(varints(np.round(channel).astype(np.int64)) for channel in channels))


def _packed(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data, 9)).decode()


TRACES = "traces"
"""The folder beside a report in which the report finds traces."""


SUFFIX = ".trace.json"


MOST_IN_A_PAGE = 1_500_000
"""Bytes of traces that a page holds; it opens further ones from their files."""


def trace_file_beside(folder: Path, run: str) -> Path:
    """Return the file in which the report of a folder finds the trace of a run."""
    return folder / TRACES / f"{run}{SUFFIX}"


def traces_beside(page: Path, runs: Collection[str]) -> list[Mapping[str, Any]]:
    """Return the traces beside a page that are of its runs, in the order of their names, as far as the page holds them.

    Raises:
        FileError: a file is no trace.
    """
    found: list[Mapping[str, Any]] = []
    left = MOST_IN_A_PAGE
    for path in sorted((page.parent / TRACES).glob(f"*{SUFFIX}")):
        if path.name.removesuffix(SUFFIX) not in runs or path.stat().st_size > left:
            continue
        value = parse_json(read_text(path), path)
        if not isinstance(value, dict) or value.get("format") != FORMAT or value.get("run") not in runs:
            raise FileError(path, "this is not the trace its name says. Remove it, or write it again: rvsg trace.")
        left -= path.stat().st_size
        found.append(value)
    return found
