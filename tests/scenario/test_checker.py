import re
from dataclasses import replace
from pathlib import Path

import pytest
from tests.scenario.small_world import GOOD, MISSION, WORLD, human, people, walk

from rvsg.scenario.rules import near_place, read_ends
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Pause, Task, Track
from rvsg.scenario.validity import about_turns, check, warnings


def rules_of(configuration: HumanConfiguration) -> list[str]:
    return [finding.rule for finding in check(configuration, MISSION, WORLD)]


def test_a_valid_configuration_has_no_finding() -> None:
    assert check(people(human(*GOOD)), MISSION, WORLD) == ()


@pytest.mark.parametrize(
    ("rule", "tasks"),
    [
        ("unknown-waypoint", ("Dock → Store: A1 B1 C1 D1 Z9 E1", GOOD[1])),
        ("invalid-waypoint", ("Dock → Dock: A1 B2 C3 B2 A1",)),
        ("repeated-waypoint", ("Dock → Dock: A1 A2 A2 A1",)),
        ("not-neighbours", ("Dock → Store: A1 B1 D1 E1", GOOD[1])),
        ("leg-through-obstacle", ("Dock → Dock: A1 B1 C2 D2 D1 C1 B1 A1",)),
        ("empty-path", ("Dock → Dock: ", "Dock → Dock: A1 A2 A1")),
        ("short-path", ("Dock → Dock: A1", "Dock → Dock: A1 A2 A1")),
        ("broken-chain", (GOOD[0], "Store → Dock: E2 D1 C1 B1 A1")),
        ("open-loop", (GOOD[0],)),
        ("unknown-area", ("Dokc → Store: A1 B1 C1 D1 E1", GOOD[1])),
        ("wrong-area", ("Dock → Office: A1 B1 C1 D1 E1", GOOD[1])),
        ("spawn-on-robot", ("walk about: B4 B5 B4",)),
        ("never-moves", (Task(name="look", path=("A1",), pauses=(Pause(at="A1", duration_s=3),)),)),
        ("pause-off-path", (Task(name="look", path=("A1", "A2", "A1"), pauses=(Pause(at="B7", duration_s=3),)),)),
    ],
)
def test_each_rule_of_one_person_is_found_and_named(rule: str, tasks: tuple[str | Task, ...]) -> None:
    findings = check(people(human(*tasks)), MISSION, WORLD)
    assert [finding.rule for finding in findings] == [rule]
    assert findings[0].human == "Ada"
    assert findings[0].reason
    assert findings[0].suggestion


def test_a_track_that_ends_where_the_robot_differs_needs_the_recorded_robot() -> None:
    followed = human(*GOOD).replace(track=Track(points=((0.0, 0.0), (1.0, 0.0)), until_m=0.5))
    assert rules_of(people(followed)) == ["track-without-robot"]
    driven = MISSION.model_copy(update={"driven": Track(points=((1.0, 3.0),))})
    assert check(people(followed), driven, WORLD) == ()
    assert Mission.model_validate_json(driven.model_dump_json()) == driven and driven.id != MISSION.id


def test_who_appears_later_may_appear_where_somebody_starts() -> None:
    late = human(*GOOD, name="Bo").replace(track=Track(start_s=5.0, points=((0.0, 0.0),)))
    assert check(people(human(*GOOD), late), MISSION, WORLD) == ()


def test_a_hop_through_a_gap_too_narrow_for_a_person_is_refused() -> None:
    cells = WORLD.occupancy.cells.copy()
    cells[16:24, 20:28] = 100  # y -0.2 to 0.2, x 0.5 to 0.9: A1 and B1 lie on either side
    cells[18:22, 20:28] = 0  # a gap of 0.2 m on the line
    world = replace(WORLD, occupancy=replace(WORLD.occupancy, cells=cells))
    cells[:16, 20:28] = cells[24:40, 20:28] = 100
    mission = MISSION.model_copy(update={"world_id": world.id})
    found = check(people(human("walk: A1 B1 A1")), mission, world)
    assert [(finding.rule, finding.position) for finding in found] == [("too-narrow", 1), ("too-narrow", 2)]
    assert {finding.suggestion for finding in found} == {"Lead the path over other waypoints."}


