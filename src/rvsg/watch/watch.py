"""A watch over a suite: monitor a robot, and test next what its runs suggest."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from rvsg.app.campaign import campaigns_in
from rvsg.app.folder import LEDGER, alone_in, reading
from rvsg.app.proposal import make_generator
from rvsg.app.suites import Suite
from rvsg.app.wiring import let_rehearse
from rvsg.core.documents import read_document
from rvsg.core.errors import InputError, RvsgError
from rvsg.core.plugins import Spec, ignore
from rvsg.generation.generator import Generator
from rvsg.simulation.simulators import Simulator, by_content, stack_in_words
from rvsg.store.knowledge_base import open_knowledge
from rvsg.watch.adaptation import Loop, Monitor
from rvsg.watch.self_adaptation import DeclaredRules, Journal, JournalNote, RuleSet, Watched
from rvsg.watch.suite_watch import LiveSuite, RecordingMonitor, StackUnderTest, SuiteWatch
from rvsg.world.world import World


@dataclass
class CampaignMonitor:
    """Watches campaigns, also running ones: every run of their searches and confirmations, once."""

    folder: Path
    _new: list[str] = field(default_factory=list)

    def new(self, seen: frozenset[str]) -> Iterator[Watched]:
        """Yield the runs that are not among those seen."""
        known = set(seen)  # attempts share runs
        for folder in _campaign_folders(self.folder):
            try:
                campaigns = campaigns_in(folder, optional=True)
            except RvsgError as error:
                self._new.append(f"{folder.name} cannot be read yet: {error}")
                continue
            for campaign in campaigns:
                simulator, route = campaign.record.simulator, campaign.plan.mission.route.name
                version = stack_in_words(by_content(simulator, simulator.options))
                with reading(campaign.source) as ledger:
                    attempts = [a for a in ledger.attempts(campaign.name) if a.purpose in ("search", "confirmation")]
                    for run_id in (m.run_id for attempt in attempts for m in attempt.measurements):
                        if run_id not in known:
                            known.add(run_id)
                            yield Watched(source=run_id, route=route, version=version, run=ledger.run(run_id))

    def troubles(self) -> Sequence[str]:
        """Return what could not be read."""
        found, self._new = self._new, []
        return found


def _campaign_folders(folder: Path) -> list[Path]:
    return [path.parent for path in sorted([*folder.glob(LEDGER), *folder.glob(f"*/{LEDGER}")])]


RULES = "rules.yaml"
APPROVED = "approved.txt"
JOURNAL = "watch.jsonl"
PLANS = "plans"
KNOWLEDGE = "knowledge.sqlite"


def watch(
    suite: Suite | str | Path,
    monitor: Monitor | str | Path | None,
    out: str | Path,
    *,
    cycles: int | None = None,
    seconds: float | None = None,
    every_s: float = 30.0,
    route: str | None = None,
    rules: RuleSet | str | Path | None = None,
    generator: str | Spec | Generator = "heuristic",
    simulator: str | Spec | Simulator = "embedded",
    stack: str | Spec | None = None,
    knowledge: str | Path | None = None,
    seed: int = 0,
    jobs: int = 1,
    on_note: Callable[[JournalNote], None] = ignore,
    on_message: Callable[[str], None] = ignore,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Journal:
    """Run the loop of self-adaptation over a suite until it is done or its time is over.

    Args:
        monitor: a folder of recordings or of campaigns, or a monitor of your own.
        out: the folder of journal, plans and knowledge. A stopped loop resumes in it.
        cycles: how many cycles; without it and without `seconds` the loop runs until it is interrupted.
        seconds: how long; the plan under way is finished.
        every_s: pause after a cycle in which there was nothing to do.
        route: of all recordings; by default the folder of a recording names its route.
        rules: what makes a plan legitimate; by default `rules.yaml` in the suite's folder, else the defaults.
        generator: writes variants of what is near its limit.
        simulator: a name, a Spec, or an instance, which stays open.
        stack: the navigation stack under test. A parameter file of Nav2 is read again when it changes: a new version.
        knowledge: the knowledge base; by default one in `out`.

    Raises:
        InputError: there is nothing to watch, the suite is empty or of several worlds, or another watch works in `out`.
    """
    if monitor is None:
        raise InputError("Nothing to watch. Give --monitor DIR, a folder of recordings or of campaigns.")
    opened = suite if isinstance(suite, Suite) else Suite.open(suite)
    cases = LiveSuite(opened, lambda: subject.version)
    chosen, writer = _rules(opened, rules), make_generator(generator)
    watching = monitor if not isinstance(monitor, str | Path) else _monitor(Path(monitor), cases.world, route)

    def ready(made: Simulator) -> None:
        let_rehearse(writer, made, cases.world, seed=seed)
        made.prepare(on_message)

    subject = StackUnderTest.of(simulator, stack, ready)
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    end = math.inf if seconds is None else clock() + seconds
    done = 0
    with closing(subject), alone_in(folder), open_knowledge(knowledge or folder / KNOWLEDGE) as known:
        world, journal = cases.world, Journal(folder / JOURNAL)
        loop = Loop(
            monitor=watching,
            watch=SuiteWatch(cases, chosen, subject, journal, known.entries, writer, seed=seed, jobs=jobs),
            legitimator=DeclaredRules(chosen, world, lambda: approved(folder)),
            learn=lambda entries: known.add(entries, origin="watch"),
            journal=journal,
            plans=folder / PLANS,
            tell=on_note,
            stop=lambda: clock() >= end,
        )
        while clock() < end and (cycles is None or done < cycles):
            busy = loop.cycle()
            done += 1
            if not busy and clock() < end and done != cycles:
                sleep(max(0.0, min(every_s, end - clock())))
    return loop.journal


def approve(out: str | Path, plan: str, *, on_message: Callable[[str], None] = ignore) -> None:
    """Approve a plan or a change of the suite that waits; the next cycle carries it out.

    Raises:
        InputError: nothing of that id waits.
    """
    folder = Path(out)
    decided = Journal(folder / JOURNAL).decided
    if decided.get(plan) != "waits":
        waiting = ", ".join(sorted(key for key, outcome in decided.items() if outcome == "waits"))
        raise InputError(f"{plan} does not wait for approval. Waiting: {waiting or 'none'}.")
    with (folder / APPROVED).open("a", encoding="utf-8") as file:
        file.write(f"{plan}\n")
    on_message(f"Approved. The next cycle of the watch in {folder} carries it out.")


def approved(folder: Path) -> frozenset[str]:
    """Return the ids of the plans and changes that a person has approved."""
    file = folder / APPROVED
    return frozenset(file.read_text(encoding="utf-8").split()) if file.is_file() else frozenset()


def _rules(suite: Suite, given: RuleSet | str | Path | None) -> RuleSet:
    if isinstance(given, RuleSet):
        return given
    path = Path(given) if given is not None else suite.folder / "rules" / RULES
    return RuleSet() if given is None and not path.is_file() else read_document(path, RuleSet)[0]


def _monitor(folder: Path, world: World, route: str | None) -> Monitor:
    if not folder.is_dir():
        raise InputError(f"{folder}: this is no folder. Give one of recordings or of campaigns.")
    if _campaign_folders(folder):
        return CampaignMonitor(folder)
    if route is not None:
        world.route(route)
    return RecordingMonitor(folder, world, route)
