"""The loop as shipped: recordings and campaigns are watched, and scenarios follow from what they show."""

from __future__ import annotations

from pathlib import Path

import pytest

import rvsg
from rvsg.api.exchange import export
from rvsg.api.watching import approve, watch
from rvsg.campaign.watch.journal import Journal
from rvsg.campaign.watch.parts import RuleSet
from rvsg.cli import main
from rvsg.core.errors import InputError
from rvsg.store.knowledge import KnowledgeBase

FAST = "kinematic"
pytest.importorskip("rosbags")


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> rvsg.Suite:
    world = rvsg.load_world("warehouse")
    made = rvsg.Suite.create(tmp_path_factory.mktemp("suite") / "suite")
    crossing = rvsg.scenario(world, "route_1", [rvsg.walk("Anna", "E15", "H15")])
    return made.add(crossing, "R3", name="crossing", expected="pass")


@pytest.fixture
def field(tmp_path: Path) -> Path:
    """A folder with one recording of route_1, in which somebody walks elsewhere than in the suite."""
    folder = tmp_path / "field"
    (folder / "route_1").mkdir(parents=True)
    world = rvsg.load_world("warehouse")
    seen = rvsg.scenario(world, "route_1", [rvsg.walk("Ben", "B12", "E12", speed_m_s=1.0)])
    export(rvsg.simulate(seen, 1, simulator=FAST), folder / "route_1" / "drive.mcap", "mcap")
    return folder


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
    again = watch(suite, field, tmp_path / "w", cycles=1, simulator=FAST, every_s=0.0)
    assert again.spent == 15


def test_a_new_version_runs_the_suite_again_and_a_recording_still_written_is_tried_again(
    suite: rvsg.Suite, field: Path, tmp_path: Path
) -> None:
    (field / "version.txt").write_text("nav 2\n")
    whole = (field / "route_1" / "drive.mcap").read_bytes()
    (field / "route_1" / "drive.mcap").write_bytes(whole[: len(whole) // 2])
    how = {"simulator": FAST, "every_s": 0.0, "rules": RuleSet(near=0.0), "cycles": 1}
    first = watch(suite, field, tmp_path / "w", **how)  # type: ignore[arg-type]
    assert [note.part for note in first.notes] == ["monitor"] and not first.seen
    (field / "route_1" / "drive.mcap").write_bytes(whole)
    second = watch(suite, field, tmp_path / "w", **how)  # type: ignore[arg-type]
    assert kinds(second)[0] == "new version" and second.seen == {"route_1/drive.mcap"}
    assert any(note.text.startswith("case crossing") for note in second.notes if note.part == "execute")


def test_a_requirement_near_its_limit_becomes_a_variant_of_the_generator(
    suite: rvsg.Suite, field: Path, tmp_path: Path
) -> None:
    how = {"simulator": FAST, "every_s": 0.0, "cycles": 1, "generator": "random", "seed": 4}
    journal = watch(suite, field, tmp_path / "w", rules=RuleSet(near=5.0, approval="new"), **how)  # type: ignore[arg-type]
    assert "near its limit" in kinds(journal)
    waiting = {note.plan for note in journal.notes if note.outcome == "waits" and note.plan}
    assert waiting and journal.spent == 0
    plan = sorted(waiting)[0]
    approve(tmp_path / "w", plan)
    with pytest.raises(InputError):
        approve(tmp_path / "w", "planned-0000000000000000")
    again = watch(suite, field, tmp_path / "w", rules=RuleSet(near=5.0, approval="new"), **how)  # type: ignore[arg-type]
    assert {note.plan for note in again.notes if note.part == "execute"} == {plan}


def test_a_campaign_is_watched(suite: rvsg.Suite, tmp_path: Path) -> None:
    settings = {"simulator": FAST, "scenarios": 1, "refinements": 0, "repeats": 2, "confirmations": 0}
    campaign = rvsg.Campaign.create(tmp_path / "c", generator="random", route="route_1", **settings)
    list(campaign.run(jobs=1))
    journal = watch(suite, tmp_path / "c", tmp_path / "w", cycles=1, simulator=FAST, rules=RuleSet(near=0.0))
    assert journal.seen == {run.id for run in campaign.runs()}


def test_time_is_bounded(suite: rvsg.Suite, field: Path, tmp_path: Path) -> None:
    now = [0.0]

    def sleep(seconds: float) -> None:
        now[0] += seconds

    how = {"clock": lambda: now[0], "sleep": sleep, "simulator": FAST, "rules": RuleSet(max_runs=0)}
    journal = watch(suite, field, tmp_path / "w", seconds=95.0, every_s=30.0, **how)  # type: ignore[arg-type]
    assert now[0] == 95.0 and journal.spent == 0


def test_the_verb(suite: rvsg.Suite, field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "w"
    given = ["watch", str(suite.folder), "--monitor", str(field), "--out", str(out), "--simulator", FAST]
    assert main([*given, "--cycles", "1"]) == 0
    assert (out / "watch.log").read_text().count("\n") == len(Journal(out / "watch.jsonl").notes)
    for wrong in (
        ["watch", str(suite.folder)],
        [*given, "--for", "soon"],
        [*given, "--rules", str(tmp_path / "none.yaml")],
        ["watch", str(suite.folder), "--monitor", str(tmp_path / "nowhere")],
        ["watch", str(suite.folder), "--out", str(out), "--approve", "planned-1"],
    ):
        assert main(wrong) == 2
    assert "Traceback" not in capsys.readouterr().err
