"""Attempts that a campaign holds as summaries only: the records are the same, and few are in memory."""

from __future__ import annotations

import gc
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from tests.campaign.parts import parts, plan, warehouse

from rvsg.campaign import ledger, runner
from rvsg.campaign.attempt import Attempt, AttemptSummary, Measurement
from rvsg.campaign.execution import AttemptFinished
from rvsg.campaign.feedback import StoredFeedback
from rvsg.campaign.hybrid import HybridStrategy, MapElitesStrategy
from rvsg.campaign.ledger import CachedLedger, Ledger
from rvsg.campaign.loop import run_campaign, stream_campaign
from rvsg.campaign.strategies import StudyStrategy
from rvsg.core.errors import StoreError
from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.store.memory import MemoryLedger
from rvsg.store.sqlite import SqliteLedger

STRATEGIES = [StudyStrategy, HybridStrategy, MapElitesStrategy]


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep so few attempts that nearly everything is read from the store."""
    monkeypatch.setattr(ledger, "ATTEMPTS", 2)
    monkeypatch.setattr(runner, "RECENT", 3)


def made(ledger: Ledger, strategy: Any) -> list[Attempt]:
    wanted = plan(scenarios=3, refinements=2, repeats=2)
    asking = strategy(wanted, StoredFeedback(CachedLedger(ledger), wanted, warehouse()), warehouse())
    return run_campaign(wanted, asking, parts(ledger, generator=HeuristicGenerator()))


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_search_that_reads_its_attempts_from_the_store_makes_the_same_records(strategy: Any, tmp_path: Path) -> None:
    kept = made(MemoryLedger(), strategy)
    with SqliteLedger(tmp_path / "ledger.sqlite") as ledger:
        assert [a.to_json() for a in made(ledger, strategy)] == [a.to_json() for a in kept]
        cached = CachedLedger(ledger)
        for attempt in kept:
            summary = cached.summary(attempt)
            assert all(
                getattr(summary, f.name) == getattr(attempt, f.name) for f in fields(summary) if f.name != "read"
            )
            assert summary.runs == attempt.runs and summary.record == attempt == attempt.record
        with pytest.raises(StoreError) as caught:
            ledger.attempt("test", len(kept))
        assert caught.value.code == "store-damaged"


@pytest.mark.usefixtures("few")
def test_a_campaign_holds_few_measurements_at_a_time(tmp_path: Path) -> None:
    wanted = plan(scenarios=6, refinements=1, repeats=3, confirmations=0)
    with SqliteLedger(tmp_path / "ledger.sqlite") as ledger:
        made = parts(ledger)
        strategy = StudyStrategy(wanted, StoredFeedback(made.ledger, wanted, warehouse()), warehouse())
        before = _measurements()
        running = stream_campaign(wanted, strategy, made)
        most = max(_measurements() - before for event in running if isinstance(event, AttemptFinished))
    assert len(strategy.attempts) == 12 and all(type(each) is AttemptSummary for each in strategy.attempts)
    assert most <= 3 * (2 + 1), "two attempts in the cache, and the last runs"


def _measurements() -> int:
    gc.collect()
    return sum(type(each) is Measurement for each in gc.get_objects())
