from collections import Counter

from tests.campaign.parts import MemoryLedger, WalkGenerator, parts, plan, warehouse

from rvsg.campaign.conformance import check_strategy
from rvsg.campaign.elite import EliteStrategy
from rvsg.campaign.loop import feedback_from, run_campaign
from rvsg.scenario.brief import Brief


def test_it_keeps_the_promises_of_a_strategy() -> None:
    scenario = WalkGenerator().propose(Brief(mission=plan().mission, requirement=None, seed=1), warehouse()).scenario
    assert scenario is not None
    check_strategy(EliteStrategy, plan(), scenario, warehouse())


def test_every_scenario_is_drafted_once_and_the_best_are_refined_most() -> None:
    made = plan(scenarios=4, refinements=9)
    ledger = MemoryLedger()
    strategy = EliteStrategy(made, feedback_from(ledger, made, warehouse()))  # type: ignore[arg-type]
    attempts = [a for a in run_campaign(made, strategy, parts(ledger)) if a.purpose == "search"]
    assert [a.brief.kind for a in attempts[:4]] == ["new"] * 4
    assert [a.brief.scenario_index for a in attempts[:4]] == [0, 1, 2, 3]
    assert {a.brief.kind for a in attempts[4:]} == {"refine"}
    assert len(attempts) == made.attempts
    places = [(a.brief.scenario_index, a.brief.configuration_index) for a in attempts]
    assert len(set(places)) == len(places)
    worst_by_the_robot = max(
        range(4),
        key=lambda s: max(
            made.requirement.badness(a.mean) for a in attempts if a.brief.scenario_index == s and a.mean is not None
        ),
    )
    refined = Counter(a.brief.scenario_index for a in attempts[4:])
    assert refined[worst_by_the_robot] >= len(attempts[4:]) / 4


def test_a_refinement_starts_from_the_best_configuration_of_its_scenario() -> None:
    made = plan(scenarios=2, refinements=5)
    ledger = MemoryLedger()
    strategy = EliteStrategy(made, feedback_from(ledger, made, warehouse()))  # type: ignore[arg-type]
    attempts = [a for a in run_campaign(made, strategy, parts(ledger)) if a.purpose == "search"]
    for attempt in attempts[2:]:
        before = [a for a in attempts[: attempt.index] if a.brief.scenario_index == attempt.brief.scenario_index]
        assert attempt.brief.feedback is not None
        best = max(before, key=lambda a: (made.requirement.badness(a.mean or 0.0), -a.index))
        assert attempt.brief.feedback.mean == best.mean
        assert attempt.brief.feedback.weaker is None


def test_a_model_is_told_what_its_last_answer_measured_where_that_is_not_refined() -> None:
    made = plan(scenarios=2, refinements=5, proposals=12)
    ledger = MemoryLedger()
    strategy = EliteStrategy(made, feedback_from(ledger, made, warehouse()))  # type: ignore[arg-type]
    attempts = [a for a in run_campaign(made, strategy, parts(ledger)) if a.purpose == "search"]
    told = 0
    for attempt in attempts[2:]:
        last = [a for a in attempts[: attempt.index] if a.brief.scenario_index == attempt.brief.scenario_index][-1]
        feedback = attempt.brief.feedback
        assert feedback is not None
        if feedback.scenario == last.proposal.scenario:
            assert feedback.weaker is None
        else:
            assert feedback.weaker is not None and feedback.weaker.scenario == last.proposal.scenario
            assert feedback.weaker.rows and feedback.weaker.mean == last.mean
            told += 1
    assert told
