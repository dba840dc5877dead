"""Read and write records as files: each stage reads what the one before wrote. `-` is standard input or output.

A scenario is read from its own JSON, or from that of a proposal or an attempt. Runs are one JSON object per line.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import TypeVar

import numpy as np
import pydantic

from rvsg.core.documents import mistakes_of
from rvsg.core.errors import FileError, InputError
from rvsg.core.files import write_whole
from rvsg.core.inputs import parse_json, read_lines, read_text
from rvsg.core.records import Record
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.archive import RunHeader, run_from_value, run_to_json
from rvsg.simulation.run import Run

Kept = TypeVar("Kept", bound=Record)
MOST_LISTED = 12
NO_RUNS = "this holds no runs, one JSON object per line; `rvsg simulate SCENARIO --out RUNS` makes some."
WORLD_FOLDER = "world_folder"
"""The key beside a saved record under which the folder of its world stands. It is no part of the record or its id."""


def write_text(path: Path, text: str) -> None:
    """Write a file atomically, or standard output."""
    if str(path) == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
    else:
        write_whole(path, text)


def check_writable(path: Path) -> None:
    """Check that an output file can be written before starting the work; FileError says why it cannot.

    Missing folders are made when the file is written.
    """
    if str(path) == "-":
        return
    if path.is_dir():
        raise FileError(path, "this is a folder; give the name of a file.", code="not-writable")
    if path.exists() and not path.is_file():
        return  # a device or a pipe
    nearest = next((folder for folder in path.parents if folder.exists()), Path())
    probe = nearest / f".{path.name}.{os.getpid()}"
    try:  # access rights alone do not tell: no file can be made in /proc
        probe.touch()
        probe.unlink()
    except OSError as error:
        reason = f"{nearest} is no folder that can be written ({error.strerror})"
        raise FileError(path, f"the file cannot be written: {reason}.", code="not-writable") from None


def read_record(path: Path, kind: type[Kept]) -> Kept:
    """Return a record from a JSON file; FileError names everything that is wrong."""
    return validated(path, parse_json(read_text(path), path), kind)


def read_scenario(path: Path) -> tuple[Scenario, Path | None]:
    """Return a scenario, on its own or inside a proposal or an attempt, and the saved folder of its world."""
    text = read_text(path)
    if '"arrays"' in text.partition("\n")[0]:
        raise FileError(
            path, "these are runs; expected the scenario they are of, or a proposal.", code="runs-not-scenario"
        )
    value = parse_json(text, path)
    folder = value.pop(WORLD_FOLDER, None) if isinstance(value, dict) else None
    for key in ("proposal", "scenario"):
        if isinstance(value, dict) and key in value and "people" not in value:
            value = value[key]
    if value is None:
        raise FileError(path, "this proposal holds no valid scenario; its `problems` say why.")
    return validated(path, value, Scenario), Path(folder) if isinstance(folder, str) else None


def with_world_folder(text: str, folder: Path | None) -> str:
    """Return the JSON of a record with the folder of its world beside it; unchanged where that is None."""
    if folder is None:
        return text
    return json.dumps({WORLD_FOLDER: str(folder), **json.loads(text)}, indent=2, ensure_ascii=False) + "\n"


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
    found = error.__context__
    if isinstance(found, pydantic.ValidationError):
        return "this is not a run: " + "; ".join(mistakes_of(found, RunHeader))
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


def validated(path: Path, value: object, kind: type[Kept]) -> Kept:
    """Return a record made of plain data; FileError names everything that is wrong."""
    try:
        return kind.model_validate_json(json.dumps(value))
    except pydantic.ValidationError as error:
        wrong = mistakes_of(error, kind, whole="the whole file")
        more = [f"and {len(wrong) - MOST_LISTED} more"] if len(wrong) > MOST_LISTED else []
        listed = "; ".join([*wrong[:MOST_LISTED], *more])
        raise FileError(path, f"this is not a {kind.__name__.lower()}: {listed}.", code="record-invalid") from None
