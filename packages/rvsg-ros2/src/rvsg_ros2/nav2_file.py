"""Nav2's parameter files for a running system: written for a robot, and scaled for a faster clock.

`rvsg.simulation.stacks.nav2_params` reads such files; what this module writes, it reads back without a loss, but for
what the release decides: recoveries pass the velocity smoother from Jazzy on.

Nav2 up to Kilted runs its loops on wall time, also with `use_sim_time`: controller server, costmap updates, behaviours,
behaviour tree and velocity smoother. At R times real time every frequency of theirs must be R times higher, and so must
the limits that they multiply with one over that frequency. What counts simulated time already (publish_frequency,
time-outs of the progress checker, velocity_timeout, tolerances of transforms) stays. From Lyrical on the loops follow
the simulated clock, and only the RateController of the behaviour tree still counts wall time.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from jinja2 import Environment, PackageLoader

from rvsg.core.documents import parse_yaml, read_yaml
from rvsg.core.errors import FileError, InputError
from rvsg.robots.robot import DEFAULT_ROBOT, MonitorPolygon, Robot, load_robot
from rvsg.simulation.stacks.mppi import Mppi
from rvsg.simulation.stacks.nav2_keys import CRITICS, DWB, NEGATIVE, OPTIONS, SAME_AS
from rvsg.simulation.stacks.nav2_params import POLYGON, read_nav2_text
from rvsg.simulation.stacks.nav2_stack import Configured, Nav2Dwb, Nav2Settings
from rvsg.simulation.stacks.parameters import value_at
from rvsg.simulation.stacks.protocol import NavigationStack
from rvsg.simulation.stacks.pure_pursuit import PurePursuit
from rvsg.simulation.stacks.stack_choice import StackChoice, StackLike
from rvsg_ros2.interfaces import Release
from rvsg_ros2.options import Ros2Options, scan_topic


def nav2_text(robot: Robot, driver: NavigationStack, release: Release) -> str:
    """Return Nav2's parameter file for a robot, with the names and frames that the stack `ros2` uses.

    Args:
        driver: a built-in stack, whose controller and changes of the robot's parameters are taken over.

    Raises:
        InputError: the stack has no controller of Nav2.
    """
    name = driver.name or type(driver).__name__
    robot, options, old = driver.adapt(robot), Ros2Options(), release == "humble"
    controller = _controller(driver, robot, name)
    size = robot.navigation.costmaps.local_size_m
    if size % 1:
        raise InputError(f"costmaps.local_size_m is {size:g}; Nav2 takes whole metres.", code="nav2-whole-metres")
    lidars = [(each.name, scan_topic(options, robot.lidars, k)) for k, each in enumerate(robot.lidars)]
    loader = PackageLoader("rvsg_ros2", ".")
    environment = Environment(loader=loader, finalize=_yaml, trim_blocks=True, lstrip_blocks=True)  # noqa: S701 (YAML)
    text = environment.get_template("nav2_params.yaml.j2").render(
        robot=robot,
        o=options,
        maps=robot.navigation.costmaps,
        smoother=robot.smoother,
        side=robot.limits.lateral_m_s,
        old=old,
        separator=Verbatim("/" if old else "::"),
        controller=controller,
        lidars=lidars,
        polygons={each.name: _polygon(each, old) for each in robot.navigation.collision_monitor},
        corners=_corners,
        verbatim=Verbatim,
    )
    values = yaml.safe_load(text)
    numbers = robot.navigation.replace(smoother=robot.smoother).model_dump()
    places = read_nav2_text(text, Path("nav2_params.yaml")).places
    for option in (option for kind in OPTIONS.values() for option in kind.values()):
        *path, last = places[option]
        section = values
        for part in path:
            section = section[part]
        value = value_at(numbers, option)
        section[int(last) if isinstance(section, list) else last] = -value if path[-1] in NEGATIVE else value
    local = values["local_costmap"]["local_costmap"]["ros__parameters"]
    local["width"] = local["height"]  # Nav2 takes no 3.0
    head = f"# Nav2 ({release.capitalize()}) for the robot {robot.name}, as RVSG's {name} drives it.\n"
    return head + yaml.safe_dump(values, sort_keys=False, width=120)


class Verbatim(str):
    """Text that a template takes as it is."""


def _yaml(value: Any) -> str:
    """Return a value as YAML on one line."""
    if isinstance(value, Verbatim):
        return value
    return yaml.safe_dump(value, default_flow_style=True, width=math.inf, sort_keys=False).removesuffix("...\n").strip()


def _controller(driver: NavigationStack, robot: Robot, name: str) -> dict[str, Any]:
    """Return the section of the controller."""
    if isinstance(driver, Configured):
        dumped = driver.settings.model_dump(mode="json")  # the names of a controller's own options are Nav2's
        own = {key: value for key, value in dumped.items() if key not in Nav2Settings.model_fields}
    if type(driver) is PurePursuit:
        plugin = "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
        return {"plugin": plugin, "transform_tolerance": 0.1, **own}
    if type(driver) is Mppi:
        critics = [key for key in own if key.endswith("Critic") and own[key]["enabled"]]
        own |= {key: {**own[key], "cost_power": 1} for key in critics}
        plugin = "nav2_mppi_controller::MPPIController"
        return {"plugin": plugin, "motion_model": "DiffDrive", **own, "visualize": False, "critics": critics}
    if isinstance(driver, Nav2Dwb):
        return _dwb(robot)
    raise InputError(
        f"The stack {name} has no controller of Nav2. Those that have one: nav2-dwb, nav2-rpp, nav2-mppi.",
        code="stack-not-nav2",
    )


def _dwb(robot: Robot) -> dict[str, Any]:
    """Return the section of DWB, with what only the running Nav2 reads."""
    dwb = robot.dwb
    values: dict[str, Any] = {name: getattr(dwb, field) for name, field in DWB.items()}
    values |= {name: values[other] for name, other in SAME_AS.items()}
    if not dwb.max_lateral_m_s:
        values |= {"acc_lim_y": 0.0, "decel_lim_y": 0.0, "vy_samples": 1}
    values = {name: -value if name.startswith("decel") else value for name, value in values.items()}
    obstacle = "ObstacleFootprint" if dwb.check_footprint else "BaseObstacle"
    values[f"{obstacle}.scale"] = values.pop("BaseObstacle.scale")
    return {
        "plugin": "dwb_core::DWBLocalPlanner", "debug_trajectory_details": False, "min_vel_y": -dwb.max_lateral_m_s,
        "min_speed_xy": 0.0, "max_speed_xy": dwb.max_speed_m_s, "min_speed_theta": 0.0, "transform_tolerance": 0.2,
        "xy_goal_tolerance": robot.navigation.behaviours.goal_tolerance_m,
        "forward_prune_distance": dwb.prune_distance_m, "short_circuit_trajectory_evaluation": True, "stateful": True,
        "critics": [obstacle if name == "BaseObstacle" else name for name in CRITICS if name != "ObstacleFootprint"],
        **values, "RotateToGoal.lookahead_time": -1.0,
    }  # fmt: skip


def _polygon(polygon: MonitorPolygon, old: bool) -> dict[str, Any]:
    found: dict[str, Any] = {"type": "polygon", "action_type": polygon.action_type, "enabled": True}
    found |= polygon.model_dump(include=POLYGON - {"min_points"})
    if polygon.points is None:
        found["footprint_topic"] = "/local_costmap/published_footprint"
    else:
        found["points"] = [float(n) for point in polygon.points for n in point] if old else _corners(polygon.points)
    return found | ({"max_points": polygon.min_points - 1} if old else {"min_points": polygon.min_points})


def _corners(points: Iterable[tuple[float, float]]) -> str:
    """Return corners as Nav2 reads them: a text."""
    return f"[{', '.join(f'[{x:g}, {y:g}]' for x, y in points)}]"


def new_nav2_params(
    robot: Robot | str | Path = DEFAULT_ROBOT,
    stack: StackLike = "nav2-dwb",
    options: Mapping[str, Any] | None = None,
    *,
    release: Release = "jazzy",
) -> str:
    """Return the Nav2 parameter file of a robot, with the parameters that a built-in stack drives it with.

    Args:
        stack: nav2-dwb, nav2-rpp or nav2-mppi.
        options: of that stack.

    Raises:
        InputError: the stack has no controller of Nav2.
    """
    given = robot if isinstance(robot, Robot) else load_robot(robot)
    return nav2_text(given, StackChoice.of(stack, options).driver, release)


SCALED: tuple[tuple[str, str, Any], ...] = (
    # Wall-clock frequencies.
    ("controller_server", "controller_frequency", 20.0),
    ("local_costmap", "update_frequency", 5.0),
    ("global_costmap", "update_frequency", 5.0),
    ("behavior_server", "cycle_frequency", 10.0),
    ("recoveries_server", "cycle_frequency", 10.0),
    ("velocity_smoother", "smoothing_frequency", 20.0),
    ("waypoint_follower", "loop_rate", 20),
    # Limits that these loops multiply with one over their frequency.
    ("velocity_smoother", "max_accel", [2.5, 0.0, 3.2]),
    ("velocity_smoother", "max_decel", [-2.5, 0.0, -3.2]),
    # Limits on the wall time of work that takes as long at any speed, but is counted in simulated time.
    ("controller_server", "costmap_update_timeout", 0.30),
    ("planner_server", "costmap_update_timeout", 1.0),
    ("bt_navigator", "default_server_timeout", 20),
)
"""Node, parameter, Nav2's default where the file has none: multiplied by the speed."""
TREES = {
    "default_nav_to_pose_bt_xml": "navigate_to_pose_w_replanning_and_recovery.xml",
    "default_nav_through_poses_bt_xml": "navigate_through_poses_w_replanning_and_recovery.xml",
}
"""The parameters of bt_navigator that name a tree, and the trees that Nav2 takes without them."""
CONTROL_HZ = 20.0
"""Nav2's default rate of velocity commands."""
BY_THE_CLOCK: tuple[Release, ...] = ("lyrical",)
"""Releases whose loops follow the simulated clock."""
NOT_SCALED = ("docking_server", "route_server", "collision_monitor")
_RATE = re.compile(r'(<RateController\b[^>]*?\bhz\s*=\s*")([^"]+)(")')


