import csv
import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.coded import coded
from tests.study.study_files import write_log, write_logged, write_scenario

from rvsg.core.errors import InputError
from rvsg.store.sqlite import SqliteLedger
from rvsg.world.world_folder import load_world
from rvsg_study.import_study import import_study
from rvsg_study.study_folder import REQUIREMENTS
from rvsg_study.study_tables import Row, Sample, build, corrected, expected_best, gather
from rvsg_study.table_files import write_tables

METHODS = {"distance": 0.0, "no_req": 1.0, "random": 2.0}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two scenarios of three configurations, baselines of three, and repeats of a best and a worst scenario."""
    folder = tmp_path_factory.mktemp("tables")
    root = folder / "results"
    for at in range(2):
        write_scenario(root / "distance" / "route_1" / str(at), configurations=3, offset=0.01 * at, description="")
    for method in ("no_req", "random"):
        for at in range(4):
            offset = METHODS[method] + 0.02 * at
            write_scenario(root / method / "route_1" / str(at), requirement=method, offset=offset, description="")
    for which, offset in (("best", 0.0), ("worst", 0.5)):
        repeats = write_scenario(root / f"{which}_scenario" / "distance" / "route_1" / "0", description="")
        for k in range(5):
            write_log(repeats / f"log_{k}.csv", offset=offset + 0.001 * (k + 1))
        chosen = root / "distance" / "route_1" / "0" / "log_0.csv"
        (repeats / "log_0.csv").write_bytes(chosen.read_bytes())
        write_logged(repeats)
    with SqliteLedger(folder / "ledger.sqlite") as ledger:
        import_study(root, ledger, load_world("warehouse"))
        yield ledger, folder


@pytest.fixture(scope="module")
def written(made):
    ledger, folder = made
    write_tables(ledger, out=folder / "out")
    return folder / "out"


def lookup(rows):
    return {(row.requirement, row.route, row.method, row.metric): row.value for row in rows}


def test_the_published_way_takes_the_best_configuration_of_every_scenario(made):
    published, _ = build(gather(made[0]))
    found = lookup(published.rq1)
    # Offset 0 is nearest to the robot: humans stand at y = 1 + offset; gap = distance - 0.75.
    first, second = (found["R1", "route_1", method, "dto"] for method in ("rvsg", "unguided"))
    assert first < second
    assert found["R1", "route_1", "rvsg", "runs"] == 6
    assert found["R1", "route_1", "unguided", "runs"] == 4


def test_the_honest_way_spends_equally_and_takes_first_configurations_first(made):
    material = gather(made[0])
    _, honest = build(material)
    found = lookup(honest.rq1)
    assert {found["R1", "route_1", method, "runs"] for method in ("rvsg", "unguided", "random")} == {4}
    trials = material.trials["R1", "route_1"]["rvsg"]
    used = [t.samples[0].values["dto"] for t in trials if t.configuration in (0, 1)]
    assert found["R1", "route_1", "rvsg", "dto"] == pytest.approx(np.mean(used))


def test_the_honest_repeats_leave_out_the_run_that_selected(made):
    published, honest = build(gather(made[0]))
    assert lookup(published.rq3)["R1", "route_1", "best", "runs"] == 5
    assert lookup(honest.rq3)["R1", "route_1", "best", "runs"] == 4


def test_repeats_are_compared_by_mann_whitney_and_a12(made):
    material = gather(made[0])
    published, _ = build(material)
    found = lookup(published.rq2)
    best, worst = ([s.values["dto"] for s in material.repeats["R1", "route_1"][which]] for which in ("best", "worst"))
    expected = stats.mannwhitneyu(best, worst, alternative="two-sided")
    assert found["R1", "all", "best", "dto_p"] == expected.pvalue
    assert found["R1", "all", "best", "dto_a12"] == pytest.approx(expected.statistic / 25)
    assert found["R1", "all", "best", "dto_std"] == pytest.approx(np.std(best, ddof=1))


def test_the_expected_best_of_k_is_the_mean_over_every_choice():
    rng = np.random.default_rng(3)
    samples = [Sample(str(i), {"dto": float(rng.random()), "pl": float(rng.random())}, None) for i in range(7)]
    choices = list(itertools.combinations(samples, 3))
    worst = [min(choice, key=lambda s: s.values["dto"]).values["pl"] for choice in choices]
    assert expected_best(samples, "pl", REQUIREMENTS["distance"], 3) == pytest.approx(np.mean(worst))
    assert expected_best(samples[:2], "pl", REQUIREMENTS["distance"], 3) is None


def test_p_values_are_corrected_within_a_requirement_and_comparison():
    rows = [
        Row("R1", "a", "best", "dto_p", 0.01),
        Row("R1", "b", "best", "dto_p", 0.04),
        Row("R2", "a", "best", "x_p", 0.04),
    ]
    assert [row.value for row in corrected(rows)] == pytest.approx([0.02, 0.04, 0.04])


def test_all_tables_are_written_in_three_formats(written):
    for way in ("published", "honest"):
        for name in ("rq1", "rq2", "rq3"):
            with (written / way / f"{name}.csv").open(newline="") as file:
                rows = list(csv.DictReader(file))
            assert rows
            assert set(rows[0]) == {"requirement", "route", "method", "metric", "value"}
            assert "| route_1 |" in (written / way / f"{name}.md").read_text() or name == "rq2"
            tex = (written / way / f"{name}.tex").read_text()
            assert tex.count("\\begin{table}") == tex.count("\\end{table}") > 0
            assert "route\\_1" in tex or name == "rq2"


def test_a_store_without_anything_to_tabulate_is_refused(tmp_path):
    with SqliteLedger(tmp_path / "empty.sqlite") as ledger, pytest.raises(InputError, check=coded("tables-empty")):
        write_tables(ledger, out=tmp_path / "out")


def test_selection_at_equal_budgets_counts_one_run_of_every_configuration(made):
    material = gather(made[0])
    _, once = build(material)
    trials = material.trials["R1", "route_1"]["rvsg"]
    luckier = replace(trials[0].samples[0], values=dict.fromkeys(trials[0].samples[0].values, -5.0), objective=-5.0)
    trials[0] = replace(trials[0], samples=(trials[0].samples[0], luckier))
    _, repeated = build(material)
    key = ("R1", "route_1", "rvsg", "dto_best3")
    assert lookup(repeated.rq1)[key] == lookup(once.rq1)[key]


def test_a_table_without_rows_says_why_and_a_refused_run_is_named_below(tmp_path):
    """Two guided scenarios without repeats, one of whose logs cannot be read."""
    root = tmp_path / "results"
    for at in range(2):
        write_scenario(root / "distance" / "route_1" / str(at), configurations=2, offset=0.01 * at, description="")
    (root / "distance" / "route_1" / "1" / "log_1.csv").write_text("timestamp\n")
    with SqliteLedger(tmp_path / "ledger.sqlite") as ledger:
        import_study(root, ledger, load_world("warehouse"))
        said = write_tables(ledger, out=tmp_path / "out")
    assert "rq2 and rq3 are empty: the store holds no best or worst scenario that was repeated" in said
    (refused,) = [note for note in said if "run 1 left out" in note]
    assert "distance/route_1: scenario 1, configuration 1" in refused
    for way in ("published", "honest"):
        for name in ("rq1", "rq2", "rq3"):
            md, tex = ((tmp_path / "out" / way / f"{name}.{ending}").read_text() for ending in ("md", "tex"))
            for text in (md, tex):
                empty = "No rows: the store holds no best or worst scenario that was repeated."
                assert ("No rows" in text, empty in text) == (name != "rq1", name != "rq1")
            assert refused in md and "run 1 left out" in tex
            assert tex.index("Left out") > tex.rfind("\\end{table}")


def test_an_undefined_value_is_a_dash_and_the_dash_is_explained(written):
    for name in ("rq1", "rq3"):
        text = (written / "honest" / f"{name}.md").read_text()
        rows = [line for line in text.splitlines() if line.startswith("| ")]
        assert not any("|  |" in row for row in rows)
        dashed = [row for row in rows if "| – |" in row]
        assert bool(dashed) == ("–: no value." in text)
    assert "–: no value." in (written / "honest" / "rq3.md").read_text()  # the row of the numbers of runs
