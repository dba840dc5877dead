"""Nav2 parameters for a system that runs at several times real time.

Nav2 up to Kilted runs its loops on wall time, also with `use_sim_time`: controller server, costmap updates, behaviours,
behaviour tree and velocity smoother. At R times real time every frequency of theirs must be R times higher, and so must
the limits that they multiply with one over that frequency. What counts simulated time already (publish_frequency,
time-outs of the progress checker, velocity_timeout, tolerances of transforms) stays. From Lyrical on the loops follow
the simulated clock, and only the RateController of the behaviour tree still counts wall time.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from rvsg.core.documents import read_yaml
from rvsg.core.errors import FileError
from rvsg_ros2.interfaces import Release

# (node, parameter, Nav2's default where the file has none): wall-clock frequencies, times R.
FREQUENCIES: tuple[tuple[str, str, Any], ...] = (
    ("controller_server", "controller_frequency", 20.0),
    ("local_costmap", "update_frequency", 5.0),
    ("global_costmap", "update_frequency", 5.0),
    ("behavior_server", "cycle_frequency", 10.0),
    ("recoveries_server", "cycle_frequency", 10.0),
    ("velocity_smoother", "smoothing_frequency", 20.0),
    ("waypoint_follower", "loop_rate", 20),
)
# Limits that these loops multiply with one over their frequency, times R.
STEPS: tuple[tuple[str, str, Any], ...] = (
    ("velocity_smoother", "max_accel", [2.5, 0.0, 3.2]),
    ("velocity_smoother", "max_decel", [-2.5, 0.0, -3.2]),
)
# Limits on the wall time of work that takes as long at any speed, but is counted in simulated time, times R.
ALLOWANCES: tuple[tuple[str, str, Any], ...] = (
    ("controller_server", "costmap_update_timeout", 0.30),
    ("planner_server", "costmap_update_timeout", 1.0),
    ("bt_navigator", "default_server_timeout", 20),
)
BEHAVIOUR_LIMITS = ("acceleration_limit", "deceleration_limit")
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
            for values in _sections(self.values, "bt_navigator"):
                values[name] = str(tree)
        path = folder / "params.yaml"
        path.write_text(self.text())
        return path


def scale_file(path: Path, speed: float, release: Release) -> Scaled:
    """Read a Nav2 parameter file and return it for `speed` times real time.

    Raises:
        FileError: the file holds no parameters of Nav2 nodes.
    """
    document = read_yaml(path)
    values = document.value
    if not isinstance(values, dict) or not any(True for _ in _sections(values, "controller_server")):
        raise FileError(
            path,
            "this is no Nav2 parameter file: expected a controller_server with ros__parameters.",
            code="nav2-params",
        )
    return scale(values, speed, release)


def scale(values: dict[str, Any], speed: float, release: Release) -> Scaled:
    """Scale parameters in place; see the module."""
    made = Scaled(values)
    made.control_hz = _control_hz(values)
    if speed == 1.0:
        return made
    if release in BY_THE_CLOCK:
        _scale_trees(made, speed)
        return made
    for node, name, default in (*FREQUENCIES, *STEPS, *ALLOWANCES):
        for section in _sections(values, node):
            if name != "costmap_update_timeout" or release != "humble":
                _set(made, section, node, name, _times(section.get(name, default), speed))
    for node in ("behavior_server", "recoveries_server"):
        for section in _sections(values, node):
            _scale_behaviours(made, section, node, speed, release)
    for section in _sections(values, "bt_navigator"):
        period = section.get("bt_loop_duration", 10)
        _set(made, section, "bt_navigator", "bt_loop_duration", max(1, round(period / speed)))
        if round(period / speed) < 1:
            made.notes.append("bt_navigator.bt_loop_duration: 1 ms is the least; the tree ticks less often than at 1x")
    for section in _sections(values, "controller_server"):
        _scale_controllers(made, section, speed)
    for section in _sections(values, "velocity_smoother"):
        _fit_timer(made, section, speed)
    _scale_trees(made, speed)
    made.notes += [f"{node}: not scaled" for node in NOT_SCALED if any(map(_works, _sections(values, node)))]
    return made


def _sections(values: Any, node: str) -> Iterator[dict[str, Any]]:
    """Yield the parameters of a node, under whichever namespaces they stand."""
    if not isinstance(values, dict):
        return
    for key, inner in values.items():
        if not isinstance(inner, dict):
            continue
        if str(key).rstrip("/").rpartition("/")[2] == node and isinstance(inner.get("ros__parameters"), dict):
            yield inner["ros__parameters"]
        if key != "ros__parameters":
            yield from _sections(inner, node)


def _works(section: dict[str, Any]) -> bool:
    """Return whether a node has anything to do: a collision monitor whose polygons are all off has not."""
    polygons = section.get("polygons")
    if not isinstance(polygons, list):
        return True
    named = [section.get(name) for name in polygons]
    return any(not isinstance(each, dict) or each.get("enabled", True) for each in named)


def _set(made: Scaled, section: dict[str, Any], node: str, name: str, value: Any) -> None:
    before = section.get(name)
    if before != value:
        section[name] = value
        made.changes.append(Change(f"{node}.{name}", before, value))


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, list):
        return [_times(each, factor) for each in value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return round(value * factor) if isinstance(value, int) else float(value * factor)


def _control_hz(values: dict[str, Any]) -> float:
    """Return the rate of velocity commands: that of the last node that shapes them."""
    for node, name in (("velocity_smoother", "smoothing_frequency"), ("controller_server", "controller_frequency")):
        for section in _sections(values, node):
            rate = section.get(name, CONTROL_HZ)
            if isinstance(rate, int | float) and rate > 0:
                return float(rate)
    return CONTROL_HZ


def _fit_timer(made: Scaled, section: dict[str, Any], speed: float) -> None:
    """Give the smoother the rate that it keeps: its timer cuts the period to whole milliseconds, its steps do not."""
    period_ms = 1000.0 / section["smoothing_frequency"]
    if period_ms > 1.0 and period_ms != int(period_ms):
        kept = int(100_000.0 / int(period_ms)) / 100.0  # just below, so that the cut gives the same milliseconds
        _set(made, section, "velocity_smoother", "smoothing_frequency", kept)
        made.control_hz = kept / speed
        made.notes.append(
            f"velocity_smoother: its timer takes whole milliseconds, so commands come at {made.control_hz:.4g} Hz"
        )


def _scale_behaviours(made: Scaled, section: dict[str, Any], node: str, speed: float, release: Release) -> None:
    for plugin in section.get("behavior_plugins", ["spin", "backup", "drive_on_heading", "wait"]):
        settings = section.get(plugin)
        if not isinstance(settings, dict):
            continue
        drives = any(word in str(settings.get("plugin", "")) for word in ("BackUp", "DriveOnHeading"))
        defaults = (2.5, -2.5) if release == "kilted" and drives else (None, None)
        for name, default in zip(BEHAVIOUR_LIMITS, defaults, strict=True):
            if (value := settings.get(name, default)) is not None:
                _set(made, settings, f"{node}.{plugin}", name, _times(value, speed))


def _scale_controllers(made: Scaled, section: dict[str, Any], speed: float) -> None:
    frequency = float(section.get("controller_frequency", 20.0 * speed)) / speed
    for name in section.get("controller_plugins", ["FollowPath"]):
        settings = section.get(name)
        if not isinstance(settings, dict):
            continue
        plugins = " ".join(str(settings.get(key, "")) for key in ("plugin", "primary_controller"))
        where = f"controller_server.{name}"
        if "LimitedAccelGenerator" in str(settings.get("trajectory_generator_name", "")):
            _set(made, settings, where, "sim_period", settings.get("sim_period", 1.0 / frequency))
        if any(kind in plugins for kind in ("RotationShim", "RegulatedPurePursuit")):
            _set(made, settings, where, "max_angular_accel", _times(settings.get("max_angular_accel", 3.2), speed))
            made.notes.append(
                f"{where}.max_angular_accel: scaled for its step per cycle; where the controller also computes a "
                "braking angle from it, turns end more abruptly than at 1x"
            )
        if "MPPI" in plugins:
            made.notes.append(
                f"{where}: MPPI moves its control sequence on by model_dt per cycle only where the controller's period "
                "equals it. model_dt is simulated time and stays; the sequence is not moved on. Prefer speed 1, or "
                "compare with a run at 1x."
            )


def _scale_trees(made: Scaled, speed: float) -> None:
    """Scale the RateControllers of the behaviour trees that bt_navigator uses."""
    for section in _sections(made.values, "bt_navigator"):
        for parameter, default in TREES.items():
            given = str(section.get(parameter) or "")
            path = Path(given) if given and "$(" not in given else _installed(Path(given).name if given else default)
            if path is None or not path.is_file():
                made.notes.append(
                    f"bt_navigator.{parameter}: the tree {given or default} was not found, so its RateController keeps "
                    "wall time. Source your ROS 2, or give the path of the file."
                )
                continue
            text = path.read_text()
            rates = [rate for _, rate, _ in _RATE.findall(text)]
            changed = _RATE.sub(lambda found: f"{found[1]}{_scaled_rate(found[2], speed)}{found[3]}", text)
            made.trees[parameter] = changed
            made.changes.append(Change(str(path), rates, [_scaled_rate(rate, speed) for rate in rates]))


def _scaled_rate(rate: str, speed: float) -> str:
    try:
        return f"{float(rate) * speed:.6g}"
    except ValueError:
        return rate  # a variable of the tree


def _installed(name: str) -> Path | None:
    """Return a behaviour tree that the sourced ROS 2 has installed."""
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        path = Path(prefix) / "share" / "nav2_bt_navigator" / "behavior_trees" / name
        if path.is_file():
            return path
    return None
