"""A store as a plug-in would bring it: a folder of text files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rvsg.core.errors import StoreError
from rvsg.core.files import write_whole
from rvsg.core.records import canonical_json
from rvsg.runs.attempt import Attempt
from rvsg.runs.ledger import Ledger
from rvsg.simulation.archive import PackedRun, run_from_json, run_to_json
from rvsg.simulation.run import Run


class JsonLedger(Ledger):
    def __init__(self, path: Path, *, ending: str = "json") -> None:
        self.path, self.ending = path, ending

    def close(self) -> None:
        pass

    def begin(self, campaign: str, settings: Mapping[str, Any]) -> None:
        known = self.settings(campaign)
        if known is not None and canonical_json(known) != canonical_json(dict(settings)):
            raise StoreError("other settings")
        write_whole(self._file(campaign, "settings"), canonical_json(dict(settings)))

    def settings(self, campaign: str) -> dict[str, Any] | None:
        file = self._file(campaign, "settings")
        return json.loads(file.read_text()) if file.exists() else None

    def campaigns(self) -> tuple[str, ...]:
        return tuple(file.parent.name for file in self.path.glob(f"*/settings.{self.ending}"))

    def keep(self, run: PackedRun) -> None:
        write_whole(self._file("runs", run.id), run_to_json(run.unpack()))

    def append(self, attempt: Attempt, runs: Sequence[PackedRun]) -> None:
        file = self._file(attempt.campaign, f"{attempt.index:05d}")
        if file.exists():
            raise StoreError("that index is taken")
        for run in runs:
            self.keep(run)
        write_whole(file, canonical_json(attempt.model_dump(mode="json")))

    def attempts(self, campaign: str) -> Iterator[Attempt]:
        for file in sorted((self.path / campaign).glob(f"0*.{self.ending}")):
            yield Attempt.from_json(file.read_text())

    def run(self, run_id: str) -> Run:
        found = self.find(run_id)
        if found is None:
            raise StoreError(f"no run {run_id}")
        return found

    def find(self, run_id: str) -> Run | None:
        file = self._file("runs", run_id)
        return run_from_json(file.read_text()) if file.exists() else None

    def _file(self, folder: str, name: str) -> Path:
        return self.path / folder / f"{name}.{self.ending}"
