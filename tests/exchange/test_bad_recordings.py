"""Recordings that lack something, or hold too much: a clear message, or a result that says what it rests on."""

from __future__ import annotations

import json
import math
import tracemalloc
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.coded import coded
from tests.exchange.judged import judged

from rvsg.core.errors import FileError
from rvsg.simulation.run import Run
from rvsg.world.world import World
from rvsg_exchange.bag import CYLINDER, Messages, rosbags_types, write_bag
from rvsg_exchange.recordings import MCAP, open_bag

rosbags = pytest.importorskip("rosbags.rosbag2", reason="the extra `bag` is not installed")
NEEDED = ("/odom", "/tf", "/tf_static", "/human_states", "/goal_pose")
BEGIN_S = 10.0
"""Second of the bag at which the run begins."""

Said = tuple[str, float, Any]
Change = Callable[[str, float, Any], Iterator[Said]]


@pytest.fixture(scope="module")
def said(run: Run, world: World, tmp_path_factory: pytest.TempPathFactory) -> list[Said]:
    """The messages of a recording of the run: what a robot with people around it would record, at 5 Hz."""
    path = tmp_path_factory.mktemp("bag") / "run.mcap"
    write_bag(run, world, path)
    found, seen = [], dict.fromkeys(NEEDED, 0)
    with open_bag(path) as reader:
        for connection, stamp, raw in reader.messages():
            if connection.topic not in NEEDED:
                continue
            if seen[connection.topic] % 4 == 0:
                found.append((connection.topic, stamp / 1e9, reader.deserialize(raw, connection.msgtype)))
            seen[connection.topic] += 1
    return found


def recorded(said: list[Said], folder: Path, change: Change | None = None, *, sqlite: bool = False) -> Path:
    """Write the messages, changed, as a recording; they stay as they are."""
    types, topics = rosbags_types(), {}
    plugin = rosbags.StoragePlugin.SQLITE3 if sqlite else rosbags.StoragePlugin.MCAP
    with rosbags.Writer(folder / "bag", version=9, storage_plugin=plugin) as writer:
        for each in deepcopy(said) if change else said:
            for topic, t, message in change(*each) if change else [each]:
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, message.__msgtype__, typestore=types)
                writer.write(topics[topic], round(t * 1e9), types.serialize_cdr(message, message.__msgtype__))
    return folder / "bag"


def without(*left_out: str) -> Change:
    def change(topic: str, t: float, message: Any) -> Iterator[Said]:
        if topic not in left_out:
            yield topic, t, message

    return change


def test_a_recording_in_sqlite_is_read_like_one_in_mcap(said: list[Said], tmp_path: Path, world: World) -> None:
    (tmp_path / "b").mkdir()
    one = judged(recorded(said, tmp_path), world=world)
    two = judged(recorded(said, tmp_path / "b", sqlite=True), world=world)
    assert np.array_equal(one.run.trajectory.x, two.run.trajectory.x) and len(one.run.human_names) == 2
    assert one.notes == two.notes and any("/clock" in note for note in one.notes)


def test_gaps_are_told(said: list[Said], tmp_path: Path, world: World) -> None:
    def change(topic: str, t: float, message: Any) -> Iterator[Said]:
        at = t - BEGIN_S
        if not (topic == "/odom" and 4.0 < at < 6.0) and not (topic == "/human_states" and at > 8.0):
            yield topic, t, message

    found = judged(recorded(said, tmp_path, change), world=world)
    assert any("1 gap " in note and "2.0 s" in note for note in found.notes)
    assert sum("seen from 0.0 s to 8.0 s only" in note for note in found.notes) == 2


