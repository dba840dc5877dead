"""Runs the loop cycle by cycle, part by part, and keeps a journal."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from rvsg.campaign.knowledge import Entry, entry_of_case
from rvsg.campaign.suite import CaseResult, State
from rvsg.campaign.watch.journal import Journal, Note, Part
from rvsg.campaign.watch.parts import (
    Analyser,
    Change,
    Decision,
    Executor,
    Keeper,
    Legitimator,
    Memory,
    Monitor,
    Planned,
    Planner,
    Sign,
)
from rvsg.core.errors import FileError, SimulationError
from rvsg.core.files import write_whole

Tell = Callable[[Note], None]
Kept = TypeVar("Kept", Planned, Change)


def now() -> str:
    """Return the time of day, UTC."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


@dataclass(kw_only=True)
class Loop:
    """Monitor, Analyse, Plan, Legitimate, Execute over Knowledge.

    `plans` is the folder that keeps every plan as a file. A stopped loop resumes where it was: plans that were accepted
    and not run come first. A plan is run once; one that was under way is repeated with the same
    seeds.
    """

    monitor: Monitor
    analyser: Analyser
    planner: Planner
    legitimator: Legitimator
    executor: Executor
    knowledge: Memory
    keeper: Keeper
    journal: Journal
    plans: Path
    place: str
    simulator: str
    renew: Callable[[], Sequence[str]] = lambda: ()
    """Read the suite and the stack again, which a person may have changed; return what could not be read, in words."""
    version: Callable[[], str] = lambda: ""
    """The version under test; empty if nothing says so."""
    tell: Tell = lambda _: None
    clock: Callable[[], str] = now
    stop: Callable[[], bool] = lambda: False
    """Asked before every plan; True ends the cycle, which the next start completes."""

    def cycle(self) -> bool:
        """Do one cycle; return whether there was anything to do."""
        troubles = list(self.renew())
        watched = list(self.monitor.new(self.journal.seen))
        for trouble in (*troubles, *self.monitor.troubles()):
            self._note("monitor", trouble)
        if watched:
            told = ", ".join(each.source for each in watched[:5]) + (", ..." if len(watched) > 5 else "")
            self._note("monitor", f"{_number(len(watched), 'new run', 'new runs')}: {told}")
            entries = self.analyser.entries(watched)
            new = self.knowledge.add(entries, origin="watch")
            self._note("knowledge", f"{_number(new, 'new entry', 'new entries')} of what was watched")
        self._plan(self.analyser.analyse(watched))
        busy = bool(watched)
        for planned in self._open_plans():
            if self.stop():
                return True
            busy |= self._run_if_legitimate(planned)
        for change in self._open_changes():
            busy |= self._keep_if_legitimate(change)
        if told := self.journal.version_in_words():
            self._note("analyse", told, outcome="version")
        if watched or busy:
            seen = tuple(each.source for each in watched)
            self._note("loop", f"cycle complete; {self.journal.spent} runs so far", seen=seen, outcome="complete")
        return busy

    def _plan(self, signs: Sequence[Sign]) -> None:
        for sign in signs:
            if sign.symptom.id in self.journal.handled:
                continue
            self._note("analyse", sign.text)
            made = self.planner.plan(sign.symptom, index=len(self.journal.handled))
            for planned in made:
                write_whole(self.plans / f"{planned.id}.json", planned.to_json())
            names = ", ".join(each.name for each in made)
            what = f"{_number(len(made), 'scenario', 'scenarios')} because of {sign.symptom.in_words}: {names}"
            text = what if made else "nothing can be planned"
            self._note("plan", text, symptom=sign.symptom)

    def _open_plans(self) -> Iterator[Planned]:
        """Yield the plans that are neither refused nor run: those that were accepted, then cases, then the others."""
        decided = self.journal.decided
        plans = [_read(path, Planned) for path in self._open("planned-*.json")]
        yield from sorted(plans, key=lambda p: (decided.get(p.id) != "accepted", not p.is_case, p.name))

    def _open_changes(self) -> Iterator[Change]:
        """Yield the changes that are neither refused nor written."""
        for path in self._open("change-*.json"):
            yield _read(path, Change)

    def _open(self, pattern: str) -> list[Path]:
        settled = self.journal.settled
        return [path for path in sorted(self.plans.glob(pattern)) if path.stem not in settled]

    def _run_if_legitimate(self, planned: Planned) -> bool:
        """Decide on a plan, run it where it is accepted; return whether anything was done."""
        before = self.journal.decided.get(planned.id)
        decision = self.legitimator.decide(planned, spent=self.journal.spent)
        if decision.outcome != before:
            text = f"{decision.outcome}: {planned.name} ({'; '.join(decision.reasons)})"
            self._note("legitimate", text, plan=planned.id, outcome=decision.outcome)
            if decision.outcome == "refused":
                self._learn([self._rejected(planned, decision)])
        if decision.outcome != "accepted":
            return decision.outcome != before
        try:
            results = self.executor.execute(planned)
        except SimulationError as error:
            self._note("execute", f"{planned.name} could not be run: {error}", plan=planned.id, outcome="failed")
            return True
        # Knowledge before the note: entries are kept once, so a loop that is killed here repeats and adds none twice.
        new = self.knowledge.add(self._entries(planned, results), origin="watch")
        for change in self.keeper.changes(planned, results):
            write_whole(self.plans / f"{change.id}.json", change.to_json())
        runs = max((len(each.seeds) for each in results), default=0)
        told = "; ".join(f"{each.requirement} {_state(planned, each)}: {_counted(each)}" for each in results)
        self._note(
            "execute",
            f"{planned.name}: {told}",
            plan=planned.id,
            outcome="run",
            runs=runs,
            results=_found(planned, results),
        )
        self._note("knowledge", f"{_number(new, 'new entry', 'new entries')} of {planned.name}")
        return True

    def _keep_if_legitimate(self, change: Change) -> bool:
        """Decide on a change of the suite, make it where it is accepted; return whether anything was done."""
        before = self.journal.decided.get(change.id)
        decision = self.legitimator.decide_change(change, alike=self.keeper.alike(change))
        if decision.outcome != before:
            text = f"{decision.outcome}: {change.in_words} ({'; '.join(decision.reasons)})"
            if decision.outcome == "waits":
                text += f"; approve it with --approve {change.id}"
            self._note("legitimate", text, plan=change.id, outcome=decision.outcome)
        if decision.outcome == "accepted":
            self.keeper.keep(change)
            told = f"written into the suite: {change.case}, {change.requirement}"
            self._note("knowledge", told, plan=change.id, outcome="written")
        return decision.outcome != before

    def _entries(self, planned: Planned, results: Sequence[CaseResult]) -> list[Entry]:
        version = self.version()
        told = (f"version {version}",) if version else ()
        entries = [entry_of_case(planned.scenario, each, self.place, self.simulator) for each in results]
        return [entry.replace(lessons=(*entry.lessons, *told)) for entry in entries]

    def _rejected(self, planned: Planned, decision: Decision) -> Entry:
        mission = planned.scenario.mission
        return Entry(
            kind="rejected",
            world=mission.world,
            place=self.place,
            route=mission.route.name,
            requirement=", ".join(planned.requirements),
            description=planned.scenario.description or planned.name,
            scenario=planned.scenario,
            lessons=decision.reasons,
        )

    def _learn(self, entries: Sequence[Entry]) -> None:
        new = self.knowledge.add(entries, origin="watch")
        self._note("knowledge", f"{_number(new, 'new entry', 'new entries')} of refused plans")

    def _note(self, part: Part, text: str, **more: Any) -> None:
        note = Note(time=self.clock(), cycle=self.journal.cycle + 1, part=part, text=text, **more)
        self.journal.add(note)
        self.tell(note)


def _read(path: Path, kind: type[Kept]) -> Kept:
    try:
        return kind.from_json(path.read_bytes())
    except ValueError as error:
        raise FileError(path, f"this is no {kind.__name__.lower()} of a watch any more: {error}") from None


def _number(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def _found(planned: Planned, results: Sequence[CaseResult]) -> tuple[tuple[str, str], ...]:
    """Return what the results say of each requirement of a case; nothing for a new scenario."""
    return tuple((f"{r.case} {r.requirement}", r.state.value) for r in results) if planned.is_case else ()


def _state(planned: Planned, result: CaseResult) -> str:
    """Return what a result says; only a case of the suite can be broken, for nothing was expected of a new scenario."""
    if planned.is_case:
        return result.state.value
    return {State.BROKEN: "violated", State.PASSED: "holds"}.get(result.state, result.state.value)


def _counted(result: CaseResult) -> str:
    return f"{result.verdict.violations} of {result.verdict.runs} runs violate it"
