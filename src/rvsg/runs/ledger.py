"""The Ledger, where attempts and runs are stored for good, one in memory, and the bounded cache of runs."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Generic, Protocol, TypeVar

from rvsg.core.errors import StoreError
from rvsg.core.records import canonical_json
from rvsg.runs.attempt import Attempt
from rvsg.runs.observation import FailureMode, RunObservation, observe
from rvsg.simulation.archive import PackedRun
from rvsg.simulation.run import Run
from rvsg.world.world import World

K = TypeVar("K")
V = TypeVar("V")
RUNS = 16
"""Runs in memory with their arrays, some 0.3 MB each."""
OBSERVATIONS = 4096
"""Observations of runs in memory, some 4 kB each."""


class Ledger(Protocol):
    """Where attempts and runs are stored, in order, for good.

    A plug-in of the kind `store` is created with the path that is its own in the campaign's folder, and its options. A
    run is stored by its content id, possibly before the attempt it belongs to, so that an interruption loses at most
    the runs in progress. Derive a ledger from this class: `forget_empty` has a default.
    """

    def begin(self, campaign: str, settings: Mapping[str, Any]) -> None:
        """Store the settings of a new campaign; StoreError if others are stored under that name."""
        ...

    def settings(self, campaign: str) -> dict[str, Any] | None:
        """Return the settings of a campaign; None if it was never begun."""
        ...

    def campaigns(self) -> tuple[str, ...]:
        """Return the names of all campaigns, in the order they were begun."""
        ...

    def forget_empty(self, campaign: str) -> bool:
        """Delete a campaign that has no attempt and return True; return False, changing nothing, where it has one."""
        return False

    def close(self) -> None:
        """Release every resource; no other method is called afterwards."""
        ...

    def keep(self, run: PackedRun) -> None:
        """Store a run; where its id is known, nothing changes."""
        ...

    def append(self, attempt: Attempt, runs: Sequence[PackedRun]) -> None:
        """Store an attempt with its runs, all or nothing; StoreError if its index is taken."""
        ...

    def attempts(self, campaign: str) -> Iterator[Attempt]:
        """Return the attempts of a campaign in the order of their index."""
        ...

    def run(self, run_id: str) -> Run:
        """Return the run of that id; StoreError if there is none."""
        ...

    def find(self, run_id: str) -> Run | None:
        """Return the run of that id, or None."""
        ...


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


class Recent(Generic[K, V]):
    """A mapping of bounded size that forgets what was used least recently."""

    def __init__(self, most: int) -> None:
        self.most = most
        self._kept: OrderedDict[K, V] = OrderedDict()

    def add(self, key: K, value: V) -> V:
        """Keep a value and return it."""
        self._kept[key] = value
        self._kept.move_to_end(key)
        if len(self._kept) > self.most:
            self._kept.popitem(last=False)
        return value

    def get(self, key: K) -> V | None:
        """Return a value that is still kept; None if it is not."""
        if key not in self._kept:
            return None
        self._kept.move_to_end(key)
        return self._kept[key]

    def get_or(self, key: K, make: Callable[[K], V]) -> V:
        """Return a value, made and kept where it is not kept any more."""
        known = self.get(key)
        return self.add(key, make(key)) if known is None else known


class CachedLedger:
    """A ledger with what a campaign used last in memory: runs with their arrays, and observations of runs.

    Args:
        ledger: Where everything is stored.
    """

    def __init__(self, ledger: Ledger) -> None:
        self.ledger = ledger
        self._runs: Recent[str, Run] = Recent(RUNS)
        self._observations: Recent[str, RunObservation] = Recent(OBSERVATIONS)

    def keep(self, run: PackedRun) -> None:
        """Store a run; where its id is known, nothing changes."""
        self.ledger.keep(run)

    def append(self, attempt: Attempt, runs: Sequence[PackedRun]) -> None:
        """Store an attempt with its runs."""
        self.ledger.append(attempt, runs)

    def attempts(self, campaign: str) -> Iterator[Attempt]:
        """Return the attempts of a campaign in the order of their index."""
        return self.ledger.attempts(campaign)

    def find(self, run_id: str) -> Run | None:
        """Return the run of that id, or None."""
        return self._runs.get(run_id) or self.ledger.find(run_id)

    def run(self, run_id: str) -> Run:
        """Return the run of that id; StoreError if there is none."""
        return self._runs.get_or(run_id, self.ledger.run)

    def keep_in_memory(self, run: Run) -> None:
        """Keep a run that was made in this process."""
        self._runs.add(run.id, run)

    def note(self, observation: RunObservation) -> None:
        """Keep what was observed of a run where it was made."""
        self._observations.add(observation.run_id, observation)

    def observation(self, run_id: str, world: World) -> RunObservation:
        """Return what is observed of a run: as noted, else of the run as it is stored."""
        return self._observations.get_or(run_id, lambda _: observe(self.run(run_id), world))

    def failure_mode(self, run_id: str, world: World) -> FailureMode | None:
        """Return how a run fails if it does."""
        return self.observation(run_id, world).mode
