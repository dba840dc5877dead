"""A Run as bytes and as JSON, and back: exact to the last bit.

As JSON a run is one object: the fields of `RunHeader`, and `arrays`, each a list (a list of rows where it has a row
per sample and a column per human). As bytes it is a PackedRun: the header and the arrays in one stream of the standard
library's LZMA. Before it, `rounded` brings the arrays to the steps in which they are stored.

In the stream, an array whose values are multiples of its step is stored as integers, each the change since the sample
before, and the bytes of all integers are sorted by significance: most of the upper ones are 0. Without that, LZMA
needs four times as much. Any other array is stored as it is, so that `decode` returns what `encode` was given.
"""

from __future__ import annotations

import hashlib
import json
import lzma
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import Field

from rvsg.core.documents import mistakes_of
from rvsg.core.errors import FileError, InputError
from rvsg.core.inputs import parse_json, read_lines
from rvsg.core.records import Record, canonical_json
from rvsg.simulation.events import RecordedEvent
from rvsg.simulation.run import Outcome, Run, Trajectory

Floats = NDArray[np.float64]


PER_SAMPLE = ("t", "x", "y", "yaw", "v", "omega", "acceleration")
LATERAL = "lateral"
"""An array per sample that only runs of a base that moves sideways have."""
PER_HUMAN = ("human_x", "human_y", "human_yaw", "human_speed")

DECIMALS = {
    **dict.fromkeys(("x", "y", "v", "omega", "acceleration", "lateral", "imu", *PER_HUMAN), 4),
    "t": 6,
    "yaw": 6,
}
"""Decimals kept, by the last part of an array's name; SI units, so 4 is 0.1 mm, 0.1 mm/s, 0.0001 m/s2.

Jerk is a second difference of the robot's yaw, so yaw has more."""
MAGIC = b"RVR3"
EARLIER = (b"RVQ1", b"RVQ2")
MOST_BYTES = 256_000_000
"""No archive is larger when it is unpacked."""
EXACT = 2**50
"""Integers below this are exact as float64, and so are their differences."""

LARGEST = 1e6
"""No number of a run is larger, in SI units: beyond it, squares and exponentials of the metrics overflow."""
Coordinate = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Radius = Annotated[float, Field(ge=0, le=100)]
Outline = tuple[tuple[Coordinate, Coordinate], ...]


class RunHeader(Record):
    """All of a Run but its arrays; `same_log` says that the log is the trajectory."""

    scenario_id: str
    simulator: str
    options: dict[str, Any]
    seed: Annotated[int, Field(ge=0)]
    outcome: Outcome
    clock_ratio: Annotated[float, Field(gt=0, le=LARGEST)] = 1.0
    human_names: tuple[str, ...]
    robot_radius_m: Radius = 0.35
    human_radius_m: tuple[Radius, ...]
    goal: tuple[Coordinate, Coordinate, Coordinate]
    time_limit_s: Annotated[float, Field(ge=0, le=LARGEST)]
    recoveries: Annotated[int, Field(ge=0)] = 0
    details: dict[str, Any] = Field(default_factory=dict)
    human_groups: tuple[int | None, ...] = ()
    events: tuple[RecordedEvent, ...] = ()
    robot_outline: Outline = ()
    human_outlines: Annotated[tuple[Outline, ...], Field(exclude_if=lambda outlines: not outlines)] = ()
    robot_latency_s: Annotated[float, Field(ge=0, le=LARGEST)] = 0.0
    robot_deceleration_m_s2: Annotated[float, Field(gt=0, le=LARGEST)] = 2.5
    same_log: bool = False


def header_of(run: Run) -> RunHeader:
    """The run without its arrays; InputError where a simulator gave it a value out of range."""
    fields = {name: getattr(run, name) for name in RunHeader.model_fields if name != "same_log"}
    try:
        return RunHeader(**fields, same_log=run.log is run.trajectory)
    except pydantic.ValidationError as error:
        raise InputError(f"the simulator {run.simulator} made a run that cannot be stored: {error}") from None


