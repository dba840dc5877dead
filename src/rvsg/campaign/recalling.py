"""A ledger whose last runs need no reading: feedback asks for a run right after it was made, several times."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

from rvsg.campaign.attempt import Ledger
from rvsg.simulation.run import Run

MOST = 16
"""Runs kept with their arrays, some 0.3 MB each."""


class Recalling:
    """The Ledger given, which also keeps the last runs that were made in this process or read."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._runs: OrderedDict[str, Run] = OrderedDict()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._ledger, name)

    def made(self, run: Run) -> None:
        """Keep a run until `MOST` others came."""
        self._runs[run.id] = run
        self._runs.move_to_end(run.id)
        if len(self._runs) > MOST:
            self._runs.popitem(last=False)

    def run(self, run_id: str) -> Run:
        """Return the run of that id; StoreError if there is none."""
        if run_id not in self._runs:
            self.made(self._ledger.run(run_id))
        return self._runs[run_id]
