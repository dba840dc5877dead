"""Scenarios made of recordings, and how they compare with what happened."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rvsg
from rvsg.app.reconstruction import rebuild, recorded_cases, suite_of_recordings, world_of_recording
from rvsg.app.suites import Suite
from rvsg.core.errors import FileError
from rvsg.evaluation.metrics import measure
from rvsg.evaluation.sampled import sampled
from rvsg.recording.fidelity import compare, estimates, recorded_as
from rvsg.recording.inspection import inspect, map_share
from rvsg.recording.intent import People, recorded_scenario
from rvsg.recording.recorded_run import recorded_run
from rvsg.recording.tracks import PersonTrack, Recording, load_recording
from rvsg.report.run_facts import judged_curve
from rvsg.robots.robot import load_robot
from rvsg.scenario.validity import check
from rvsg.scenario.variation import shifted
from rvsg.search.nearest_violation import nearest_violation
from rvsg.simulation.events import Contact
from rvsg.simulation.run import Outcome, Run
from rvsg.world.space import robot_space
from rvsg.world.world import Route, World

pytest.importorskip("rosbags", reason="the extra `bag` is not installed")
T = np.arange(0.0, 20.0, 0.1)


@pytest.fixture(scope="module")
def world() -> World:
    return rvsg.load_world("warehouse")


@pytest.fixture(scope="module")
def run(world: World) -> Run:
    scenario = rvsg.propose(world, "route_1", "R1", humans=2, seed=3).scenario
    assert scenario is not None
    return rvsg.simulate(scenario, [1], world=world)[0]


@pytest.fixture(scope="module")
def bag(run: Run, world: World, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from rvsg_exchange.bag import write_bag

    path = tmp_path_factory.mktemp("bag") / "run.mcap"
    write_bag(run, world, path)
    return path


def walker(*points: tuple[float, float, float], name: str = "Ann") -> PersonTrack:
    """Return somebody who is at (t, x, y) and walks straight between."""
    t, x, y = np.array(points).T
    times = np.arange(t[0], t[-1] + 1e-6, 0.1)
    columns = [times, np.interp(times, t, x), np.interp(times, t, y), np.zeros(len(times)), np.full(len(times), np.nan)]
    return PersonTrack(name=name, rows=np.column_stack(columns))


def recording(world: World, *people: PersonTrack) -> Recording:
    start = world.route("route_1").start
    y = start.y - np.minimum(0.5 * T, 4.0)
    robot = np.column_stack([T, np.full(len(T), start.x), y, np.full(len(T), -np.pi / 2), np.zeros((len(T), 3))])
    return Recording(source="bag", people=people, robot=robot, goal=(start.x, float(y[-1]), -np.pi / 2))


@pytest.mark.parametrize("people", list(People))
def test_a_scenario_of_an_own_run_is_valid_and_findable(bag: Path, world: World, people: People) -> None:
    scenario = recorded_scenario(
        load_recording(bag, world=world), world, people=people, route=world.route("route_1")
    ).scenario
    assert check(scenario.people, scenario.mission, world) == ()
    assert [human.name for human in scenario.people.humans] == ["Person 1", "Person 2"]
    tracked = [human.track is not None and len(human.track.points) > 1 for human in scenario.people.humans]
    assert all(tracked) == any(tracked) == (people is not People.INTENT)
    assert (scenario.mission.driven is not None) == (people is People.BLENDED)
    assert rvsg.Scenario.from_json(scenario.to_json()) == scenario


def test_recorded_people_repeat_a_run_and_the_page_shows_both(bag: Path, run: Run, world: World) -> None:
    found = rebuild(bag, world, runs=2, route="route_1", people="as-recorded")
    assert found.repeats and all(each.repeats for each in found.fidelities)
    for each in found.fidelities:
        assert each.gap_m is not None and each.gap_m[0] == pytest.approx(each.gap_m[1], abs=0.1)
        assert each.time_s[0] == pytest.approx(each.time_s[1], rel=0.05) and each.path_m < 0.5
        assert each.time_s[0] == round(float(found.made.recording.robot[-1, 0]), 2)
    assert found.fidelities[0].time_s[1] == round(float(found.runs[0].trajectory.t[-1]), 2)
    half = replace(found, fidelities=(found.fidelities[0], found.fidelities[1].replace(differences=("Later.",))))
    third = replace(half, fidelities=(*half.fidelities, half.fidelities[1]))
    assert half.repeats and not third.repeats and "1 of 3 runs keep" in third.verdict
    assert all("at least half have to" in each.verdict for each in (found, half, third))
    assert found.estimates == ()
    page = found.page()
    assert "recorded" in page and found.verdict.split(":")[0] in page and "Human 1" not in page


def test_other_people_do_not_repeat_it(bag: Path, world: World) -> None:
    made = recorded_scenario(load_recording(bag, world=world), world, route=world.route("route_1"))
    mission = made.scenario.mission
    backwards = mission.route.model_copy(update={"goal": mission.route.start.replace(x=mission.route.start.x - 3.0)})
    other = made.scenario.replace(mission=mission.replace(route=backwards))
    (run,) = rvsg.simulate(other, [0], world=world)
    found = compare(made.recording, run, world)
    assert not found.repeats and len(found.differences) >= 2 and found.path_m > 0.5
    left = run.details["left_tracks_s"]
    assert isinstance(left, dict) and set(left) == {"Person 1", "Person 2"}, "blended people notice"


def test_pauses_speed_and_goals_of_a_track_are_recovered(world: World) -> None:
    start = world.route("route_1").start
    x, y = start.x, start.y
    ann = walker((0, x + 1, y - 4), (4, x + 1, y - 1), (7, x + 1, y - 1), (10, x + 1, y + 2))
    made = recorded_scenario(recording(world, ann), world, people="intent")
    (human,) = made.scenario.people.humans
    (task,) = human.tasks
    (pause,) = task.pauses
    assert pause.duration_s == pytest.approx(3.0, abs=0.8)
    at = human.position(pause.at, world.grid)
    assert at is not None and np.hypot(at[0] - (x + 1), at[1] - (y - 1)) < 0.5
    assert human.speed_m_s * 0.893 == pytest.approx(0.85, abs=0.2) and not human.cyclic


def test_who_comes_later_is_absent_until_then(world: World) -> None:
    start = world.route("route_1").start
    ann = walker((4, start.x + 1, start.y - 2), (8, start.x + 1, start.y + 2))
    for people in People:
        made = recorded_scenario(recording(world, ann), world, people=people)
        track = made.scenario.people.humans[0].track
        assert track is not None and track.start_s == pytest.approx(4.0, abs=1.2)
        (run,) = rvsg.simulate(made.scenario, [0], world=world)
        k = int(np.searchsorted(run.trajectory.t, track.start_s - 0.3))
        assert run.trajectory.human_x[k, 0] < -20.0
        k = int(np.searchsorted(run.trajectory.t, track.start_s + 0.5))
        place = np.array([run.trajectory.human_x[k, 0], run.trajectory.human_y[k, 0]])
        assert np.hypot(*(place - track.points[0])) < 1.0


def test_of_500_people_the_nearest_hundred_are_kept_with_a_note(world: World) -> None:
    start = world.route("route_1").start
    many = [walker((0, start.x + 1, start.y + 0.003 * k), (15, start.x, start.y + 2), name=f"P{k}") for k in range(500)]
    found = recording(world, *many)
    made = recorded_scenario(found, world, people="as-recorded")
    assert len(made.scenario.people.humans) == 100
    assert next(note.count for note in made.notes if note.kind == "many") == 400


def test_what_is_missing_is_one_message(world: World, bag: Path, tmp_path: Path) -> None:
    ann = walker((0, 1, 1), (15, 3, 1))
    with pytest.raises(FileError):
        recorded_scenario(Recording(source="bag", people=(ann,)), world)
    with pytest.raises(FileError):
        recorded_scenario(recording(world), world)
    with pytest.raises(FileError):
        world_of_recording(recording(world, ann), None, tmp_path / "w")
    outside = recording(world, ann)
    outside.robot[:, 1] += 500.0
    with pytest.raises(FileError):
        recorded_scenario(outside, world)


def test_a_wrong_world_and_another_route_are_told(world: World, bag: Path) -> None:
    found = load_recording(bag, world=world)
    assert not any(note.kind == "world" for note in inspect(found, world).notes)
    office = rvsg.load_world("office")
    note, _ = (note for note in inspect(found, office).notes if note.kind == "world")
    assert note.count > 0.1 * len(found.robot)
    assert note.count == sum(not robot_space(office).is_free(x, y) for x, y in found.robot[:, 1:3])
    same = world.route("route_1")

    def told(route: Route) -> list[str]:
        return [note.text for note in recorded_scenario(found, world, route=route).notes if "goal of" in note.text]

    def away_m(route: Route) -> float:
        return float(np.hypot(*(found.robot[:, 1:3] - (route.goal.x, route.goal.y)).T).min())

    elsewhere = same.model_copy(update={"goal": max(world.routes, key=away_m).goal})
    assert told(elsewhere) and not told(same)
    start = same.start.replace(x=same.start.x + 50.0)
    with pytest.raises(FileError):
        recorded_scenario(found, world, route=elsewhere.model_copy(update={"start": start}))


def test_tracks_without_a_map_get_an_open_floor_where_asked(world: World, tmp_path: Path) -> None:
    start = world.route("route_1").start
    found = recording(world, walker((0, start.x + 1.0, start.y - 2.0), (15, start.x + 1.0, start.y - 1.9)))
    with pytest.raises(FileError, match="--open-floor"):
        world_of_recording(found, None, tmp_path / "site")
    floor = world_of_recording(found, None, tmp_path / "site", open_floor=True)
    assert not inspect(found, floor).notes
    assert recorded_scenario(found, floor).scenario.mission.world == floor.name
    low, high = found.robot[:, 1:3].min(axis=0), found.robot[:, 1:3].max(axis=0)
    assert robot_space(floor).is_free(*(low - 1.0)) and robot_space(floor).is_free(*(high + 1.0))
    assert not robot_space(floor).is_free(*(low - 4.0))
    far = recording(world, walker((0, start.x, start.y), (15, start.x + 1e9, start.y)))
    with pytest.raises(FileError, match="apart"):
        world_of_recording(far, None, tmp_path / "far", open_floor=True)


def test_people_in_walls_tell_a_wrong_world_whose_floor_the_robot_could_drive_on(world: World) -> None:
    start = world.route("route_1").start
    ann = walker((0, start.x + 1.0, start.y - 2.0), (15, start.x + 1.0, start.y - 1.9))
    assert not inspect(recording(world, ann), world).notes
    aside = replace(ann, rows=ann.rows + np.array([0.0, 40.0, 0.0, 0.0, 0.0]), name="Bob")
    (note,) = inspect(recording(world, ann, aside), world).notes
    assert note.kind == "world" and note.count == len(aside.rows)


def test_the_map_of_a_bag_is_compared_with_that_of_the_world(world: World, bag: Path) -> None:
    found = load_recording(bag, world=world)
    assert found.occupancy is not None and map_share(found, world) == 1.0
    cells, size = found.occupancy.cells, found.occupancy.resolution
    finer = replace(found.occupancy, cells=cells.repeat(2, 0).repeat(2, 1), resolution=size / 2)
    aside = replace(found.occupancy, origin=found.occupancy.origin.replace(x=found.occupancy.origin.x + 1.0))
    assert map_share(replace(found, occupancy=finer), world) == 1.0
    moved = replace(world, map_offset=(2.0, 0.0))
    assert map_share(load_recording(bag, world=moved), moved) == 1.0, "both maps lie in the frame of the map"
    for other, where in ((found, rvsg.load_world("office")), (replace(found, occupancy=aside), world)):
        (note,) = (each for each in inspect(other, where).notes if each.kind == "map")
        assert f"{map_share(other, where):.0%}" in note.text and map_share(other, where) < 0.5
    empty = replace(found.occupancy, cells=np.zeros_like(cells))
    for nothing in (replace(found, occupancy=empty), replace(found, occupancy=None)):
        assert not any(note.kind == "map" for note in inspect(nothing, world).notes)
    bare = replace(world, occupancy=empty)
    assert map_share(found, bare) == 0.0
    made = recorded_scenario(replace(found, occupancy=aside), world, route=world.route("route_1"))
    assert [note.kind for note in made.notes].count("map") == 1


def test_a_robot_that_stops_at_its_goal_has_arrived_by_one_rule(world: World) -> None:
    start = world.route("route_1").start
    found = recording(world, walker((0, start.x + 1.0, start.y - 2.0), (15, start.x + 1.0, start.y - 1.9)))
    x, y, yaw = found.goal or (0.0, 0.0, 0.0)
    for short_m, outcome in ((0.3, Outcome.REACHED), (1.0, Outcome.ABORTED)):
        other = replace(found, goal=(x, y - short_m, yaw))
        assert recorded_run(other)[0].outcome is outcome
        made = recorded_scenario(other, world, people="as-recorded")
        (run,) = rvsg.simulate(made.scenario, [0], world=world)
        assert recorded_as(made.recording, run).outcome is outcome


def test_the_map_of_a_recording_becomes_a_world(bag: Path, tmp_path: Path) -> None:
    found = load_recording(bag)
    made = world_of_recording(found, None, tmp_path / "site")
    assert made.grid.valid and (tmp_path / "site" / "world.yaml").is_file()
    assert recorded_scenario(found, made).scenario.mission.world == "site"


def test_a_faster_robot_and_a_slow_answer_are_estimated(bag: Path, run: Run, world: World) -> None:
    made = recorded_scenario(load_recording(bag, world=world), world, route=world.route("route_1"))
    robot = load_robot("tiago_omni")
    quick = made.recording.robot.copy()
    quick[:, 0] *= 0.7
    commands = np.column_stack([quick[:, 0] - 0.3, quick[:, 4], quick[:, 5]])
    faster = Recording(source="bag", people=made.recording.people, robot=quick, commands=commands)
    found = {each.parameter: each.recorded for each in estimates(faster, run, robot)}
    assert found["limits.speed_m_s"] == pytest.approx(robot.limits.speed_m_s / 0.7, rel=0.1)
    assert found["latency_s"] == pytest.approx(0.3, abs=0.05)
    steady = made.recording.robot.copy()
    steady[:, 1] = steady[0, 1] + 0.3 * steady[:, 0]
    steady[:, 2] = steady[0, 2]
    told = estimates(replace(faster, robot=steady, commands=np.empty((0, 3))), run, robot)
    assert "limits.acceleration_m_s2" not in {each.parameter for each in told}


def test_a_simulated_robot_that_is_held_up_makes_the_recorded_one_no_faster(bag: Path, run: Run) -> None:
    robot, found = load_robot("tiago_omni"), load_recording(bag)
    path = run.trajectory
    held = replace(run, trajectory=replace(path, x=path.x * 0.01, y=path.y * 0.01), outcome=Outcome.TIMED_OUT)
    assert estimates(found, held, robot) == ()
    found.robot[:, 0] *= 0.25
    speed = np.hypot(*(np.gradient(found.robot[:, k], found.robot[:, 0]) for k in (1, 2)))
    told = {each.parameter: each.recorded for each in estimates(found, held, robot)}
    assert robot.limits.speed_m_s < told["limits.speed_m_s"] <= float(speed.max())


def test_a_folder_becomes_a_suite_and_what_cannot_be_read_is_told(bag: Path, world: World, tmp_path: Path) -> None:
    folder = tmp_path / "bags"
    folder.mkdir()
    (folder / "whole.mcap").write_bytes(bag.read_bytes())
    (folder / "cut.mcap").write_bytes(bag.read_bytes()[:5000])
    cases = recorded_cases(folder, world, "R1", runs=1)
    assert [case.source for case in cases] == ["whole.mcap", "cut.mcap"]
    assert cases[0].kinds and cases[0].gap_m < 1.5 and cases[1].problem
    suite = suite_of_recordings(cases, tmp_path / "suite", "R1")
    (case,) = suite.cases
    assert case.name.startswith("01-") and "whole.mcap" in case.title
    (tmp_path / "suite" / f"{case.name}.yaml").rename(tmp_path / "suite" / "mine.yaml")
    again = suite_of_recordings(cases, tmp_path / "suite", "R1")
    assert [each.name for each in again.cases] == ["mine"], "a case keeps its name"
    with pytest.raises(FileError):
        recorded_cases(tmp_path / "suite", world)
    for no_folder in (tmp_path / "absent", bag):
        with pytest.raises(FileError):
            recorded_cases(no_folder, world)


def test_each_recording_of_a_suite_has_its_own_map_or_an_open_floor(bag: Path, tmp_path: Path) -> None:
    folder, suite = tmp_path / "bags", tmp_path / "suite"
    folder.mkdir()
    (folder / "mapped.mcap").write_bytes(bag.read_bytes())
    rows = [f"{name},{t:.1f},{x + 0.5 * t:.2f},{y}" for name, x, y in (("robot", 0, 0), ("1", 2, 1)) for t in T[:60]]
    (folder / "bare.csv").write_text("id,t,x,y\n" + "\n".join(rows))
    mapped, bare = recorded_cases(folder, None, "R1", runs=1, worlds=suite / "worlds")
    assert mapped.rebuilt is not None and mapped.rebuilt.world.name == "mapped"
    assert bare.rebuilt is None and "--open-floor" in bare.problem
    cases = recorded_cases(folder, None, "R1", runs=1, worlds=suite / "worlds", open_floor=True)
    suite_of_recordings(cases, suite, "R1")
    moved = suite.rename(tmp_path / "moved")
    assert {world.name for world in Suite.open(moved).worlds.values()} == {"mapped", "bare"}


def test_encounters_are_cut_out_of_a_long_drive(world: World, tmp_path: Path) -> None:
    start, t = world.route("route_1").start, np.arange(0.0, 120.0, 0.2)
    away = 2.0 - 2.0 * np.abs((t / 60.0) % 2.0 - 1.0)  # 2 m away and back
    lines = [f"robot,{a:.1f},{start.x:.3f},{start.y - b:.3f}" for a, b in zip(t, away, strict=True)]
    for name, begin in (("1", 20.0), ("2", 90.0)):
        lines += [f"{name},{begin + 0.2 * k:.1f},{start.x + 1:.3f},{start.y - 4 + 0.2 * k:.3f}" for k in range(30)]
    (tmp_path / "long.csv").write_text("id,t,x,y,frame\n" + "\n".join(f"{line},world" for line in lines))
    cases = recorded_cases(tmp_path, world, "R1", runs=1, people="as-recorded")
    assert len(cases) == 2 and all("long.csv at" in case.source for case in cases)
    for case in cases:
        assert case.rebuilt is not None, case.problem
        assert len(case.rebuilt.made.scenario.people.humans) == 1


@pytest.mark.parametrize(("beside_m", "contacts"), [(-0.15, True), (0.0, None), (0.15, False)])
def test_contact_counts_only_beyond_the_error_of_the_recording(
    world: World, beside_m: float, contacts: bool | None
) -> None:
    start, noise = world.route("route_1").start, np.random.default_rng(1)
    ann = walker((0, start.x + 0.9, start.y - 2.0), (15, start.x + 0.9, start.y - 1.9))
    ann.rows[:, 1:3] += noise.normal(0.0, 0.02, (len(ann.rows), 2))
    made = recorded_scenario(recording(world, ann), world, people="as-recorded")
    (run,) = rvsg.simulate(made.scenario, [0], world=world)
    (person,) = made.recording.people
    gap_m = float(sampled(recorded_as(made.recording, run), world).gap.min())
    aside = np.array([0.0, beside_m - gap_m, 0.0, 0.0, 0.0])
    found = replace(made.recording, people=(replace(person, rows=person.rows + aside),))
    away = replace(run, trajectory=replace(run.trajectory, human_x=run.trajectory.human_x + 5.0), events=())
    for other in (away, replace(away, simulator="recording", trajectory=recorded_as(found, run).trajectory)):
        fidelity = compare(found, other, world)
        (gap,) = fidelity.gaps
        assert 0.005 < gap.error_m < 0.05 and gap.recorded_m == pytest.approx(beside_m, abs=0.02)
        assert bool(fidelity.contact) == (contacts is None)
        if contacts is not None:
            assert bool(fidelity.events["contacts"][0]) == contacts
        touches = bool(fidelity.events["contacts"][1])
        assert any("contact" in each for each in fidelity.differences) == (contacts is not None and touches != contacts)


def test_a_contact_that_the_bag_holds_is_told_whatever_smoothing_leaves_of_it(
    run: Run, world: World, tmp_path: Path
) -> None:
    from rvsg_exchange.bag import write_bag

    touch = Contact(
        time_s=8.0, x=0.0, y=0.0, person=run.human_names[1], until_s=8.3, closing_speed_m_s=0.5, robot_part_m_s=0.5,
        person_part_m_s=0.0, bearing_rad=0.0, overlap_m=0.0,
    )  # fmt: skip
    path = tmp_path / "contact.mcap"
    write_bag(replace(run, events=(touch,)), world, path)
    found = load_recording(path, world=world)
    assert found.contacts == (touch,) and any("contact" in line for line in inspect(found, world).lines)
    made = recorded_scenario(found, world, people="as-recorded")
    again = replace(run, human_names=tuple(person.name for person in made.recording.people), events=())
    fidelity = compare(made.recording, again, world)
    assert fidelity.events["contacts"] == (1, 0) and not fidelity.contact
    assert any("contact" in each for each in fidelity.differences)


def test_the_smallest_change_that_violates_is_found(world: World) -> None:
    start = world.route("route_1").start
    beside = recording(world, walker((0, start.x + 1.6, start.y - 4), (15, start.x + 1.6, start.y + 1)))
    scenario = recorded_scenario(beside, world, people="as-recorded").scenario
    found = nearest_violation(scenario, "clearance", repeats=1, most=1.6)
    assert found.violations == 0
    (change, *_) = found.changes
    assert change.kind == "towards the robot" and 0.0 < change.size <= 1.6
    moved = change.scenario.people.humans[0].track
    before = scenario.people.humans[0].track
    assert moved is not None and before is not None
    assert np.hypot(*(np.array(moved.points[0]) - before.points[0])) == pytest.approx(change.size, abs=0.01)


def test_a_shifted_person_does_the_same_later_and_elsewhere(world: World) -> None:
    start = world.route("route_1").start
    made = recording(world, walker((0, start.x + 1, start.y - 4), (10, start.x + 1, start.y + 2)))
    (human,) = recorded_scenario(made, world, people="as-recorded").scenario.people.humans
    later = shifted(human, world.grid, 1.5)
    assert later is not None and later.track is not None and human.track is not None
    assert later.track.start_s == pytest.approx(human.track.start_s + 1.5) and later.track.points == human.track.points
    earlier = shifted(human, world.grid, -1.0)
    assert earlier is not None and earlier.track is not None
    assert earlier.track.points == human.track.points[5:] and earlier.track.start_s == pytest.approx(0.0)
    aside = shifted(human.replace(track=None), world.grid, 0.0, (0.5, 0.0))
    assert aside is not None
    for task, was in zip(aside.tasks, human.tasks, strict=True):
        for name, old in zip(task.path, was.path, strict=True):
            at, before = aside.position(name, world.grid), human.position(old, world.grid)
            assert at is not None and before is not None and at[0] == pytest.approx(before[0] + 0.5, abs=1e-3)
    assert shifted(human.replace(track=None), world.grid, -1.0) is None


@pytest.mark.parametrize("people", ["as-recorded", "blended"])
def test_who_is_absent_counts_in_no_distance(world: World, people: str) -> None:
    start = world.route("route_1").start
    ann = walker((3, start.x + 1, start.y - 3), (8, start.x + 1, start.y))
    found = rebuild(recording(world, ann), world, runs=1, people=people)
    recorded = recorded_as(found.made.recording, found.runs[0])
    for run in (recorded, found.runs[0]):
        path = run.trajectory
        there = np.abs(path.human_x[:, 0] - start.x) < 10.0
        expected = np.hypot(path.human_x[:, 0] - path.x, path.human_y[:, 0] - path.y)[there].mean()
        values = measure(run, world=world)
        assert 0 < there.sum() < len(path) and values["dto"] == pytest.approx(expected) and expected < 5.0
        assert values["max_distance"] is not None and values["max_distance"] < 10.0
        curve = judged_curve(run, found.requirement, world).value
        assert curve[-1] == pytest.approx(expected) and np.nanmax(curve) < 10.0
