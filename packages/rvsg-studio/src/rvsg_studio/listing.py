"""Worlds, campaigns and suites in a folder of work, kept until their files change."""

from __future__ import annotations

import contextlib
import os
import re
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from rvsg.app.campaign import Campaign, campaigns_in
from rvsg.app.folder import LEDGER, MATRIX, STORE
from rvsg.app.input_files import INPUTS
from rvsg.core.errors import InputError, RvsgError
from rvsg.core.files import write_whole
from rvsg.core.records import Record
from rvsg.findings.ranking import search_attempts
from rvsg.report.answer_row import AnswerRow
from rvsg.report.result import is_complete
from rvsg.report.words import tried_of
from rvsg.search.execution import account, calls_of
from rvsg.suites.suite_folder import HEAD

DEEPEST = 6
"""Levels of folders below the one that is listed."""
MOST_FOLDERS = 20_000
SKIPPED = ("node_modules", "__pycache__")
SAVE_EVERY_S = 5.0
_RESULTS = re.compile(rb'\s*\{\s*"suite"\s*:')


class FoundFailure(Record):
    """A confirmed configuration that violates the requirement or touches a person."""

    row: AnswerRow
    """What its campaign says of it."""
    scenario_id: str

    @property
    def severity(self) -> tuple[float, ...]:
        """A key that sorts failures of any campaigns as an answer orders its own; larger is worse."""
        row = self.row
        often = {"always": 3, "sometimes": 2, "not settled": 2, "rarely": 0}[row.often] if row.violated == "yes" else 0
        at_least = row.bounds[0] if row.bounds is not None else 0.0
        return row.contacts > 0, often or row.violated == "open", row.contacts / max(1, row.runs), at_least


class FoundCampaign(Record):
    """A campaign in a folder, in short."""

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
    changed_s: float = 0.0
    """When its ledger changed last, seconds since 1970."""
    status: str = ""
    """Status, tone and headline of its answer."""
    tone: str = "quiet"
    headline: str = ""
    elsewhere: str = ""
    """Contact that its failures do not show."""
    failures: tuple[FoundFailure, ...] = ()
    """The most severe first."""
    scenarios: frozenset[str] = frozenset()
    """The ids of all scenarios that it measured."""
    problem: str = ""
    """Why it has no answer; without a name, why it cannot be read."""
    unread: bool = False
    """Whether it is still to be read; what is known of it may be old, or its folder alone."""

    @property
    def shown(self) -> str:
        """The folder as pages name it."""
        return "this folder" if self.folder == "." else self.folder

    @property
    def tried(self) -> str:
        """How many configurations were tried, of how many."""
        return tried_of(self.attempts, self.planned)


def why_not(first: FoundCampaign, second: FoundCampaign) -> str:
    """Return why two campaigns cannot be compared scenario by scenario; empty where they can."""
    if first.folder == second.folder:
        return "the same campaign"
    if (first.world, first.route) != (second.world, second.route):
        return "another world or route"
    if first.requirement != second.requirement:
        return "another requirement"
    return "" if first.scenarios & second.scenarios else "no scenario in common"


Failure = tuple[FoundCampaign, FoundFailure]


class Listing(Record):
    """What lies in a folder. Paths are relative to it, with `/`."""

    worlds: tuple[str, ...]
    campaigns: tuple[FoundCampaign, ...]
    suites: tuple[str, ...]
    matrices: tuple[str, ...] = ()
    """Folders of campaigns of several routes and requirements."""
    cut: bool = False
    """Whether the folder holds more folders than are looked at."""

    @property
    def failures(self) -> list[Failure]:
        """The failures of all campaigns, the most severe first."""
        failures = [(campaign, failure) for campaign in self.campaigns for failure in campaign.failures]
        return sorted(failures, key=lambda failure: failure[1].severity, reverse=True)

    @property
    def unread(self) -> int:
        """How many campaigns are still to be read."""
        return sum(campaign.unread for campaign in self.campaigns)


Stamp = tuple[tuple[str, int, int], ...]
"""Name, change in ns and bytes of each file of a store."""


