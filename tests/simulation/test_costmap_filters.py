"""Nav2's keepout and speed filters: their masks, what they make of both costmaps, and the speed of each controller."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.simulation.parts import TIAGO

from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError, InputError
from rvsg.scenario.builder import scenario
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.world_lookup import load_world
from rvsg.simulation.embedded.costmap_filters import keepout_costs, on_map, speed_shares
from rvsg.simulation.embedded.simulator import EmbeddedSimulator
from rvsg.simulation.embedded.trace import trace_run
from rvsg.simulation.run import Run
from rvsg.simulation.stacks.nav2_params import read_nav2_params
from rvsg.simulation.stacks.parameter_file import SKELETONS
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg.world.occupancy import runs_of
from rvsg.world.world import World

PARAMS = """\
controller_server:
  ros__parameters:
    FollowPath: {{plugin: "{plugin}"}}
local_costmap:
  local_costmap:
    ros__parameters:
      filters: ["keepout_filter"]
      keepout_filter: {{plugin: "nav2_costmap_2d::KeepoutFilter", filter_info_topic: "/keepout_info", enabled: true}}
global_costmap:
  global_costmap:
    ros__parameters:
      filters: ["keepout_filter", "speed_filter"]
      keepout_filter: {{plugin: "nav2_costmap_2d::KeepoutFilter", filter_info_topic: "keepout_info", enabled: {off}}}
      speed_filter: {{plugin: "nav2_costmap_2d::SpeedFilter", filter_info_topic: "speed_info", enabled: {speed}}}
keepout_filter_mask_server:
  ros__parameters: {{topic_name: "keepout_mask", yaml_filename: "keepout.yaml"}}
keepout_costmap_filter_info_server:
  ros__parameters: {{type: 0, filter_info_topic: "keepout_info", mask_topic: "/keepout_mask"}}
speed_filter_mask_server:
  ros__parameters: {{topic_name: "speed_mask", yaml_filename: "speed.yaml"}}
speed_costmap_filter_info_server:
  ros__parameters: {{type: {type}, filter_info_topic: "/speed_info", mask_topic: "speed_mask", multiplier: {by}}}
