from __future__ import annotations

import io

import pytest
from rich.console import Console
from tests.campaign.parts import plan

from rvsg.cli import progress
from rvsg.cli.progress import CampaignProgress
from rvsg.runs.attempt import Failure
from rvsg.scenario.brief import Brief
from rvsg.search.execution import AloneStarted, ExplanationStarted, ProposalStarted, RunFinished


def run(purpose: str, seed: int) -> RunFinished:
    lost = Failure(seed=seed, reason="it did not start")
    return RunFinished(campaign="test", index=0, purpose=purpose, run=lost)  # type: ignore[arg-type]


def test_progress_names_the_stages_and_counts_what_each_can_need_at_most(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    the_plan = plan(scenarios=8, refinements=0, repeats=5, confirmations=30)
    brief = Brief(mission=the_plan.mission, requirement=the_plan.requirement, seed=1)
    totals = []
    with CampaignProgress(the_plan, []) as shown:
        shown(AloneStarted(campaign="test", runs=3))
        for seed in range(3):
            shown(run("baseline", seed))
        now[0] = 5000.0  # another campaign had the workers
        shown(ProposalStarted(campaign="test", index=0, brief=brief))
        for seed in range(40):
            now[0] += 2.0
            shown(run("search", seed))
            totals.append(shown.total)
        shown(ExplanationStarted(campaign="test", without=("Human 1",), people=1, runs=15))
    lines = [line for line in capsys.readouterr().err.splitlines() if line]
    assert lines[0] == "prepare · alone · search · confirm · cause · shrink"
    assert lines[1] == "alone 0/3 · search · confirm · cause · shrink"
    assert lines[2] == "search 0/40 · confirm · cause · shrink"
    assert len([line for line in lines if line.startswith("search")]) == 11, "a line for every tenth"
    assert set(totals) == {40}
    assert "search 20/40 · confirm · cause · shrink   1-4 min left" in lines[7]
    assert lines[-1].startswith("cause")


def test_on_a_terminal_the_stages_stand_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    paper = io.StringIO()
    told = Console(width=100, force_terminal=True, file=paper, color_system=None, legacy_windows=False)
    monkeypatch.setattr(progress, "console", lambda: told)
    with CampaignProgress(plan(scenarios=8, confirmations=30), []) as shown:
        assert shown.line is not None
        shown(AloneStarted(campaign="test", runs=3))
    assert "alone 0/3" in paper.getvalue()
    assert CampaignProgress(plan(), [], name="beside").line is None
