"""Records as files: what a stage writes, the next one reads. `-` is standard input or output.

A scenario is read from its own JSON, or from that of a proposal or an attempt that holds one. Runs are one JSON
object per line, so one run is a JSON document and many are JSON lines.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

import numpy as np
import pydantic

from rvsg.core.documents import mistakes_of
from rvsg.core.errors import FileError, InputError
from rvsg.core.files import write_whole
from rvsg.core.records import Record
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.archive import RunHeader, run_from_json, run_to_json
from rvsg.simulation.run import Run

Kept = TypeVar("Kept", bound=Record)
MOST_TOLD = 12


def read_text(path: Path) -> str:
    """The text of a file or of standard input."""
    if str(path) == "-":
        return sys.stdin.read()
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise FileError(path, f"the file cannot be read: {reason}.") from None


def write_text(path: Path, text: str) -> None:
    """Write a file whole, or standard output."""
    if str(path) == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
    else:
        write_whole(path, text)


def check_writable(path: Path) -> None:
    """Refuse a file that cannot be written, before the work whose result it is to hold; FileError says why.

    A folder that is not there yet is no reason: every verb makes those of its output, so that no work is in vain.
    """
    if str(path) == "-":
        return
    if path.is_dir():
        raise FileError(path, "this is a folder; give the name of a file.")
    if path.exists() and not path.is_file():
        return  # a device or a pipe is written to where it is
    nearest = next((folder for folder in path.parents if folder.exists()), Path())
    probe = nearest / f".{path.name}.{os.getpid()}"
    try:  # what a system says of its rights is not all: nobody makes a file in /proc
        probe.touch()
        probe.unlink()
    except OSError as error:
        reason = f"{nearest} is no folder that can be written ({error.strerror})"
        raise FileError(path, f"the file cannot be written: {reason}.") from None


def read_record(path: Path, kind: type[Kept]) -> Kept:
    """A record from a JSON file; FileError with everything that is wrong, and the line of what is not JSON."""
    return _validated(path, _json(path, read_text(path)), kind)


def read_scenario(path: Path) -> Scenario:
    """A scenario, on its own or inside a proposal or an attempt."""
    text = read_text(path)
    if '"arrays"' in text.partition("\n")[0]:
        raise FileError(path, "these are runs; expected the scenario they are of, or a proposal.")
    value = _json(path, text)
    for key in ("proposal", "scenario"):
        if isinstance(value, dict) and key in value and "people" not in value:
            value = value[key]
    if value is None:
        raise FileError(path, "this proposal holds no valid scenario; its `problems` say why.")
    return _validated(path, value, Scenario)


def read_runs(paths: Iterable[Path]) -> list[Run]:
    """All runs of the files, in order; FileError names the line of what is not a run."""
    runs = []
    for path in paths:
        text = read_text(path)
        _no_other_record(path, text)
        for number, line in enumerate(text.splitlines(), 1):
            if not line.strip():
                continue
            try:
                run = run_from_json(line)
            except InputError as error:
                raise FileError(path, f"{_told(error)}.", line=number) from None
            if wrong := _impossible(run):
                raise FileError(path, wrong, line=number)
            runs.append(run)
    if not runs:
        raise InputError("There is no run in the files given; `rvsg simulate SCENARIO --out RUNS` makes some.")
    return runs


def _impossible(run: Run) -> str:
    """What of a run cannot have happened, in words; empty where there is nothing."""
    if not len(run.trajectory) or not len(run.log):
        return "this run holds no moment; its arrays are empty."
    named = {name: getattr(run, name) for name in ("time_limit_s", "clock_ratio", "robot_radius_m")}
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


def _no_other_record(path: Path, text: str) -> None:
    """Say so where a whole JSON document over several lines (a scenario, a proposal) stands for runs."""
    if text.lstrip().partition("\n")[0].strip() not in ("{", "["):
        return
    try:
        value = json.loads(text)
    except json.JSONDecodeError:
        return
    if not (isinstance(value, dict) and "arrays" in value):
        raise FileError(
            path, "this holds no runs, one JSON object per line; `rvsg simulate SCENARIO --out RUNS` makes some."
        )


def _told(error: InputError) -> str:
    """What is wrong with a run, in words where pydantic found it."""
    found = error.__context__
    if isinstance(found, pydantic.ValidationError):
        return "this is not a run: " + "; ".join(mistakes_of(found, RunHeader))
    return str(error)


def once(runs: Iterable[Run]) -> list[Run]:
    """The runs without those that are given twice: one run counted twice would make a verdict surer than it is."""
    return list({(run.id, digest(run)): run for run in runs}.values())


def digest(run: Run) -> str:
    """A hash of everything that happened in a run."""
    return hashlib.sha256(run_to_json(run).encode()).hexdigest()


def runs_text(runs: Iterable[Run]) -> str:
    """Runs as JSON lines."""
    return "".join(run_to_json(run) for run in runs)


def _json(path: Path, text: str) -> object:
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        if not text.strip():
            raise FileError(path, "the file is empty.") from None
        what = error.msg.removesuffix(" starting at").lower()
        raise FileError(path, f"this is not JSON: {what}, at character {error.colno}.", line=error.lineno) from None


def _validated(path: Path, value: object, kind: type[Kept]) -> Kept:
    try:
        return kind.model_validate_json(json.dumps(value))
    except pydantic.ValidationError as error:
        wrong = [f"the whole file{said}" if said.startswith(":") else said for said in mistakes_of(error, kind)]
        more = [f"and {len(wrong) - MOST_TOLD} more"] if len(wrong) > MOST_TOLD else []
        listed = "; ".join([*wrong[:MOST_TOLD], *more])
        raise FileError(path, f"this is not a {kind.__name__.lower()}: {listed}.") from None
