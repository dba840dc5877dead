"""Families of scenarios with ranges, and scenarios whose world changed."""

from dataclasses import replace
from typing import Any

import pytest
from tests.coded import coded
from tests.scenario.small_world import GOOD, WORLD, human, people

import rvsg
from rvsg.core.errors import InputError, UnknownName
from rvsg.scenario.scenario import Attention, HumanConfiguration, Mission, Scenario
from rvsg.scenario.validity import check, warnings
from rvsg.scenario.variation import changes_that_matter, family_of, migrate, same_floor, waypoints_used
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


def test_a_waypoint_that_is_used_and_moved_is_named_with_its_distance_and_any_other_may_move() -> None:
    used = waypoints_used(PEOPLE)[1]
    moved = with_waypoint_moved(used, 0.4)
    assert changes_that_matter(PEOPLE, MISSION, moved) == (f"Waypoint {used} moved by 0.4 m.",)
    assert "wrong-world" in rules(moved)
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
    old = scenario.mission.route
    elsewhere = replace(world, routes=(old.replace(goal=old.start, start=old.goal),))
    assert migrate(scenario, elsewhere)[1][-1].startswith(f"{old.name} stays as it was saved")
    assert len(migrate(scenario, elsewhere, route=elsewhere.routes[0])[1]) == 1


@pytest.fixture
def value() -> dict[str, Any]:
    world = rvsg.load_world("warehouse")
    people = [rvsg.walk("Human 1", "E15", "H15", pauses_s={"H15": 3.0}), rvsg.walk("Human 10", "E12", "H12")]
    return rvsg.scenario(world, "route_1", people).model_dump(mode="json")


def test_a_range_in_the_file_and_one_given_besides_span_a_family(value: dict[str, Any]) -> None:
    value["people"]["humans"][0]["speed_m_s"] = "0.8 to 1.4"
    family = family_of(value, ["Human 10.start_delay_s=0 to 5"])
    assert [(each.name, each.low, each.high) for each in family.ranges] == [
        ("Human 1.speed_m_s", 0.8, 1.4),
        ("Human 10.start_delay_s", 0.0, 5.0),
    ]
    first, second = family.at((0.9, 4.5)).people.humans
    assert (first.speed_m_s, second.start_delay_s) == (0.9, 4.5)
    assert family.middle.people.humans[0].speed_m_s == pytest.approx(1.1)
    assert family.at((0.9, 4.5)).mission == family.middle.mission


def test_a_pause_may_vary(value: dict[str, Any]) -> None:
    pauses = [
        (k, len(task["pauses"])) for k, task in enumerate(value["people"]["humans"][0]["tasks"]) if task["pauses"]
    ]
    (task, _), *_ = pauses
    family = family_of(value, [f"Human 1.tasks[{task}].pauses[0].duration_s=1 to 9"])
    assert family.at((7.0,)).people.humans[0].tasks[task].pauses[0].duration_s == 7.0


def test_attention_varies_by_its_words(value: dict[str, Any]) -> None:
    value["people"]["humans"][1]["attention"] = "distracted to unseeing"
    family = family_of(value, ["Human 1.attention=attentive to unseeing"])
    assert [str(each) for each in family.ranges] == ["distracted to unseeing", "attentive to unseeing"]
    assert [family.at((0.0, each)).people.humans[0].attention.value for each in (0.9, 1.0, 2.5, 3.0)] == [
        "attentive", "distracted", "unseeing", "unseeing",
    ]  # fmt: skip
    assert family.middle.people.humans[0].attention is Attention.DISTRACTED


ATTENTIONS = ("unseeing to attentive", "attentive to attentive", "0 to 1", "attentive")


@pytest.mark.parametrize("words", ATTENTIONS)
def test_a_range_of_attention_that_cannot_be_used_is_refused(value: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError):
        family_of(value, [f"Human 1.attention={words}"])


UNUSABLE = ("", "=fast", "=1.4 to 0.8", "=1 to 1", "=-1 to 1")


@pytest.mark.parametrize("vary", [*(f"Human 1.speed_m_s{r}" for r in UNUSABLE), "Human 3.speed_m_s=1 to 2", "=1 to 2"])
def test_a_range_that_cannot_be_used_is_refused(value: dict[str, Any], vary: str) -> None:
    with pytest.raises(InputError):
        family_of(value, [vary])


def test_an_unknown_number_is_told_with_the_nearest(value: dict[str, Any]) -> None:
    with pytest.raises(UnknownName, check=lambda error: "speed_m_s" in error.known):
        family_of(value, ["Human 1.sped_m_s=1 to 2"])


def test_only_people_may_vary_and_a_scenario_without_a_range_is_no_family(value: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        family_of(value)
    value["mission"]["route"]["time_limit_s"] = "20 to 30"
    with pytest.raises(InputError):
        family_of(value)


def test_a_description_that_speaks_of_a_range_is_none(value: dict[str, Any]) -> None:
    value["description"] = "1 to 2"
    assert len(family_of(value, ["Human 1.speed_m_s=1 to 2"]).ranges) == 1


def test_what_changes_nothing_for_who_is_on_a_track_may_not_vary(value: dict[str, Any]) -> None:
    human = value["people"]["humans"][0]
    places = [[1.0, 0.1 * k] for k in range(200)]
    tracks: dict[str, dict[str, Any]] = {
        "as-recorded": {"points": places},
        "blended": {"points": places, "until_m": 0.5},
        "appears": {"points": places[:1], "leaves": False},
    }
    for form, track in tracks.items():
        human |= {"track": track, "start": places[0]}
        assert family_of(value, ["Human 1.track.start_s=0 to 2"]).ranges[0].high == 2.0
        for key in ("start[0]", "start_delay_s"):
            with pytest.raises(UnknownName, match="--people intent") as refused:
                family_of(value, [f"Human 1.{key}=0 to 1"])
            assert "track.points[10]" not in str(refused.value)
        if form == "as-recorded":
            for span in ("attention=attentive to unseeing", "speed_m_s=0.8 to 1.4"):
                with pytest.raises(UnknownName):
                    family_of(value, [f"Human 1.{span}"])
        else:
            assert family_of(value, ["Human 1.speed_m_s=0.8 to 1.4"])
