"""Attempts that a campaign keeps in its store only: they say the same, and hardly any is in memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.campaign.parts import parts, plan, warehouse

from rvsg.campaign import ledger
from rvsg.campaign.attempt import Attempt
from rvsg.campaign.feedback import StoredFeedback
from rvsg.campaign.hybrid import HybridStrategy, MapElitesStrategy
from rvsg.campaign.ledger import ASKED_OFTEN, CachedLedger, Filed, Filing, Ledger, whole
from rvsg.campaign.loop import run_campaign
from rvsg.campaign.strategies import StudyStrategy
from rvsg.core.errors import StoreError
from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.store.memory import MemoryLedger
from rvsg.store.sqlite import SqliteLedger

STRATEGIES = [StudyStrategy, HybridStrategy, MapElitesStrategy]


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep so few attempts that nearly everything is read from the store."""
    monkeypatch.setattr(ledger, "LAST", 2)
    monkeypatch.setattr(ledger, "LAST_BRIEFS", 1)


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


@pytest.mark.usefixtures("few")
def test_a_filed_attempt_says_what_the_record_says(tmp_path: Path) -> None:
    with SqliteLedger(tmp_path / "ledger.sqlite") as ledger:
        attempts = made(ledger, StudyStrategy)
        file = Filing(ledger, "test")
        filed = [file(attempt) for attempt in attempts]
        assert all(isinstance(each, Filed) for each in filed)
        for attempt, each in zip(attempts, filed, strict=True):
            for name in (*Attempt.model_fields, *ASKED_OFTEN):
                assert getattr(each, name) == getattr(attempt, name), name
            assert each == attempt and attempt == whole(each) and type(whole(each)) is Attempt
            assert each.replace(index=99) == attempt.replace(index=99)
            assert each != attempt.replace(index=99)
        assert filed[0] != filed[1] and filed[0] == file(attempts[0])
        with pytest.raises(StoreError) as caught:
            ledger.attempt("test", len(attempts))
        assert caught.value.code == "store-damaged"
        with pytest.raises(AttributeError):
            filed[0].nothing  # type: ignore[attr-defined]  # noqa: B018
