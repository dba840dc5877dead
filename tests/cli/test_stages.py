"""The stages by hand give what the campaign gives."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest
from tests.cli.commands import Terminal
from tests.cli.test_run import attempts_of

from rvsg.app.folder import LEDGER
from rvsg.scenario.brief import Feedback
from rvsg.simulation.archive import read_runs
from rvsg.store.sqlite import SqliteLedger
from rvsg.testing import same_run

KINEMATIC = "--simulator kinematic"


@pytest.fixture
def proposal(terminal: Terminal) -> Path:
    """A proposal in `p.json`."""
    terminal("scenario propose --generator random --seed 5 --out p.json")
    written = json.loads(Path("p.json").read_text())
    assert written["first_findings"] == [] and written["scenario"]["mission"]["route"]["name"] == "route_1"
    return Path("p.json")


@pytest.mark.slow
@pytest.mark.usefixtures("proposal")
def test_repeats_have_the_next_seeds_and_do_not_depend_on_the_jobs(terminal: Terminal) -> None:
    asked = f"simulate p.json {KINEMATIC} --seed 9 --repeats 3 --out"
    terminal(asked, "one.jsonl")
    terminal(asked, "two.jsonl --jobs 2")
    assert Path("one.jsonl").read_bytes() == Path("two.jsonl").read_bytes()
    assert [run.seed for run in read_runs([Path("one.jsonl")])] == [9, 10, 11]


@pytest.mark.usefixtures("proposal")
def test_evaluate_judges_all_runs_of_a_scenario_and_refuses_two_scenarios(terminal: Terminal) -> None:
    terminal("simulate p.json", KINEMATIC, "--repeats 16 --out a.jsonl")
    terminal("scenario propose --generator random --seed 6 --out other.json")
    terminal("simulate other.json", KINEMATIC, "--out b.jsonl")
    told = terminal.json("evaluate a.jsonl")
    assert told["verdict"]["runs"] == 16 == len(told["measurements"])
    assert told["verdict"]["status"] in ("PASS", "FAIL", "FLAKY", "INCONCLUSIVE")
    assert (told["next_repeats"] > 0) == (told["verdict"]["status"] == "INCONCLUSIVE")
    terminal("evaluate a.jsonl b.jsonl", code=2)


def test_a_refinement_by_hand_is_told_what_was_measured(terminal: Terminal, proposal: Path) -> None:
    terminal("simulate p.json", KINEMATIC, "--repeats 4 --out r.jsonl")
    terminal("evaluate r.jsonl --feedback f.json", code=2)  # which scenario?
    assert not Path("f.json").exists()
    terminal("evaluate r.jsonl --scenario p.json --feedback f.json")
    told = Feedback.from_json(Path("f.json").read_text())
    assert len(told.objectives) == 4 and told.moments and told.series
    terminal("scenario propose --generator heuristic --generator-option tries=3 --feedback f.json --out refined.json")
    before, after = (json.loads(path.read_text())["scenario"] for path in (proposal, Path("refined.json")))
    assert after["people"] != before["people"]
    assert before["description"] == ""  # so the refinement tells of everybody
    assert all(name in after["description"] for name in ("Human 1", "Human 2"))


def test_stages_stand_in_a_pipe(terminal: Terminal, proposal: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(proposal.read_text()))
    terminal("simulate -", KINEMATIC)
    monkeypatch.setattr(sys, "stdin", io.StringIO(terminal.out))
    assert terminal.json("evaluate -")["verdict"]["runs"] == 1


def test_a_run_is_made_again_from_its_seed_and_a_report_from_the_ledger(terminal: Terminal) -> None:
    small = "--strategy random --scenarios 1 --refinements 1 --confirmations 2 --jobs 1"
    first = terminal.json("run", KINEMATIC, small, "--out c")
    (confirmation,) = (a for a in attempts_of(Path("c")) if a.purpose == "confirmation")
    with SqliteLedger(Path("c") / LEDGER) as ledger:
        kept = ledger.run(confirmation.measurements[1].run_id)
    terminal("simulate c/best_scenario.json", KINEMATIC, "--seed", kept.seed, "--out again.jsonl")
    assert same_run(read_runs([Path("again.jsonl")])[0], kept)
    page = Path("c/report.html").read_bytes()
    Path("c/report.html").unlink()
    told = terminal.json("report c")
    assert Path("c/report.html").read_bytes() == page
    assert all(told[key] == first[key] for key in told)


@pytest.mark.usefixtures("proposal")
def test_metrics_measures_every_run_of_a_file_and_names_the_file_that_holds_none(terminal: Terminal) -> None:
    terminal("simulate p.json", KINEMATIC, "--repeats 2 --out runs.jsonl")
    one = Path("one.json")
    one.write_text(Path("runs.jsonl").read_text().splitlines()[0])
    both = terminal.json("evaluate --metric dto runs.jsonl")
    assert both[0] == terminal.json("evaluate --metric dto one.json") and len(both) == 2
    one.write_text("nothing\n")
    error = terminal.refused("evaluate --metric all one.json")
    assert (error.path, error.line) == (one, 1)


@pytest.mark.slow
@pytest.mark.usefixtures("proposal")
def test_a_bag_alone_prints_no_run(terminal: Terminal) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    terminal("simulate p.json --seed 1 --bag run.mcap")
    assert terminal.out == "" and Path("run.mcap").stat().st_size > 1000