def arrays_of(run: Run) -> dict[str, Floats]:
    """The run's arrays by name: `trajectory.x`, `log.x`, ..., `imu`."""
    parts = {"trajectory": run.trajectory} | ({} if run.log is run.trajectory else {"log": run.log})
    arrays = {f"{part}.{name}": array for part, path in parts.items() for name, array in series_of(path).items()}
    arrays["imu"] = run.imu
    return {name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()}


def series_of(path: Trajectory) -> dict[str, Floats]:
    """The arrays of a trajectory by name, in the order in which they are stored."""
    names = (*PER_SAMPLE, *PER_HUMAN, *((LATERAL,) if path.lateral.size else ()))
    return {name: getattr(path, name) for name in names}


def assemble(header: RunHeader, arrays: dict[str, Floats]) -> Run:
    """The run of a header and arrays; InputError where their shapes do not fit or a number is not finite."""
    trajectory = _trajectory("trajectory", arrays, len(header.human_names))
    log = trajectory if header.same_log else _trajectory("log", arrays, len(header.human_names))
    _check_people(header)
    fields = {name: getattr(header, name) for name in RunHeader.model_fields if name != "same_log"}
    return Run(**fields, trajectory=trajectory, log=log, imu=_bounded("imu", arrays.get("imu", np.empty(0))))


@dataclass(frozen=True)
class PackedRun:
    """A run as bytes, with what a store keeps beside them. Equal runs have equal bytes."""

    id: str
    scenario_id: str
    seed: int
    data: bytes

    @classmethod
    def of(cls, run: Run) -> Self:
        """Pack a run."""
        header = canonical_json(header_of(run).model_dump(mode="json"))
        return cls(run.id, run.scenario_id, run.seed, encode(header, arrays_of(run)))

    def unpack(self) -> Run:
        """Return the run."""
        return unpack(self.data)


def rounded(run: Run) -> Run:
    """Return the run with its arrays rounded to the steps in which they are stored, a tenth of a millimetre or so.

    Raises:
        InputError: The arrays do not fit together, or a number is not finite.
    """
    _check_people(run)
    arrays, humans = rounded_arrays(arrays_of(run)), len(run.human_names)
    trajectory = _trajectory("trajectory", arrays, humans)
    log = trajectory if run.log is run.trajectory else _trajectory("log", arrays, humans)
    return replace(run, trajectory=trajectory, log=log, imu=_bounded("imu", arrays["imu"]))


def unpack(data: bytes) -> Run:
    """Return the run of a PackedRun's bytes.

    Raises:
        ValueError: The bytes are damaged (pydantic's ValidationError is one).
        InputError: The arrays do not fit together.
    """
    header, arrays = decode(data)
    return assemble(RunHeader.from_json(header), arrays)


def rounded_arrays(arrays: Mapping[str, Floats]) -> dict[str, Floats]:
    """Round each array to the decimals of its name; one of another name, or with huge values, stays as it is."""
    return {
        name: array if (steps := _steps(name, array)) is None else steps / _scale(name)
        for name, array in arrays.items()
    }


def encode(text: str, arrays: Mapping[str, Floats]) -> bytes:
    """Encode a text and named arrays; equal input gives equal bytes."""
    listed, plain, changes = [], [], [np.empty(0, np.int64)]
    for name, array in arrays.items():
        steps = _steps(name, array)
        exact = steps is not None and np.array_equal(steps / _scale(name), array)
        listed.append([name, array.shape, exact])
        if exact and steps is not None:
            change = np.diff(steps.astype(np.int64).reshape(len(array), -1), axis=0, prepend=0).T.ravel()
            changes.append((change << 1) ^ (change >> 63))  # 0, -1, 1, -2 ... become 0, 1, 2, 3 ...
        else:
            plain.append(array.astype("<f8").tobytes())
    planes = np.concatenate(changes).astype("<i8").view(np.uint8).reshape(-1, 8).T.tobytes()
    said = text.encode()
    line = json.dumps([len(said), listed], separators=(",", ":")).encode()
    body = b"".join([line, b"\n", said, *plain, planes])
    return MAGIC + lzma.compress(body, check=lzma.CHECK_CRC32, preset=1)


