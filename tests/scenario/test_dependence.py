"""A scenario stays valid as long as what it depends on in its world is the same."""

from dataclasses import replace

import pytest
from tests.coded import coded
from tests.scenario.small_world import GOOD, WORLD, human, people

from rvsg.core.errors import InputError
from rvsg.scenario.scenario import HumanConfiguration, Mission, Scenario
from rvsg.scenario.validity import check, warnings
from rvsg.scenario.variation import changes_that_matter, migrate, same_floor, waypoints_used
from rvsg.world.world import World

MISSION = Mission.of(WORLD, WORLD.routes[0])
PEOPLE: HumanConfiguration = people(human(*GOOD))


def with_waypoint_moved(name: str, by: float) -> World:
    moved = tuple(w.model_copy(update={"x": w.x + by}) if w.name == name else w for w in WORLD.grid.waypoints)
    return replace(WORLD, grid=WORLD.grid.model_copy(update={"waypoints": moved}))


def relabelled() -> World:
    areas = tuple(a.model_copy(update={"name": f"New {a.name}"}) for a in WORLD.areas)
    more = WORLD.routes[0].model_copy(update={"name": "another"})
    return replace(WORLD, areas=areas, routes=(*WORLD.routes, more), activities=("sweeping",))


def rules(world: World) -> list[str]:
    return [finding.rule for finding in check(PEOPLE, MISSION, world)]


def test_new_labels_routes_and_activities_keep_a_scenario_valid() -> None:
    world = relabelled()
    assert world.id != WORLD.id
    assert changes_that_matter(PEOPLE, MISSION, world) == ()
    assert rules(world) == rules(WORLD)
    assert {f.rule for f in warnings(PEOPLE, MISSION, world)} >= {"unknown-area"}


def test_a_waypoint_that_is_used_and_moved_is_named_with_its_distance() -> None:
    used = waypoints_used(PEOPLE)[1]
    changes = changes_that_matter(PEOPLE, MISSION, with_waypoint_moved(used, 0.4))
    assert changes == (f"Waypoint {used} moved by 0.4 m.",)
    assert "wrong-world" in rules(with_waypoint_moved(used, 0.4))


def test_a_waypoint_that_nobody_uses_may_move() -> None:
    unused = next(w.name for w in WORLD.grid.waypoints if w.name not in waypoints_used(PEOPLE))
    assert changes_that_matter(PEOPLE, MISSION, with_waypoint_moved(unused, 0.4)) == ()


def test_a_changed_floor_matters() -> None:
    world = replace(WORLD, lidar_height_m=WORLD.lidar_height_m + 0.1)
    assert not same_floor(MISSION, world)
    assert len(changes_that_matter(PEOPLE, MISSION, world)) == 1


def test_a_mission_of_an_earlier_version_keeps_its_id_and_fits_its_own_world_alone() -> None:
    old = MISSION.model_copy(update={"parts": None})
    assert "parts" not in old.model_dump(mode="json")
    assert Mission.from_json(old.to_json()) == old
    assert same_floor(old, WORLD) and not same_floor(old, relabelled())
    assert len(changes_that_matter(PEOPLE, old, relabelled())) == 1


def test_migrating_takes_the_nearest_waypoints_and_refuses_what_is_too_far() -> None:
    used = waypoints_used(PEOPLE)[1]
    scenario = Scenario(mission=MISSION, people=PEOPLE)
    world = with_waypoint_moved(used, 0.4)
    migrated, changes = migrate(scenario, world)
    assert migrated.mission.world_id == world.id
    assert len(changes) == 1 and changes[0].startswith(f"Waypoint {used} becomes {used}, 0.40 m")
    assert changes_that_matter(migrated.people, migrated.mission, world) == ()
    with pytest.raises(InputError, check=coded("waypoint-too-far")):
        migrate(scenario, world, reach_m=0.1)
