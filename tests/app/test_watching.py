"""The loop as shipped: recordings and campaigns are watched, and scenarios follow from what they show."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from tests.app.parts import crossing, suite_of
from tests.cli.commands import Terminal

import rvsg
from rvsg.core.errors import InputError
from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.simulation.embedded.simulator import EmbeddedSimulator
from rvsg.store.knowledge_base import KnowledgeBase
from rvsg.watch.self_adaptation import Journal, JournalNote, RuleSet
from rvsg.watch.suite_watch import LiveSuite, RecordingMonitor, StackUnderTest, SuiteWatch
from rvsg.watch.watch import approve, watch
from rvsg_exchange.formats import export

FAST = "kinematic"
ONCE: dict[str, Any] = {"simulator": FAST, "every_s": 0.0, "cycles": 1}
pytest.importorskip("rosbags")


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> rvsg.Suite:
    return suite_of(tmp_path_factory.mktemp("suite") / "suite", name="crossing")


@pytest.fixture(scope="module")
def _field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "field"
    (folder / "route_1").mkdir(parents=True)
    seen = crossing(ends=("B12", "E12"), speed_m_s=1.0)
    export(rvsg.simulate(seen, 1, simulator=FAST), folder / "route_1" / "drive.mcap", "mcap")
    return folder


@pytest.fixture
def field(_field: Path, tmp_path: Path) -> Path:
    """A folder with one recording of route_1, in which somebody walks elsewhere than in the suite."""
    return Path(shutil.copytree(_field, tmp_path / "field"))


def kinds(journal: Journal) -> list[str]:
    return [note.symptom.kind for note in journal.notes if note.symptom is not None]


def test_places_never_tested_become_a_scenario_that_is_run_and_known(
    suite: rvsg.Suite, field: Path, tmp_path: Path
) -> None:
    journal = watch(suite, field, tmp_path / "w", cycles=2, simulator=FAST, every_s=0.0, rules=RuleSet(near=0.0))
    assert kinds(journal) == ["never tested"]
    assert journal.cycle == 1 and journal.spent == 15
    with KnowledgeBase(str(tmp_path / "w" / "knowledge.sqlite")) as known:
        assert len(known.entries(kind="watched")) == 1
        (found,) = known.entries(kind="finding")
    assert found.scenario is not None and set(found.waypoints) & {"B12", "C12", "D12"}
    again = watch(suite, field, tmp_path / "w", **ONCE)
    assert again.spent == 15


def test_a_new_version_runs_the_suite_again_and_a_recording_still_written_is_tried_again(
    suite: rvsg.Suite, field: Path, tmp_path: Path
) -> None:
    (field / "version.txt").write_text("nav 2\n")
    whole = (field / "route_1" / "drive.mcap").read_bytes()
    (field / "route_1" / "drive.mcap").write_bytes(whole[: len(whole) // 2])
    first = watch(suite, field, tmp_path / "w", rules=RuleSet(near=0.0), **ONCE)
    assert [note.part for note in first.notes] == ["monitor"] and not first.seen
    (field / "route_1" / "drive.mcap").write_bytes(whole)
    second = watch(suite, field, tmp_path / "w", rules=RuleSet(near=0.0), **ONCE)
    assert kinds(second)[0] == "new version" and second.seen == {"route_1/drive.mcap"}
    assert any(note.text.startswith("case crossing") for note in second.notes if note.part == "execute")


def test_a_requirement_near_its_limit_becomes_a_variant_of_the_generator(
    suite: rvsg.Suite, field: Path, tmp_path: Path
) -> None:
    how = ONCE | {"generator": "random", "seed": 4, "rules": RuleSet(near=5.0, approval="new")}
    journal = watch(suite, field, tmp_path / "w", **how)
    assert "near its limit" in kinds(journal)
    waiting = {note.plan for note in journal.notes if note.outcome == "waits" and note.plan}
    assert waiting and journal.spent == 0
    plan = sorted(waiting)[0]
    approve(tmp_path / "w", plan)
    with pytest.raises(InputError):
        approve(tmp_path / "w", "planned-0000000000000000")
    again = watch(suite, field, tmp_path / "w", **how)
    assert {note.plan for note in again.notes if note.part == "execute"} == {plan}


def test_a_campaign_is_watched(suite: rvsg.Suite, tmp_path: Path) -> None:
    settings = {"simulator": FAST, "scenarios": 1, "refinements": 0, "repeats": 2, "confirmations": 0}
    campaign = rvsg.Campaign.create(tmp_path / "c", generator="random", route="route_1", **settings)
    list(campaign.run(jobs=1))
    twice = tmp_path / "both"  # two campaigns of the same runs
    for name in "ab":
        shutil.copytree(tmp_path / "c", twice / name)
    journal = watch(suite, twice, tmp_path / "w", rules=RuleSet(near=0.0), **ONCE)
    assert journal.seen == {run.id for run in campaign.runs()}
    assert "2 new runs" in next(note.text for note in journal.notes if note.part == "monitor")
    assert next(note.symptom.version for note in journal.notes if note.symptom is not None) == FAST


def test_time_is_bounded(suite: rvsg.Suite, field: Path, tmp_path: Path) -> None:
    now = [0.0]

    def sleep(seconds: float) -> None:
        now[0] += seconds

    how: dict[str, Any] = {"clock": lambda: now[0], "sleep": sleep, "simulator": FAST, "rules": RuleSet(max_runs=0)}
    journal = watch(suite, field, tmp_path / "w", seconds=95.0, every_s=30.0, **how)
    assert now[0] == 95.0 and journal.spent == 0


def test_the_verb(terminal: Terminal, suite: rvsg.Suite, field: Path) -> None:
    watched = ["watch", str(suite.folder)]
    given = [*watched, "--monitor", str(field), "--out", "w", "--simulator", FAST]
    terminal(given, "--cycles 1")
    assert Path("w/watch.log").read_text().count("\n") == len(Journal(Path("w/watch.jsonl")).notes)
    Path("empty").mkdir()
    assert "empty holds no campaign" in terminal([*watched, "--monitor", "empty", "--out", "e"], "--cycles 1")
    terminal(watched, code=2)
    terminal(given, "--for soon", code=2)
    terminal(given, "--rules none.yaml", code=2)
    terminal(watched, "--monitor nowhere", code=2)
    terminal(watched, "--out w --approve planned-1", code=2)


PARAMETERS = """controller_server:
  ros__parameters:
    controller_plugins: ["FollowPath"]
    FollowPath: {{plugin: "dwb_core::DWBLocalPlanner"{more}}}
