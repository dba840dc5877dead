import csv
import json

import pytest
from tests.coded import coded
from tests.study.study_files import lines_of, put, write_log, write_logged, write_scenario

from rvsg.core.errors import FileError
from rvsg.store.sqlite import SqliteLedger
from rvsg.world.world_folder import load_world
from rvsg_study.import_study import import_study, write_findings


@pytest.fixture
def store(tmp_path):
    with SqliteLedger(tmp_path / "ledger.sqlite") as ledger:
        yield ledger


@pytest.fixture
def results(tmp_path):
    root = tmp_path / "results"
    write_scenario(root / "distance" / "route_1" / "0", configurations=3)
    return root


def read(results, store):
    return import_study(results, store, load_world("warehouse"))


def only(results):
    return results / "distance" / "route_1" / "0"


def test_runs_scenarios_and_logged_metrics_arrive_in_the_store(results, store):
    done = read(results, store)
    assert (done.campaigns, done.attempts, done.runs, done.findings) == (1, 3, 3, [])
    attempts = list(store.attempts("distance/route_1"))
    assert [a.brief.configuration_index for a in attempts] == [0, 1, 2]
    first = attempts[0]
    assert first.proposal.scenario.people.humans[0].tasks[0].path == ("G7", "G8", "G9")
    run = store.run(first.measurements[0].run_id)
    assert run.details["logged"]["dto_logged"] == pytest.approx(first.measurements[0].values["dto_logged"], abs=1e-12)
    assert first.measurements[0].objective == first.measurements[0].values["dto_logged"]


def test_an_import_can_be_repeated_without_doubling_anything(results, store):
    read(results, store)
    assert read(results, store).attempts == 0
    assert len(list(store.attempts("distance/route_1"))) == 3


def test_a_logged_value_that_the_log_does_not_give_is_a_finding(results, store):
    path = only(results) / "log.csv"
    lines = lines_of(path)
    lines[2][lines[0].index("path_length")] = "9.5"
    put(path, lines)
    (finding,) = read(results, store).findings
    assert finding.file.endswith("log_1.csv")
    assert "path_length = 9.5, the log gives 1.25" in finding.message


def drop_column(lines):
    at = lines[0].index("robot_speed")
    return [line[:at] + line[at + 1 :] for line in lines]


def change(row, column, value):
    def edit(lines):
        lines[row][lines[0].index(column)] = value
        return lines

    return edit


@pytest.mark.parametrize(
    ("edit", "reason"),
    [
        (drop_column, "the column robot_speed missing"),
        (change(3, "robot_x", "nan"), "line 4: robot_x is"),
        (change(3, "worker2_y", ""), "line 4: worker2_y is"),
        (change(4, "timestamp", "0.1"), "time does not increase at line 5"),
        (change(4, "timestamp", "1.0"), "time does not increase at line 5"),
        (change(2, "robot_orientation_w", "0.5"), "line 3: the orientation of robot"),
        (lambda lines: lines[:2], "1 row: a run needs at least two"),
        (lambda lines: [*lines[:-1], lines[-1][:7]], "line 7 has 7 values, expected 19: is the file cut off?"),
        (lambda lines: [], "the file is empty"),
    ],
)
def test_a_log_that_cannot_be_trusted_gives_no_numbers_but_a_reason(results, store, edit, reason):
    path = only(results) / "log_1.csv"
    put(path, edit(lines_of(path)))
    done = read(results, store)
    assert (done.runs, done.refused) == (2, 1)
    (finding,) = [f for f in done.findings if f.kind == "log"]
    assert reason in finding.message
    attempt = list(store.attempts("distance/route_1"))[1]
    assert attempt.measurements == ()
    assert reason in attempt.failures[0].reason
    assert attempt.proposal.scenario is not None


def test_unknown_waypoints_are_kept_and_listed(results, store):
    path = only(results) / "distance_model_0.json"
    value = json.loads(path.read_text())
    value["Worker 1 Tasks"][0]["Path"] = ["G7", "Z99", "G9"]
    value["Worker 2 Tasks"][0]["Path"] = []
    path.write_text(json.dumps(value))
    told = [finding.message for finding in read(results, store).findings]
    assert 'Human 1, task "G7 → G9", waypoint 2: there is no waypoint "Z99"; kept' in told
    assert 'Human 2, task "G14 → G13": the path is empty' in told
    assert any("Human 2 has no known waypoint to go to" in message for message in told)
    first = next(iter(store.attempts("distance/route_1")))
    assert first.proposal.scenario.people.humans[0].tasks[0].path == ("G7", "Z99", "G9")


@pytest.mark.parametrize(
    ("file", "kept", "told"),
    [
        ("distance_model_0.json", 80, "is the file cut off?"),
        ("distance_scenario_model.json", 24, "the description is lost"),
        ("log.csv", None, "log.csv is missing"),
        ("log_2.csv", None, "there is no log_2.csv"),
    ],
)
def test_what_is_cut_off_or_missing_is_said_to_be(results, store, file, kept, told):
    path = only(results) / file
    text = path.read_text()
    path.unlink()
    if kept is not None:
        path.write_text(text[:kept])
    done = read(results, store)
    assert any(told in finding.message for finding in done.findings)
    assert done.runs == (2 if file == "log_2.csv" else 3)
    lost = next(iter(store.attempts("distance/route_1"))).proposal.scenario is None
    assert lost is (file == "distance_model_0.json")


def test_the_run_that_selected_a_scenario_is_found_among_its_repeats(results, store):
    folder = write_scenario(results / "best_scenario" / "distance" / "route_1" / "0")
    (folder / "log_0.csv").write_bytes((only(results) / "log_2.csv").read_bytes())
    for k in (1, 2, 3):
        write_log(folder / f"log_{k}.csv", offset=0.01 * k)
    write_logged(folder)
    assert read(results, store).findings == []
    (attempt,) = store.attempts("best_scenario/distance/route_1")
    assert attempt.purpose == "confirmation"
    assert len(attempt.measurements) == 4
    assert attempt.proposal.extra["selected_by"] == [attempt.measurements[0].run_id]


def test_strange_folders_and_routes_are_listed(results, store):
    write_scenario(results / "distance" / "route_99" / "0")
    (results / "notes").mkdir()
    told = [f"{finding.file}: {finding.message}" for finding in read(results, store).findings]
    assert any(line.startswith("notes: this folder fits nowhere") for line in told)
    assert any(line.startswith("distance/route_99: left out: There is no route") for line in told)


def test_a_folder_without_the_layout_is_refused_with_what_was_expected(tmp_path, store):
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileError, check=coded("study-layout")):
        read(tmp_path / "empty", store)


def test_findings_are_written_as_a_table(results, store, tmp_path):
    (only(results) / "log.csv").unlink()
    write_findings(read(results, store).findings, tmp_path / "findings.csv")
    with (tmp_path / "findings.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[0]["file"] == "distance/route_1/0/log.csv"
    assert {"file", "kind", "message"} == set(rows[0])
