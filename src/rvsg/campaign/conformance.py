"""Checks of what every Strategy and every Ledger must do. Run them in the tests of your plug-in."""

from __future__ import annotations

from collections.abc import Callable

from rvsg.campaign.attempt import Attempt, Ledger, Measurement
from rvsg.campaign.plan import Plan
from rvsg.campaign.strategies import Ask, FeedbackOf, Strategy
from rvsg.core.errors import StoreError
from rvsg.core.seeds import seed_for
from rvsg.evaluation.judge import judge
from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Feedback
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.archive import PackedRun, arrays_of
from rvsg.simulation.run import Run
from rvsg.world.world import World

Made = Callable[[Plan, FeedbackOf, World], Strategy]


def check_strategy(made: Made, plan: Plan, scenario: Scenario, world: World) -> None:
    """Check the promises of a strategy; AssertionError names the first broken one.

    A strategy spends at most `plan.search_runs` runs and then stops, also where every proposal is invalid. Asking
    twice without telling gives the same asks. A new one that is told the same attempts continues the same way, so
    that a campaign resumes. Every ask has the mission and the number of people of the plan. `scenario` stands for
    what a generator answers.
    """
    for answered in (True, False):
        told = _play(made, plan, scenario if answered else None, world)
        assert not answered or told, "it asks for nothing at all"
        for cut in (0, 1, len(told) // 2, len(told)):
            strategy = made(plan, _feedback, world)
            for attempt in told[:cut]:
                strategy.tell(attempt)
            asks = strategy.ask()
            assert strategy.ask() == asks, "asking twice without telling gives different asks"
            expected = tuple(attempt.brief for attempt in told[cut : cut + len(asks)])
            continued = tuple(ask.brief for ask in asks)
            assert continued == expected, f"told again, it does not continue the same way after {cut} attempts"
            assert bool(asks) == (cut < len(told)), f"after {cut} attempts it asks for {len(asks)} attempts"
        for attempt in told:
            assert attempt.brief.mission == plan.mission, "a brief is of another mission than the plan's"
            assert attempt.brief.humans == plan.humans, "a brief is of another number of humans than the plan's"
        answers = [a for a in told if a.proposal.generator == "conformance"]
        briefs = {a.brief.id: a.brief for a in answers}  # a configuration that is run again keeps its brief
        assert len({b.seed for b in briefs.values()}) == len(briefs), "briefs for the generator share a seed"


def check_ledger(opened: Callable[[], Ledger], attempt: Attempt, run: Run) -> None:
    """Raises AssertionError naming the first promise that is broken. `opened` opens the same, empty ledger each time.

    What was kept is there when it is opened again, equal to the last bit, in the order of the index; an index that
    is taken is refused and leaves nothing; settings are kept once; what is absent is None or a StoreError.
    """
    ledger, name, packed = opened(), attempt.campaign, PackedRun.of(run)
    assert ledger.settings(name) is None and list(ledger.attempts(name)) == []
    assert ledger.find(run.id) is None
    _refuses(lambda: ledger.run(run.id), "a run that is not there")
    ledger.begin(name, {"seed": 1})
    ledger.begin(name, {"seed": 1})
    _refuses(lambda: ledger.begin(name, {"seed": 2}), "other settings under the same name")
    second, first = attempt.replace(index=1), attempt.replace(index=0)
    ledger.append(second, [])
    ledger.keep(packed)
    ledger.append(first, [packed])
    _refuses(lambda: ledger.append(second, [packed]), "an index that is taken")
    again = opened()
    assert list(again.attempts(name)) == [first, second], "the attempts are not there again, or not in order"
    assert again.settings(name) == {"seed": 1} and again.campaigns() == (name,)
    kept, given = arrays_of(again.run(run.id)), arrays_of(run)
    assert all((kept[key] == given[key]).all() for key in given), "the run is not what was kept"


def _play(made: Made, plan: Plan, scenario: Scenario | None, world: World) -> list[Attempt]:
    """Everything a strategy asks for, where the generator always answers `scenario` (None: with nothing valid)."""
    strategy = made(plan, _feedback, world)
    told: list[Attempt] = []
    spent: set[tuple[str, int]] = set()
    while asks := strategy.ask():
        for ask in asks:
            told.append(_answered(plan, strategy.name, len(told), ask, scenario))
            strategy.tell(told[-1])
            spent.update((told[-1].proposal.model_dump_json(), m.seed) for m in told[-1].measurements)
        assert len(spent) <= plan.search_runs, f"it spends {len(spent)} runs, the plan has {plan.search_runs}"
        assert len(told) <= plan.search_runs + plan.attempts, f"it does not stop after {len(told)} attempts"
    return told


def _answered(plan: Plan, strategy: str, index: int, ask: Ask, scenario: Scenario | None) -> Attempt:
    """Return the attempt of an ask with made-up measurements that differ from attempt to attempt."""
    proposal = ask.proposal or Proposal(generator="conformance", scenario=scenario)
    seeds = ask.seeds or [seed_for(plan.seed, "search", index, repeat) for repeat in range(plan.repeats)]
    value = 1.0 + 0.1 * (index % 3)
    measurements = tuple(
        Measurement(run_id=f"run-{index}-{seed}", seed=seed, outcome="reached", values={}, objective=value)
        for seed in (seeds if proposal.scenario else ())
    )
    return Attempt(
        campaign=plan.name,
        index=index,
        strategy=strategy,
        brief=ask.brief,
        proposal=proposal,
        measurements=measurements,
        verdict=judge(plan.requirement, [value] * len(measurements)) if measurements else None,
    )


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