class _Index(Record):
    """The campaigns of each store with its stamp when they were read, kept between two sessions."""

    format: Literal[7] = 7
    stores: dict[str, tuple[Stamp, tuple[FoundCampaign, ...]]] = Field(default_factory=dict)


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
        """Held while what is known changes."""
        self._reading = threading.Lock()
        """Held while stores are read, so that none is read twice."""
        self._background: threading.Thread | None = None
        self._known: dict[str, tuple[Stamp, tuple[FoundCampaign, ...]]] = {}
        if cache is not None:
            with contextlib.suppress(OSError, ValidationError):  # missing, damaged, of another version: only a cache
                self._known = _Index.model_validate_json(cache.read_bytes()).stores

    def listing(self, *, wait: bool = True) -> Listing:
        """Return what lies in the folder now.

        Args:
            wait: read every campaign that has changed first. Without it they are read in the background, and what is
                known of them by then is marked as `unread`.
        """
        worlds, stores, suites, matrices = (list[str]() for _ in range(4))
        cut = False
        for count, (path, names) in enumerate(_folders(self.folder)):
            if cut := count >= MOST_FOLDERS:
                break
            place = path.relative_to(self.folder).as_posix()
            if "world.yaml" in names:
                worlds.append(place)
            if HEAD in names:
                suites.append(place)
            if LEDGER in names or STORE in names:
                stores.append(place)
            if MATRIX in names:
                matrices.append(place)
        with self._lock:
            gone = set(self._known).difference(stores)
            for place in gone:
                del self._known[place]
        if gone:
            self._save()
        if wait:
            self._read_changed(stores)
        elif any(self._changed(place) for place in stores):
            with self._lock:
                if self._background is None or not self._background.is_alive():
                    self._background = threading.Thread(target=self._read_changed, args=(stores,), daemon=True)
                    self._background.start()
        campaigns = [campaign for place in stores for campaign in self._campaigns(place)]
        newest_first = sorted(campaigns, key=lambda campaign: (-campaign.changed_s, campaign.folder))
        return Listing(
            worlds=tuple(sorted(worlds)),
            campaigns=tuple(newest_first),
            suites=tuple(sorted(suites)),
            matrices=tuple(sorted(matrices)),
            cut=cut,
        )

    def _changed(self, place: str) -> bool:
        remembered = self._known.get(place)
        return remembered is None or remembered[0] != _stamp(self.folder / place)

    def _campaigns(self, place: str) -> tuple[FoundCampaign, ...]:
        """Return what is known of a store, marked where that is old."""
        remembered = self._known.get(place)
        if remembered is None:
            return (FoundCampaign(folder=place, unread=True, changed_s=_changed_s(self.folder / place)),)
        unread = self._changed(place)
        return tuple(campaign.model_copy(update={"unread": unread}) for campaign in remembered[1])

    def _read_changed(self, stores: list[str]) -> None:
        saved = time.monotonic()
        with self._reading:
            changed = [place for place in stores if self._changed(place)]
            for place in changed:
                entry = (_stamp(self.folder / place), _read(self.folder / place, place))
                with self._lock:
                    self._known[place] = entry
                if time.monotonic() - saved > SAVE_EVERY_S:
                    self._save()
                    saved = time.monotonic()
            if changed:
                self._save()

    def _save(self) -> None:
        if self._cache is not None:
            with self._lock:
                text = _Index(stores=dict(self._known)).model_dump_json()
            write_whole(self._cache, text)


def suite_results_in(folder: Path, *, most: int = 200) -> tuple[str, ...]:
    """Return the files of results of suites in a folder and below it, relative to it with `/`; `most` at most.

    A file counts by its first key. Whether it can be read, `rvsg.suites.suite_folder.read_results` says.
    """
    results = list[str]()
    for path, names in _folders(folder):
        for name in sorted(names):
            place = path / name
            if len(results) == most or not name.endswith(".json") or name.startswith(".") or not place.is_file():
                continue
            with place.open("rb") as file:
                if _RESULTS.match(file.read(80)):
                    results.append(place.relative_to(folder).as_posix())
    return tuple(results)


def _folders(top: Path) -> Iterator[tuple[Path, frozenset[str]]]:
    """Yield every folder with the names of its files, links and hidden folders left out."""
    for path, folders, files in os.walk(top):
        here = Path(path)
        depth = len(here.relative_to(top).parts)
        inside = LEDGER in files or "world.yaml" in files
        listed = sorted(name for name in folders if not name.startswith(".") and name not in SKIPPED)
        if inside and here == top:  # the folder of a campaign that is itself the studio's holds what the studio adds
            listed = [name for name in listed if name not in (INPUTS, "vlm")]
        folders[:] = [] if depth >= DEEPEST or (inside and here != top) else listed
        yield here, frozenset(files)


def _stamp(folder: Path) -> Stamp:
    """Return what changes when the store does: time and size of the ledger and of the log it writes ahead."""
    stamps = []
    for path in sorted(folder.glob("ledger.*")):
        if path.name.endswith("-shm"):  # readers change it, too
            continue
        try:
            status = path.stat()
        except FileNotFoundError:  # the log is gone when the last reader closes
            continue
        if status.st_size:
            stamps.append((path.name, status.st_mtime_ns, status.st_size))
    return tuple(stamps)


def _read(folder: Path, place: str) -> tuple[FoundCampaign, ...]:
    changed = _changed_s(folder)
    try:
        return tuple(_found(campaign, place, changed) for campaign in campaigns_in(folder, optional=True))
    except RvsgError as error:
        return (FoundCampaign(folder=place, name=place, problem=str(error), changed_s=changed),)


def _changed_s(folder: Path) -> float:
    """Return when a store changed last, seconds since 1970."""
    return max((path.stat().st_mtime for path in folder.glob("ledger.*") if path.exists()), default=0.0)


def _found(campaign: Campaign, place: str, changed: float) -> FoundCampaign:
    said: dict[str, Any] = {}
    try:
        with campaign.result() as result:
            attempts, answer = result.attempts, result.answer
    except InputError as error:  # its world is not there any more
        attempts, said["problem"] = campaign.attempts(), str(error)
    else:
        scenarios = {entry.attempt: entry.scenario_id for entry in result.entries}
        said = {"status": answer.status, "tone": answer.tone, "headline": answer.headline}
        said["elsewhere"] = answer.elsewhere.text if answer.elsewhere is not None else ""
        said["failures"] = tuple(FoundFailure(row=r, scenario_id=scenarios[r.attempt]) for r in answer.failures)
    summary, calls = account(attempts), calls_of(search_attempts(attempts))
    return FoundCampaign(
        folder=place,
        name=campaign.name,
        world=campaign.plan.mission.world,
        route=campaign.plan.mission.route.name,
        requirement=campaign.requirement.name,
        generator=campaign.config.generator_name,
        complete=is_complete(campaign.plan, attempts),
        attempts=summary.search_attempts,
        planned=campaign.plan.attempts,
        runs=summary.search_runs + summary.confirmation_runs + summary.baseline_runs,
        calls=summary.calls,
        calls_s=sum(call.latency_s for call in calls),
        model=calls[0].model if calls else "",
        cost_usd=summary.cost_usd,
        changed_s=changed,
        scenarios=frozenset(a.proposal.scenario.id for a in attempts if a.proposal.scenario and a.measurements),
        **said,
    )
