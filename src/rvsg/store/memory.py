"""A ledger in memory, for tests and for campaigns whose records nobody keeps."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.ledger import Ledger
from rvsg.core.errors import StoreError
from rvsg.core.records import canonical_json
from rvsg.simulation.archive import PackedRun
from rvsg.simulation.run import Run


class MemoryLedger(Ledger):
    """A Ledger of dictionaries; `runs` holds the packed runs by id, `kept` the attempts in the order they came."""

    def __init__(self) -> None:
        self.kept: list[Attempt] = []
        self.runs: dict[str, PackedRun] = {}
        self._settings: dict[str, str] = {}

    def begin(self, campaign: str, settings: Mapping[str, Any]) -> None:
        """Keep the settings of a new campaign; StoreError if others are kept under that name."""
        text = canonical_json(dict(settings))
        if self._settings.setdefault(campaign, text) != text:
            raise StoreError(f"campaign {campaign!r} was begun with other settings")

    def settings(self, campaign: str) -> dict[str, Any] | None:
        """Return the settings of a campaign; None if it was never begun."""
        text = self._settings.get(campaign)
        return None if text is None else dict(json.loads(text))

    def campaigns(self) -> tuple[str, ...]:
        """Return the names of all campaigns."""
        return tuple(dict.fromkeys([*self._settings, *(attempt.campaign for attempt in self.kept)]))

    def forget_empty(self, campaign: str) -> bool:
        """Delete a campaign that has no attempt and return True; return False, changing nothing, where it has one."""
        if any(attempt.campaign == campaign for attempt in self.kept):
            return False
        self._settings.pop(campaign, None)
        return True

    def close(self) -> None:
        """Do nothing; the records stay."""

    def keep(self, run: PackedRun) -> None:
        """Keep a run; one of the same id that is known already stays as it is."""
        self.runs.setdefault(run.id, run)

    def append(self, attempt: Attempt, runs: Sequence[PackedRun]) -> None:
        """Keep an attempt with its runs; StoreError if its index is taken."""
        if any((kept.campaign, kept.index) == (attempt.campaign, attempt.index) for kept in self.kept):
            raise StoreError(f"attempt {attempt.index} of campaign {attempt.campaign!r} exists already")
        for run in runs:
            self.keep(run)
        self.kept.append(attempt)

    def attempts(self, campaign: str) -> Iterator[Attempt]:
        """Yield the attempts of a campaign in the order of their index."""
        own = [attempt for attempt in self.kept if attempt.campaign == campaign]
        yield from sorted(own, key=lambda attempt: attempt.index)

    def run(self, run_id: str) -> Run:
        """Return the run of that id; StoreError if there is none."""
        found = self.find(run_id)
        if found is None:
            raise StoreError(f"there is no run {run_id!r}")
        return found

    def find(self, run_id: str) -> Run | None:
        """Return the run of that id, or None."""
        packed = self.runs.get(run_id)
        return packed.unpack() if packed is not None else None
