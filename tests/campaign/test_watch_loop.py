"""The loop over scripted parts: what is done in which order, what is refused, what waits, how it resumes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import pytest

import rvsg
from rvsg.core.errors import FileError, SimulationError
from rvsg.evaluation.verdict import judge
from rvsg.findings.findings import Entry
from rvsg.scenario.scenario import Scenario, Task
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.suites.suite import CaseResult, State
from rvsg.watch.adaptation import Loop
from rvsg.watch.self_adaptation import Change, DeclaredRules, Journal, JournalNote, Planned, RuleSet, Symptom, Watched

LIMIT = rvsg.Requirement(name="R1", title="x", text="x", metric="min_distance", worse="smaller", limit=0.5)


@pytest.fixture(scope="module")
def crossing() -> Scenario:
    return rvsg.scenario(rvsg.load_world("warehouse"), "route_1", [rvsg.walk("Anna", "E15", "H15")], description="x")


def violated(version: str) -> Symptom:
    return Symptom(kind="violated", route="route_1", requirement="R1", version=version)


class Scripted:
    """Every part at once: runs to see, a sign for each, a plan for each sign, results; notes what it is asked."""

    simulator, version = KinematicSimulator(), ""

    def __init__(self, scenario: Scenario, sources: Iterable[str] = ("a", "b")) -> None:
        self.scenario, self.sources, self.world = scenario, list(sources), rvsg.load_world("warehouse")
        self.suite = self.subject = self
        self.asked: list[str] = []
        self.kept: dict[str, Entry] = {}
        self.fails = False
        self.called_for: list[Change] = []
        self.written: list[str] = []
        self.run = rvsg.simulate(scenario, 1, simulator="kinematic")[0]

    def new(self, seen: frozenset[str]) -> list[Watched]:
        new = [source for source in self.sources if source not in seen]
        return [Watched(source=each, route="route_1", version="", run=self.run) for each in new]

    def renew(self) -> Sequence[str]:
        return ()

    def troubles(self) -> Sequence[str]:
        return ()

    def analyse(self, watched: Sequence[Watched]) -> list[tuple[Symptom, str]]:
        return [(violated(each.source), each.source) for each in watched]

    def entries(self, watched: Sequence[Watched]) -> list[Entry]:
        return []

    def plan(self, symptom: Symptom, index: int) -> list[Planned]:
        name = f"plan {symptom.version}"
        return [Planned(why=symptom, name=name, scenario=self.scenario, requirements=("R1",), runs=4)]

    def execute(self, planned: Planned) -> list[CaseResult]:
        self.asked.append(planned.name)
        if self.fails:
            raise SimulationError("no simulator")
        how = {"requirement": "R1", "expected": "pass", "state": State.BROKEN, "seeds": (0, 1, 2, 3)}
        how |= {"verdict": judge(LIMIT, [0.0, 1.0, 0.0, 1.0]), "violations": (True, False, True, False)}
        return [CaseResult(case="planned", title=planned.name, **how)]

    def changes(self, planned: Planned, results: Sequence[CaseResult]) -> list[Change]:
        return self.called_for

    def alike(self, change: Change) -> int:
        return len(self.written)

    def keep(self, change: Change) -> None:
        self.written.append(change.case)

    def learn(self, entries: Iterable[Entry]) -> int:
        before = len(self.kept)
        self.kept |= {entry.id: entry for entry in entries}
        return len(self.kept) - before


def loop(folder: Path, parts: Scripted, rules: RuleSet | None = None, **how: object) -> Loop:
    world = rvsg.load_world("warehouse")
    approved = folder / "approved.txt"

    def read() -> frozenset[str]:
        return frozenset(approved.read_text().split()) if approved.exists() else frozenset()

    given = {
        "monitor": parts,
        "watch": parts,
        "legitimator": DeclaredRules(rules or RuleSet(), world, read),
        "learn": parts.learn,
        "journal": Journal(folder / "watch.jsonl"),
        "plans": folder / "plans",
        "clock": lambda: "2026-01-01T00:00:00+00:00",
    }
    return Loop(**{**given, **how})  # type: ignore[arg-type]


def test_a_cycle_does_each_part_in_turn_and_the_next_has_nothing_to_do(tmp_path: Path, crossing: Scenario) -> None:
    parts = Scripted(crossing)
    made = loop(tmp_path, parts)
    assert made.cycle() is True
    assert made.cycle() is False
    assert sorted(parts.asked) == ["plan a", "plan b"]
    order = list(dict.fromkeys(note.part for note in made.journal.notes))
    assert order == ["monitor", "knowledge", "analyse", "plan", "legitimate", "execute", "loop"]
    assert (made.journal.spent, made.journal.cycle) == (8, 1)
    (entry,) = parts.kept.values()  # the same scenario and verdict, known once
    assert entry.verdict is not None and entry.requirement == "R1"
    words = (tmp_path / "watch.log").read_text().splitlines()
    assert len(words) == len(made.journal.notes)
    notes = [json.loads(line) for line in (tmp_path / "watch.jsonl").read_text().splitlines()]
    assert notes[-1]["seen"] == ["a", "b"] and notes[-1]["outcome"] == "complete"


def test_the_same_symptom_is_acted_on_once(tmp_path: Path, crossing: Scenario) -> None:
    parts = Scripted(crossing, ["a"])
    loop(tmp_path, parts).cycle()
    parts.analyse = lambda watched: [(violated("a"), "c")]  # type: ignore[method-assign]
    parts.sources.append("c")
    loop(tmp_path, parts).cycle()
    assert parts.asked == ["plan a"]


def test_a_loop_that_is_stopped_goes_on_and_runs_no_plan_twice(tmp_path: Path, crossing: Scenario) -> None:
    parts = Scripted(crossing, ["a", "b", "c"])
    stopped = loop(tmp_path, parts, stop=lambda: bool(parts.asked))
    stopped.cycle()
    assert len(parts.asked) == 1 and stopped.journal.cycle == 0
    loop(tmp_path, parts).cycle()
    assert sorted(parts.asked) == ["plan a", "plan b", "plan c"]
    whole = tmp_path / "whole"
    other = Scripted(crossing, ["a", "b", "c"])
    loop(whole, other).cycle()
    assert other.kept == parts.kept


def test_a_note_that_was_cut_by_a_kill_is_dropped_and_a_damaged_one_is_told(tmp_path: Path, crossing: Scenario) -> None:
    parts = Scripted(crossing, ["a"])
    loop(tmp_path, parts).cycle()
    path = tmp_path / "watch.jsonl"
    count = len(path.read_text().splitlines())
    with path.open("a") as file:
        file.write('{"time": "2026')
    assert len(Journal(path).notes) == count
    path.write_text(path.read_text().replace('"cycle"', '"cicle"', 1))
    with pytest.raises(FileError) as raised:
        Journal(path)
    assert raised.value.line == 1


def test_a_plan_that_cannot_be_run_is_settled_with_the_reason(tmp_path: Path, crossing: Scenario) -> None:
    parts = Scripted(crossing, ["a"])
    parts.fails = True
    made = loop(tmp_path, parts)
    assert (made.cycle(), made.cycle(), parts.asked) == (True, False, ["plan a"])
    assert [note.outcome for note in made.journal.notes if note.part == "execute"] == ["failed"]


@pytest.mark.parametrize(
    ("change", "rules", "rule"),
    [
        ({}, {"speed_m_s": (0.3, 1.0)}, "plausibility"),
        ({"behaviour": "threatening"}, {}, "safety"),
        ({}, {"start_gap_m": 50.0}, "safety"),
        ({}, {"max_people": 0}, "plausibility"),
        ({}, {"max_runs": 3}, "budget"),
        ({}, {"max_runs_per_plan": 3}, "budget"),
        ({"tasks": (Task(name="x", path=("E15", "H12")),)}, {}, "validity"),
    ],
)
def test_a_plan_that_breaks_a_rule_is_refused_with_the_rule_on_record(
    change: dict[str, object], rules: dict[str, object], rule: str, tmp_path: Path, crossing: Scenario
) -> None:
    human = crossing.people.humans[0].replace(**change)
    parts = Scripted(crossing, ["a"])
    parts.scenario = crossing.replace(people=crossing.people.replace(humans=(human,)))
    made = loop(tmp_path, parts, RuleSet(**rules))  # type: ignore[arg-type]
    made.cycle()
    assert parts.asked == []
    (entry,) = parts.kept.values()
    assert entry.kind == "rejected" and {lesson.split(":")[0] for lesson in entry.lessons} == {rule}
    assert [note.outcome for note in made.journal.notes if note.part == "legitimate"] == ["refused"]


def test_the_rules_for_new_people_do_not_refuse_a_case_of_the_suite(tmp_path: Path, crossing: Scenario) -> None:
    rules = DeclaredRules(RuleSet(start_gap_m=50.0), rvsg.load_world("warehouse"), frozenset)
    (plan,) = Scripted(crossing).plan(violated("a"), 0)
    assert rules.decide(plan, spent=0)[0] == "refused"
    assert rules.decide(plan.replace(is_case=True), spent=0) == ("accepted", ("all rules hold",))


def test_a_plan_waits_for_a_person_and_is_asked_once(tmp_path: Path, crossing: Scenario) -> None:
    parts = Scripted(crossing, ["a"])
    made = loop(tmp_path, parts, RuleSet(approval="new"))
    made.cycle()
    made.cycle()
    waiting = [note for note in made.journal.notes if note.outcome == "waits"]
    assert len(waiting) == 1 and parts.asked == []
    (tmp_path / "approved.txt").write_text(f"{waiting[0].plan}\n")
    loop(tmp_path, parts, RuleSet(approval="new")).cycle()
    assert parts.asked == ["plan a"]


def new_case(scenario: Scenario) -> Change:
    how = {"expected": "violation", "reason": "2 of 4 runs violate it", "is_new": True}
    return Change(case="new", title="new", scenario=scenario, requirement="R1", **how)


def test_a_change_of_the_suite_waits_for_a_person_and_is_written_once(tmp_path: Path, crossing: Scenario) -> None:
    parts = Scripted(crossing, sources=["a"])
    parts.called_for = [asked := new_case(crossing)]
    assert loop(tmp_path, parts).cycle() is True
    assert parts.written == []
    assert loop(tmp_path, parts).cycle() is False  # it still waits, and that is said once
    waits = [note for note in Journal(tmp_path / "watch.jsonl").notes if note.outcome == "waits"]
    assert [note.plan for note in waits] == [asked.id] and asked.id in waits[0].text
    (tmp_path / "approved.txt").write_text(f"{asked.id}\n")
    assert loop(tmp_path, parts).cycle() is True
    assert parts.written == ["new"]
    assert loop(tmp_path, parts).cycle() is False


@pytest.mark.parametrize(
    ("rules", "written"),
    [(RuleSet(write_back="always"), ["new"]), (RuleSet(write_back="never"), []), (RuleSet(max_failures=0), [])],
)
def test_the_rules_say_what_is_written_back(
    tmp_path: Path, crossing: Scenario, rules: RuleSet, written: list[str]
) -> None:
    parts = Scripted(crossing, sources=["a"])
    parts.called_for = [new_case(crossing)]
    made = loop(tmp_path, parts, rules)
    made.cycle()
    assert parts.written == written
    assert ("refused" in {note.outcome for note in made.journal.notes}) is (not written)


def test_what_cannot_be_read_anew_is_in_the_log(tmp_path: Path, crossing: Scenario) -> None:
    parts = Scripted(crossing, sources=[])
    parts.renew = lambda: ["the stack is left as it was"]  # type: ignore[method-assign]
    made = loop(tmp_path, parts)
    assert made.cycle() is False
    assert [(note.part, note.text) for note in made.journal.notes] == [("monitor", "the stack is left as it was")]


def test_the_log_sums_up_what_the_cases_say_of_a_new_version(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "watch.jsonl")

    def note(**what: object) -> None:
        journal.add(JournalNote(time="2026-01-01T00:00:00+00:00", cycle=1, part="execute", text="x", **what))  # type: ignore[arg-type]

    note(results=(("old R1", "broken"),))
    note(symptom=Symptom(kind="new version", version="B", change=1))
    assert journal.version_in_words() == ""
    note(results=(("aisle R1", "broken"), ("aisle R2", "passed")))
    note(results=(("door R1", "passed"),))
    told = Journal(journal.path).version_in_words()
    assert "B" in told and "1 broken (aisle R1)" in told and "2 passed" in told and "old" not in told
    note(outcome="version")
    assert journal.version_in_words() == ""
