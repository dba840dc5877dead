"""One account of runs, calls, tokens and money, and the limits of what calls cost."""

from __future__ import annotations

import pytest
from tests.campaign.parts import MemoryLedger, WalkGenerator, plan, searched

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.execution import Limits, account
from rvsg.campaign.hybrid import HybridStrategy
from rvsg.campaign.strategies import StudyStrategy
from rvsg.core.errors import BudgetSpent
from rvsg.generation.generator import Call, Proposal
from rvsg.scenario.brief import Brief
from rvsg.world.world import World


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
    the_plan = plan(scenarios=3, refinements=1, repeats=2, confirmations=0)
    return searched(strategy, the_plan, ledger, generator=Paid(price), changes={"limits": Limits(**limits)})


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


def test_a_limit_of_money_cannot_be_kept_where_the_price_is_unknown() -> None:
    with pytest.raises(BudgetSpent):
        searched(generator=Paid(None), changes={"limits": Limits(usd=1.0)})


def test_a_configuration_that_is_run_again_pays_its_calls_once() -> None:
    attempts = paid(MemoryLedger(), HybridStrategy)
    asked = [a for a in attempts if a.proposal.generator != "hybrid"]
    briefs = {(a.brief.scenario_index, a.brief.configuration_index) for a in asked}
    assert len(asked) > len(briefs)
    assert account(attempts).calls == 2 * len(briefs)
