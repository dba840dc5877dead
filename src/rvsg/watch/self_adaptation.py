"""What a watch writes down: symptoms, plans and changes, the rules that decide on them, and the journal.

The journal is the whole state: a stopped loop reads it and resumes with the next step.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from rvsg.core.errors import FileError
from rvsg.core.records import Record
from rvsg.scenario import validity
from rvsg.scenario.placement import start_gap_m
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.run import Run
from rvsg.suites.suite import State
from rvsg.world.world import World


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
        if self.kind == "new version":
            return f"the new version {self.version}"
        if self.kind == "never tested":
            return f"untested places on {self.route} ({', '.join(self.places)})"
        return f"{self.requirement} {self.kind} on {self.route}"


Sign = tuple[Symptom, str]
"""A symptom, and the values it was read from, in words for the log."""


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


Decision = tuple[Literal["accepted", "refused", "waits"], tuple[str, ...]]
"""What was decided on a plan or a change, and why. Every reason stands for a rule that was declared."""


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


class DeclaredRules:
    """Refuses a plan that breaks a rule, and lets one wait where a person has to approve it.

    Args:
        approved: the ids of the plans that a person has approved, read again for every decision.
    """

    def __init__(self, rules: RuleSet, world: World, approved: Callable[[], frozenset[str]]) -> None:
        self.rules = rules
        self.world = world
        self.approved = approved

    def decide(self, planned: Planned, *, spent: int) -> Decision:
        """Decide on a plan by validity, plausibility, safety of the people, budget and approval, in this order."""
        findings = validity.check(planned.scenario.people, planned.scenario.mission, self.world)
        broken = [f"validity: {finding}" for finding in findings]
        if not planned.is_case:  # the people of a case were accepted when it was added
            broken += [*self._implausible(planned), *self._unsafe(planned)]
        if planned.runs > self.rules.max_runs_per_plan:
            most = self.rules.max_runs_per_plan
            broken.append(f"budget: {planned.runs} runs, at most {most} for one plan")
        if spent + planned.runs > self.rules.max_runs:
            left = f"{spent} of {self.rules.max_runs} runs are spent"
            broken.append(f"budget: {left}, and the plan may take {planned.runs}")
        if broken:
            return "refused", tuple(broken)
        asks = self.rules.approval == "always" or (self.rules.approval == "new" and not planned.is_case)
        if not asks:
            return "accepted", ("all rules hold",)
        if planned.id in self.approved():
            return "accepted", ("all rules hold; a person approved it",)
        return "waits", ("approval: a person has to approve it",)

    def decide_change(self, change: Change, *, alike: int) -> Decision:
        """Decide on a change of the suite by the rules `write_back` and `max_failures`."""
        if self.rules.write_back == "never":
            return "refused", ("write_back: the suite is not changed",)
        if change.is_new and alike >= self.rules.max_failures:
            reason = f"max_failures: the suite knows {alike} failures of {change.requirement} on this route"
            return "refused", (reason,)
        if self.rules.write_back == "always":
            return "accepted", ("write_back: always",)
        if change.id in self.approved():
            return "accepted", ("write_back: a person approved it",)
        return "waits", ("write_back: a person has to approve it",)

    def _implausible(self, planned: Planned) -> Iterator[str]:
        low, high = self.rules.speed_m_s
        people = planned.scenario.people.humans
        if len(people) > self.rules.max_people:
            yield f"plausibility: {len(people)} people, at most {self.rules.max_people}"
        for human in people:
            if not low <= human.speed_m_s <= high:
                yield f"plausibility: {human.name} walks at {human.speed_m_s:g} m/s, not {low:g} to {high:g}"

    def _unsafe(self, planned: Planned) -> Iterator[str]:
        for human in planned.scenario.people.humans:
            if human.behaviour.value in self.rules.forbidden_behaviours:
                yield f"safety: {human.name} is asked to be {human.behaviour.value}"
            at = human.starts_at(self.world.grid)
            if at is None:
                continue
            gap = start_gap_m(human.body_radius_m, at, planned.scenario.mission)
            if gap < self.rules.start_gap_m:
                yield f"safety: {human.name} starts {gap:.2f} m from the robot, at least {self.rules.start_gap_m:g} m"


QUIET = (State.PASSED.value, State.KNOWN_FAILURE.value)
"""States that were expected; the log counts their cases and names the others."""
Part = Literal["loop", "monitor", "analyse", "plan", "legitimate", "execute", "knowledge"]


class JournalNote(Record):
    """One thing that the loop did."""

    time: str
    """UTC, ISO 8601."""
    cycle: int
    part: Part
    text: str
    seen: tuple[str, ...] = ()
    """Sources whose cycle is complete."""
    symptom: Symptom | None = None
    """A symptom that has been acted on."""
    plan: str | None = None
    """The id of a plan or a change of the suite that was decided on or done."""
    outcome: str = ""
    runs: int = 0
    """Runs that it took."""
    results: tuple[tuple[str, str], ...] = ()
    """Of a case of the suite: its name with each requirement, and the state."""


class Journal:
    """A file of notes, and the state that follows from them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.words = path.with_suffix(".log")
        self.notes = list(_read_notes(path)) if path.exists() else []

    @property
    def seen(self) -> frozenset[str]:
        """Sources that were watched in a complete cycle."""
        return frozenset(source for note in self.notes for source in note.seen)

    @property
    def handled(self) -> frozenset[str]:
        """Ids of the symptoms that were acted on."""
        return frozenset(note.symptom.id for note in self.notes if note.symptom is not None and note.part == "plan")

    @property
    def versions(self) -> list[str]:
        """The versions that were acted on, in their order."""
        symptoms = [note.symptom for note in self.notes if note.symptom is not None]
        return [symptom.version for symptom in symptoms if symptom.kind == "new version"]

    @property
    def settled(self) -> frozenset[str]:
        """Ids of the plans that were refused or run, and of the changes that were refused or written."""
        done = [note for note in self.notes if note.part == "execute" or note.outcome in ("refused", "written")]
        return frozenset(note.plan for note in done if note.plan is not None)

    @property
    def decided(self) -> dict[str, str]:
        """The last decision on each plan, by its id."""
        return {n.plan: n.outcome for n in self.notes if n.part == "legitimate" and n.plan is not None}

    @property
    def spent(self) -> int:
        """Runs of all plans."""
        return sum(note.runs for note in self.notes)

    @property
    def cycle(self) -> int:
        """Cycles that are complete."""
        return sum(note.part == "loop" and note.outcome == "complete" for note in self.notes)

    def version_in_words(self) -> str:
        """Return what the cases say of the version that was acted on last; empty if that is said already."""
        version, results = "", dict[str, str]()
        for note in self.notes:
            if note.symptom is not None and note.symptom.kind == "new version":
                version, results = note.symptom.version, {}
            elif note.outcome == "version":
                results = {}
            results |= dict(note.results)
        states = []
        for state in dict.fromkeys(results.values()):
            names = [name for name, said in results.items() if said == state]
            states.append(f"{len(names)} {state}" + ("" if state in QUIET else f" ({', '.join(names)})"))
        return f"the suite on {version}: {', '.join(states)}" if states else ""

    def add(self, note: JournalNote) -> None:
        """Append a note to both files; each line is flushed before the next thing is done."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        line = json.dumps(note.model_dump(mode="json"), ensure_ascii=False)
        for path, text in ((self.path, line), (self.words, in_words(note))):
            with path.open("a", encoding="utf-8") as file:
                file.write(text + "\n")
        self.notes.append(note)


def in_words(note: JournalNote) -> str:
    """Return a note as a line of the log."""
    return f"{note.time[:19].replace('T', ' ')}  cycle {note.cycle:<3} {note.part:10}  {note.text}"


def _read_notes(path: Path) -> list[JournalNote]:
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    notes = []
    for number, line in enumerate(lines, 1):
        try:
            notes.append(JournalNote.from_json(line))
        except ValidationError:
            if number == len(lines) and not line.endswith("\n"):
                path.write_text("".join(lines[:-1]), encoding="utf-8")  # the process was killed while it wrote this
                break
            raise FileError(
                path, "this line is no note of a watch. Move the folder away to start again.", line=number
            ) from None
    return notes
