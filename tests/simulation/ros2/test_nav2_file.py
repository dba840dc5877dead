"""A parameter file that is written for a robot asks for exactly what the built-in stack does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.coded import coded

from rvsg.cli import main
from rvsg.core.errors import InputError
from rvsg.robots.robot import load_robot, shipped_robots
from rvsg.simulation.embedded.robot_parameters import stack_of
from rvsg.simulation.stacks.nav2_keys import OPTIONS
from rvsg.simulation.stacks.nav2_params import read_nav2_params, read_nav2_text
from rvsg.simulation.stacks.nav2_stack import Configured, Nav2Settings
from rvsg.simulation.stacks.parameter_file import with_values_in_file
from rvsg.simulation.stacks.parameters import value_at
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg_ros2.interfaces import Release
from rvsg_ros2.nav2_file import nav2_text, scale_nav2_params

MONITOR = (
    {"name": "Stop", "action_type": "stop", "points": ((0.5, 0.4), (0.5, -0.4), (-0.5, -0.4)), "min_points": 6},
    {"name": "Ahead", "action_type": "approach", "time_before_collision": 1.5},
)
STACKS = {
    "nav2-dwb": {"PathDist": {"scale": 20.0}, "behaviours": {"planner_tolerance_m": 0.3}},
    "nav2-rpp": {"lookahead_dist": 0.8, "smoother": {"acceleration_m_s2": 1.5}, "collision_monitor": MONITOR},
    "nav2-mppi": {"batch_size": 500, "CostCritic": {"cost_weight": 2.0}},
}


def driver(name: str, **options: object) -> Configured:
    made = StackChoice.of(name, options).driver
    assert isinstance(made, Configured)
    return made


@pytest.mark.parametrize("release", ["humble", "jazzy"])
@pytest.mark.parametrize("stack", STACKS)
@pytest.mark.parametrize("name", sorted(shipped_robots()))
def test_what_is_written_reads_back_as_the_same_stack(name: str, stack: str, release: Release, tmp_path: Path) -> None:
    robot, written = load_robot(name), driver(stack, **STACKS[stack])
    file = tmp_path / "nav2_params.yaml"
    file.write_text(nav2_text(robot, written, release))
    read = driver(str(file))
    assert type(read) is type(written)
    one, other = (stack_of(each.adapt(robot)) for each in (written, read))
    told = {"smoothed", "gives_up_without_plan"}  # what only the release says
    assert [key for key, value in one.behaviours if value != getattr(other.behaviours, key)] == (
        [] if release == "jazzy" else sorted(told, reverse=True)
    )
    different = [key for key in one._fields if not np.array_equal(getattr(one, key), getattr(other, key))]
    assert different == ([] if release == "jazzy" else ["behaviours"])
    own = {} if stack == "nav2-dwb" else type(written.settings).model_fields.keys() - Nav2Settings.model_fields.keys()
    assert [key for key in own if getattr(written.settings, key) != getattr(read.settings, key)] == []


@pytest.mark.parametrize("stack", STACKS)
def test_every_key_of_the_table_is_changed_where_it_is_read(stack: str) -> None:
    text, path = nav2_text(load_robot("tiago_omni"), driver(stack), "jazzy"), Path("nav2_params.yaml")
    read = read_nav2_text(text, path)
    table = {option for kind in OPTIONS.values() for option in kind.values()}
    numbers = {option: value_at(read.options, option) for option in read.places}
    changed = {key: value for key, value in numbers.items() if isinstance(value, int | float) and value > 1e-6}
    assert table <= changed.keys()
    for option, value in changed.items():
        if isinstance(value, bool):
            continue
        other = value + 1 if isinstance(value, int) else 0.9 * value
        after = with_values_in_file(text, path, {option: other})
        different = [(old, new) for old, new in zip(text.splitlines(), after.splitlines(), strict=True) if old != new]
        assert len(different) == 1


def test_a_robot_that_moves_sideways_may_do_so_past_the_velocity_smoother(tmp_path: Path) -> None:
    tiago = load_robot("tiago_omni")
    robot = tiago.replace(limits=tiago.limits.replace(lateral_m_s=0.3))
    text = nav2_text(robot, driver("nav2-dwb"), "jazzy")
    smoother = yaml.safe_load(text)["velocity_smoother"]["ros__parameters"]
    assert (smoother["max_velocity"][1], smoother["min_velocity"][1]) == (0.3, -0.3)
    assert smoother["max_accel"][1] == smoother["max_accel"][0] and smoother["max_decel"][1] < 0.0
    file = tmp_path / "nav2_params.yaml"
    file.write_text(text)
    entries = {entry.key: entry.state for entry in read_nav2_params(file).entries}
    assert entries["velocity_smoother.max_velocity"] == "honoured"


def test_frames_topics_and_plug_ins_are_those_of_the_release() -> None:
    made = {
        release: yaml.safe_load(nav2_text(load_robot("tiago_omni"), driver("nav2-dwb"), release))
        for release in ("humble", "jazzy")
    }
    local = made["jazzy"]["local_costmap"]["local_costmap"]["ros__parameters"]
    assert [local[f"{name}_layer"][name]["topic"] for name in ("front", "rear")] == ["/scan", "/scan_rear"]
    assert isinstance(local["width"], int)
    spin = {key: values["behavior_server"]["ros__parameters"]["spin"]["plugin"] for key, values in made.items()}
    assert spin == {"humble": "nav2_behaviors/Spin", "jazzy": "nav2_behaviors::Spin"}


@pytest.mark.parametrize("release", ["jazzy", "kilted", "lyrical"])
def test_what_the_launch_file_of_nav2_starts_beside_can_be_configured(release: Release, tmp_path: Path) -> None:
    """Collision monitor and docking server refuse without these; the monitor must let every command pass."""
    file = tmp_path / "nav2_params.yaml"
    file.write_text(nav2_text(load_robot("tiago_omni"), driver("nav2-dwb"), release))
    nodes = {name: values.get("ros__parameters") for name, values in yaml.safe_load(file.read_text()).items()}
    monitor, docking = nodes["collision_monitor"], nodes["docking_server"]
    listed = [*monitor["polygons"], *monitor["observation_sources"]]
    assert len(listed) == 3 and not any(monitor[name]["enabled"] for name in listed)
    assert [docking[name]["plugin"] for name in docking["dock_plugins"]] == ["opennav_docking::SimpleChargingDock"]
    entries = [entry for entry in read_nav2_params(file).entries if entry.key.startswith("collision_monitor")]
    assert entries and not [entry.key for entry in entries if entry.state == "not supported"]


def test_it_can_be_scaled(tmp_path: Path) -> None:
    file = tmp_path / "nav2_params.yaml"
    file.write_text(nav2_text(load_robot("tiago_omni"), driver("nav2-rpp"), "jazzy"))
    changed = {change.name: change.after for change in scale_nav2_params(file, 4.0, "jazzy").changes}
    assert changed["controller_server.controller_frequency"] == 80.0
    assert changed["controller_server.FollowPath.max_angular_accel"] == pytest.approx(12.8)
    assert changed["velocity_smoother.max_accel"] == pytest.approx([10.0, 0.0, 12.8])


@pytest.mark.parametrize(
    ("stack", "options", "code"),
    [("stop-and-go", {}, "stack-not-nav2"), ("nav2-dwb", {"costmaps": {"local_size_m": 2.5}}, "nav2-whole-metres")],
)
def test_what_nav2_cannot_do_is_refused(stack: str, options: dict[str, object], code: str) -> None:
    with pytest.raises(InputError, check=coded(code)):
        nav2_text(load_robot("tiago_omni"), driver(stack, **options), "jazzy")


def test_the_verb_writes_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "own" / "nav2.yaml"
    wanted = ["--robot", "turtlebot3_waffle", "--stack", "nav2-rpp", "--out", str(file)]
    assert main(["ros2", "new-params", *wanted]) == 0
    server = yaml.safe_load(file.read_text())["controller_server"]["ros__parameters"]
    assert server["FollowPath"]["lookahead_dist"] == 0.6
    assert main(["ros2", "new-params"]) == 0
    assert "dwb_core::DWBLocalPlanner" in capsys.readouterr().out