def test_a_finding_says_who_where_why_and_what_helps() -> None:
    (finding,) = check(people(human("Dock → Store: A1 B1 D1 E1", GOOD[1])), MISSION, WORLD)
    assert str(finding) == ('Ada, task "Dock → Store", waypoint 3: B1 and D1 are not neighbours. Walk B1 C1 D1.')


@pytest.mark.parametrize(("task", "meant"), [("Dock → Dock: A1 a-2 A1", "A2"), ("Dokc → Dock: A1 A2 A1", "Dock")])
def test_an_unknown_name_comes_with_the_one_that_was_meant(task: str, meant: str) -> None:
    (finding,) = check(people(human(task)), MISSION, WORLD)
    assert finding.suggestion == f'Did you mean "{meant}"?'


@pytest.mark.parametrize(
    "name", ["Dock -> Store", "dock → STORE", "Dock (A1) → Store (E1)", "Dock to Store", "A1 → E1"]
)
def test_a_task_name_is_read_however_its_arrow_and_case_are_written(name: str) -> None:
    assert rules_of(people(human(f"{name}: A1 B1 C1 D1 E1", GOOD[1]))) == []
    assert "wrong-area" in rules_of(people(human(f"{name}: A1 B1 C1 D1", "x: D1 C1 B1 A1")))


def beside_the_robot(gap_m: float, axis: int) -> Mission:
    """Return the mission with the robot this far from A1 along an axis: its front, or its side."""
    reach = max(abs(corner[axis]) for corner in MISSION.robot_record.outline) + human(*GOOD).body_radius_m
    x, y = WORLD.grid.position("A1")
    away = (reach + gap_m, 0.0) if axis == 0 else (0.0, reach + gap_m)
    start = MISSION.route.start.replace(x=x + away[0], y=y + away[1], yaw=0.0)
    return MISSION.replace(route=MISSION.route.replace(start=start))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("gap_m", "found"), [(-0.4, True), (-0.01, True), (0.01, False)])
def test_nobody_may_start_in_contact_with_the_robots_body(gap_m: float, found: bool, axis: int) -> None:
    rules = [finding.rule for finding in check(people(human(*GOOD)), beside_the_robot(gap_m, axis), WORLD)]
    assert ("spawn-on-robot" in rules) == found


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("gap_m", "found"), [(-0.01, False), (0.01, True), (0.49, True), (0.51, False)])
def test_a_start_close_to_the_robot_is_a_warning_and_stays_valid(gap_m: float, found: bool, axis: int) -> None:
    mission = beside_the_robot(gap_m, axis)
    warned = [each for each in warnings(people(human(*GOOD)), mission, WORLD) if each.rule != "turns-without-stop"]
    assert [finding.rule for finding in warned] == ["spawn-near-robot"] * found
    assert "spawn-near-robot" not in [finding.rule for finding in check(people(human(*GOOD)), mission, WORLD)]
    assert all(f"{gap_m:.2f} m" in str(finding) for finding in warned)


def paused(way: str, at: str, seconds: float) -> Task:
    return walk(way).replace(pauses=(Pause(at=at, duration_s=seconds, doing="sort"),))


TO, FRO = "to: A1 B1 C1 D1 E1", "fro: E1 D1 C1 B1 A1"


@pytest.mark.parametrize(
    ("tasks", "rules"),
    [
        ((TO, FRO), ["turns-without-stop"]),
        ((paused(TO, "E1", 5), FRO), ["turns-without-stop"]),
        ((paused(TO, "E1", 5), paused(FRO, "A1", 5)), []),
        ((paused(TO, "E1", 5), paused(FRO, "C1", 5)), ["turns-without-stop"]),
        ((paused(TO, "E1", 25), paused(FRO, "A1", 600)), ["pause-longer-than-run"]),
    ],
    ids=["nowhere", "at one end", "at both ends", "half way", "longer than the run"],
)
def test_who_turns_round_without_a_stop_and_who_outlasts_the_run_is_a_warning(
    tasks: tuple[str | Task, ...], rules: list[str]
) -> None:
    someone = people(human(*tasks))
    assert [finding.rule for finding in warnings(someone, MISSION, WORLD)] == rules
    assert check(someone, MISSION, WORLD) == ()


def test_a_way_round_a_corner_is_no_turning_round() -> None:
    grid, ways = WORLD.grid, ("a: A1 A2 A3", "b: A3 B3 C3", "c: C3 B2 A1")
    assert about_turns(human(*ways), grid) == ("A1", "C3")
    assert about_turns(human("a: A1 A2 A3 B3 C3", cyclic=False), grid) == ()


