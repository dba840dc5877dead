"""The study has five routes; any subset of routes and requirements is read and tabulated."""

import csv

import pytest
from tests.study.study_files import write_log, write_logged, write_scenario

from rvsg.store.sqlite import SqliteLedger
from rvsg.world.world_folder import load_world
from rvsg_study.import_study import import_study
from rvsg_study.table_files import write_tables

ROUTES = ("route_1", "route_4", "route_5")


def tabulated(root, folder):
    """The findings of an import, the time limits of its runs by route, and the rows of every table."""
    with SqliteLedger(folder / "ledger.sqlite") as ledger:
        findings = import_study(root, ledger, load_world("warehouse")).findings
        limits = {
            a.brief.mission.route.name: ledger.run(a.measurements[0].run_id).time_limit_s
            for campaign in ledger.campaigns()
            for a in ledger.attempts(campaign)
        }
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("rvsg_study.table_files.can_draw", lambda: False)  # figures take seconds
            write_tables(ledger, out=folder / "tables")
    rows = {}
    for path in (folder / "tables").glob("*/*.csv"):
        with path.open(newline="") as file:
            rows[path.parent.name, path.stem] = list(csv.DictReader(file))
    return findings, limits, rows


def scenario(folder, route, *, repeats=0, **options):
    """A scenario folder whose `log.csv` fits the goal and the time limit of the route."""
    write_scenario(folder, description="", **options)
    for k in range(1, repeats):
        write_log(folder / f"log_{k}.csv", offset=options.get("offset", 0.0) + 0.001 * k)
    write_logged(folder, goal=(route.goal.x, route.goal.y, route.goal.yaw), limit=route.time_limit_s)


@pytest.fixture(scope="module")
def three_routes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("routes")
    root = folder / "results"
    world = load_world("warehouse")
    for name in ROUTES:
        route = world.route(name)
        for at in range(2):
            scenario(root / "reach" / name / str(at), route, requirement="reach", configurations=2, offset=0.1 * at)
            for method in ("no_req", "random"):
                scenario(root / method / name / str(at), route, requirement=method, offset=0.5 + 0.1 * at)
        for which in ("best", "worst"):
            place = root / f"{which}_scenario" / "reach" / name / "0"
            scenario(place, route, requirement="reach", repeats=4, offset=0.2)
    return tabulated(root, folder)


def test_every_route_keeps_its_own_time_limit_and_goal(three_routes):
    findings, limits, _ = three_routes
    assert limits == {"route_1": 25.0, "route_4": 28.0, "route_5": 35.0}
    assert findings == []


@pytest.mark.parametrize("way", ["published", "honest"])
def test_every_route_has_the_same_rows(three_routes, way):
    _, _, rows = three_routes
    for table in ("rq1", "rq3"):
        by_route = {
            name: {(r["method"], r["metric"]) for r in rows[way, table] if r["route"] == name} for name in ROUTES
        }
        assert by_route["route_1"] == by_route["route_4"] == by_route["route_5"] != set()
    spent = {r["method"]: float(r["value"]) for r in rows[way, "rq2"] if r["metric"] == "runs"}
    # The first repeat on every route is a run of the search: honestly, it does not count.
    expected = {"published": 12.0, "honest": 9.0}[way]
    assert spent == {"best": expected, "worst": expected}


def test_one_route_of_one_requirement_is_enough(tmp_path):
    route = load_world("warehouse").route("route_5")
    for at in range(2):
        scenario(tmp_path / "results" / "jerk" / "route_5" / str(at), route, requirement="jerk", configurations=2)
    findings, limits, rows = tabulated(tmp_path / "results", tmp_path)
    assert findings == [] and limits == {"route_5": 35.0}
    assert {(r["requirement"], r["route"], r["method"]) for r in rows["published", "rq1"]} == {
        ("R2", "route_5", "rvsg")
    }
    assert rows["honest", "rq2"] == [] == rows["honest", "rq3"]


def test_a_best_scenario_without_its_worst_is_tabulated_alone(tmp_path):
    route = load_world("warehouse").route("route_4")
    scenario(tmp_path / "results" / "best_scenario" / "distance" / "route_4" / "0", route, repeats=3)
    _, _, rows = tabulated(tmp_path / "results", tmp_path)
    assert {r["method"] for r in rows["published", "rq3"]} == {"best"}
    assert not any(r["metric"].endswith("_p") for r in rows["published", "rq3"])