def decode(data: bytes) -> tuple[str, dict[str, Floats]]:
    """Decode what `encode` returned.

    Raises:
        ValueError: The bytes are not from `encode`.
    """
    if data.startswith(EARLIER):
        raise ValueError("an earlier version of RVSG stored this run; read it with that version")
    if not data.startswith(MAGIC):
        raise ValueError("this is no archive of a run")
    stream = lzma.LZMADecompressor(format=lzma.FORMAT_XZ, memlimit=2**26)
    try:
        body = stream.decompress(data[len(MAGIC) :], max_length=MOST_BYTES)
        if not stream.eof:
            raise ValueError("it ends too early, or is too large")
        return _decoded(body)
    except (lzma.LZMAError, ValueError, TypeError, LookupError, ArithmeticError, RecursionError) as error:
        raise ValueError(f"the archive is damaged ({error})") from None


def _decoded(body: bytes) -> tuple[str, dict[str, Floats]]:
    line, _, rest = body.partition(b"\n")
    length, listed = json.loads(line)
    sizes = [math.prod(shape) for _, shape, _ in listed]
    end = length + 8 * sum(size for size, (_, _, exact) in zip(sizes, listed, strict=True) if not exact)
    folded = np.frombuffer(rest[end:], np.uint8).reshape(8, -1).T.copy().view("<u8").ravel()
    changes = (folded >> np.uint64(1)).astype(np.int64) ^ -(folded & np.uint64(1)).astype(np.int64)
    arrays: dict[str, Floats] = {}
    at, place = length, 0
    for (name, shape, exact), size in zip(listed, sizes, strict=True):
        if exact:
            steps = changes[place : place + size].reshape(-1, shape[0]).cumsum(axis=1).T
            arrays[name], place = np.ascontiguousarray(steps).reshape(shape) / _scale(name), place + size
        else:
            arrays[name], at = np.frombuffer(rest[at : at + 8 * size], "<f8").reshape(shape).copy(), at + 8 * size
    if place != len(changes):
        raise ValueError("it has another length than it says")
    return rest[:length].decode(), arrays


def _steps(name: str, array: Floats) -> Floats | None:
    """Return an array as multiples of its step, to the nearest; None where it is not rounded."""
    if not array.size or name.rpartition(".")[2] not in DECIMALS:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = np.ascontiguousarray(array) * _scale(name)  # sums of other layouts differ in the last bit
        return np.rint(scaled) if (np.abs(scaled) < EXACT).all() else None


def _scale(name: str) -> float:
    return float(10.0 ** DECIMALS[name.rpartition(".")[2]])


def run_to_json(run: Run) -> str:
    """The run as one JSON object, ending in a newline."""
    value = header_of(run).model_dump(mode="json") | {
        "arrays": {name: array.tolist() for name, array in arrays_of(run).items()}
    }
    return json.dumps(value, ensure_ascii=False, allow_nan=False) + "\n"


