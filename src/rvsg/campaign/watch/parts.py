"""The parts of the loop as protocols, and the records they hand to one another."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from rvsg.campaign.knowledge import Entry
from rvsg.campaign.suite import CaseResult
from rvsg.core.records import Record
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.run import Run


@dataclass(frozen=True, kw_only=True)
class Watched:
    """A run that the monitor saw."""

    source: str
    """What it is known by, e.g. a file; a source is watched once."""
    route: str
    version: str
    """Label of the stack that drove; empty if nothing says so."""
    run: Run


class Symptom(Record):
    """What the analysis shows, and why it calls for a plan. Equal symptoms are acted on once."""

    kind: Literal["near its limit", "violated", "never tested", "new version"]
    route: str = ""
    requirement: str = ""
    places: tuple[str, ...] = ()
    version: str = ""
    change: int = 0
    """Of a new version: how many there were before, so that the way back to an old one counts, too."""

    @property
    def in_words(self) -> str:
        """The symptom as part of a sentence."""
        words = {
            "near its limit": f"{self.requirement} near its limit on {self.route}",
            "violated": f"{self.requirement} violated on {self.route}",
            "never tested": f"untested places on {self.route} ({', '.join(self.places)})",
            "new version": f"the new version {self.version}",
        }
        return words[self.kind]


class Sign(Record):
    """A symptom with what it was read from."""

    symptom: Symptom
    source: str
    text: str
    """The values, in words for the log."""


class Planned(Record):
    """A scenario that is planned, and why."""

    why: Symptom
    name: str
    scenario: Scenario
    requirements: tuple[str, ...]
    """As the suite names them."""
    runs: int
    """Runs at most."""
    is_case: bool = False
    """Whether it is a case of the suite, which was accepted when it was added."""


class Change(Record):
    """What a result calls for in the suite: a new known failure, or an expectation that holds again."""

    case: str
    """The name of the case."""
    title: str
    scenario: Scenario
    requirement: str
    """As the suite names it."""
    expected: Literal["pass", "violation"]
    reason: str
    """Why the failure is known: what found it, and how often the runs violate the requirement."""
    is_new: bool
    """Whether the suite has no such case yet."""

    @property
    def in_words(self) -> str:
        """The change as part of a sentence."""
        if self.expected == "pass":
            return f"{self.case}: {self.requirement} is expected to hold from now on"
        return f"{self.case}: a new known failure of {self.requirement}, {self.reason}"


class Decision(Record):
    """What was decided on a plan or a change. Every reason stands for a rule that was declared."""

    outcome: Literal["accepted", "refused", "waits"]
    reasons: tuple[str, ...]


class Monitor(Protocol):
    """Sees runs."""

    def new(self, seen: frozenset[str]) -> Iterable[Watched]:
        """Return the runs whose source is not among those seen."""
        ...

    def troubles(self) -> Sequence[str]:
        """Return what could not be read since the last call, in words."""
        ...


class Analyser(Protocol):
    """Judges what was seen."""

    def analyse(self, watched: Sequence[Watched]) -> Sequence[Sign]:
        """Return what calls for a plan."""
        ...

    def entries(self, watched: Sequence[Watched]) -> Sequence[Entry]:
        """Return what was seen as knowledge."""
        ...


class Planner(Protocol):
    """Turns symptoms into scenarios."""

    def plan(self, symptom: Symptom, *, index: int) -> Sequence[Planned]:
        """Return scenarios for a symptom; none if nothing can be planned. Equal arguments give equal plans."""
        ...


class Legitimator(Protocol):
    """Accepts or refuses plans by declared rules."""

    def decide(self, planned: Planned, *, spent: int) -> Decision:
        """Decide on a plan after `spent` runs."""
        ...

    def decide_change(self, change: Change, *, alike: int) -> Decision:
        """Decide on a change of the suite, which knows `alike` failures of this requirement on this route."""
        ...


class Executor(Protocol):
    """Runs what was accepted."""

    def execute(self, planned: Planned) -> Sequence[CaseResult]:
        """Run a plan and return a result for each requirement."""
        ...


class Memory(Protocol):
    """Keeps what the loop learns."""

    def add(self, entries: Iterable[Entry], *, origin: str = "") -> int:
        """Add entries; return how many are new."""
        ...


class Keeper(Protocol):
    """Writes into the suite what the loop finds."""

    def changes(self, planned: Planned, results: Sequence[CaseResult]) -> Sequence[Change]:
        """Return what the results of a plan call for in the suite."""
        ...

    def alike(self, change: Change) -> int:
        """Return how many failures of the requirement on the route of a change the suite knows."""
        ...

    def keep(self, change: Change) -> None:
        """Write a change into the suite; doing it twice changes nothing more."""
        ...


class RuleSet(Record):
    """The rules by which plans are legitimate; a file `rules.yaml` in the suite's folder may change them."""

    max_runs: int = 1000
    """Runs of the loop in all."""
    max_runs_per_plan: int = 30
    max_people: int = 8
    speed_m_s: tuple[float, float] = (0.3, 2.0)
    """Walking speeds that are plausible for people at work."""
    start_gap_m: float = 1.0
    """Nobody starts nearer to the robot than this, surface to surface."""
    forbidden_behaviours: tuple[str, ...] = ("threatening",)
    """Behaviours that nobody is asked for."""
    approval: Literal["never", "new", "always"] = "never"
    """Which plans wait for a person's approval: none, those that are no case of the suite, or all."""
    near: float = 0.15
    """A requirement is near its limit within this share of the limit."""
    write_back: Literal["never", "approved", "always"] = "approved"
    """Whether new failures and fixed cases are written into the suite: never, once a person approved it, or at once."""
    max_failures: int = 5
    """No further failure of a requirement on a route is written into a suite that knows so many."""
