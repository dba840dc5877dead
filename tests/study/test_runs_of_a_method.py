"""Tables of own campaigns count the runs of the search, and none that explain a failure."""

from __future__ import annotations

from tests.campaign.parts import MemoryLedger, plan, searched

from rvsg.search.strategies import StudyStrategy
from rvsg_study.study_tables import gather


def test_runs_without_some_of_the_people_are_no_runs_of_the_method() -> None:
    ledger = MemoryLedger()
    attempts = searched(StudyStrategy, plan(scenarios=2, refinements=0, repeats=1, confirmations=20), ledger)
    assert {"search", "baseline"} <= {each.purpose for each in attempts}
    trials = [trial for methods in gather(ledger).trials.values() for each in methods.values() for trial in each]
    assert len(trials) == sum(each.purpose == "search" for each in attempts)
