"""Files of tracks: CSV, Parquet and JSON with named columns, ETH/UCY text, and TrajNet++ text.

A table has the columns `id`, `t`, `x`, `y` and, where known, `yaw` and `speed`; a unit may follow the name, as in
`x_cm`, `t_ms`, `yaw_deg`, `speed_km_h`. The column `frame` is `map` (also where it is missing) or `world`. The rows of
the id `robot` are the robot's. JSON is a list of such rows, or an object `{"frame": ..., "tracks": [...]}`.
"""

from __future__ import annotations

import csv
import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import FileError, InputError, how_to_install
from rvsg.core.inputs import parse_json, read_text
from rvsg.recording.recorded_run import speed_of
from rvsg.recording.tracks import Note, PersonTrack, Recording, Stream
from rvsg.world.world import World

Floats = NDArray[np.float64]
Row = tuple[str, float, float, float, float, float, str]
"""Id, time s, x m, y m, yaw rad, speed m/s, frame."""

ENDINGS = (".csv", ".parquet", ".json", ".txt", ".ndjson")
ROBOT = "robot"
UNITS = {
    "t": {"s": 1.0, "ms": 1e-3, "ns": 1e-9},
    "x": {"m": 1.0, "cm": 0.01, "mm": 0.001},
    "y": {"m": 1.0, "cm": 0.01, "mm": 0.001},
    "yaw": {"rad": 1.0, "deg": math.pi / 180.0},
    "speed": {"m_s": 1.0, "km_h": 1.0 / 3.6},
}
ANNOTATED_S = 0.4
"""ETH, UCY and TrajNet++ are annotated every 0.4 s."""
BACK_S = 1.0
TURNS_RAD = 4 * math.pi
"""A yaw beyond this is taken for one in degrees, unless its column is named for its unit."""


def read_tracks(path: Path, *, world: World | None = None) -> Recording:
    """Read a file of tracks by its ending; FileError names the line that cannot be used."""
    if not path.exists():
        raise FileError(path, "the recording does not exist.")
    kind = path.suffix.lower()
    notes: list[Note] = []
    if kind == ".txt" or kind == ".ndjson":
        rows = list(_trajnet(path) if read_text(path).lstrip().startswith("{") else _eth(path))
        notes.append(Note(kind="clock", text=f"Frames are counted as {ANNOTATED_S:g} s apart, as ETH and UCY are."))
    else:
        source = {".csv": _csv, ".parquet": _parquet, ".json": _json}[kind]
        rows = list(_columns(path, source(path), notes))
    if not rows:
        raise FileError(path, "the file holds no track. It needs the columns id, t, x, y.")
    frames = {row[6] for row in rows}
    if wrong := sorted(frames - {"map", "world"}):
        said = f'tracks are in the frame "{wrong[0]}".'
        raise FileError(path, f"{said} Give them in the map frame (map) or in that of the world (world).")
    if len(frames) > 1:
        raise FileError(path, "some tracks are in the map frame and some in that of the world. Give all in one.")
    by_name: dict[str, list[tuple[float, ...]]] = defaultdict(list)
    for row in rows:
        track = by_name[row[0]]
        if track and row[1] < track[-1][0] - BACK_S:
            said = f"the time of {row[0]} goes back from {track[-1][0]:.1f} s to {row[1]:.1f} s"
            raise FileError(path, f"{said}, so the file holds several recordings. Cut it into one for each.")
        track.append(row[1:6])
    offset = world.map_offset if world is not None and frames == {"map"} else (0.0, 0.0)
    begin = min(track[0][0] for track in by_name.values())
    tracks = {name: _array(track, begin, offset) for name, track in by_name.items()}
    robot = np.empty((0, 7))
    if ROBOT in tracks:
        robot = _robot(tracks.pop(ROBOT))
    else:
        notes.append(Note(kind="no-robot", text="The file holds no robot (id `robot`)."))
    streams = (Stream(name=path.name, kind=kind[1:], messages=len(rows), used_for="read"),)
    people = tuple(PersonTrack(name=_called(name), rows=rows) for name, rows in tracks.items())
    if not people:
        notes.append(Note(kind="no-people", text="The file holds no people."))
    return Recording(source=str(path), people=people, robot=robot, streams=streams, notes=tuple(notes))


def _called(name: str) -> str:
    return f"Person {name}" if name.replace(".", "", 1).isdigit() else name


def _array(track: list[tuple[float, ...]], begin: float, offset: tuple[float, float]) -> Floats:
    rows = np.array(sorted(track))
    rows = rows[np.isfinite(rows[:, :3]).all(axis=1)]
    rows[:, 0] -= begin
    rows[:, 1:3] += offset
    return np.asarray(rows)


def _robot(rows: Floats) -> Floats:
    """Return the robot's rows with its speed and turning; without a yaw it faces where it drives."""
    rows = rows[np.diff(rows[:, 0], prepend=-math.inf) > 0.0]
    if len(rows) < 2:
        return np.empty((0, 7))
    t = rows[:, 0]
    vx, vy = (np.gradient(rows[:, k], t) for k in (1, 2))
    yaw = rows[:, 3] if np.isfinite(rows[:, 3]).all() else _driving(vx, vy)
    speed = np.where(np.isfinite(rows[:, 4]), rows[:, 4], speed_of(rows))
    return np.column_stack([rows[:, :3], yaw, speed, np.gradient(np.unwrap(yaw), t), np.zeros(len(t))])


