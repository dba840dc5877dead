"""What lies in a folder of work: worlds, campaigns and suites, summed up and kept until their files change."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationError

from rvsg.api.folder import LEDGER, STORE
from rvsg.api.index import campaigns_in
from rvsg.api.suites import HEAD
from rvsg.core.errors import RvsgError
from rvsg.core.files import write_whole
from rvsg.core.records import Record

DEEPEST = 6
"""Levels of folders below the one that is listed."""
MOST_FOLDERS = 20_000
SKIPPED = ("node_modules", "__pycache__")
FORMAT = 2


class FoundFinding(Record):
    """A confirmation of a campaign, in short. `status` is its verdict."""

    attempt: int
    status: str
    violated: bool
    violations: int
    runs: int
    description: str


class FoundCampaign(Record):
    """A campaign in a folder, in short. `problem` says why it cannot be read; then the rest is empty."""

    folder: str
    """Relative to the folder that is listed, with `/`."""
    name: str = ""
    world: str = ""
    route: str = ""
    requirement: str = ""
    generator: str = ""
    complete: bool = False
    attempts: int = 0
    planned: int = 0
    runs: int = 0
    calls: int = 0
    calls_s: float = 0.0
    """What the calls of the model took together, seconds."""
    model: str = ""
    cost_usd: float | None = None
    violated: bool = False
    changed_s: float = 0.0
    """When its ledger changed last, seconds since 1970."""
    findings: tuple[FoundFinding, ...] = ()
    problem: str = ""


class Listing(Record):
    """What lies in a folder. Paths are relative to it, with `/`."""

    worlds: tuple[str, ...]
    campaigns: tuple[FoundCampaign, ...]
    suites: tuple[str, ...]
    cut: bool = False
    """Whether the folder holds more folders than are looked at."""


class Lister:
    """Lists a folder of work. A campaign is read again only when its ledger has changed.

    Args:
        folder: what is listed.
        cache: a file that keeps what was read between two sessions; None keeps it in memory.
    """

    def __init__(self, folder: Path, cache: Path | None = None) -> None:
        self.folder = folder
        self._cache = cache
        self._lock = threading.Lock()
        self._known: dict[str, _Kept] = _read_cache(cache) if cache is not None else {}

    def listing(self) -> Listing:
        """Return what lies in the folder now."""
        with self._lock:
            worlds, stores, suites, cut = [], [], [], False
            for count, (path, names) in enumerate(_folders(self.folder)):
                if count >= MOST_FOLDERS:
                    cut = True
                    break
                place = path.relative_to(self.folder).as_posix()
                if "world.yaml" in names:
                    worlds.append(place)
                if HEAD in names:
                    suites.append(place)
                if LEDGER in names or STORE in names:
                    stores.append(place)
            campaigns = [each for place in stores for each in self._campaigns(place)]
            self._forget(stores)
        newest_first = sorted(campaigns, key=lambda each: (-each.changed_s, each.folder))
        return Listing(
            worlds=tuple(sorted(worlds)), campaigns=tuple(newest_first), suites=tuple(sorted(suites)), cut=cut
        )

    def _campaigns(self, place: str) -> tuple[FoundCampaign, ...]:
        stamp = _stamp(self.folder / place)
        known = self._known.get(place)
        if known is None or known.stamp != stamp:
            known = self._known[place] = _Kept(stamp=stamp, campaigns=_read(self.folder / place, place))
            self._save()
        return known.campaigns

    def _forget(self, stores: list[str]) -> None:
        gone = set(self._known).difference(stores)
        for place in gone:
            del self._known[place]
        if gone:
            self._save()

    def _save(self) -> None:
        if self._cache is None:
            return
        kept = {place: each.model_dump(mode="json") for place, each in self._known.items()}
        self._cache.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self._cache, json.dumps({"format": FORMAT, "stores": kept}))


class _Kept(Record):
    """The campaigns of a store as they were when its files had this stamp (name, change in ns, bytes)."""

    stamp: tuple[tuple[str, int, int], ...]
    campaigns: tuple[FoundCampaign, ...]

    @classmethod
    def of(cls, value: Any) -> Self:
        return cls.model_validate_json(json.dumps(value))


def _read_cache(path: Path) -> dict[str, _Kept]:
    """Return what was kept; nothing where the file is missing, cut off or of another version: it is only a cache."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        if found["format"] != FORMAT:
            return {}
        return {place: _Kept.of(value) for place, value in found["stores"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, ValidationError):
        return {}


def _folders(top: Path) -> Iterator[tuple[Path, frozenset[str]]]:
    """Yield every folder with the names of its files, links and hidden folders left out."""
    for path, folders, files in os.walk(top):
        here = Path(path)
        depth = len(here.relative_to(top).parts)
        inside = LEDGER in files or "world.yaml" in files
        folders[:] = [] if depth >= DEEPEST or inside else sorted(f for f in folders if _is_listed(f))
        yield here, frozenset(files)


def _is_listed(name: str) -> bool:
    return not name.startswith(".") and name not in SKIPPED


def _stamp(folder: Path) -> tuple[tuple[str, int, int], ...]:
    """Return what changes when the store does: time and size of the ledger and of the log it writes ahead."""
    found = []
    for path in sorted(folder.glob("ledger.*")):
        if path.name.endswith("-shm"):  # readers change it, too
            continue
        try:
            status = path.stat()
        except FileNotFoundError:  # the log is gone when the last reader closes
            continue
        if status.st_size:
            found.append((path.name, status.st_mtime_ns, status.st_size))
    return tuple(found)


def _read(folder: Path, place: str) -> tuple[FoundCampaign, ...]:
    changed = max((path.stat().st_mtime for path in folder.glob("ledger.*") if path.exists()), default=0.0)
    try:
        return tuple(_found(campaign, place, changed) for campaign in campaigns_in(folder, optional=True))
    except RvsgError as error:
        return (FoundCampaign(folder=place, name=place, problem=str(error), changed_s=changed),)


def _found(campaign: Any, place: str, changed: float) -> FoundCampaign:
    from rvsg.campaign.accounting import calls_of
    from rvsg.campaign.ranking import search_attempts
    from rvsg.report.summary import summarise

    attempts = campaign.attempts()
    summary = summarise(campaign.plan, attempts)
    account = summary.accounting
    calls = calls_of(search_attempts(attempts))
    return FoundCampaign(
        folder=place,
        name=campaign.name,
        world=campaign.plan.mission.world,
        route=campaign.plan.mission.route.name,
        requirement=campaign.requirement.name,
        generator=campaign.config.generator_name,
        complete=summary.complete,
        attempts=account.search_attempts,
        planned=campaign.plan.attempts,
        runs=account.search_runs + account.confirmation_runs + account.baseline_runs,
        calls=account.calls,
        calls_s=sum(call.latency_s for call in calls),
        model=calls[0].model if calls else "",
        cost_usd=account.cost_usd,
        violated=summary.violated,
        changed_s=changed,
        findings=tuple(_confirmations(attempts)),
    )


def _confirmations(attempts: list[Any]) -> Iterator[FoundFinding]:
    from rvsg.evaluation.judge import violated

    for attempt in attempts:
        verdict, scenario = attempt.verdict, attempt.proposal.scenario
        if attempt.purpose != "confirmation" or verdict is None or scenario is None:
            continue
        yield FoundFinding(
            attempt=attempt.index,
            status=verdict.status.value,
            violated=violated(verdict),
            violations=verdict.violations,
            runs=verdict.runs,
            description=scenario.description,
        )
