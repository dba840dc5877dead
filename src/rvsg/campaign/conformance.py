"""What every Strategy and every Ledger must do. Plug-in writers run these checks in their tests."""

from __future__ import annotations

from collections.abc import Callable

from rvsg.campaign.attempt import Attempt, Ledger
from rvsg.campaign.plan import Plan
from rvsg.campaign.strategies import FeedbackOf, Strategy
from rvsg.core.errors import StoreError
from rvsg.evaluation.judge import judge
from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief, Feedback
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.archive import arrays_of
from rvsg.simulation.run import Run

Made = Callable[[Plan, FeedbackOf], Strategy]


def check_strategy(made: Made, plan: Plan, scenario: Scenario) -> None:
    """Raises AssertionError naming the first promise that is broken.

    A strategy asks for exactly `plan.attempts` briefs, also where every proposal is invalid; asking twice without
    telling gives the same briefs; told again from the beginning, a fresh one asks for the same (so a campaign
    resumes); it is of the plan's mission. `scenario` stands for what a generator answers.
    """
    for answered in (True, False):
        told = _play(made, plan, scenario if answered else None)
        assert len(told) == plan.attempts, f"{len(told)} attempts were asked for, the plan has {plan.attempts}"
        for cut in (0, 1, len(told) // 2, len(told)):
            strategy = made(plan, _feedback)
            for attempt in told[:cut]:
                strategy.tell(attempt)
            briefs = strategy.ask()
            assert strategy.ask() == briefs, "asking twice without telling gives different briefs"
            expected = tuple(attempt.brief for attempt in told[cut : cut + len(briefs)])
            assert briefs == expected, f"told again, it does not continue the same way after {cut} attempts"
            assert bool(briefs) == (cut < len(told)), f"after {cut} attempts it asks for {len(briefs)} briefs"
        for attempt in told:
            assert attempt.brief.mission == plan.mission, "a brief is of another mission than the plan's"
            assert attempt.brief.humans == plan.humans, "a brief is of another number of humans than the plan's"
    assert len({a.brief.seed for a in told}) == len(told), "briefs share a seed"


def check_ledger(opened: Callable[[], Ledger], attempt: Attempt, run: Run) -> None:
    """Raises AssertionError naming the first promise that is broken. `opened` opens the same, empty ledger each time.

    What was kept is there when it is opened again, equal to the last bit, in the order of the index; an index that
    is taken is refused and leaves nothing; settings are kept once; what is absent is None or a StoreError.
    """
    ledger, name = opened(), attempt.campaign
    assert ledger.settings(name) is None and list(ledger.attempts(name)) == []
    assert ledger.find(run.id) is None
    _refuses(lambda: ledger.run(run.id), "a run that is not there")
    ledger.begin(name, {"seed": 1})
    ledger.begin(name, {"seed": 1})
    _refuses(lambda: ledger.begin(name, {"seed": 2}), "other settings under the same name")
    second, first = attempt.replace(index=1), attempt.replace(index=0)
    ledger.append(second, [])
    ledger.keep(run)
    ledger.append(first, [run])
    _refuses(lambda: ledger.append(second, [run]), "an index that is taken")
    again = opened()
    assert list(again.attempts(name)) == [first, second], "the attempts are not there again, or not in order"
    assert again.settings(name) == {"seed": 1} and again.campaigns() == (name,)
    kept, given = arrays_of(again.run(run.id)), arrays_of(run)
    assert all((kept[key] == given[key]).all() for key in given), "the run is not what was kept"


def _play(made: Made, plan: Plan, scenario: Scenario | None) -> list[Attempt]:
    """Everything a strategy asks for, answered always with the same scenario (None: with nothing valid)."""
    strategy = made(plan, _feedback)
    told: list[Attempt] = []
    while briefs := strategy.ask():
        for brief in briefs:
            told.append(_answered(plan, strategy.name, len(told), brief, scenario))
            strategy.tell(told[-1])
        assert len(told) <= plan.attempts, f"more than the plan's {plan.attempts} attempts are asked for"
    return told


def _answered(plan: Plan, strategy: str, index: int, brief: Brief, scenario: Scenario | None) -> Attempt:
    verdict = judge(plan.requirement, [1.0 + 0.1 * (index % 3)] * plan.repeats) if scenario else None
    proposal = Proposal(generator="conformance", scenario=scenario)
    return Attempt(campaign=plan.name, index=index, strategy=strategy, brief=brief, proposal=proposal, verdict=verdict)


def _feedback(attempt: Attempt, previous: Attempt | None) -> Feedback:
    scenario, verdict = attempt.proposal.scenario, attempt.verdict
    assert scenario is not None and verdict is not None and verdict.mean is not None
    before = previous.verdict.mean if previous and previous.verdict else None
    return Feedback(
        scenario=scenario,
        objectives=verdict.objectives,
        mean=verdict.mean,
        interval=(verdict.mean, verdict.mean),
        previous_mean=before,
    )


def _refuses(action: Callable[[], object], what: str) -> None:
    try:
        action()
    except StoreError:
        return
    raise AssertionError(f"the ledger accepts {what}; a StoreError is due")
