"""Memory of a campaign: what is kept of its attempts and runs, and what is read again from the ledger.

An attempt takes some 30 kB: its scenario, every metric of every run, and all that its brief tells. A search reads
hardly any of it again, so a campaign keeps a few numbers of each attempt, and takes as much memory after 20,000 runs as
after the first thousand.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar, cast

from rvsg.campaign.attempt import Attempt, Ledger
from rvsg.campaign.feedback import Glance, Look
from rvsg.core.records import Record
from rvsg.scenario.brief import Feedback, Remembered
from rvsg.scenario.scenario import Scenario
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


LAST = 256
"""Attempts kept as they are but for their brief, some 25 kB each: those made or read last."""
LAST_BRIEFS = 4
"""Attempts kept with their brief, some 0.5 MB each where it tells of measurements."""
ASKED_OFTEN = (
    "index",
    "purpose",
    "confirms",
    "mean",
    "runs",
    "scenario_index",
    "scenario_id",
    "untold_id",
    "lesson",
    "seeds",
    "measured_runs",
    "violations",
    "valued_runs",
)


class Filed:
    """An Attempt of the ledger. Whatever it does not hold itself is read from there."""

    __slots__ = (*ASKED_OFTEN, "_filing")

    def __init__(self, attempt: Attempt, filing: Filing) -> None:
        self._filing = filing
        for name in ASKED_OFTEN:
            setattr(self, name, getattr(attempt, name))

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._filing.read(cast(int, self.index), but_brief=name in _BUT_BRIEF), name)

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        same = isinstance(other, Attempt | Filed) and self.index == other.index
        return same and bool(whole(cast(Attempt, self)) == whole(cast(Attempt, other)))

    __hash__ = None  # type: ignore[assignment]


_BUT_BRIEF = frozenset(Attempt.model_fields) - {"brief"}


def whole(attempt: Attempt) -> Attempt:
    """Return the record itself of an attempt that is possibly filed, for those who keep or serialise it."""
    return attempt._filing.read(attempt.index) if isinstance(attempt, Filed) else attempt


class Filing:
    """Files the attempts of a campaign.

    Args:
        ledger: Where they are stored. One that has no method `attempt`, or keeps everything in memory, is not read
            again; then attempts are kept as they are.
    """

    def __init__(self, ledger: Ledger, campaign: str) -> None:
        self._reads: Callable[[str, int], Attempt] | None = getattr(ledger, "attempt", None)
        self._campaign = campaign
        self._last: OrderedDict[int, Attempt] = OrderedDict()
        self._briefs: OrderedDict[int, Attempt] = OrderedDict()

    def __call__(self, attempt: Attempt) -> Attempt:
        """Return what stands for a stored attempt."""
        if self._reads is None:
            return attempt
        self._keep(attempt)
        return cast(Attempt, Filed(attempt, self))

    def read(self, index: int, *, but_brief: bool = False) -> Attempt:
        """Return an attempt.

        Args:
            but_brief: Nobody asks for its brief.
        """
        kept = self._last if but_brief else self._briefs
        if index not in kept:
            assert self._reads is not None
            self._keep(self._reads(self._campaign, index))
        kept.move_to_end(index)
        return kept[index]

    def _keep(self, attempt: Attempt) -> None:
        self._briefs[attempt.index] = attempt
        self._last[attempt.index] = attempt.model_copy(update={"brief": None})
        for kept, most in ((self._last, LAST), (self._briefs, LAST_BRIEFS)):
            if len(kept) > most:
                kept.popitem(last=False)


T = TypeVar("T")


class Sharing:
    """Replaces parts of attempts by equal parts of the attempts before."""

    def __init__(self) -> None:
        self._known: dict[Hashable, list[object]] = {}
        self._given: dict[frozenset[str], set[str]] = {}

    def __call__(self, attempt: Attempt) -> Attempt:
        """Return the attempt, its parts shared."""
        brief, scenario = attempt.brief, attempt.proposal.scenario
        self._replace(brief, "mission", "requirement", "moved_by")
        if scenario is not None:
            _put(attempt.proposal, "scenario", self._scenario(scenario))
        for name in ("feedback", "untold"):
            told = getattr(brief, name)
            if isinstance(told, Feedback):
                self._feedback(told)
        _put(brief, "memory", tuple(self._remembered(earlier) for earlier in brief.memory))
        self._slim(attempt)
        return attempt

    def _slim(self, part: object) -> None:
        """Share the sets in which pydantic notes which fields were given: one of its own takes more than a record."""
        if isinstance(part, tuple):
            for each in part:
                self._slim(each)
        elif isinstance(part, dict):
            for each in part.values():
                self._slim(each)
        elif isinstance(part, Record):
            given = part.__pydantic_fields_set__
            shared = self._given.setdefault(frozenset(given), given)
            if shared is not given:
                object.__setattr__(part, "__pydantic_fields_set__", shared)
                for each in part.__dict__.values():
                    self._slim(each)

    def _feedback(self, told: Feedback) -> None:
        _put(told, "scenario", self._scenario(told.scenario))
        if told.best is not None:
            _put(told, "best", self._scenario(told.best))

    def _remembered(self, earlier: Remembered) -> Remembered:
        _put(earlier, "scenario", self._scenario(earlier.scenario))
        return self._same(earlier, (id(earlier.scenario), earlier.mean, earlier.runs, earlier.lesson))

    def _scenario(self, scenario: Scenario) -> Scenario:
        self._replace(scenario, "mission")
        for human in scenario.people.humans:
            _put(human, "tasks", tuple(self._same(task, (task.name, task.path)) for task in human.tasks))
        paces = tuple((human.speed_m_s, human.start_delay_s, len(human.tasks)) for human in scenario.people.humans)
        return self._same(scenario, (scenario.description, paces))

    def _replace(self, record: Record, *fields: str) -> None:
        for name in fields:
            _put(record, name, self._same(getattr(record, name), name))

    def _same(self, part: T, key: Hashable) -> T:
        """Return the first part that is equal to this one, among those of its key."""
        known = cast(list[T], self._known.setdefault(key, []))
        for other in known:
            if other is part or other == part:
                return other
        known.append(part)
        return part


def _put(record: Record, name: str, part: object) -> None:
    """Replace a field of a frozen record by an equal object."""
    record.__dict__[name] = part
