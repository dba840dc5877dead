"""The run of a recording and the text of its notes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from rvsg.recording.recorded_run import recorded_run
from rvsg.recording.tracks import load_recording
from rvsg.simulation.run import Run
from rvsg.world.world import Route


class Judged(NamedTuple):
    run: Run
    notes: tuple[str, ...]


def judged(path: Path, *, route: Route | None = None, **given: Any) -> Judged:
    run, notes = recorded_run(load_recording(path, **given), route)
    return Judged(run, tuple(map(str, notes)))