@dataclass(frozen=True)
class Change:
    """One parameter that was scaled."""

    name: str
    """`node.parameter`, or the file of a behaviour tree."""
    before: Any
    """None: not given, so Nav2's default was scaled."""
    after: Any

    def __str__(self) -> str:
        """Return the change in words."""
        before = "Nav2's default" if self.before is None else self.before
        return f"{self.name}: {before} becomes {self.after}"


@dataclass
class Scaled:
    """Parameters for a speed, what was changed, and what could not be."""

    values: dict[str, Any]
    changes: list[Change] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    trees: dict[str, str] = field(default_factory=dict)
    """Texts of scaled behaviour trees, by the parameter that names the file."""
    missing_trees: list[str] = field(default_factory=list)
    """Behaviour trees whose file was not found; their RateControllers keep wall time."""
    control_hz: float = CONTROL_HZ
    """The rate at which velocity commands come, in simulated time."""

    def text(self) -> str:
        """Return the parameter file."""
        return yaml.safe_dump(self.values, sort_keys=False, allow_unicode=True, width=120)

    def write(self, folder: Path) -> Path:
        """Write parameter file and trees; return the path of the first."""
        for name, text in self.trees.items():
            tree = folder / f"{name}.xml"
            tree.write_text(text)
            for values in self.sections("bt_navigator"):
                values[name] = str(tree)
        path = folder / "params.yaml"
        path.write_text(self.text())
        return path

    def sections(self, node: str, values: dict[str, Any] | None = None) -> Iterator[dict[str, Any]]:
        """Yield the parameters of a node, under whichever namespaces they stand."""
        for key, inner in (self.values if values is None else values).items():
            if not isinstance(inner, dict):
                continue
            if str(key).rstrip("/").rpartition("/")[2] == node and isinstance(inner.get("ros__parameters"), dict):
                yield inner["ros__parameters"]
            if key != "ros__parameters":
                yield from self.sections(node, inner)

    def set(self, section: dict[str, Any], where: str, name: str, value: Any) -> None:
        """Set a parameter, and keep the change."""
        before = section.get(name)
        if before != value:
            section[name] = value
            self.changes.append(Change(f"{where}.{name}", before, value))


