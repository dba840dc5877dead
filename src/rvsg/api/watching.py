"""Watch a robot, and let what is seen decide what is tested next."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from rvsg.api.folder import alone_in
from rvsg.api.knowledge import open_knowledge
from rvsg.api.proposing import make_generator
from rvsg.api.simulating import ignore
from rvsg.api.suites import Suite
from rvsg.api.watch_parts import (
    CampaignMonitor,
    RecordingMonitor,
    SimulationExecutor,
    SuiteAnalyser,
    SuitePlanner,
    is_campaign,
)
from rvsg.api.watch_subject import LiveSuite, Subject
from rvsg.api.wiring import let_rehearse
from rvsg.campaign.watch.journal import Journal, Note, in_words
from rvsg.campaign.watch.legitimate import DeclaredRules
from rvsg.campaign.watch.loop import Loop
from rvsg.campaign.watch.parts import Monitor, RuleSet
from rvsg.core.documents import read_document
from rvsg.core.errors import InputError
from rvsg.core.plugins import Spec
from rvsg.generation.generator import Generator
from rvsg.simulation.protocol import Simulator
from rvsg.store.knowledge import KnowledgeBase
from rvsg.world.world import World

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
    on_note: Callable[[Note], None] = ignore,
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
        raise InputError("What is to be watched? Give --monitor DIR, a folder of recordings or of campaigns.")
    opened = suite if isinstance(suite, Suite) else Suite.open(suite)
    cases = LiveSuite(opened, lambda: subject.version)
    chosen, writer = _rules(opened, rules), make_generator(generator)
    watching = monitor if not isinstance(monitor, str | Path) else _monitor(Path(monitor), cases.world, route)

    def ready(made: Simulator) -> None:
        let_rehearse(writer, made, cases.world, seed=seed)
        made.prepare(on_message)

    subject = Subject.of(simulator, stack, ready)
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    time_left = _time_left(seconds, clock)
    with closing(subject), alone_in(folder), open_knowledge(knowledge or folder / KNOWLEDGE) as known:
        parts = _Parts(cases, subject, watching, writer, chosen, known, folder)
        loop = parts.loop(jobs=jobs, seed=seed, on_note=on_note, stop=lambda: time_left() <= 0)
        _repeat(loop.cycle, cycles, time_left, lambda: sleep(max(0.0, min(every_s, time_left()))))
    return loop.journal


def _time_left(seconds: float | None, clock: Callable[[], float]) -> Callable[[], float]:
    """Return a function that returns the seconds that are left, infinite without an end."""
    end = math.inf if seconds is None else clock() + seconds
    return lambda: math.inf if end == math.inf else end - clock()


def _repeat(
    cycle: Callable[[], bool], most: int | None, time_left: Callable[[], float], pause: Callable[[], None]
) -> None:
    """Run cycles to the last one or to the end of the time, with a pause after each that found nothing to do."""
    done = 0
    while time_left() > 0 and (most is None or done < most):
        busy = cycle()
        done += 1
        if not busy and time_left() > 0 and done != most:
            pause()


@dataclass(frozen=True)
class _Parts:
    """What a loop over a suite is made of."""

    cases: LiveSuite
    subject: Subject
    monitor: Monitor
    writer: Generator
    rules: RuleSet
    known: KnowledgeBase
    folder: Path

    def loop(self, *, jobs: int, seed: int, on_note: Callable[[Note], None], stop: Callable[[], bool]) -> Loop:
        """Return the loop that monitors, analyses, plans, asks and executes."""
        cases, subject, rules, world = self.cases, self.subject, self.rules, self.cases.world
        journal = Journal(self.folder / JOURNAL)
        return Loop(
            monitor=self.monitor,
            analyser=SuiteAnalyser(
                cases,
                world,
                rules.near,
                lambda: _versions(journal),
                lambda: subject.version,
                lambda: self.known.entries(world=world.name),
            ),
            planner=SuitePlanner(cases, world, rules, self.writer, self.known, seed),
            legitimator=DeclaredRules(rules, world, lambda: approved(self.folder)),
            executor=SimulationExecutor(cases, world, subject, jobs),
            knowledge=self.known,
            keeper=cases,
            journal=journal,
            plans=self.folder / PLANS,
            place=world.floor_id,
            simulator=subject.simulator.name,
            renew=lambda: [*cases.renew(), *subject.renew()],
            version=lambda: subject.version,
            tell=on_note,
            stop=stop,
        )


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


def note_in_words(note: Note) -> str:
    """Return a note as a line of the log."""
    return in_words(note)


def _rules(suite: Suite, given: RuleSet | str | Path | None) -> RuleSet:
    if isinstance(given, RuleSet):
        return given
    path = Path(given) if given is not None else suite.folder / "rules" / RULES
    return RuleSet() if given is None and not path.is_file() else read_document(path, RuleSet)[0]


def _monitor(folder: Path, world: World, route: str | None) -> Monitor:
    if not folder.is_dir():
        raise InputError(f"{folder}: this is no folder. Give one of recordings or of campaigns.")
    if is_campaign(folder):
        return CampaignMonitor(folder)
    if route is not None:
        world.route(route)
    return RecordingMonitor(folder, world, route)


def _versions(journal: Journal) -> list[str]:
    """Return the versions that were acted on, in their order."""
    return [n.symptom.version for n in journal.notes if n.symptom is not None and n.symptom.kind == "new version"]