def test_poses_that_are_no_numbers_are_left_out(said: list[Said], tmp_path: Path, world: World) -> None:
    def change(topic: str, t: float, message: Any) -> Iterator[Said]:
        if topic == "/tf" and 3.0 < t - BEGIN_S < 3.5:
            message.transforms[0].transform.translation.x = math.nan
        if topic == "/odom" and 5.0 < t - BEGIN_S < 5.5:
            message.pose.pose.position.y = math.inf
        yield topic, t, message

    path = judged(recorded(said, tmp_path, change), world=world).run.trajectory
    assert np.isfinite(path.x).all() and np.isfinite(path.y).all() and np.isfinite(path.human_x).all()


def test_two_robots_are_refused_until_one_is_named(said: list[Said], tmp_path: Path, run: Run, world: World) -> None:
    def change(topic: str, t: float, message: Any) -> Iterator[Said]:
        yield topic, t, message
        if topic == "/odom":
            yield "/other/odom", t, message

    path = recorded(said, tmp_path, change)
    with pytest.raises(FileError):
        judged(path, world=world)
    found = judged(path, world=world, robot_topic="/odom")
    assert found.run.trajectory.x[-1] == pytest.approx(run.trajectory.x[-1], abs=0.2)


def test_without_odometry_transforms_place_the_robot(said: list[Said], tmp_path: Path, run: Run, world: World) -> None:
    found = judged(recorded(said, tmp_path, without("/odom")), world=world)
    assert any("no odometry" in note for note in found.notes)
    assert np.allclose(found.run.trajectory.x, run.trajectory.x[::4][: len(found.run.trajectory)], atol=1e-6)
    assert found.run.trajectory.v.max() == pytest.approx(run.trajectory.v.max(), abs=0.1)


def on_another_clock(topic: str, t: float, message: Any) -> Iterator[Said]:
    if topic == "/human_states":
        message.header.stamp.sec += 1_700_000_000
    yield topic, t, message


def with_goals_of_another_type(topic: str, t: float, message: Any) -> Iterator[Said]:
    yield topic, t, message.pose if topic == "/goal_pose" else message


def with_facts_of_others(topic: str, t: float, message: Any) -> Iterator[Said]:
    if topic == "/goal_pose":
        yield "/rvsg/run", t, Messages(rosbags_types()).make("std_msgs/String", data='{"t0": 0.0, "header": {}}')
    yield topic, t, message


@pytest.mark.parametrize(
    ("change", "named"),
    [
        pytest.param(without("/odom", "/tf"), {}, id="no-pose-of-the-robot"),
        pytest.param(on_another_clock, {}, id="another-clock"),
        pytest.param(with_goals_of_another_type, {}, id="goal-of-another-type"),
        pytest.param(with_facts_of_others, {}, id="facts-of-others"),
        pytest.param(None, {"robot_topic": "/tf"}, id="robot-topic"),
        pytest.param(None, {"people_topic": "/odom"}, id="people-topic"),
    ],
)
def test_what_cannot_be_read_as_a_run_is_refused(
    said: list[Said], tmp_path: Path, world: World, change: Change | None, named: dict[str, str]
) -> None:
    with pytest.raises(FileError):
        judged(recorded(said, tmp_path, change), world=world, **named)


def test_a_recording_of_several_runs_is_refused(said: list[Said], tmp_path: Path, world: World) -> None:
    again = [(topic, t + said[-1][1], message) for topic, t, message in said]  # stamps begin again
    with pytest.raises(FileError):
        judged(recorded([*said, *again], tmp_path), world=world)


@pytest.mark.parametrize("frame", ["base_footprint", "camera"])
def test_people_are_moved_to_the_map_frame(
    said: list[Said], tmp_path: Path, run: Run, world: World, frame: str
) -> None:
    path = run.trajectory

    def change(topic: str, t: float, message: Any) -> Iterator[Said]:
        if topic == "/human_states":
            k = int(np.abs(path.t - (t - BEGIN_S)).argmin())
            cos, sin = math.cos(path.yaw[k]), math.sin(path.yaw[k])
            message.header.frame_id = frame
            for i, agent in enumerate(message.agents):
                dx, dy = path.human_x[k, i] - path.x[k], path.human_y[k, i] - path.y[k]
                agent.position.position.x, agent.position.position.y = cos * dx + sin * dy, -sin * dx + cos * dy
        yield topic, t, message

    bag = recorded(said, tmp_path, change)
    if frame == "camera":
        with pytest.raises(FileError):
            judged(bag, world=world)
        return
    found = judged(bag, world=world).run
    assert np.allclose(found.trajectory.human_x, path.human_x[::4][: len(found.trajectory)], atol=1e-6)


