"""The loop of self-adaptation: monitor, analyse, plan, legitimate, execute over knowledge."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from rvsg.core.errors import FileError, SimulationError
from rvsg.core.files import write_whole
from rvsg.findings.findings import Entry, entry_of_case
from rvsg.suites.suite import CaseResult, State
from rvsg.watch.self_adaptation import (
    Change,
    Decision,
    DeclaredRules,
    Journal,
    JournalNote,
    Part,
    Planned,
    Symptom,
    Watched,
)
from rvsg.watch.suite_watch import SuiteWatch


class Monitor(Protocol):
    """Sees runs."""

    def new(self, seen: frozenset[str]) -> Iterable[Watched]:
        """Return the runs whose source is not among those seen."""
        ...

    def troubles(self) -> Sequence[str]:
        """Return what could not be read since the last call, in words."""
        ...


Written = TypeVar("Written", Planned, Change)


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
    watch: SuiteWatch
    """The suite and the stack under test: analyses what was seen, plans, runs what was accepted."""
    legitimator: DeclaredRules
    learn: Callable[[Iterable[Entry]], int]
    """Keeps what the loop learns, and returns how many entries are new."""
    journal: Journal
    plans: Path
    tell: Callable[[JournalNote], None] = lambda _: None
    clock: Callable[[], str] = now
    stop: Callable[[], bool] = lambda: False
    """Asked before every plan; True ends the cycle, which the next start completes."""

    def cycle(self) -> bool:
        """Do one cycle; return whether there was anything to do."""
        troubles = list(self.watch.renew())
        watched = list(self.monitor.new(self.journal.seen))
        for trouble in (*troubles, *self.monitor.troubles()):
            self._note("monitor", trouble)
        if watched:
            summary = ", ".join(run.source for run in watched[:5]) + (", ..." if len(watched) > 5 else "")
            self._note("monitor", f"{_number(len(watched), 'new run', 'new runs')}: {summary}")
            self._learn(self.watch.entries(watched), "what was watched")
        for symptom, text in self.watch.analyse(watched):
            self._plan(symptom, text)
        busy = bool(watched)
        # Plans that were accepted come first, then cases of the suite, then the others.
        plans, decided = self._open("planned-*.json", Planned), self.journal.decided
        for planned in sorted(plans, key=lambda p: (decided.get(p.id) != "accepted", not p.is_case, p.name)):
            if self.stop():
                return True
            busy |= self._run_if_legitimate(planned)
        for change in self._open("change-*.json", Change):
            busy |= self._keep_if_legitimate(change)
        if summary := self.journal.version_in_words():
            self._note("analyse", summary, outcome="version")
        if watched or busy:
            seen = tuple(run.source for run in watched)
            self._note("loop", f"cycle complete; {self.journal.spent} runs so far", seen=seen, outcome="complete")
        return busy

    def _plan(self, symptom: Symptom, text: str) -> None:
        handled = self.journal.handled
        if symptom.id in handled:
            return
        self._note("analyse", text)
        plans = self.watch.plan(symptom, len(handled))
        for planned in plans:
            write_whole(self.plans / f"{planned.id}.json", planned.to_json())
        names = ", ".join(planned.name for planned in plans)
        what = f"{_number(len(plans), 'scenario', 'scenarios')} because of {symptom.in_words}: {names}"
        self._note("plan", what if plans else "nothing can be planned", symptom=symptom)

    def _open(self, pattern: str, kind: type[Written]) -> list[Written]:
        settled = self.journal.settled
        return [_read(path, kind) for path in sorted(self.plans.glob(pattern)) if path.stem not in settled]

    def _decided(self, asked: Planned | Change, decision: Decision, what: str) -> bool:
        """Note a decision; return whether it is another one than before."""
        outcome, reasons = decision
        if outcome == self.journal.decided.get(asked.id):
            return False
        text = f"{outcome}: {what} ({'; '.join(reasons)})"
        if outcome == "waits" and isinstance(asked, Change):
            text += f"; approve it with --approve {asked.id}"
        self._note("legitimate", text, plan=asked.id, outcome=outcome)
        return True

    def _run_if_legitimate(self, planned: Planned) -> bool:
        """Decide on a plan, run it where it is accepted; return whether anything was done."""
        decision = self.legitimator.decide(planned, spent=self.journal.spent)
        outcome, reasons = decision
        is_new = self._decided(planned, decision, planned.name)
        if is_new and outcome == "refused":
            self._learn([self._rejected(planned, reasons)], "refused plans")
        if outcome != "accepted":
            return is_new
        try:
            results = self.watch.execute(planned)
        except SimulationError as error:
            self._note("execute", f"{planned.name} could not be run: {error}", plan=planned.id, outcome="failed")
            return True
        # Knowledge before the note: entries are kept once, so a loop that is killed here repeats and adds none twice.
        new = self.learn(self._entries(planned, results))
        for change in self.watch.suite.changes(planned, results):
            write_whole(self.plans / f"{change.id}.json", change.to_json())
        summary = "; ".join(
            f"{result.requirement} {_state(planned, result)}: "
            f"{result.verdict.violations} of {result.verdict.runs} runs violate it"
            for result in results
        )
        self._note(
            "execute",
            f"{planned.name}: {summary}",
            plan=planned.id,
            outcome="run",
            runs=max((len(result.seeds) for result in results), default=0),
            results=tuple((f"{r.case} {r.requirement}", r.state.value) for r in results) if planned.is_case else (),
        )
        self._note("knowledge", f"{_number(new, 'new entry', 'new entries')} of {planned.name}")
        return True

    def _keep_if_legitimate(self, change: Change) -> bool:
        """Decide on a change of the suite, make it where it is accepted; return whether anything was done."""
        decision = self.legitimator.decide_change(change, alike=self.watch.suite.alike(change))
        is_new = self._decided(change, decision, change.in_words)
        if decision[0] == "accepted":
            self.watch.suite.keep(change)
            summary = f"written into the suite: {change.case}, {change.requirement}"
            self._note("knowledge", summary, plan=change.id, outcome="written")
        return is_new

    def _entries(self, planned: Planned, results: Sequence[CaseResult]) -> list[Entry]:
        version = self.watch.subject.version
        place, simulator = self.watch.world.floor_id, self.watch.subject.simulator.name
        lessons = (f"version {version}",) if version else ()
        entries = [entry_of_case(planned.scenario, result, place, simulator) for result in results]
        return [entry.replace(lessons=(*entry.lessons, *lessons)) for entry in entries]

    def _rejected(self, planned: Planned, reasons: tuple[str, ...]) -> Entry:
        mission = planned.scenario.mission
        return Entry(
            kind="rejected",
            world=mission.world,
            place=self.watch.world.floor_id,
            route=mission.route.name,
            requirement=", ".join(planned.requirements),
            description=planned.scenario.description or planned.name,
            scenario=planned.scenario,
            lessons=reasons,
        )

    def _learn(self, entries: Sequence[Entry], of: str) -> None:
        self._note("knowledge", f"{_number(self.learn(entries), 'new entry', 'new entries')} of {of}")

    def _note(self, part: Part, text: str, **more: Any) -> None:
        note = JournalNote(time=self.clock(), cycle=self.journal.cycle + 1, part=part, text=text, **more)
        self.journal.add(note)
        self.tell(note)


def _read(path: Path, kind: type[Written]) -> Written:
    try:
        return kind.from_json(path.read_bytes())
    except ValueError as error:
        raise FileError(path, f"this is no {kind.__name__.lower()} of a watch any more: {error}") from None


def _number(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def _state(planned: Planned, result: CaseResult) -> str:
    """Return what a result says; only a case of the suite can be broken, for nothing was expected of a new scenario."""
    if planned.is_case:
        return result.state.value
    return {State.BROKEN: "violated", State.PASSED: "holds"}.get(result.state, result.state.value)