def scale_nav2_params(path: str | Path, speed: float, release: Release = "jazzy", text: str | None = None) -> Scaled:
    """Return Nav2 parameters for `speed` times real time, with every change and what cannot be scaled.

    Args:
        text: the file with other values; by default as it is.

    Raises:
        FileError: the file holds no parameters of Nav2 nodes.
    """
    values = (read_yaml(Path(path)) if text is None else parse_yaml(text, Path(path))).value
    if not isinstance(values, dict) or not any(True for _ in Scaled(values).sections("controller_server")):
        said = "this is no Nav2 parameter file: expected a controller_server with ros__parameters."
        raise FileError(Path(path), said, code="nav2-params")
    return scale(values, speed, release)


def scale(values: dict[str, Any], speed: float, release: Release) -> Scaled:
    """Scale parameters in place; see the module."""
    made = Scaled(values)
    made.control_hz = _control_hz(made)
    if speed == 1.0:
        return made
    if release not in BY_THE_CLOCK:
        _scale_rates(made, speed, release)
    _scale_trees(made, speed)
    if release not in BY_THE_CLOCK:
        made.notes += [f"{node}: not scaled" for node in NOT_SCALED if any(map(_works, made.sections(node)))]
    return made


def _scale_rates(made: Scaled, speed: float, release: Release) -> None:
    for node, name, default in SCALED:
        for section in made.sections(node):
            if name != "costmap_update_timeout" or release != "humble":
                made.set(section, node, name, _times(section.get(name, default), speed))
    for node in ("behavior_server", "recoveries_server"):
        for section in made.sections(node):
            for name in section.get("behavior_plugins", ["spin", "backup", "drive_on_heading", "wait"]):
                if isinstance(settings := section.get(name), dict):
                    _scale_behaviour(made, settings, f"{node}.{name}", speed, release)
    for section in made.sections("bt_navigator"):
        period = section.get("bt_loop_duration", 10)
        made.set(section, "bt_navigator", "bt_loop_duration", max(1, round(period / speed)))
        if round(period / speed) < 1:
            made.notes.append("bt_navigator.bt_loop_duration: 1 ms is the least; the tree ticks less often than at 1x")
    for section in made.sections("controller_server"):
        frequency = float(section.get("controller_frequency", 20.0 * speed)) / speed
        for name in section.get("controller_plugins", ["FollowPath"]):
            if isinstance(settings := section.get(name), dict):
                _scale_controller(made, settings, f"controller_server.{name}", speed, frequency)
    for section in made.sections("velocity_smoother"):
        # Its timer cuts the period to whole milliseconds, its steps do not.
        period_ms = 1000.0 / section["smoothing_frequency"]
        if period_ms > 1.0 and period_ms != int(period_ms):
            rate = int(100_000.0 / int(period_ms)) / 100.0  # just below, so that the cut gives the same milliseconds
            made.set(section, "velocity_smoother", "smoothing_frequency", rate)
            made.control_hz = rate / speed
            made.notes.append(
                f"velocity_smoother: its timer takes whole milliseconds, so commands come at {made.control_hz:.4g} Hz"
            )


