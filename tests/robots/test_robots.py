"""Robot files: what ships, what is refused, what content means for ids, and what takes the robot of a mission."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from rvsg.cli.robots import robots as robots_command
from rvsg.core.documents import DocumentError, read_yaml
from rvsg.core.errors import FileError, UnknownName
from rvsg.core.records import Pose
from rvsg.generation.forecast import forecaster_of
from rvsg.robots.polygons import crosses_itself, inside
from rvsg.robots.robot import draw_robot, load_robot, shipped_robots
from rvsg.scenario.placement import robot_reach_m, start_gap_m
from rvsg.scenario.scenario import Mission
from rvsg.world.routes import robot_stands
from rvsg.world.space import robot_space
from rvsg.world.world_folder import load_world

PLAIN = {
    "name": "box",
    "footprint": [[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]],
    "body_height_m": 0.4,
    "limits": {
        "speed_m_s": 1.0,
        "reverse_m_s": 0.2,
        "yaw_rate_rad_s": 1.0,
        "acceleration_m_s2": 1.0,
        "deceleration_m_s2": 1.0,
        "yaw_acceleration_rad_s2": 2.0,
    },
    "lidars": [{"name": "scan", "x": 0.25, "y": 0.0, "field_of_view_rad": 4.0, "rays": 401, "max_range_m": 10.0}],
}


def written(folder: Path, **changes: object) -> Path:
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(PLAIN | changes))
    return path


def test_one_shipped_robot_is_calibrated_and_all_name_their_source() -> None:
    robots = shipped_robots()
    assert [name for name, robot in robots.items() if robot.calibrated] == ["tiago_omni"]
    assert all(robot.source and robot.title for robot in robots.values())


def test_the_default_robot_has_not_changed() -> None:
    # Scenarios name it without its content. Raise VERSION of the simulator with this id.
    assert load_robot("tiago_omni").id == "robot-d5ef08763146854c"


def test_the_navigation_of_a_steered_vehicle_follows_from_its_size(tmp_path: Path) -> None:
    body = {
        "footprint": [[1.75, 0.4], [-0.45, 0.4], [-0.45, -0.4], [1.75, -0.4]],
        "lidars": [PLAIN["lidars"][0] | {"x": 1.7}],
    }
    steered = {"drive": {"kind": "ackermann", "wheelbase_m": 1.3, "max_steering_rad": 1.1}}
    own = {"navigation": {"costmaps": {"local_size_m": 4.0}}}
    robot, round_one, given = (load_robot(written(tmp_path, **body, **each)) for each in (steered, {}, steered | own))
    assert robot.navigation.dwb.check_footprint and robot.navigation.behaviours.goal_tolerance_rad > math.pi
    assert 0.5 * robot.navigation.costmaps.local_size_m > robot.turning_radius_m + 1.5
    assert robot.replace(name="other").navigation == robot.navigation
    assert given.navigation == robot.navigation.replace(costmaps=robot.navigation.costmaps.replace(local_size_m=4.0))
    assert round_one.navigation == load_robot(written(tmp_path)).navigation


def test_a_robot_file_is_read(tmp_path: Path) -> None:
    robot = load_robot(written(tmp_path))
    assert (robot.length_m, robot.width_m, robot.radius_m) == pytest.approx((0.6, 0.4, 0.3))
    assert robot.id != load_robot(written(tmp_path, padding_m=0.02)).id


LIDAR = PLAIN["lidars"][0]  # type: ignore[index]
LIMITS: dict[str, float] = PLAIN["limits"]  # type: ignore[assignment]
BOWTIE = [[0.3, 0.2], [-0.3, -0.2], [-0.3, 0.2], [0.3, -0.2]]
ASIDE = [[0.3, 0.2], [0.1, 0.2], [0.1, -0.2], [0.3, -0.2]]


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"footprint": BOWTIE}, ("footprint",)),
        ({"footprint": ASIDE}, ("footprint",)),
        ({"footprint": [[0.3, 0.0], [-0.3, 0.0], [0.1, 0.0]]}, ("footprint",)),
        ({"body": ASIDE}, ("body",)),
        ({"limits": {**LIMITS, "acceleration_m_s2": 0.0}}, ("limits", "acceleration_m_s2")),
        ({"limits": {**LIMITS, "speed_m_s": 0.0}}, ("limits", "speed_m_s")),
        ({"limits": {**LIMITS, "lateral_m_s": 0.5}}, ("limits", "lateral_m_s")),
        ({"limits": {**LIMITS, "lateral_m_s": -0.1}}, ("limits", "lateral_m_s")),
        ({"lidars": []}, ("lidars",)),
        ({"lidars": [LIDAR, {**LIDAR, "name": "far", "x": 30.0}]}, ("lidars", 1)),
        ({"lidars": [LIDAR, {**LIDAR, "name": "in", "x": 0.0, "height_m": 0.2}]}, ("lidars", 1)),
        ({"lidars": [LIDAR, LIDAR]}, ("lidars", 1, "name")),
        ({"drive": {"kind": "ackermann"}}, ("drive",)),
        ({"drive": {"kind": "differential", "wheelbase_m": 0.5}}, ("drive",)),
        ({"safety_zones": [{"name": "a", "polygon": BOWTIE, "speed_m_s": 0.0}]}, ("safety_zones", 0, "polygon")),
        ({"navigation": {"dwb": {"max_lateral_m_s": 0.5}}}, ("navigation", "dwb", "max_lateral_m_s")),
        ({"colour": "red"}, ("colour",)),
    ],
)
def test_a_robot_that_cannot_be_is_one_mistake_at_its_line(
    tmp_path: Path, changes: dict[str, object], key: tuple[str | int, ...]
) -> None:
    path = written(tmp_path, **changes)
    with pytest.raises(DocumentError) as caught:
        load_robot(path)
    (problem,) = caught.value.problems
    assert problem.path == path and problem.key == key and problem.line == read_yaml(path).lines[key]


def test_an_unknown_robot_and_a_missing_file_are_told(tmp_path: Path) -> None:
    with pytest.raises(UnknownName):
        load_robot("turtlebot")
    with pytest.raises(FileError):
        load_robot(tmp_path / "none.yaml")


def test_a_missions_id_holds_the_content_of_its_robot() -> None:
    default = MISSION
    assert default.robot == "tiago_omni"
    assert default.robot_record == load_robot("tiago_omni")
    waffle = default.replace(robot="turtlebot3_waffle")
    assert waffle.robot == load_robot("turtlebot3_waffle")
    assert waffle.robot_name == "turtlebot3_waffle"
    assert Mission.from_json(waffle.to_json()).id == waffle.id != default.id
    assert waffle.replace(robot=load_robot("turtlebot3_waffle").replace(padding_m=0.03)).id != waffle.id
    foreign = default.replace(robot="somebody's robot")
    assert (foreign.robot_name, foreign.robot_record) == ("somebody's robot", None)


@pytest.mark.parametrize("name", shipped_robots())
def test_a_drawing_shows_body_lidars_and_zones(name: str) -> None:
    robot = load_robot(name)
    root = ElementTree.fromstring(draw_robot(robot))
    kinds = [element.get("class") for element in root.iter()]
    assert kinds.count("view") == len(robot.lidars)
    assert kinds.count("zone") == len(robot.safety_zones)
    assert kinds.count("body") == kinds.count("footprint") == 1


def test_polygons() -> None:
    square = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
    assert not crosses_itself(square)
    assert crosses_itself([*square, (1.0, 1.0)])
    assert crosses_itself([(0.0, 0.0), (2.0, 0.0), (1.0, 0.0), (1.0, 1.0)])
    assert inside(square, 0.9, -0.9)
    assert not inside(square, 1.1, 0.0)


WORLD = load_world("warehouse")
MISSION = Mission(world=WORLD.name, world_id=WORLD.id, route=WORLD.route("route_1"))
TUGGER = MISSION.replace(robot="tugger")


def at(mission: Mission, ahead: float, left: float) -> tuple[float, float]:
    start = mission.route.start
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    return start.x + ahead * cos - left * sin, start.y + ahead * sin + left * cos


def test_the_checker_measures_from_the_body_of_another_robot() -> None:
    assert start_gap_m(0.4, at(MISSION, 1.0, 0.0), MISSION) == pytest.approx(1.0 - 0.3585 - 0.4)
    assert start_gap_m(0.4, at(TUGGER, 1.65, 0.0), TUGGER) == pytest.approx(0.1)
    assert start_gap_m(0.4, at(TUGGER, 0.4, 1.0), TUGGER) == pytest.approx(1.0 - 0.325 - 0.4)
    assert start_gap_m(0.4, at(TUGGER, 1.0, 0.0), TUGGER) < 0.0
    assert robot_reach_m(MISSION) == 0.35
    assert robot_reach_m(TUGGER) == pytest.approx(math.hypot(1.15, 0.325))


def test_the_forecast_takes_speed_and_size_of_another_robot() -> None:
    usual = forecaster_of(MISSION, WORLD)
    waffle = forecaster_of(MISSION.replace(robot="turtlebot3_waffle"), WORLD)
    assert waffle.robot_speed == pytest.approx(0.98 * 0.22)
    assert waffle.robot_radius == 0.22
    assert (usual.robot_speed, usual.robot_radius) != (waffle.robot_speed, waffle.robot_radius)


def test_a_route_proposal_asks_for_the_room_the_robot_takes() -> None:
    space = robot_space(WORLD)
    start = WORLD.route("route_1").start
    tugger = load_robot("tugger")
    huge = tugger.replace(footprint=((9.0, 4.0), (-9.0, 4.0), (-9.0, -4.0), (9.0, -4.0)), body=tugger.footprint)
    assert robot_stands(space, start, load_robot("turtlebot3_waffle"))
    assert not robot_stands(space, Pose(x=start.x, y=start.y), huge)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"footprint": [[300, 200], [-0.3, 0.2], [-0.3, -0.2]]}, "if millimetres are meant, write 0.3)"),
        ({"lidars": [{**LIDAR, "yaw": 180}]}, "if degrees are meant, write 3.142)"),
        ({"lidars": [{**LIDAR, "rays": 3}]}, "greater than or equal to 11"),
    ],
)
def test_a_wrong_value_in_a_list_is_the_only_mistake_and_its_unit_is_recognised(
    tmp_path: Path, changes: dict[str, object], said: str
) -> None:
    with pytest.raises(DocumentError) as caught:
        load_robot(written(tmp_path, **changes))
    assert said in caught.value.problems[0].message
    assert not any("values" in problem.message for problem in caught.value.problems)


def test_a_lidar_beside_the_body_is_doubtful(tmp_path: Path) -> None:
    assert not any(robot.doubts for robot in shipped_robots().values())
    robot = load_robot("turtlebot3_waffle")
    front = max(x for x, _ in robot.outline)
    moved = robot.replace(lidars=(robot.lidars[0].replace(x=front + 0.18, y=0.0),))
    assert "0.18 m outside of the body" in moved.doubts[0]


def test_a_footprint_that_holds_less_than_the_body_as_it_turns_is_doubtful() -> None:
    robot = load_robot("turtlebot3_waffle")
    bare = robot.replace(footprint=robot.body, body=None)  # the axle lies 0.08 m behind the front: stuck at pillars
    assert "0.09 m from obstacles, but half of the body is 0.15 m wide" in bare.doubts[0]
    checked = bare.replace(navigation=bare.navigation.replace(dwb=bare.navigation.dwb.replace(check_footprint=True)))
    assert not checked.doubts


def test_the_page_and_the_command_tell_the_same_of_each_robot(capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "test-another-robot.md").read_text()
    robots_command()
    said = capsys.readouterr().out
    for name, robot in shipped_robots().items():
        size, speed = f"{robot.length_m:.2f} x {robot.width_m:.2f} m", f"{robot.driving_speed_m_s:g} m/s"
        (row,) = [line for line in page.splitlines() if line.startswith(f"| `{name}`")]
        assert f"| {size} |" in row and f"| {speed} |" in row
        assert f"{size}, {robot.drive.kind}, {speed}" in said