def run_from_json(text: str | bytes) -> Run:
    """Read a run; InputError says what is wrong with it."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"this is not JSON: {error}") from None
    return run_from_value(value)


def run_from_value(value: Any) -> Run:
    """Return the run of a JSON object that was read; InputError says what is wrong with it."""
    if not isinstance(value, dict) or not isinstance(value.get("arrays"), dict):
        raise InputError("a run is a JSON object with `arrays`; `rvsg simulate` writes one")
    value = dict(value)
    listed = value.pop("arrays")
    try:
        header = RunHeader.model_validate_json(json.dumps(value))
        arrays = {str(name): np.asarray(array, dtype=np.float64) for name, array in listed.items()}
    except pydantic.ValidationError as error:
        raise InputError(f"this is not a run: {error}") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"an array of this run is not made of numbers: {error}") from None
    return assemble(header, arrays)


def _check_people(run: Run | RunHeader) -> None:
    if len(run.human_radius_m) != len(run.human_names):
        raise InputError("human_radius_m must have one radius for each of human_names")
    if run.human_groups and len(run.human_groups) != len(run.human_names):
        raise InputError("human_groups must have one group (or null) for each of human_names, or be empty")


def _trajectory(prefix: str, arrays: dict[str, Floats], humans: int) -> Trajectory:
    checked: dict[str, Floats] = {}
    sideways = (LATERAL,) if f"{prefix}.{LATERAL}" in arrays else ()
    for name in PER_SAMPLE + PER_HUMAN + sideways:
        array = arrays.get(f"{prefix}.{name}")
        if array is None:
            raise InputError(f"the run lacks the array {prefix}.{name}")
        if name in PER_HUMAN and array.size == 0:
            array = array.reshape(len(arrays[f"{prefix}.t"]), humans)
        expected = (len(arrays[f"{prefix}.t"]),) + ((humans,) if name in PER_HUMAN else ())
        if array.shape != expected:
            raise InputError(f"{prefix}.{name} has the shape {array.shape}, expected {expected}")
        checked[name] = _bounded(f"{prefix}.{name}", array)
    return Trajectory(**checked)


def _bounded(name: str, array: Floats) -> Floats:
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds numbers that are not finite")
    if array.size and np.abs(array).max() > LARGEST:
        raise InputError(f"{name} holds numbers beyond {LARGEST:,.0f}; expected SI units: m, s, m/s, rad")
    return array


NO_RUNS = "this holds no runs, one JSON object per line; `rvsg simulate SCENARIO --out RUNS` makes some."


def holds_runs(path: Path) -> bool:
    """Return whether a file holds runs rather than a scenario, by its first line; False for standard input."""
    return str(path) != "-" and any('"arrays"' in line for _, line in islice(read_lines(path), 1))


def read_runs(paths: Iterable[Path]) -> list[Run]:
    """Return all runs of the files, in order; FileError names the line of what is not a run."""
    runs: list[Run] = []
    for path in paths:
        for number, line in read_lines(path):
            if not line.strip():
                continue
            if not runs and line.strip() in ("{", "["):
                raise FileError(path, NO_RUNS, code="no-runs")
            try:
                run = run_from_value(parse_json(line, path, line=number))
            except FileError:
                raise
            except InputError as error:
                raise FileError(path, f"{_reason(error)}.", line=number, code="run-invalid") from None
            if wrong := _impossible(run):
                raise FileError(path, wrong, line=number, code="run-impossible")
            runs.append(run)
    if not runs:
        raise InputError(
            "There is no run in the files given; `rvsg simulate SCENARIO --out RUNS` makes some.", code="no-runs"
        )
    return runs


def _impossible(run: Run) -> str:
    """Return why a run is impossible; empty if it is not."""
    if not len(run.trajectory) or not len(run.log):
        return "this run holds no moment; its arrays are empty."
    named = {name: getattr(run, name) for name in ("time_limit_s", "robot_radius_m")}
    radii = enumerate(run.human_radius_m)
    for name, value in (named | {f"human_radius_m[{human}]": radius for human, radius in radii}).items():
        if not value > 0:
            return f"{name} must be positive, got {value:g}."
    for name, t in (("trajectory.t", run.trajectory.t), ("log.t", run.log.t)):
        if t[0] < 0:
            return f"{name} must begin at 0 s or later, got {t[0]:g}."
        if (late := np.flatnonzero(np.diff(t) <= 0)).size:
            before, after = late[0], late[0] + 1
            return f"{name} must increase, but {name}[{after}] is {t[after]:g} s after {t[before]:g} s."
    return ""


def _reason(error: InputError) -> str:
    """Return what is wrong with a run."""
    cause = error.__context__
    if isinstance(cause, pydantic.ValidationError):
        return "this is not a run: " + "; ".join(mistakes_of(cause, RunHeader))
    return str(error)


def once(runs: Iterable[Run]) -> list[Run]:
    """Return the runs without duplicates: a run counted twice would make a verdict look surer than it is."""
    return list({(run.id, digest(run)): run for run in runs}.values())


def digest(run: Run) -> str:
    """Return a hash of everything that happened in a run."""
    return hashlib.sha256(run_to_json(run).encode()).hexdigest()


def runs_text(runs: Iterable[Run]) -> str:
    """Return runs as JSON lines."""
    return "".join(run_to_json(run) for run in runs)
