"""Generators that fail, repeat themselves or cost money: what a campaign makes of them."""

from __future__ import annotations

import pytest
from tests.campaign.parts import Counted, MemoryLedger, Stops, WalkGenerator, plan, searched

from rvsg.core.errors import BudgetSpent, GenerationError
from rvsg.generation.generator import Call, Proposal
from rvsg.generation.people_sampler import box
from rvsg.report.answer_row import ranked_scenarios
from rvsg.runs.attempt import Attempt, Plan
from rvsg.scenario.brief import Brief
from rvsg.scenario.rules import Finding
from rvsg.search.execution import Limits, account
from rvsg.search.hybrid import HybridStrategy
from rvsg.search.strategies import StudyStrategy
from rvsg.world.world import World

STRATEGIES = [StudyStrategy, HybridStrategy]


def the_plan() -> Plan:
    return plan(scenarios=3, refinements=1, repeats=2, confirmations=0)


def run(ledger: MemoryLedger, strategy: type, generator: WalkGenerator) -> tuple[list[Attempt], int]:
    """Run a campaign; return its attempts and how many runs were simulated."""
    simulator = Counted()
    return searched(strategy, the_plan(), ledger, generator=generator, simulator=simulator), simulator.runs


class Unusable(WalkGenerator):
    """A model whose answers can never be used."""

    def propose(self, brief: Brief, world: World) -> Proposal:
        self.briefs.append(brief)
        problem = Finding(rule="unreadable", reason="The answer is no configuration.", suggestion="Answer with JSON.")
        return Proposal(generator="walk", scenario=None, problems=(problem,))


class Stubborn(WalkGenerator):
    """A model that answers every brief with the same configuration."""

    def propose(self, brief: Brief, world: World) -> Proposal:
        return super().propose(brief.replace(seed=3, kind="new", feedback=None), world)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_answers_that_can_never_be_used_end_the_search_with_what_was_wrong(strategy: type) -> None:
    generator = Unusable()
    attempts, runs = run(MemoryLedger(), strategy, generator)
    assert runs == 0
    assert 2 <= len(generator.briefs) <= the_plan().search_runs
    assert all(a.proposal.problems for a in attempts)
    assert ranked_scenarios(the_plan(), attempts) == ((), ())


@pytest.mark.parametrize(
    ("strategy", "generator", "after"),
    [
        *((strategy, WalkGenerator, 1) for strategy in STRATEGIES),
        (StudyStrategy, Stubborn, 3),
        *(pytest.param(strategy, WalkGenerator, 0, marks=pytest.mark.exhaustive) for strategy in STRATEGIES),
    ],
)
def test_a_service_that_fails_leaves_a_campaign_that_resumes_to_the_same_records(
    strategy: type, generator: type[WalkGenerator], after: int
) -> None:
    whole, _ = run(MemoryLedger(), strategy, generator())
    ledger = MemoryLedger()
    with pytest.raises(GenerationError):
        run(ledger, strategy, Stops(after, generator()))
    assert len(ledger.kept) == after
    assert run(ledger, strategy, generator())[0] == whole


def test_a_configuration_that_is_proposed_again_is_told_and_not_run_again() -> None:
    attempts, runs = run(MemoryLedger(), StudyStrategy, Stubborn())
    assert [a.same_as for a in attempts] == [None, *[0] * (len(attempts) - 1)]
    assert runs == the_plan().repeats
    assert len({m.run_id for a in attempts for m in a.measurements}) == runs


class Mover(Stubborn):
    """A model that leaves the people as they are and moves an object at every answer."""

    def propose(self, brief: Brief, world: World) -> Proposal:
        made = super().propose(brief, world)
        assert made.scenario is not None
        cart = box("cart", (1.0 + 0.1 * len(self.briefs), 1.0), (0.4, 0.4, 1.0), 0.0, world.lidar_height_m)
        mission = made.scenario.mission.replace(moved=(cart,))
        return made.replace(scenario=made.scenario.replace(mission=mission))


def test_the_same_people_beside_another_object_are_another_configuration() -> None:
    attempts, _ = run(MemoryLedger(), StudyStrategy, Mover())
    assert [a.same_as for a in attempts] == [None] * len(attempts)
    assert len({a.proposal.scenario.situation for a in attempts if a.proposal.scenario}) == len(attempts)


class Paid(WalkGenerator):
    """A generator of a plug-in that says what its calls cost."""

    def __init__(self, usd: float | None = 0.02) -> None:
        super().__init__()
        self.usd = usd

    def propose(self, brief: Brief, world: World) -> Proposal:
        call = Call(purpose=brief.kind, model="paid", input_tokens=900, output_tokens=100, cost_usd=self.usd)
        return super().propose(brief, world).replace(calls=(call, call))


def paid(
    ledger: MemoryLedger, strategy: type = StudyStrategy, price: float | None = 0.02, **limits: float
) -> list[Attempt]:
    return searched(strategy, the_plan(), ledger, generator=Paid(price), changes={"limits": Limits(**limits)})


@pytest.mark.parametrize(
    ("limits", "attempts"), [({"calls": 3}, 2), ({"calls": 4}, 2), ({"tokens": 2001}, 2), ({"usd": 0.05}, 2)]
)
def test_a_limit_of_any_kind_ends_the_search_of_any_generator(limits: dict[str, float], attempts: int) -> None:
    ledger = MemoryLedger()
    with pytest.raises(BudgetSpent):
        paid(ledger, **limits)
    spent = account(ledger.kept)
    assert (spent.search_attempts, spent.calls, spent.input_tokens) == (attempts, 2 * attempts, 1800 * attempts)
    assert spent.cost_usd == pytest.approx(0.04 * attempts)


def test_a_search_with_a_larger_limit_goes_on_to_the_same_records() -> None:
    whole, ledger = MemoryLedger(), MemoryLedger()
    paid(whole)
    with pytest.raises(BudgetSpent):
        paid(ledger, calls=3)
    paid(ledger, calls=50)
    assert ledger.kept == whole.kept
    with pytest.raises(BudgetSpent):  # a limit of money cannot be kept where the price is unknown
        paid(MemoryLedger(), price=None, usd=1.0)


def test_a_configuration_that_is_run_again_pays_its_calls_once() -> None:
    attempts = paid(MemoryLedger(), HybridStrategy)
    asked = [a for a in attempts if a.proposal.generator != "hybrid"]
    briefs = {(a.brief.scenario_index, a.brief.configuration_index) for a in asked}
    assert len(asked) > len(briefs)
    assert account(attempts).calls == 2 * len(briefs)
