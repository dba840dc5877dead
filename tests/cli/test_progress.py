from __future__ import annotations

import io

import pytest
from rich.console import Console
from tests.campaign.parts import plan

from rvsg.campaign.attempt import Attempt, Failure
from rvsg.campaign.execution import AttemptFinished, ExplanationStarted, ProposalStarted, RunFinished
from rvsg.cli import progress
from rvsg.cli.progress import CampaignProgress
from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief


@pytest.mark.parametrize("width", [80, 60])
def test_progress_shows_done_total_and_time_left_on_a_narrow_terminal(
    width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = Console(width=width, force_terminal=True, file=io.StringIO(), color_system=None, legacy_windows=False)
    monkeypatch.setattr(progress, "console", lambda: told)
    the_plan = plan(scenarios=100, refinements=4, repeats=5, confirmations=30)
    shown = CampaignProgress(the_plan, [])
    assert shown.bar is not None
    brief = Brief(mission=the_plan.mission, requirement=the_plan.requirement, seed=1, scenario_index=41)
    shown(ProposalStarted(campaign="test", index=41, brief=brief))
    shown.runs = 1233
    shown.bar.update(shown.task, completed=1233)
    shown.worst = 1.2345
    shown(ProposalStarted(campaign="test", index=41, brief=brief))
    with told.capture() as captured:
        told.print(shown.bar.get_renderable())
    (line,) = captured.get().splitlines()
    assert len(line) <= width
    assert f"1233/{the_plan.runs} runs" in " ".join(line.split())
    assert " left " in line and ("-:--:--" in line or "0:" in line)
    if width == 80:
        assert "scenario 42" in line
    shown(ExplanationStarted(campaign="test", without=("Human 1",), people=1, runs=15))
    with told.capture() as captured:
        told.print(shown.bar.get_renderable())
    assert "1233/1248 runs" in " ".join(captured.get().split())  # such runs are none of the plan's


def test_the_estimate_does_not_count_the_wait_for_other_campaigns(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    the_plan = plan(scenarios=2, refinements=0, repeats=5)
    shown = CampaignProgress(the_plan, [], name="second")
    now[0] = 5000.0
    brief = Brief(mission=the_plan.mission, requirement=the_plan.requirement, seed=1)
    shown(ProposalStarted(campaign="test", index=0, brief=brief))
    for seed in range(5):
        now[0] += 2.0
        shown(
            RunFinished(campaign="test", index=0, purpose="search", run=Failure(seed=seed, reason="it did not start"))
        )
    made = Attempt(
        campaign="test", index=0, strategy="study", brief=brief, proposal=Proposal(generator="none", scenario=None)
    )
    shown(AttemptFinished(campaign="test", attempt=made))
    left = (the_plan.runs - 5) * 2
    assert f"about {left} s left" in capsys.readouterr().err
