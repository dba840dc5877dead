"""Runs and scenarios as files of other tools, opened by readers that are not ours."""

from __future__ import annotations

import csv
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from tests.exchange.judged import judged

from rvsg.core.errors import FileError, UnknownName
from rvsg.core.records import Pose
from rvsg.evaluation.metrics import METRICS, measure
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.exporter import Exportable
from rvsg.simulation.run import Run
from rvsg.world.world import World
from rvsg_exchange.bag import rosbags_types, write_bag
from rvsg_exchange.formats import Csv, Parquet, goals_yaml, scenario_osc, world_sdf
from rvsg_exchange.recordings import open_bag


@pytest.fixture(scope="module")
def bag(run: Run, world: World, tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("rosbags", reason="the extra `bag` is not installed")
    path = tmp_path_factory.mktemp("bag") / "run.mcap"
    write_bag(run, world, path)
    return path


def test_nav2_goals_are_poses_in_the_map_frame(world: World) -> None:
    route = world.route("route_1").replace(through=(Pose(x=1.0, y=2.0, yaw=np.pi / 2),))
    jazzy = yaml.safe_load(goals_yaml(route, world))
    first, last = jazzy["poses"]
    assert first["header"]["frame_id"] == "map"
    assert first["pose"]["position"] == {"x": 1.0, "y": 2.0, "z": 0.0}
    assert first["pose"]["orientation"]["z"] == pytest.approx(np.sqrt(0.5))
    assert last["pose"]["position"]["x"] == route.goal.x
    kilted = yaml.safe_load(goals_yaml(route, world, release="kilted"))
    assert kilted["poses"]["goals"] == jazzy["poses"]


def test_openscenario_names_every_pose_and_no_text_leaves_its_comment(scenario: Scenario, world: World) -> None:
    text = scenario_osc(scenario.replace(description="two\nlines"), world)
    assert "# two lines\n" in text
    assert text.count("pose_3d(position_3d(") == 2
    assert f"timeout({scenario.mission.route.time_limit_s:g}s)" in text


def test_a_gazebo_world_has_every_object_and_an_actor_for_every_person(world: World, run: Run) -> None:
    root = ElementTree.fromstring(world_sdf(world, run))
    names = [model.get("name") for model in root.iter("model")]
    assert names[1:] == [thing.name for thing in world.objects]
    assert [actor.get("name") for actor in root.iter("actor")] == list(run.human_names)
    times = [float(each.text or "") for each in root.find(".//actor//trajectory").iter("time")]  # type: ignore[union-attr]
    assert times == sorted(times)
    assert times[0] == 0.0


def test_csv_gives_back_the_same_floats_and_parquet_opens_in_pandas(run: Run, tmp_path: Path) -> None:
    Csv().write(Exportable(runs=(run,)), tmp_path / "run.csv")
    with (tmp_path / "run.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["x"]) for row in rows if row["who"] == "robot"] == run.trajectory.x.tolist()
    assert Counter(row["who"] for row in rows) == dict.fromkeys(("robot", *run.human_names), len(run.trajectory))
    pandas = pytest.importorskip("pandas", reason="the extra `tables` is not installed")
    pytest.importorskip("pyarrow", reason="the extra `tables` is not installed")
    Parquet().write(Exportable(runs=(run,)), tmp_path / "run.parquet")
    frame = pandas.read_parquet(tmp_path / "run.parquet")
    assert np.array_equal(frame[frame.who == "robot"].yaw.to_numpy(), run.trajectory.yaw)
    assert frame[frame.who != "robot"].omega.isna().all()


def test_a_bag_opens_in_an_independent_reader(bag: Path, run: Run) -> None:
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
    counts: Counter[str] = Counter()
    names = set()
    with bag.open("rb") as file:
        messages = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()]).iter_decoded_messages()
        for _, channel, _, message in messages:
            counts[channel.topic] += 1
            if channel.topic == "/human_states":
                names |= {agent.name for agent in message.agents}
    assert counts["/clock"] == counts["/tf"] == counts["/odom"] == len(run.trajectory)
    assert counts["/map"] == counts["/tf_static"] == 1
    assert names == set(run.human_names)


def test_a_bag_read_back_gives_the_same_metrics(bag: Path, run: Run, world: World) -> None:
    recorded = judged(bag, world=world)
    assert recorded.notes == ()
    assert recorded.run.id == run.id
    before, after = measure(run, METRICS, world=world), measure(recorded.run, METRICS, world=world)
    assert after.keys() == before.keys()
    for name, value in before.items():
        assert after[name] == (None if value is None else pytest.approx(value, abs=1e-6)), name


def test_a_recording_of_a_robot_needs_no_word_of_ours(bag: Path, run: Run, world: World, tmp_path: Path) -> None:
    """The same bag without `/rvsg/run` and `/goal_pose`, with the route named, gives the same course."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    with open_bag(bag) as reader, Writer(tmp_path / "plain", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        left_out = ("/rvsg/run", "/goal_pose", "/clock")
        kept = [each for each in reader.connections if each.topic not in left_out]
        made = {each.topic: writer.add_connection(each.topic, each.msgtype, typestore=rosbags_types()) for each in kept}
        for connection, stamp, data in reader.messages(connections=kept):
            writer.write(made[connection.topic], stamp, data)
    with pytest.raises(FileError):
        judged(tmp_path / "plain", world=world)
    recorded = judged(tmp_path / "plain", world=world, route=world.route("route_1"))
    assert len(recorded.notes) >= 1  # no /clock
    assert np.allclose(recorded.run.trajectory.x, run.trajectory.x, atol=1e-9)
    assert recorded.run.outcome is run.outcome
    assert recorded.run.human_radius_m == pytest.approx(run.human_radius_m)


def test_a_topic_that_is_not_recorded_is_refused(bag: Path) -> None:
    with pytest.raises(UnknownName):
        judged(bag, people_topic="/peoples")


@pytest.mark.parametrize("content", [b"", b"not a bag", b"\x89MCAP0\r\n"])
def test_another_file_is_no_recording(tmp_path: Path, content: bytes) -> None:
    pytest.importorskip("rosbags", reason="the extra `bag` is not installed")
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(FileError):
        judged(path)
    with pytest.raises(FileError):
        judged(tmp_path / "absent.mcap")
