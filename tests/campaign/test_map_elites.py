from __future__ import annotations

import pytest
from tests.campaign.parts import MemoryLedger, plan, searched, warehouse
from tests.campaign.test_failures import run_of

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.feedback import MapCell, failure_map
from rvsg.campaign.hybrid import MapElitesStrategy
from rvsg.campaign.observation import encounter_of
from rvsg.campaign.ranking import measured

PLAN = {"scenarios": 5, "refinements": 3, "repeats": 3, "confirmations": 0, "budget_runs": 60}


@pytest.fixture(scope="module")
def whole() -> tuple[MemoryLedger, list[Attempt]]:
    ledger = MemoryLedger()
    return ledger, searched(MapElitesStrategy, plan(**PLAN), ledger)


def mapped(whole: tuple[MemoryLedger, list[Attempt]]) -> tuple[MapCell, ...]:
    ledger, attempts = whole
    return failure_map(attempts, plan().requirement, run_of=ledger.run, world=warehouse())


def test_an_encounter_says_where_on_the_way_it_is_and_who_is_met() -> None:
    met = encounter_of(run_of((0.0, 1.0), (0.0, 0.0)), warehouse())
    assert met is not None
    assert (met.stretch, met.who, met.kind) == ("middle third", "Human 1", "stands beside it")


def test_the_map_holds_the_worst_configuration_of_every_kind(whole: tuple[MemoryLedger, list[Attempt]]) -> None:
    cells = mapped(whole)
    assert len({cell.encounter for cell in cells}) == len(cells) > 3
    assert sum(cell.configurations for cell in cells) == len(measured(whole[1]))
    shares = [cell.violations / cell.runs for cell in cells]
    assert shares == sorted(shares, reverse=True)


def test_it_spends_its_runs_and_repeats_the_worst_of_the_cells(whole: tuple[MemoryLedger, list[Attempt]]) -> None:
    assert len({m.run_id for a in whole[1] for m in a.measurements}) == 60
    assert max(len(a.measurements) for a in measured(whole[1])) > 1
