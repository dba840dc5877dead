"""The stages by hand give what the campaign gives."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest
from tests.cli.commands import printed, rvsg

from rvsg.app.folder import LEDGER
from rvsg.cli import main
from rvsg.core.errors import FileError, RvsgError
from rvsg.scenario.brief import Feedback
from rvsg.simulation.archive import read_runs
from rvsg.store.sqlite import SqliteLedger
from rvsg.testing import same_run

KINEMATIC = ["--simulator", "kinematic"]


@pytest.fixture
def proposal(tmp_path: Path) -> Path:
    path = tmp_path / "proposal.json"
    rvsg("scenario propose --generator random --seed 5 --out", path)
    written = json.loads(path.read_text())
    assert written["first_findings"] == [] and written["scenario"]["mission"]["route"]["name"] == "route_1"
    return path


@pytest.mark.slow
def test_repeats_have_the_next_seeds_and_do_not_depend_on_the_jobs(proposal: Path, tmp_path: Path) -> None:
    asked = ["simulate", str(proposal), *KINEMATIC, "--seed", "9", "--repeats", "3"]
    main([*asked, "--out", str(tmp_path / "one.jsonl")])
    main([*asked, "--jobs", "2", "--out", str(tmp_path / "two.jsonl")])
    assert (tmp_path / "one.jsonl").read_bytes() == (tmp_path / "two.jsonl").read_bytes()
    assert [run.seed for run in read_runs([tmp_path / "one.jsonl"])] == [9, 10, 11]


def test_evaluate_judges_all_runs_of_a_scenario_and_refuses_two_scenarios(
    proposal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs, other = tmp_path / "a.jsonl", tmp_path / "b.jsonl"
    main(["simulate", str(proposal), *KINEMATIC, "--repeats", "16", "--out", str(runs)])
    main(["scenario", "propose", "--generator", "random", "--seed", "6", "--out", str(tmp_path / "other.json")])
    main(["simulate", str(tmp_path / "other.json"), *KINEMATIC, "--out", str(other)])
    capsys.readouterr()
    assert main(["evaluate", str(runs), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["verdict"]["runs"] == 16 == len(told["measurements"])
    assert told["verdict"]["status"] in ("PASS", "FAIL", "FLAKY", "INCONCLUSIVE")
    assert (told["next_repeats"] > 0) == (told["verdict"]["status"] == "INCONCLUSIVE")
    assert main(["evaluate", str(runs), str(other)]) == 2


def test_a_refinement_by_hand_is_told_what_was_measured(
    proposal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs, feedback, refined = tmp_path / "r.jsonl", tmp_path / "f.json", tmp_path / "refined.json"
    main(["simulate", str(proposal), *KINEMATIC, "--repeats", "4", "--out", str(runs)])
    assert main(["evaluate", str(runs), "--feedback", str(feedback)]) == 2  # which scenario?
    assert not feedback.exists()
    assert main(["evaluate", str(runs), "--scenario", str(proposal), "--feedback", str(feedback)]) == 0
    told = Feedback.from_json(feedback.read_text())
    assert len(told.objectives) == 4 and told.moments and told.series
    asked = ["scenario", "propose", "--generator", "heuristic", "--generator-option", "tries=3"]
    assert main([*asked, "--feedback", str(feedback), "--out", str(refined)]) == 0
    before = json.loads(proposal.read_text())["scenario"]
    after = json.loads(refined.read_text())["scenario"]
    assert after["people"] != before["people"]
    assert before["description"] == ""  # so the refinement tells of everybody
    assert all(name in after["description"] for name in ("Human 1", "Human 2"))


def test_stages_stand_in_a_pipe(
    proposal: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(proposal.read_text()))
    assert main(["simulate", "-", *KINEMATIC]) == 0
    monkeypatch.setattr(sys, "stdin", io.StringIO(capsys.readouterr().out))
    assert main(["evaluate", "-", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"]["runs"] == 1


def test_a_run_is_made_again_from_its_seed_and_a_report_from_the_ledger(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, again = tmp_path / "campaign", tmp_path / "again.jsonl"
    small = "--strategy random --scenarios 1 --refinements 1 --confirmations 2 --jobs 1"
    first = printed(capsys, "run", KINEMATIC, small, "--out", out)
    with SqliteLedger(out / LEDGER) as ledger:
        attempts = list(ledger.attempts(ledger.campaigns()[0]))
        (confirmation,) = (a for a in attempts if a.purpose == "confirmation")
        kept = ledger.run(confirmation.measurements[1].run_id)
    rvsg("simulate", out / "best_scenario.json", KINEMATIC, "--seed", kept.seed, "--out", again)
    assert same_run(read_runs([again])[0], kept)
    page = (out / "report.html").read_bytes()
    (out / "report.html").unlink()
    told = printed(capsys, "report", out)
    assert (out / "report.html").read_bytes() == page
    assert all(told[key] == first[key] for key in told)


def test_metrics_measures_every_run_of_a_file_and_names_the_file_that_holds_none(
    errors: list[RvsgError], proposal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs, one = tmp_path / "runs.jsonl", tmp_path / "one.json"
    main(["simulate", str(proposal), *KINEMATIC, "--repeats", "2", "--out", str(runs)])
    one.write_text(runs.read_text().splitlines()[0])
    capsys.readouterr()
    assert main(["evaluate", "--metric", "dto", str(runs)]) == 0
    both = json.loads(capsys.readouterr().out)
    assert main(["evaluate", "--metric", "dto", str(one)]) == 0
    assert both[0] == json.loads(capsys.readouterr().out)
    assert len(both) == 2
    one.write_text("nothing\n")
    assert main(["evaluate", "--metric", "all", str(one)]) == 2
    assert isinstance(errors[-1], FileError) and (errors[-1].path, errors[-1].line) == (one, 1)