"""
ZONE = (-1.0, 3.0, -6.0, -2.0)
"""left, right, low, high; m"""


def mask(folder: Path, name: str, values: np.ndarray, *, x: float, y: float, resolution: float = 0.05) -> None:
    """Write a mask whose grey is the share of occupation."""
    Image.fromarray(np.round(255 - 2.55 * values[::-1]).astype(np.uint8)).save(folder / f"{name}.pgm")
    (folder / f"{name}.yaml").write_text(
        f"image: {name}.pgm\nmode: scale\nresolution: {resolution}\norigin: [{x}, {y}, 0.0]\nnegate: 0\n"
        "occupied_thresh: 1.0\nfree_thresh: 0.0\n"
    )


def params(
    folder: Path, stack: str = "nav2-dwb", *, keepout: str = "true", speed: str = "true", kind: int = 1, by: float = 1.0
) -> Path:
    """Write a parameter file; with masks that fill a part of the warehouse, where its values are 100 and 40."""
    left, _, low, _ = ZONE
    for name, value in (("keepout", 100), ("speed", 40)):
        values = np.zeros((120, 120))
        values[20:100, 20:100] = value
        mask(folder, name, values, x=left - 1.0, y=low - 1.0)
    file = folder / f"{stack}.yaml"
    text = PARAMS.format(plugin=SKELETONS[stack], off=keepout, speed=speed, type=kind, by=by)
    file.write_text(text.replace("enabled: true}", f"enabled: {keepout}}}", 1))
    return file


@pytest.fixture(scope="module")
def world() -> World:
    return load_world("warehouse")


def driven(world: World, stack: str | Path) -> Run:
    simulator = EmbeddedSimulator(stack=str(stack))
    return simulator.run(empty(world), world, seed=1)


def empty(world: World) -> Scenario:
    return scenario(world, "route_1", [])


def inside(run: Run, grown: float = 0.0) -> np.ndarray:
    left, right, low, high = ZONE
    x, y = run.trajectory.x, run.trajectory.y
    return (x > left - grown) & (x < right + grown) & (y > low - grown) & (y < high + grown)


def test_a_mask_is_read_as_the_map_server_publishes_it(tmp_path: Path, world: World) -> None:
    read = read_nav2_params(params(tmp_path, by=2.0))
    keepout, speed = StackChoice.of(str(read.path)).driver.adapt(TIAGO).navigation.costmap_filters
    assert (keepout.kind, keepout.costmaps, speed.kind, speed.costmaps) == (
        "keepout", ("local", "global"), "speed_percent", ("global",)
    )  # fmt: skip
    assert {value for value, _ in keepout.cells} == {0, 100} and {value for value, _ in speed.cells} == {0, 40}
    cells = on_map(speed, world.occupancy)
    assert (cells == 40).sum() == 80 * 80 and (cells == -1).any()
    shares = speed_shares(TIAGO.replace(navigation=TIAGO.navigation.replace(costmap_filters=(speed,))),
                          world.occupancy, "global")  # fmt: skip
    assert set(np.unique(shares)) == {-1.0, 0.8, 1.0}
    robot = TIAGO.replace(navigation=TIAGO.navigation.replace(costmap_filters=(keepout,)))
    costs = keepout_costs(robot, world.occupancy, "local")
    assert set(np.unique(costs)) == {0, 254, 255} and not keepout_costs(TIAGO, world.occupancy, "local").size
    states = {entry.key: entry.state for entry in read.entries}
    assert states["speed_filter_mask_server.yaml_filename"] == "honoured"
    assert "not supported" not in states.values()


def test_cells_are_kept_by_their_lengths() -> None:
    values = np.array([[0, 0, -1], [-1, 100, 100]], np.int16)
    assert runs_of(values) == [(0, 2), (-1, 2), (100, 2)]


@pytest.mark.parametrize("stack", sorted(SKELETONS))
def test_a_robot_is_slower_in_a_zone_and_as_fast_behind_it(stack: str, tmp_path: Path, world: World) -> None:
    before = driven(world, stack)
    limited = params(tmp_path, stack, keepout="false")
    after = driven(world, limited)
    slow = inside(after, -0.75)  # the global costmap is updated once in a second
    assert slow.sum() > 50 and inside(before, -0.75).sum() > 10
    limit = 0.4 * StackChoice.of(str(limited)).driver.adapt(TIAGO).navigation.costmap_filters[0].full_m_s
    assert after.trajectory.v[slow].max() <= limit + 0.01 < before.trajectory.v[inside(before, -0.75)].max()
    assert after.trajectory.v[~inside(after, 1.0)].max() > limit + 0.05
    again = driven(world, limited)
    assert (again.trajectory.x == after.trajectory.x).all(), "the same file gives the same run"


def test_a_trace_shows_the_samples_of_a_zone(tmp_path: Path, world: World) -> None:
    simulator = EmbeddedSimulator(stack=str(params(tmp_path, keepout="false")))
    frames = [each for each in trace_run(empty(world), world, seed=1, simulator=simulator).frames if each.evaluation]
    fastest = [each.evaluation.velocity[:, 0].max() for each in frames if each.evaluation is not None]
    assert min(fastest) == pytest.approx(0.4) and max(fastest) == pytest.approx(1.0)
    assert all(each.evaluation is not None and each.evaluation.best >= 0 for each in frames[:40])


@pytest.mark.parametrize("stack", sorted(SKELETONS))
def test_nobody_drives_into_a_keepout_zone(stack: str, tmp_path: Path, world: World) -> None:
    assert inside(driven(world, stack)).any()
    run = driven(world, params(tmp_path, stack, speed="false"))
    assert not inside(run).any(), "the robot's centre stays out, whether there is another way or not"


def test_a_limit_in_m_s_is_a_share_of_the_speed_of_the_controller(tmp_path: Path, world: World) -> None:
    file = params(tmp_path, "nav2-rpp", keepout="false", kind=2, by=0.005)
    robot = StackChoice.of(str(file)).driver.adapt(TIAGO)
    assert robot.navigation.costmap_filters[0].full_m_s == 0.5
    assert set(np.unique(speed_shares(robot, world.occupancy, "global"))) == {-1.0, 0.4, 1.0}
    after = driven(world, file)
    assert after.trajectory.v[inside(after, -0.75)].max() <= 0.2 + 0.01


@pytest.mark.parametrize("stack", ["nav2-dwb", "nav2-rpp"])
def test_a_mask_without_zones_leaves_a_run_as_it_is(stack: str, tmp_path: Path, world: World) -> None:
    off = driven(world, params(tmp_path, stack, keepout="false", speed="false"))
    file = params(tmp_path, stack, keepout="false")
    mask(tmp_path, "speed", np.zeros((120, 120)), x=-2.0, y=-7.0)
    assert (driven(world, file).trajectory.x == off.trajectory.x).all()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("yaml_filename: \"speed.yaml\"", "", "lead to a yaml_filename"),
        ("SpeedFilter", "BinaryFilter", "keepout and speed filters are simulated"),
        ("type: 1", "type: 3", "type 1 (percent) or 2 (m/s)"),
    ],
)  # fmt: skip
def test_what_is_not_simulated_of_a_filter_is_told(old: str, new: str, said: str, tmp_path: Path) -> None:
    file = params(tmp_path)
    file.write_text(file.read_text().replace(old, new))
    told = [entry for entry in read_nav2_params(file).entries if entry.state == "not supported"]
    assert {entry.key.rpartition(".")[2] for entry in told} >= {"filters", "plugin"}
    assert said in told[0].note


def test_a_mask_that_cannot_be_used_is_told_with_its_file(tmp_path: Path, world: World) -> None:
    file = params(tmp_path)
    (tmp_path / "speed.pgm").write_bytes(b"P5 no picture")
    with pytest.raises(FileError, match=r"speed\.pgm.*(cannot be read|not a readable)"):
        read_nav2_params(file)
    (tmp_path / "speed.yaml").write_text("image: speed.pgm\nresolution: 0\n")
    with pytest.raises(DocumentError, match=r"speed\.yaml:2: resolution"):
        read_nav2_params(file)
    (tmp_path / "speed.yaml").unlink()
    with pytest.raises(DocumentError, match=r"nav2-dwb\.yaml:20: .*there is no .*speed\.yaml"):
        read_nav2_params(file)
    mask(tmp_path, "speed", np.zeros((20, 20)), x=500.0, y=0.0)
    with pytest.raises(InputError, match=r"1 x 1 m from \(500, 0\) on, says nothing of the map"):
        driven(world, file)
