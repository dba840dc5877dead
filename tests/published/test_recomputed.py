"""Our metrics of the published raw logs against the values the study's client logged."""

import pytest
from tests.published_data import published_data

from rvsg.evaluation.metrics import measure
from rvsg.store.sqlite import SqliteLedger
from rvsg.world.world_folder import load_world
from rvsg_study.import_study import import_study
from rvsg_study.study_folder import EXACT, TOLERANCE

FOLDER = published_data()
pytestmark = [
    pytest.mark.exhaustive,
    pytest.mark.skipif(FOLDER is None, reason="the published study's data is not here"),
]


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    path = tmp_path_factory.mktemp("published") / "ledger.sqlite"
    with SqliteLedger(path) as ledger:
        yield import_study(FOLDER / "published", ledger, load_world("warehouse")), ledger


def test_every_run_is_imported_and_every_logged_metric_equals_ours(imported):
    done, _ = imported
    assert (done.runs, done.refused, done.compared) == (1050, 0, 1050)
    assert [f for f in done.findings if f.kind in ("metrics", "log")] == []


def test_all_sixteen_logged_metrics_were_there_to_compare(imported):
    _, ledger = imported
    for name in ledger.campaigns():
        for attempt in ledger.attempts(name):
            for measurement in attempt.measurements:
                run = ledger.run(measurement.run_id)
                logged = run.details["logged"]
                assert len(logged) == 16
                ours = measure(run, logged)
                assert all(abs(ours[key] - logged[key]) <= TOLERANCE.get(key, EXACT) for key in logged)


def test_every_repeated_scenario_holds_the_run_that_selected_it(imported):
    _, ledger = imported
    repeated = [name for name in ledger.campaigns() if "_scenario/" in name]
    assert len(repeated) == 18
    for name in repeated:
        (attempt,) = ledger.attempts(name)
        assert attempt.proposal.extra["selected_by"] == [attempt.measurements[0].run_id]
        assert len(attempt.measurements) == 30
