"""A ledger that keeps its last runs in memory: feedback asks several times for a run that was just made."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

from rvsg.campaign.attempt import Ledger
from rvsg.campaign.glance import Glance, Look
from rvsg.simulation.run import Run

MOST = 16
"""Runs kept with their arrays, some 0.3 MB each."""
MOST_GLANCES = 512
"""Glances kept, some 4 kB each."""
MOST_LOOKS = 4096
"""Looks kept, some 0.3 kB each without their glance."""


class Recalling:
    """Wraps a Ledger and keeps the last runs that were made in this process or read."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._runs: OrderedDict[str, Run] = OrderedDict()
        self._glances: OrderedDict[str, Glance] = OrderedDict()
        self._looks: OrderedDict[str, Look] = OrderedDict()
        self._same: dict[Any, Any] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._ledger, name)

    def made(self, run: Run) -> None:
        """Keep a run until `MOST` newer ones are kept."""
        self._runs[run.id] = run
        self._runs.move_to_end(run.id)
        if len(self._runs) > MOST:
            self._runs.popitem(last=False)

    def looked(self, look: Look) -> None:
        """Keep what was seen of a run until `MOST_LOOKS` others came, its glance until `MOST_GLANCES` did."""
        mode, encounter = (self._same.setdefault(each, each) for each in (look.mode, look.encounter))
        self._looks[look.run_id] = Look(look.run_id, mode, encounter)
        if len(self._looks) > MOST_LOOKS:
            self._looks.popitem(last=False)
        if look.glance is not None:
            self._glances[look.run_id] = look.glance
            if len(self._glances) > MOST_GLANCES:
                self._glances.popitem(last=False)

    def look(self, run_id: str) -> Look | None:
        """Return what was seen of a run when it was made, but for its glance; None if that is not known any more."""
        return self._looks.get(run_id)

    def glance(self, run_id: str) -> Glance | None:
        """Return what the worker that made a run saw of it; None if that is not known any more."""
        return self._glances.get(run_id)

    def run(self, run_id: str) -> Run:
        """Return the run of that id; StoreError if there is none."""
        if run_id not in self._runs:
            self.made(self._ledger.run(run_id))
        return self._runs[run_id]
