"""Files of runs, one JSON object per line."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

import numpy as np
import pydantic

from rvsg.core.documents import mistakes_of
from rvsg.core.errors import FileError, InputError
from rvsg.core.inputs import parse_json, read_lines
from rvsg.simulation.archive import RunHeader, run_from_value, run_to_json
from rvsg.simulation.run import Run

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
