"""Repair of configurations: of any that can be drawn, and of those that the published study ran."""

import json
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.published_data import published_data
from tests.scenario.small_world import GOOD, MISSION, WORLD, human, people

from rvsg.scenario.repair import repair
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Pause, Task
from rvsg.scenario.validity import check
from rvsg.world.world_folder import load_world

words = st.sampled_from([*WORLD.grid.by_name, "Z9", "e-1", "A 2", "", "Dock"])
sides = st.sampled_from([*(area.name for area in WORLD.areas), "Dokc", "Corridor", "B2", "Dock (A1)"])
names = st.one_of(
    st.builds(lambda a, b: f"{a} → {b}", sides, sides), st.sampled_from(["walk", "Dock", "→", "a -> b -> c"])
)
pauses = st.lists(st.builds(Pause, at=words, duration_s=st.floats(0.5, 20)), max_size=2).map(tuple)
tasks = st.builds(
    Task, name=names, path=st.lists(words, max_size=6).map(tuple), start_area=st.none() | sides,
    end_area=st.none() | sides, pauses=pauses,
)  # fmt: skip
humans = st.builds(
    Human, name=st.sampled_from(["Ada", "Bob", "Cem"]), tasks=st.lists(tasks, min_size=1, max_size=4).map(tuple),
    speed_m_s=st.floats(0.01, 3.0), group=st.none() | st.integers(1, 2),
)  # fmt: skip
configurations = st.lists(humans, min_size=1, max_size=3).map(lambda hs: HumanConfiguration(humans=tuple(hs)))


@given(configurations)
def test_what_is_repaired_is_valid_or_said_to_be_beyond_repair(configuration: HumanConfiguration) -> None:
    mended, repairs = repair(configuration, MISSION, WORLD)
    left = check(mended, MISSION, WORLD)
    wholly_without_work = {
        h.name for h in mended.humans if len({n for t in h.tasks for n in t.path if n in WORLD.grid.valid}) < 2
    }
    for finding in left:
        assert finding.human in wholly_without_work, f"{finding}"
    assert bool(repairs) or mended == configuration
    if not left:
        assert repair(mended, MISSION, WORLD) == (mended, ())


def test_tasks_of_one_waypoint_each_become_a_walk() -> None:
    stops = tuple(Task(name="walk", path=(name,)) for name in ("A1", "A2"))
    mended, _ = repair(HumanConfiguration(humans=(Human(name="Ada", tasks=stops),)), MISSION, WORLD)
    assert {"A1", "A2"} <= {name for task in mended.humans[0].tasks for name in task.path}
    assert check(mended, MISSION, WORLD) == ()


def test_a_long_hop_is_walked_by_the_shortest_path_and_said() -> None:
    mended, (change,) = repair(people(human("Dock → Store: A1 E1", GOOD[1])), MISSION, WORLD)
    assert mended.humans[0].tasks[0].path == ("A1", "B1", "C1", "D1", "E1")
    assert (change.human, change.task, change.before) == ("Ada", "Dock → Store", ("A1", "E1"))


def test_a_hop_through_the_shelf_goes_around_it() -> None:
    mended, _ = repair(people(human("over: B2 C2 D2 C1 B2")), MISSION, WORLD)
    path = mended.humans[0].tasks[0].path
    assert path[:2] == ("B2", "C2") and path[-1] == "B2" and len(path) == 6
    assert not check(mended, MISSION, WORLD)


def test_a_task_between_two_that_are_not_joined_is_put_in() -> None:
    mended, repairs = repair(people(human(GOOD[0], "Office → Dock: E6 D6 C6 B6 A5 A4 A3 A2 A1")), MISSION, WORLD)
    assert [task.name for task in mended.humans[0].tasks] == ["Dock → Store", "Store → Office", "Office → Dock"]
    assert (repairs[0].before, repairs[0].after) == ((), mended.humans[0].tasks[1].path)


def test_an_open_loop_is_closed_by_a_way_back() -> None:
    mended, _ = repair(people(human(GOOD[0])), MISSION, WORLD)
    assert [task.name for task in mended.humans[0].tasks] == ["Dock → Store", "Store → Dock"]


def test_somebody_who_starts_on_the_robot_starts_beside_it_and_keeps_the_work() -> None:
    mended, _ = repair(people(human("walk about: B4 B5 B6 B5 B4")), MISSION, WORLD)
    (task,) = mended.humans[0].tasks
    assert task.path[0] != "B4" and not check(mended, MISSION, WORLD)


def test_somebody_whose_only_area_is_taken_starts_with_another_task() -> None:
    ways = ("E1 → E2: E1 E2", "E2 → E1: E2 E1")
    mended, (_,) = repair(people(human(*ways), human(*ways, name="Bob")), MISSION, WORLD)
    assert mended.humans[1].tasks[0].name == "E2 → E1"


def test_a_misspelt_waypoint_is_read_and_an_unknown_one_left_out_and_both_are_said() -> None:
    mended, repairs = repair(people(human("Dock → Dock: A1 a-2 Q9 A1")), MISSION, WORLD)
    assert mended.humans[0].tasks[0].path == ("A1", "A2", "A1")
    assert ["A2" in change.what or "Q9" in change.what for change in repairs] == [True, True]


def test_the_good_comes_back_as_it_is_and_who_cannot_be_given_work_stays_invalid() -> None:
    good = people(human(*GOOD))
    assert repair(good, MISSION, WORLD) == (good, ())
    mended, _ = repair(people(human("walk: Q1 Q2")), MISSION, WORLD)
    assert check(mended, MISSION, WORLD)


def read(path: Path) -> HumanConfiguration | None:
    workers = json.loads(path.read_text(encoding="utf-8"))
    if not all(workers.values()):
        return None
    return HumanConfiguration(
        humans=tuple(
            Human(name=name, tasks=tuple(Task(name=t["Task"], path=tuple(t["Path"])) for t in tasks))
            for name, tasks in workers.items()
        )
    )


@pytest.mark.exhaustive
def test_what_the_study_ran_is_repaired_into_valid_configurations() -> None:
    folder = published_data()
    if folder is None:
        pytest.skip("the published data is not here")
    world, found = load_world("warehouse"), Counter[str]()
    for route in ("route_1", "route_2", "route_3"):
        mission = Mission.of(world, world.route(route))
        paths = sorted((folder / "published" / "distance" / route).glob("*/distance_*_[0-4].json"))
        configurations = [c for c in map(read, paths) if c is not None]
        assert len(configurations) > 40
        for configuration in configurations:
            found.update(f.rule for f in check(configuration, mission, world))
            mended, _ = repair(configuration, mission, world)
            assert check(mended, mission, world) == ()
    assert found["invalid-waypoint"] > 10
    assert found["not-neighbours"] > 1000
