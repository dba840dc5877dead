"""A Run as bytes and as JSON, and back: exact to the last bit.

As JSON a run is one object: the fields of `RunHeader`, and `arrays`, each a list (a list of rows where it has a row
per sample and a column per human). As bytes it is a PackedRun: the header's JSON and the same arrays, compressed (see
`rvsg.simulation.quantised`). Stores of version 2 and older hold a NumPy archive beside the header instead.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, replace
from typing import Annotated, Any, Self

import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import Field

from rvsg.core.errors import InputError
from rvsg.core.records import Record, canonical_json
from rvsg.simulation.events import RecordedEvent
from rvsg.simulation.quantised import decode, encode, rounded_arrays
from rvsg.simulation.run import Outcome, Run, Trajectory

PER_SAMPLE = ("t", "x", "y", "yaw", "v", "omega", "acceleration")
LATERAL = "lateral"
"""An array per sample that only runs of a base that moves sideways have."""
PER_HUMAN = ("human_x", "human_y", "human_yaw", "human_speed")

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


def arrays_of(run: Run) -> dict[str, NDArray[np.float64]]:
    """The run's arrays by name: `trajectory.x`, `log.x`, ..., `imu`."""
    parts = {"trajectory": run.trajectory} | ({} if run.log is run.trajectory else {"log": run.log})
    found = {f"{part}.{name}": array for part, path in parts.items() for name, array in series_of(path).items()}
    found["imu"] = run.imu
    return {name: np.asarray(array, dtype=np.float64) for name, array in found.items()}


def series_of(path: Trajectory) -> dict[str, NDArray[np.float64]]:
    """The arrays of a trajectory by name, in the order in which they are stored."""
    names = (*PER_SAMPLE, *PER_HUMAN, *((LATERAL,) if path.lateral.size else ()))
    return {name: getattr(path, name) for name in names}


def assemble(header: RunHeader, arrays: dict[str, NDArray[np.float64]]) -> Run:
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


def unpack_numpy(header: str, archive: bytes) -> Run:
    """Return the run of a header and a NumPy archive, as stores of version 2 and older hold it."""
    with np.load(io.BytesIO(archive), allow_pickle=False) as found:
        return assemble(RunHeader.from_json(header), {name: found[name] for name in found.files})


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


def _trajectory(prefix: str, arrays: dict[str, NDArray[np.float64]], humans: int) -> Trajectory:
    found: dict[str, NDArray[np.float64]] = {}
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
        found[name] = _bounded(f"{prefix}.{name}", array)
    return Trajectory(**found)


def _bounded(name: str, array: NDArray[np.float64]) -> NDArray[np.float64]:
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds numbers that are not finite")
    if array.size and np.abs(array).max() > LARGEST:
        raise InputError(f"{name} holds numbers beyond {LARGEST:,.0f}; expected SI units: m, s, m/s, rad")
    return array