@pytest.mark.exhaustive
def test_memory_does_not_grow_with_topics_that_are_not_needed(said: list[Said], tmp_path: Path, world: World) -> None:
    messages = Messages(rosbags_types())
    stamp, _ = messages.time(0.0)
    picture = messages.make(
        "sensor_msgs/Image", header=messages.header(stamp, "camera"), height=1000, width=1000, encoding="mono8",
        is_bigendian=0, step=1000, data=np.zeros(1_000_000, np.uint8),
    )  # fmt: skip
    pictures = [("/camera", BEGIN_S + k / 10, picture) for k in range(100)]
    path = recorded(sorted([*said, *pictures], key=lambda each: each[1]), tmp_path)
    tracemalloc.start()
    found = judged(path, world=world)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(found.run.trajectory) > 50
    assert peak < 25_000_000


def test_markers_are_read_where_they_are_chosen(said: list[Said], tmp_path: Path, run: Run, world: World) -> None:
    made = Messages(rosbags_types())

    def as_markers(topic: str, t: float, message: Any) -> Iterator[Said]:
        if topic != "/human_states":
            yield topic, t, message
            return
        size, stamp = (0.8, 0.8, 1.7), message.header.stamp
        shown = [
            made.marker(stamp, "map", CYLINDER, size, ns="people", id=k, pose=agent.position, text=agent.name)
            for k, agent in enumerate(message.agents)
        ]
        yield "/shown", t, made.make("visualization_msgs/MarkerArray", markers=shown)

    bag = recorded(said, tmp_path, as_markers)
    without = judged(bag, world=world)
    assert without.run.human_names == ()
    assert any("/shown" in note and "--people-topic" in note for note in without.notes)
    found = judged(bag, world=world, people_topic="/shown").run
    assert set(found.human_names) == set(run.human_names)


@pytest.mark.parametrize("facts", [{"imu": [[1.0], [1.0, 2.0]]}, {"log": {"t": [0.0]}}])
def test_a_damaged_description_of_a_run_in_a_bag_is_one_message(
    run: Run, world: World, tmp_path: Path, facts: dict[str, Any]
) -> None:
    whole = tmp_path / "run.mcap"
    write_bag(run, world, whole)
    with open_bag(whole) as reader:
        found = [(c.topic, stamp / 1e9, reader.deserialize(raw, c.msgtype)) for c, stamp, raw in reader.messages()]

    def damaged(topic: str, t: float, message: Any) -> Iterator[Said]:
        if topic == "/rvsg/run":
            message.data = json.dumps(json.loads(message.data) | facts)
        yield topic, t, message

    with pytest.raises(FileError):
        judged(recorded(found, tmp_path, damaged), world=world)


@pytest.mark.parametrize(
    "damage",
    [
        lambda grid: setattr(grid.info, "width", grid.info.width + 3),
        lambda grid: setattr(grid.info.origin.position, "x", math.nan),
        lambda grid: (setattr(grid.info, "width", 0), setattr(grid, "data", grid.data[:0])),
    ],
)
def test_a_map_that_is_not_as_it_says_is_one_message(
    run: Run, world: World, tmp_path: Path, damage: Callable[[Any], None]
) -> None:
    write_bag(run, world, tmp_path / "run.mcap")
    with open_bag(tmp_path / "run.mcap") as reader:
        grids = (each for each in reader.messages() if each[0].topic == "/map")
        connection, stamp, raw = next(grids)
        grid = reader.deserialize(raw, connection.msgtype)
    damage(grid)
    with pytest.raises(FileError, check=coded("bag-map")):
        judged(recorded([("/map", stamp / 1e9, grid)], tmp_path), world=world)


