from __future__ import annotations

import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from tests.published_data import published_data
from tests.world.parts import map_of, walled
from tests.world.test_passages import two_rooms

from rvsg.core.records import Pose
from rvsg.findings.feedback import rehearsing
from rvsg.generation.facts import brief_facts, neighbour_rule, route_facts, world_facts
from rvsg.generation.prompts import Prompts
from rvsg.scenario.brief import Brief
from rvsg.scenario.placement import spawn_findings
from rvsg.scenario.requirement import load_requirement
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Task
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.world.creation import world_from
from rvsg.world.grid import Grid, Waypoint
from rvsg.world.lattice import build_world
from rvsg.world.passages import free_width_m
from rvsg.world.world import Area, Route, World

DATA = published_data()


def joined_by_rule(grid: Grid) -> set[frozenset[str]]:
    """The pairs that a reader of the rule and its exceptions takes for neighbours."""
    rule = neighbour_rule(grid, grid.hops)
    valid = [w for w in grid.waypoints if w.human]
    pairs = set()
    for a, b in combinations(valid, 2):
        down, right = abs(a.row - b.row), abs(a.column - b.column)
        if max(down, right) == 1 and (rule["diagonal"] or down + right == 1):
            pairs.add(frozenset((a.name, b.name)))
    pairs -= {frozenset((entry["name"], other)) for entry in rule["not_joined"] for other in entry["to"]}
    return pairs | {frozenset((entry["name"], other)) for entry in rule["also_joined"] for other in entry["to"]}


@pytest.mark.parametrize(
    "name",
    [
        "warehouse",
        *(pytest.param(name, marks=pytest.mark.exhaustive)
          for name in ("hunav_bookstore", "nav2_warehouse", "nav2_tb3_sandbox")),
    ],
)  # fmt: skip
def test_rule_and_exceptions_say_exactly_who_is_whose_neighbour(warehouse: World, name: str) -> None:
    if name != "warehouse" and DATA is None:
        pytest.skip("the public maps are not at hand")
    maps = DATA / "maps" if DATA else Path()
    world = warehouse if name == "warehouse" else world_from("map", maps / f"{name}.yaml", name=name).world
    facts = world_facts(world)
    assert facts["row_axis"] == world.grid.up
    for key in ("rows", "columns"):
        values = [line["at"] for line in facts[key]]
        assert values in (sorted(values), sorted(values, reverse=True))
        assert len(set(values)) == len(values)
    assert joined_by_rule(world.grid) == {frozenset(hop) for hop in world.grid.hops}


def test_a_prompt_says_how_fast_and_large_the_robot_is_and_what_moves_the_value(brief: Brief, warehouse: World) -> None:
    robot = brief_facts(brief, warehouse)["robot"]
    assert (robot["speed_m_s"], robot["length_m"], robot["goal_tolerance_m"]) == pytest.approx((0.5, 0.7, 0.25))
    moved = brief.replace(requirement=load_requirement("R1"), moved_by="People who stay near.")
    text = Prompts().render("_requirement", brief_facts(moved, warehouse))
    assert "What moves it: People who stay near." in text


def grid_up_y() -> Grid:
    """Rows differ in y, as in most maps; one straight hop is missing, and no diagonal is free."""
    waypoints = tuple(
        Waypoint(name=f"{'AB'[row]}{column + 1}", x=10.0 + 2 * column, y=5.0 - 1.5 * row, row=row, column=column)
        for row in range(2)
        for column in range(3)
    )
    hops = (("A1", "A2"), ("A2", "A3"), ("A1", "B1"), ("B1", "B2"), ("B2", "B3"), ("A3", "B3"))
    return Grid(rows=("A", "B"), columns=("1", "2", "3"), waypoints=waypoints, hops=hops)


