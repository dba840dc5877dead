"""The Ledger, where attempts and runs are stored for good, and the bounded cache that a campaign reads it through.

An attempt takes some 30 kB: its scenario, every metric of every run, and all that its brief says. A search reads
hardly any of it again, so a campaign keeps a summary of each attempt and a bounded number of records. It takes as much
memory after 20,000 runs as after the first thousand, but for the summaries.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from typing import Any, Generic, Protocol, TypeVar, cast

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.observation import FailureMode, RunObservation, observe
from rvsg.core.errors import StoreError
from rvsg.core.records import Record
from rvsg.scenario.brief import Feedback, Remembered
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.archive import PackedRun
from rvsg.simulation.run import Run
from rvsg.world.world import World

K = TypeVar("K")
V = TypeVar("V")
T = TypeVar("T")
RUNS = 16
"""Runs in memory with their arrays, some 0.3 MB each."""
OBSERVATIONS = 4096
"""Observations of runs in memory, some 4 kB each."""
ATTEMPTS = 64
"""Attempts in memory, some 30 kB each, and up to 0.5 MB where the brief holds feedback."""


class Ledger(Protocol):
    """Where attempts and runs are stored, in order, for good.

    A plug-in of the kind `store` is created with the path that is its own in the campaign's folder, and its options. A
    run is stored by its content id, possibly before the attempt it belongs to, so that an interruption loses at most
    the runs in progress. Derive a ledger from this class: `forget_empty` and `attempt` have defaults.
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

    def attempt(self, campaign: str, index: int) -> Attempt:
        """Return one attempt of a campaign; StoreError if there is none. By default it looks through `attempts`."""
        for attempt in self.attempts(campaign):
            if attempt.index == index:
                return attempt
        raise StoreError(f"there is no attempt {index} of campaign {campaign!r}")

    def run(self, run_id: str) -> Run:
        """Return the run of that id; StoreError if there is none."""
        ...

    def find(self, run_id: str) -> Run | None:
        """Return the run of that id, or None."""
        ...


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
    """A ledger with what a campaign used last in memory: attempts, runs with their arrays, and observations of runs.

    Args:
        ledger: Where everything is stored.
    """

    def __init__(self, ledger: Ledger) -> None:
        self.ledger = ledger
        self._attempts: Recent[tuple[str, int], Attempt] = Recent(ATTEMPTS)
        self._runs: Recent[str, Run] = Recent(RUNS)
        self._observations: Recent[str, RunObservation] = Recent(OBSERVATIONS)

    def keep(self, run: PackedRun) -> None:
        """Store a run; where its id is known, nothing changes."""
        self.ledger.keep(run)

    def append(self, attempt: Attempt, runs: Sequence[PackedRun]) -> None:
        """Store an attempt with its runs, and keep it in memory."""
        self.ledger.append(attempt, runs)
        self._attempts.add((attempt.campaign, attempt.index), attempt)

    def attempts(self, campaign: str) -> Iterator[Attempt]:
        """Return the attempts of a campaign in the order of their index."""
        return self.ledger.attempts(campaign)

    def attempt(self, campaign: str, index: int) -> Attempt:
        """Return one attempt of a campaign; StoreError if there is none."""
        return self._attempts.get_or((campaign, index), lambda key: self.ledger.attempt(*key))

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
        return self._observations.get_or(run_id, lambda _: observe(self.run(run_id), world.grid, world))

    def failure_mode(self, run_id: str, world: World) -> FailureMode | None:
        """Return how a run fails if it does."""
        return self.observation(run_id, world).mode


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
        ledger: Where they are stored.
    """

    def __init__(self, ledger: CachedLedger, campaign: str) -> None:
        self._reads = ledger.attempt
        self._campaign = campaign
        self._last: OrderedDict[int, Attempt] = OrderedDict()
        self._briefs: OrderedDict[int, Attempt] = OrderedDict()

    def __call__(self, attempt: Attempt) -> Attempt:
        """Return what stands for a stored attempt."""
        self._keep(attempt)
        return cast(Attempt, Filed(attempt, self))

    def read(self, index: int, *, but_brief: bool = False) -> Attempt:
        """Return an attempt.

        Args:
            but_brief: Nobody asks for its brief.
        """
        kept = self._last if but_brief else self._briefs
        if index not in kept:
            self._keep(self._reads(self._campaign, index))
        kept.move_to_end(index)
        return kept[index]

    def _keep(self, attempt: Attempt) -> None:
        self._briefs[attempt.index] = attempt
        self._last[attempt.index] = attempt.model_copy(update={"brief": None})
        for kept, most in ((self._last, LAST), (self._briefs, LAST_BRIEFS)):
            if len(kept) > most:
                kept.popitem(last=False)


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
