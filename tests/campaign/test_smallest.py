"""The smallest form of every distinct failure, at the end of a campaign."""

from __future__ import annotations

import dataclasses

import pytest
from tests.campaign.parts import REQUIREMENT, MemoryLedger, measure, parts, plan, warehouse

from rvsg.campaign.attempt import Attempt, Plan
from rvsg.campaign.execution import Attempted, Parts, account
from rvsg.campaign.findings import DistinctFailure, Smallest, distinct_failures, findings
from rvsg.campaign.loop import run_campaign, stream_campaign
from rvsg.campaign.runner import Measuring
from rvsg.campaign.smallest_scenario import size
from rvsg.campaign.strategies import RandomStrategy
from rvsg.scenario.requirement import Requirement

EASY = REQUIREMENT.replace(limit=20.0)
"""A limit that every run with people violates."""


def made(ledger: MemoryLedger, requirement: Requirement = EASY, **changes: object) -> Parts:
    given = {"shrink_runs": 300, "judge": Measuring(requirement).judge, **changes}
    return dataclasses.replace(parts(ledger, measure=measure), **given)  # type: ignore[arg-type]


def the_plan(requirement: Requirement = EASY) -> Plan:
    return plan(scenarios=3, refinements=0, repeats=1, confirmations=30, requirement=requirement)


def run(ledger: MemoryLedger, requirement: Requirement = EASY, **changes: object) -> list[Attempt]:
    given = made(ledger, requirement, **changes)
    with given.runner:
        return run_campaign(the_plan(requirement), RandomStrategy(the_plan(requirement)), given)


def failures(ledger: MemoryLedger, attempts: list[Attempt]) -> tuple[DistinctFailure, ...]:
    return distinct_failures(findings(the_plan(), attempts, run_of=ledger.run, world=warehouse()))


@pytest.fixture(scope="module")
def whole() -> tuple[MemoryLedger, list[Attempt]]:
    ledger = MemoryLedger()
    return ledger, run(ledger)


def shrunk(attempts: list[Attempt]) -> list[Attempt]:
    return [a for a in attempts if a.purpose == "shrinking"]


def test_every_distinct_failure_is_shrunk_and_keeps_its_causes(whole: tuple[MemoryLedger, list[Attempt]]) -> None:
    ledger, attempts = whole
    found = failures(ledger, attempts)
    assert found
    for failure in found:
        smallest = failure.smallest
        assert smallest is not None
        assert smallest.taken_away
        assert smallest.violated == smallest.of > 0
        assert failure.cause
        assert failure.without_people is not None


def test_what_is_left_is_smaller_and_meets_seeds_of_the_confirmation(
    whole: tuple[MemoryLedger, list[Attempt]],
) -> None:
    _, attempts = whole
    for attempt in shrunk(attempts):
        confirmation = next(a for a in attempts if a.index == attempt.confirms)
        assert attempt.proposal.scenario is not None
        assert confirmation.proposal.scenario is not None
        assert size(attempt.proposal.scenario.people) < size(confirmation.proposal.scenario.people)
        assert {m.seed for m in attempt.measurements} <= {m.seed for m in confirmation.measurements}


def test_all_of_it_stays_within_the_budget(whole: tuple[MemoryLedger, list[Attempt]]) -> None:
    assert 0 < account(whole[1]).shrinking_runs <= 300
    few = run(MemoryLedger(), shrink_runs=40)
    assert account(few).shrinking_runs <= 40


def test_nothing_is_shrunk_without_a_budget_or_a_violation() -> None:
    assert not shrunk(run(MemoryLedger(), shrink_runs=0))
    assert not shrunk(run(MemoryLedger(), REQUIREMENT.replace(limit=0.001)))


def test_an_interrupted_end_resumes_to_the_same_records(whole: tuple[MemoryLedger, list[Attempt]]) -> None:
    attempts = whole[1]
    assert shrunk(attempts)
    ledger, seen = MemoryLedger(), 0
    given = made(ledger, cancelled=lambda: seen >= len(attempts) - len(shrunk(attempts)))
    with given.runner:
        for event in stream_campaign(the_plan(), RandomStrategy(the_plan()), given):
            seen += isinstance(event, Attempted)
    assert not shrunk(ledger.kept)
    assert run(ledger) == attempts


@pytest.mark.parametrize(("violated", "before", "holds"), [(0, 2, False), (0, 0, False), (4, 10, False), (5, 10, True)])
def test_what_no_longer_fails_is_not_told_as_the_failure_shrunk(violated: int, before: int, holds: bool) -> None:
    smallest = Smallest(attempt=7, scenario_id="x", taken_away=("Human 1",), violated=violated, of=10, before=before)
    assert smallest.holds is holds
