from __future__ import annotations

import pytest
from tests.campaign.parts import MemoryLedger, WalkGenerator, parts, plan, warehouse
from tests.campaign.test_failures import run_of

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.feedback import MapCell, StoredFeedback, failure_map, filled
from rvsg.campaign.hybrid import MapElitesStrategy
from rvsg.campaign.ledger import CachedLedger
from rvsg.campaign.loop import run_campaign
from rvsg.campaign.observation import encounter_of
from rvsg.campaign.ranking import measured
from rvsg.core.errors import GenerationError
from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief

PLAN = {"scenarios": 5, "refinements": 3, "repeats": 3, "confirmations": 0, "budget_runs": 60}


def searched(ledger: MemoryLedger, generator: object = None) -> list[Attempt]:
    the_plan = plan(**PLAN)
    strategy = MapElitesStrategy(the_plan, StoredFeedback(CachedLedger(ledger), the_plan, warehouse()), warehouse())  # type: ignore[arg-type]
    return run_campaign(the_plan, strategy, parts(ledger, generator=generator))


@pytest.fixture(scope="module")
def whole() -> tuple[MemoryLedger, list[Attempt]]:
    ledger = MemoryLedger()
    return ledger, searched(ledger)


def mapped(whole: tuple[MemoryLedger, list[Attempt]]) -> tuple[MapCell, ...]:
    ledger, attempts = whole
    return failure_map(attempts, plan().requirement, run_of=ledger.run, world=warehouse())


def test_an_encounter_says_where_on_the_way_it_is_and_who_is_met() -> None:
    met = encounter_of(run_of((0.0, 1.0), (0.0, 0.0)), warehouse())
    assert met is not None
    assert (met.stretch, met.who, met.kind) == ("middle third", "Human 1", "stands beside it")


def test_it_spends_its_runs(whole: tuple[MemoryLedger, list[Attempt]]) -> None:
    assert len({m.run_id for a in whole[1] for m in a.measurements}) == 60


def test_the_map_holds_the_worst_configuration_of_every_kind(whole: tuple[MemoryLedger, list[Attempt]]) -> None:
    cells = mapped(whole)
    assert len({cell.encounter for cell in cells}) == len(cells) > 3
    assert sum(cell.configurations for cell in cells) == len(measured(whole[1]))
    assert filled(cells) == (len(cells), sum(cell.violations > 0 for cell in cells))
    shares = [cell.violations / cell.runs for cell in cells]
    assert shares == sorted(shares, reverse=True)


def test_the_worst_of_the_cells_are_repeated(whole: tuple[MemoryLedger, list[Attempt]]) -> None:
    often = [len(a.measurements) for a in measured(whole[1])]
    assert max(often) > 1


def test_it_resumes_to_the_same_records(whole: tuple[MemoryLedger, list[Attempt]]) -> None:
    class Stops(WalkGenerator):
        def propose(self, brief: Brief, world: object) -> Proposal:
            if len(self.briefs) >= 7:
                raise GenerationError("stopped")
            return super().propose(brief, world)  # type: ignore[arg-type]

    ledger = MemoryLedger()
    with pytest.raises(GenerationError):
        searched(ledger, Stops())
    assert searched(ledger) == whole[1]


def test_a_generator_that_never_answers_well_ends_the_search() -> None:
    class Fails(WalkGenerator):
        def propose(self, brief: Brief, world: object) -> Proposal:
            self.briefs.append(brief)
            return Proposal(generator="walk", scenario=None)

    attempts = searched(MemoryLedger(), Fails())
    assert len({(a.brief.scenario_index, a.brief.configuration_index) for a in attempts}) == len(attempts)
    assert all(a.mean is None for a in attempts)