def test_coordinates_are_those_along_which_rows_differ(warehouse: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rvsg.generation.facts.is_walkable", lambda a, b, world: True)
    facts = world_facts(replace(warehouse, grid=grid_up_y(), areas=()))
    assert (facts["row_axis"], facts["column_axis"]) == ("y", "x")
    assert facts["rows"] == [{"name": "A", "at": 5.0}, {"name": "B", "at": 3.5}]
    assert [column["at"] for column in facts["columns"]] == [10.0, 12.0, 14.0]
    assert facts["diagonal"] is False
    assert facts["not_joined"] == [{"name": "A2", "to": ["B2"]}]
    assert joined_by_rule(grid_up_y()) == {frozenset(hop) for hop in grid_up_y().hops}
    text = Prompts().render("environment-2-grid", {**facts, "heights": False})
    assert "Rows by their y in metres: A 5, B 3.5" in text


def test_a_hop_that_nobody_fits_through_is_not_joined(warehouse: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """The checker refuses it, so the prompt must not offer it."""
    monkeypatch.setattr("rvsg.generation.facts.is_walkable", lambda a, b, world: {a, b} != {"A1", "A2"})
    facts = world_facts(replace(warehouse, grid=grid_up_y(), areas=()))
    assert facts["not_joined"] == [{"name": "A1", "to": ["A2"]}, {"name": "A2", "to": ["B2"]}]
    assert {entry["name"]: entry["to"] for entry in facts["neighbours"]}["A1"] == ["B1"]


def test_the_prompt_names_the_distance_of_starts_that_the_checker_keeps(brief: Brief, warehouse: World) -> None:
    told = float(brief_facts(brief, warehouse)["route"]["apart_m"])
    assert f"two people less than {told:g} m apart" in Prompts().render("_starts", brief_facts(brief, warehouse))

    def findings(apart_m: float) -> list[str]:
        walks = ({"tasks": (Task(name="a", path=("G16", "G17")),), "start": (x, -7.0)} for x in (0.8, 0.8 + apart_m))
        people = HumanConfiguration(humans=tuple(Human(name=f"Human {k}", **walk) for k, walk in enumerate(walks)))
        return [each.rule for each in spawn_findings(people, brief.mission, warehouse)]

    assert findings(told - 0.01) == ["spawn-on-human"]
    assert findings(told + 0.01) == []


def test_a_person_acts_against_the_robot_only_where_that_is_asked_for(brief: Brief, warehouse: World) -> None:
    usual = brief_facts(brief, warehouse)
    provoked = brief_facts(brief, warehouse, provoking=True)
    assert "threatening" not in {behaviour["name"] for behaviour in usual["behaviours"]}
    assert "threatening" in {behaviour["name"] for behaviour in provoked["behaviours"]}
    system = [Prompts().render("system", facts) for facts in (usual, provoked)]
    assert "do not act against the robot" in system[0]
    assert "do not act against the robot" not in system[1]


@pytest.fixture
def bare() -> World:
    """A hall of 10 x 6 m that is nothing but a map, with a pillar beside the route and labels for pillar and floor."""
    cells = walled(120, 200)
    cells[40:50, 90:100] = 100
    pillar = Area(name="Obstacle 1", kind="obstacle", outline=((4.5, 2), (5, 2), (5, 2.5), (4.5, 2.5)), waypoints=())
    floor = Area(name="Floor", kind="floor", outline=((1, 4), (9, 4), (9, 5.5), (1, 5.5)), waypoints=())
    start, goal = Pose(x=1.5, y=3.5), Pose(x=8.5, y=3.5)
    route = Route(name="by", start=start, goal=goal, time_limit_s=30, purpose="from Obstacle 1 to Obstacle 9")
    return build_world(name="hall", occupancy=map_of(cells), areas=(pillar, floor), routes=(route,))


def test_a_route_names_no_place_that_the_list_of_labels_does_not_hold(bare: World) -> None:
    (route,) = bare.routes
    stale, known = (
        route_facts(Mission.of(bare, r), bare) for r in (route, route.replace(purpose="from Obstacle 1 to Floor"))
    )
    assert stale["purpose"] == "" and "Obstacle 9" not in stale["description"]
    assert known["purpose"] == "from Obstacle 1 to Floor" and known["purpose"] in known["description"]
    own = route_facts(Mission.of(bare, route.replace(purpose="a tour of the stores")), bare)
    assert own["purpose"] == "a tour of the stores"


def test_things_of_a_bare_map_have_a_size_and_the_way_has_its_free_width(bare: World, warehouse: World) -> None:
    sizes = {area["name"]: area["size"] for area in world_facts(bare)["areas"]}
    assert sizes == {"Obstacle 1": "0.5 x 0.5 m", "Floor": ""}
    assert not any(area["size"] for area in world_facts(warehouse)["areas"])  # its objects have theirs
    mission = Mission.of(bare, bare.routes[0])
    drive = rehearsing(KinematicSimulator(), bare, seed=1)(mission, HumanConfiguration(humans=()))
    facts = brief_facts(Brief(mission=mission, requirement=load_requirement("R1"), seed=3), bare, undisturbed=drive)
    lines = Prompts().render("compact-context", world_facts(bare) | facts).splitlines()
    (told,) = (line for line in lines if "Without people it is" in line)
    widths = [float(width) for width in re.findall(r"\(([\d.]+)\)", told)]
    assert len(widths) == len(drive.robot)
    ways = np.array([(x, y) for _, x, y in drive.way])
    beside = min(free_width_m(bare, x, y, yaw=0.0) for x, y in ways)  # beside the pillar
    assert beside == pytest.approx(min(widths), abs=0.2) and max(widths) > min(widths) + 1.0


def test_the_text_of_a_route_and_the_list_of_its_waypoints_tell_one_width_of_a_narrow_place() -> None:
    world = two_rooms()
    mission = Mission.of(world, world.routes[0])
    drive = rehearsing(KinematicSimulator(), world, seed=1)(mission, HumanConfiguration(humans=()))
    facts = brief_facts(Brief(mission=mission, requirement=load_requirement("R1"), seed=3), world, undisturbed=drive)
    (told,) = re.findall(r"free width ([\d.]+) m", facts["route"]["description"])
    assert min(point["width_m"] for point in facts["drive"]["line"]) == float(told)