def _works(section: dict[str, Any]) -> bool:
    """Return whether a node has anything to do: a collision monitor whose polygons are all off has not."""
    polygons = section.get("polygons")
    if not isinstance(polygons, list):
        return True
    named = [section.get(name) for name in polygons]
    return any(not isinstance(each, dict) or each.get("enabled", True) for each in named)


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, list):
        return [_times(each, factor) for each in value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return round(value * factor) if isinstance(value, int) else float(value * factor)


def _control_hz(made: Scaled) -> float:
    """Return the rate of velocity commands: that of the last node that shapes them."""
    for node, name in (("velocity_smoother", "smoothing_frequency"), ("controller_server", "controller_frequency")):
        for section in made.sections(node):
            rate = section.get(name, CONTROL_HZ)
            if isinstance(rate, int | float) and rate > 0:
                return float(rate)
    return CONTROL_HZ


def _scale_behaviour(made: Scaled, settings: dict[str, Any], where: str, speed: float, release: Release) -> None:
    drives = any(word in str(settings.get("plugin", "")) for word in ("BackUp", "DriveOnHeading"))
    defaults = (2.5, -2.5) if release == "kilted" and drives else (None, None)
    for name, default in zip(("acceleration_limit", "deceleration_limit"), defaults, strict=True):
        if (value := settings.get(name, default)) is not None:
            made.set(settings, where, name, _times(value, speed))


def _scale_controller(made: Scaled, settings: dict[str, Any], where: str, speed: float, frequency: float) -> None:
    plugins = " ".join(str(settings.get(key, "")) for key in ("plugin", "primary_controller"))
    if "LimitedAccelGenerator" in str(settings.get("trajectory_generator_name", "")):
        made.set(settings, where, "sim_period", settings.get("sim_period", 1.0 / frequency))
    if any(kind in plugins for kind in ("RotationShim", "RegulatedPurePursuit")):
        made.set(settings, where, "max_angular_accel", _times(settings.get("max_angular_accel", 3.2), speed))
        made.notes.append(
            f"{where}.max_angular_accel: scaled for its step per cycle; where the controller also computes a braking "
            "angle from it, turns end more abruptly than at 1x"
        )
    if "MPPI" in plugins:
        made.notes.append(
            f"{where}: MPPI moves its control sequence on by model_dt per cycle only where the controller's period "
            "equals it. model_dt is simulated time and stays; the sequence is not moved on. Prefer speed 1, or compare "
            "with a run at 1x."
        )


def _scale_trees(made: Scaled, speed: float) -> None:
    """Scale the RateControllers of the behaviour trees that bt_navigator uses."""
    for section in made.sections("bt_navigator"):
        for parameter, default in TREES.items():
            given = str(section.get(parameter) or "")
            path = Path(given) if given and "$(" not in given else _installed(Path(given).name if given else default)
            if path is None or not path.is_file():
                made.missing_trees.append(given or default)
                made.notes.append(
                    f"bt_navigator.{parameter}: the tree {given or default} was not found, so its RateController keeps "
                    "wall time. Source your ROS 2, or give the path of the file."
                )
                continue
            text = path.read_text()
            rates = [rate for _, rate, _ in _RATE.findall(text)]
            made.trees[parameter] = _RATE.sub(
                lambda found: f"{found[1]}{_scaled_rate(found[2], speed)}{found[3]}", text
            )
            made.changes.append(Change(str(path), rates, [_scaled_rate(rate, speed) for rate in rates]))


def _scaled_rate(rate: str, speed: float) -> str:
    try:
        return f"{float(rate) * speed:.6g}"
    except ValueError:
        return rate  # a variable of the tree


def _installed(name: str) -> Path | None:
    """Return a behaviour tree that the sourced ROS 2 has installed."""
    prefixes = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    paths = [Path(prefix) / "share" / "nav2_bt_navigator" / "behavior_trees" / name for prefix in prefixes]
    return next((path for path in paths if path.is_file()), None)