"""


def test_a_parameter_file_that_changes_is_a_new_version_and_a_broken_one_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed: list[object] = []
    monkeypatch.setattr(EmbeddedSimulator, "close", lambda simulator: closed.append(simulator))
    file = tmp_path / "nav2_params.yaml"
    file.write_text(PARAMETERS.format(more=""))
    made: list[object] = []
    subject = StackUnderTest.of("embedded", str(file), made.append)
    first = subject.version
    assert first.startswith("nav2_params.yaml ") and len(made) == 1
    assert subject.renew() == [] and len(made) == 1
    file.write_text(PARAMETERS.format(more="") + "# a comment\n")
    assert subject.renew() == [] and subject.version == first
    file.write_text(PARAMETERS.format(more=", max_vel_x: 0.3"))
    assert subject.renew() == [] and subject.version != first
    driven = subject.simulator
    assert driven is made[-1]
    assert closed == made[:-1]
    second = subject.version
    file.write_text("controller_server: [")
    (told,) = subject.renew()
    assert "nav2_params.yaml" in told and subject.simulator is driven and subject.version == second
    assert subject.renew() == []
    file.write_text(PARAMETERS.format(more=""))
    assert subject.renew() == [] and subject.version == first


def test_a_changed_stack_runs_the_cases_again_and_the_way_back_too(suite: rvsg.Suite, tmp_path: Path) -> None:
    (tmp_path / "field").mkdir()
    subject, journal = StackUnderTest(EmbeddedSimulator()), Journal(tmp_path / "watch.jsonl")
    analyser = SuiteWatch(LiveSuite(suite), RuleSet(), subject, journal, lambda **_: (), HeuristicGenerator())
    symptoms = []
    for now in ("A", "A", "B", "A"):
        subject.version = now
        for symptom, _ in analyser.analyse([]):
            symptoms.append(symptom)
            journal.add(JournalNote(time="", cycle=1, part="plan", text="", symptom=symptom))
    assert [each.version for each in symptoms] == ["A", "B", "A"]
    assert len({each.id for each in symptoms}) == 3


@pytest.mark.exhaustive
def test_failures_are_written_into_the_suite_which_is_read_again_when_it_changes(
    suite: rvsg.Suite, field: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "suite"
    shutil.copytree(suite.folder, folder)
    (folder / "rules").mkdir()
    (folder / "rules" / "rules.yaml").write_text("write_back: always\nnear: 0.0\n")
    (folder / "rules" / "strict.yaml").write_text(
        "strict:\n  title: Fast\n  text: Fast.\n  metric: trg\n  worse: larger\n  limit: 1.0\n  unit: s\n"
    )
    live = LiveSuite(rvsg.Suite.open(folder))
    rvsg.Suite.open(folder).add(live.cases[0].scenario, "rules/strict.yaml#strict", expected="pass")
    assert live.renew() == [] and len(live.cases[0].expectations) == 2
    journal = watch(folder, field, tmp_path / "w", **ONCE)
    written = [note.text for note in journal.notes if note.outcome == "written"]
    new = [case for case in rvsg.Suite.open(folder).cases if case.name != "crossing"]
    assert written and len(new) == len(written)
    for case in new:
        (expectation,) = case.expectations
        assert (expectation.requirement, expectation.expected) == ("rules/strict.yaml#strict", "violation")
        assert "runs violate it" in expectation.reason
        assert any(case.name in text for text in written)
    (folder / f"{new[0].name}.yaml").write_text("nonsense: 1\n")
    (told,) = live.renew()
    assert new[0].name in told and len(live.cases) == 1 and live.renew() == []


@pytest.mark.slow
def test_a_case_that_is_fixed_is_expected_to_hold(suite: rvsg.Suite, field: Path, tmp_path: Path) -> None:
    folder = tmp_path / "suite"
    shutil.copytree(suite.folder, folder)
    made = rvsg.Suite.open(folder)
    made.add(made.cases[0].scenario, "R3", expected="violation", reason="slow")
    (field / "version.txt").write_text("nav 2\n")
    journal = watch(folder, field, tmp_path / "w", rules=RuleSet(near=0.0), **ONCE)
    (waiting,) = {note.plan for note in journal.notes if note.outcome == "waits"}
    assert waiting is not None
    approve(tmp_path / "w", waiting)
    watch(folder, field, tmp_path / "w", rules=RuleSet(near=0.0), **ONCE)
    (case,) = rvsg.Suite.open(folder).cases
    assert [(e.requirement, e.expected) for e in case.expectations] == [("R3", "pass")]


def test_a_recording_that_is_still_written_under_a_hidden_name_is_left_alone(
    suite: rvsg.Suite, field: Path, tmp_path: Path
) -> None:
    draft = field / "route_1" / ".draft" / "bag"
    draft.mkdir(parents=True)
    (draft / "bag.mcap").write_bytes(b"")
    (draft / "metadata.yaml").write_text("")
    monitor = RecordingMonitor(field, LiveSuite(suite).world)
    assert [each.source for each in monitor.new(frozenset())] == ["route_1/drive.mcap"]
    assert monitor.troubles() == []
