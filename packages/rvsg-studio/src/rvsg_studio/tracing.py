"""Trace a run on demand: simulate it again with everything recorded, for the layers of the replay."""

from __future__ import annotations

import threading
from typing import Any

from fastapi.responses import Response

import rvsg
from rvsg.app.playback import kept_trace, trace_source, trace_text
from rvsg_studio.answers import text_of
from rvsg_studio.workspace import Workspace

_tracing = threading.Lock()


def trace(workspace: Workspace, given: dict[str, Any]) -> Response:
    """Return the trace of a run of a campaign or of a file of runs."""
    run = text_of(given, "run")
    with _tracing:  # one at a time: each holds about 100 MB
        if given.get("file"):
            file, scenario = (workspace.existing(text_of(given, key)) for key in ("file", "scenario"))
            text = trace_text(trace_source(file, run=run, scenario=scenario))
        else:
            folder = workspace.existing(text_of(given, "campaign"))
            text = kept_trace(rvsg.Campaign.open(folder, given.get("name") or None), run)
    return Response(text, media_type="application/json")