OTHER = ("Bench → Bench: A6 A7 A6",)


@pytest.mark.parametrize(
    ("humans", "rules"),
    [
        ([human(*GOOD), human(*GOOD, name="Bob")], ["spawn-on-human"]),
        ([human(*GOOD, speed_m_s=2.6)], ["speed-out-of-range"]),
        ([human(*GOOD, speed_m_s=0.1)], ["speed-out-of-range"]),
        ([human(*GOOD, group=1), human(*OTHER, name="Bob")], ["group-of-one"]),
        ([human(*GOOD, group=1), human(*OTHER, name="Bob", group=1)], []),
        ([human(*GOOD), human(*OTHER)], ["same-name"]),
        ([human("Dock (loop closure): A1 A2 A1")], []),
        ([human("Dock (loop closure): A1 A2 A3", "back: A3 A2 A1")], ["wrong-area"]),
        # Explicit areas go before the name of the task.
        ([human(Task(name="fetch", path=("A1", "A2", "A3"), end_area="Dock"), "back: A3 A2 A1")], ["wrong-area"]),
    ],
)
def test_rules_of_a_person_or_of_several(humans: list[Human], rules: list[str]) -> None:
    assert rules_of(people(*humans)) == rules


def test_more_people_than_can_be_simulated_are_refused() -> None:
    crowd = people(*(human(*GOOD, name=f"Human {i}") for i in range(101)))
    assert rules_of(crowd)[0] == "too-many-humans"


def test_a_mission_of_another_world_and_a_blocked_start_are_findings_of_nobody() -> None:
    start = MISSION.route.start.model_copy(update={"x": 2.0, "y": 3.0})
    route = MISSION.route.model_copy(update={"start": start})
    mission = MISSION.model_copy(update={"world_id": "world-0", "route": route})
    findings = check(people(human(*GOOD)), mission, WORLD)
    assert [(f.rule, f.human) for f in findings] == [("wrong-world", None), ("robot-start-blocked", None)]


def test_all_findings_are_listed_at_once() -> None:
    found = rules_of(people(human("Dokc → Store: A1 Q7 D1 C4", speed_m_s=2.9)))
    assert {"unknown-area", "unknown-waypoint", "invalid-waypoint", "open-loop", "speed-out-of-range"} <= set(found)


def test_a_name_that_looks_like_a_number_or_markup_is_text_and_refused() -> None:
    for name in ("", "<b>", "../A1", "A" * 500, "Ⓐ1", "𝟙"):
        task = walk("Dock → Dock: A1 A2 A1").model_copy(update={"path": ("A1", "A2", name, "A2", "A1")})
        assert "unknown-waypoint" in rules_of(people(human(task))), name


def test_a_place_that_only_surrounds_an_area_or_waypoint_means_that() -> None:
    assert near_place("Dock entry", WORLD) == "Dock"
    assert near_place("corridor at B4", WORLD) == "B4"
    assert near_place("Dock/Store", WORLD) is None
    assert near_place("nowhere at all", WORLD) is None


def test_the_reference_page_lists_every_rule_and_no_other() -> None:
    root = Path(__file__).resolve().parents[2]
    page = (root / "docs" / "reference" / "validity-rules.md").read_text(encoding="utf-8")
    code = "".join(path.read_text(encoding="utf-8") for path in (root / "src/rvsg/scenario").glob("*.py"))
    assert set(re.findall(r"^\| `([a-z-]+)`", page, re.MULTILINE)) == set(
        re.findall(r'Finding\.of\(\s*"([a-z-]+)"', code)
    )


def test_only_fields_promise_areas_and_only_files_and_replies_fill_them_from_names() -> None:
    humans = HumanConfiguration(humans=(human("Dock → Store: A1 B1 C1 D1", "x: D1 C1 B1 A1"),))
    assert check(humans, MISSION, WORLD) == ()
    read = read_ends(humans, WORLD)
    assert [(task.start_area, task.end_area) for task in read.humans[0].tasks] == [("Dock", "Store"), (None, None)]
    assert [finding.rule for finding in check(read, MISSION, WORLD)] == ["wrong-area"]
    assert read_ends(read, WORLD) == read