def shown_as(kind: str, frame: str = "map") -> Change:
    """Show the people as messages of another type."""
    made = Messages(rosbags_types())

    def change(topic: str, t: float, message: Any) -> Iterator[Said]:
        if topic != "/human_states":
            yield topic, t, message
            return
        header = made.header(message.header.stamp, frame)
        poses = [agent.position for agent in message.agents]
        if kind == "geometry_msgs/PoseArray":
            yield "/seen", t, made.make(kind, header=header, poses=poses)
        elif kind == "people_msgs/People":
            people = [
                made.make("people_msgs/Person", name=agent.name, position=agent.position.position)
                for agent in message.agents
            ]
            yield "/seen", t, made.make(kind, header=header, people=people)
        elif kind == "vision_msgs/Detection3DArray":
            found = [
                made.make("vision_msgs/Detection3D", bbox=made.make("vision_msgs/BoundingBox3D", center=pose))
                for pose in poses
            ]
            yield "/seen", t, made.make(kind, header=header, detections=found)
        else:
            moves = [
                made.transform(message.header.stamp, "map", f"person_{k}", pose.position.x, pose.position.y, 0.0)
                for k, pose in enumerate(poses)
            ]
            yield "/tf", t, made.make("tf2_msgs/TFMessage", transforms=moves)

    return change


@pytest.mark.parametrize(
    ("kind", "named"),
    [
        ("people_msgs/People", {}),
        ("vision_msgs/Detection3DArray", {}),
        ("geometry_msgs/PoseArray", {"people_topic": "/seen"}),
        ("tf2_msgs/TFMessage", {"people_frames": "person_*"}),
    ],
)
@pytest.mark.parametrize("sqlite", [False, True], ids=["mcap", "sqlite"])
def test_people_of_each_source_are_where_they_were(
    said: list[Said], tmp_path: Path, run: Run, world: World, kind: str, named: dict[str, str], sqlite: bool
) -> None:
    found = judged(recorded(said, tmp_path, shown_as(kind), sqlite=sqlite), world=world, **named).run.trajectory
    path, t = run.trajectory, found.t
    for k in range(found.human_x.shape[1]):
        away = [
            np.hypot(found.human_x[:, k] - np.interp(t, path.t, path.human_x[:, i]),
                     found.human_y[:, k] - np.interp(t, path.t, path.human_y[:, i])).max()
            for i in range(2)
        ]  # fmt: skip
        assert min(away) < 0.3
    assert found.human_x.shape[1] == 2


def test_a_bag_that_was_cut_off_is_one_message(said: list[Said], tmp_path: Path, world: World) -> None:
    whole = next(recorded(said, tmp_path).glob("*.mcap"))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    with pytest.raises(FileError, match="mcap recover"):
        judged(cut, world=world)


def test_only_a_bag_is_said_to_be_repairable(tmp_path: Path, world: World) -> None:
    (tmp_path / "notes.mcap").write_text("Monday: the robot stopped at the gate.")
    (tmp_path / "empty.db3").touch()
    (tmp_path / "folder").mkdir()
    (tmp_path / "whole.mcap").write_bytes(MCAP + bytes(20) + MCAP)
    for path in (*map(tmp_path.joinpath, ("notes.mcap", "empty.db3", "folder", "whole.mcap")), tmp_path):
        with pytest.raises(FileError) as caught:
            judged(path, world=world)
        assert ("recover" in str(caught.value) or "reindex" in str(caught.value)) == (path is tmp_path)
    (tmp_path / "cut.db3").write_bytes(b"SQLite format 3\0" + bytes(100))
    with pytest.raises(FileError, match="reindex"):
        judged(tmp_path / "cut.db3", world=world)