def _driving(vx: Floats, vy: Floats) -> Floats:
    """Return the direction of motion; who stands keeps the last one."""
    moves = np.hypot(vx, vy) > 0.05
    if not moves.any():
        return np.zeros(len(vx))
    last = np.maximum.accumulate(np.where(moves, np.arange(len(vx)), int(moves.argmax())))
    return np.asarray(np.arctan2(vy, vx)[last])


def _columns(path: Path, table: Iterable[Mapping[str, Any]], notes: list[Note]) -> Iterator[Row]:
    """Yield the rows of a table whose columns are named; a note tells which are not read."""
    known: dict[str, tuple[str, float]] = {}
    for number, row in enumerate(table, start=1):
        if number == 1:
            known = _known(path, row)
            if unread := sorted(map(str, row.keys() - {"id", "frame"} - {column for column, _ in known.values()})):
                notes.append(Note(kind="columns", text=f"Columns that are not read: {', '.join(unread)}."))
        try:
            values = {
                name: float(row[column]) * scale for name, (column, scale) in known.items() if _is_given(row[column])
            }
            yield (
                str(row["id"]), values["t"], values["x"], values["y"], values.get("yaw", math.nan),
                values.get("speed", math.nan), str(row.get("frame") or "map"),
            )  # fmt: skip
        except (KeyError, TypeError, ValueError):
            said = f"row {number} lacks an id or a number: {dict(row)}. Complete it, or take it out."
            raise FileError(path, said) from None
        if known.get("yaw", ("",))[0] == "yaw" and abs(values.get("yaw", 0.0)) > TURNS_RAD:
            said = (
                f"row {number} has a yaw of {values['yaw']:g}. Name the column yaw_deg, or yaw_rad if it is in radians."
            )
            raise FileError(path, said)


def _is_given(value: Any) -> bool:
    return value is not None and value != ""


def _known(path: Path, row: Mapping[str, Any]) -> dict[str, tuple[str, float]]:
    """Return for each quantity its column and the factor to SI units."""
    found: dict[str, tuple[str, float]] = {}
    for name, units in UNITS.items():
        for column in map(str, row):
            unit = column.removeprefix(f"{name}_")
            if column == name or (unit in units and column != unit):
                found[name] = (column, units.get(unit, 1.0))
    missing = [name for name in ("id", "t", "x", "y") if name not in found and name not in row]
    if missing:
        named = ", ".join(f"{name}_{unit}" for name in ("t", "x") for unit in UNITS[name])
        raise FileError(path, f"there is no column {missing[0]}. Needed: id, t, x, y; with units: {named}.")
    return found


def _csv(path: Path) -> Iterator[Mapping[str, Any]]:
    with path.open(encoding="utf-8-sig", newline="") as file:
        try:
            yield from csv.DictReader(file)
        except (UnicodeDecodeError, csv.Error) as error:
            raise FileError(path, f"this is no table as text ({error}). Save it as CSV in UTF-8.") from None


def _parquet(path: Path) -> Iterator[Mapping[str, Any]]:
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise InputError(f"Parquet files need pyarrow: {how_to_install('parquet')}.") from None
    try:
        for batch in parquet.ParquetFile(path).iter_batches():
            yield from batch.to_pylist()
    except (ArrowException, OSError) as error:
        raise FileError(path, f"this is no Parquet file ({error}).") from None


def _json(path: Path) -> Iterator[Mapping[str, Any]]:
    value = parse_json(read_text(path), path)
    shared = {}
    if isinstance(value, dict):
        shared, value = {"frame": value.get("frame", "map")}, value.get("tracks")
    if not isinstance(value, list) or not all(isinstance(row, dict) for row in value):
        raise FileError(path, 'expected a list of rows, or {"frame": "map", "tracks": [rows]}.')
    for row in value:
        yield shared | row


def _numbers(path: Path) -> Iterator[tuple[int, list[float]]]:
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if words := line.replace(",", " ").split():
            try:
                yield number, [float(word) for word in words]
            except ValueError:
                raise FileError(path, f"expected numbers, not {line[:40]!r}.", line=number) from None


def _eth(path: Path) -> Iterator[Row]:
    """Yield the rows of `obsmat.txt` (frame, id, x, z, y, vx, vz, vy) or of four columns (frame, id, x, y)."""
    rows = []
    for number, values in _numbers(path):
        if len(values) not in (4, 8):
            said = f"expected 4 columns (frame, id, x, y) or 8 (obsmat.txt of ETH), not {len(values)}."
            raise FileError(path, said, line=number)
        rows.append((values[0], f"{values[1]:g}", values[2], values[4] if len(values) == 8 else values[3]))
    yield from _annotated(rows)


def _trajnet(path: Path) -> Iterator[Row]:
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if not line.strip():
            continue
        try:
            value = json.loads(line)
            track = value.get("track")
            if track is not None and "prediction_number" not in track:
                rows.append((float(track["f"]), str(track["p"]), float(track["x"]), float(track["y"])))
        except (AttributeError, KeyError, TypeError, ValueError):
            raise FileError(path, "expected a line of TrajNet++ (scene or track).", line=number) from None
    yield from _annotated(rows)


def _annotated(rows: list[tuple[float, str, float, float]]) -> Iterator[Row]:
    """Yield rows whose frames are numbers: the smallest step between two of them is 0.4 s."""
    frames = np.unique([frame for frame, *_ in rows])
    step = float(np.diff(frames).min()) if len(frames) > 1 else 1.0
    for frame, name, x, y in sorted(rows):
        yield name, frame / step * ANNOTATED_S, x, y, math.nan, math.nan, "map"
