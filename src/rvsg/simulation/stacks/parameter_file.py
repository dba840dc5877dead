"""Parameter files of Nav2 with some values changed: every other character of the file stays.

The places of values come from the marks of PyYAML's nodes, so comments, quotes and the form of every other line are
those of the user. What was written is read again: a file that does not say what was asked is never returned.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from rvsg.core.errors import FileError
from rvsg.simulation.stacks.nav2_keys import NEGATIVE
from rvsg.simulation.stacks.nav2_params import Key, read_nav2_text
from rvsg.simulation.stacks.parameters import value_at

SKELETONS = {
    "nav2-dwb": "dwb_core::DWBLocalPlanner",
    "nav2-rpp": "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController",
    "nav2-mppi": "nav2_mppi_controller::MPPIController",
}
"""The controllers of the built-in stacks, for a file of one that has none."""
SKELETON = """\
# Made by `rvsg tune` for {stack}. Merge it into the parameter file of your robot.
controller_server:
  ros__parameters:
    controller_plugins: ["FollowPath"]
    FollowPath:
      plugin: "{plugin}"
local_costmap:
  local_costmap:
    ros__parameters:
      plugins: ["obstacle_layer", "inflation_layer"]
      obstacle_layer:
        plugin: "nav2_costmap_2d::ObstacleLayer"
      inflation_layer:
        plugin: "nav2_costmap_2d::InflationLayer"
global_costmap:
  global_costmap:
    ros__parameters:
      plugins: ["static_layer", "obstacle_layer", "inflation_layer"]
      static_layer:
        plugin: "nav2_costmap_2d::StaticLayer"
      obstacle_layer:
        plugin: "nav2_costmap_2d::ObstacleLayer"
      inflation_layer:
        plugin: "nav2_costmap_2d::InflationLayer"
"""
ROS = "ros__parameters"


def skeleton(stack: str) -> str | None:
    """Return a parameter file that asks for a built-in stack with its defaults; None where Nav2 has no such stack."""
    plugin = SKELETONS.get(stack)
    return None if plugin is None else SKELETON.format(stack=stack, plugin=plugin)


def with_values_in_file(text: str, path: Path, values: Mapping[str, float]) -> str:
    """Return the text of a parameter file with other values of some options.

    Raises:
        FileError: the file has no place for one of them.
    """
    before = read_nav2_text(text, path)
    for option, value in values.items():
        if option not in before.places:
            raise FileError(path, f"this file has no place for {option}.", code="no-place")
        place = before.places[option]
        text = _changed(text, place, f"{-value if NEGATIVE & {*place} else value!r}")
    after = read_nav2_text(text, path)
    for option, value in values.items():
        if value_at(after.options, option) != value:
            raise FileError(path, f"{option} stays {value_at(after.options, option)} in this file.", code="no-place")
    return text


FILTERS = {
    "keepout": '{plugin: "nav2_costmap_2d::KeepoutFilter", enabled: true, filter_info_topic: "/keepout_filter_info"}',
    "speed": '{plugin: "nav2_costmap_2d::SpeedFilter", enabled: true, filter_info_topic: "/speed_filter_info", '
    'speed_limit_topic: "/speed_limit"}',
}
SERVERS = """\
{name}_filter_mask_server:
  ros__parameters:
    topic_name: "/{name}_filter_mask"
    yaml_filename: "{name}_mask.yaml"
{name}_costmap_filter_info_server:
  ros__parameters:
    filter_info_topic: "/{name}_filter_info"
    mask_topic: "/{name}_filter_mask"
    type: {type}
    base: 0.0
    multiplier: 1.0
"""
"""The nodes that publish a mask, under the names of Nav2's own files."""


def has_filters(text: str) -> bool:
    """Return whether a parameter file has costmap filters, or servers of their masks."""
    document = yaml.safe_load(text)
    listed = (value_at(document, f"{which}_costmap.{which}_costmap.{ROS}.filters") for which in ("local", "global"))
    return any(listed) or any(f"{name}_filter_mask_server" in document for name in FILTERS)


def with_filters_in_file(text: str, path: Path, filters: Sequence[Mapping[str, Any]]) -> str:
    """Return the text of a parameter file with costmap filters, and the servers of their masks at its end.

    Args:
        path: where the file will be, beside `keepout_mask.yaml` and `speed_mask.yaml`.
        filters: the option `costmap_filters`.
    """
    names = [each["kind"].partition("_")[0] for each in filters]
    for which in ("global", "local"):
        node: Key = (f"{which}_costmap", f"{which}_costmap", ROS)
        listed = [name for name, each in zip(names, filters, strict=True) if which in each["costmaps"]]
        if listed:
            text = _changed(text, (*node, "filters"), json.dumps([f"{name}_filter" for name in listed]))
        for name in listed:
            text = _changed(text, (*node, f"{name}_filter"), FILTERS[name])
    for name in names:
        text = f"{text.rstrip()}\n{SERVERS.format(name=name, type=int(name == 'speed'))}"
    read = {each["kind"]: each["cells"] for each in read_nav2_text(text, path).options.get("costmap_filters", ())}
    if read != {each["kind"]: each["cells"] for each in filters}:
        raise FileError(path, f"this file takes other masks: {', '.join(read) or 'none'}.", code="no-place")
    return text


def has_place(text: str, path: Path, option: str, value: float) -> bool:
    """Return whether a file can give an option this value."""
    try:
        with_values_in_file(text, path, {option: value})
    except FileError:
        return False
    return True


def _changed(text: str, place: Sequence[str], value: str) -> str:
    """Return YAML with the value at a place replaced, or inserted where it is missing."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    assert isinstance(root, yaml.MappingNode)
    node, rest = root, list(place)
    while rest:
        for count in range(len(rest), 0, -1):  # `a.b` may be nested or spelled with the dot
            found = next((item for name, item in node.value if name.value == ".".join(rest[:count])), None)
            if found is not None:
                break
        if found is None:
            return _inserted(text, node, rest, value)
        rest = rest[count:]
        if not rest:
            return text[: found.start_mark.index] + value + text[found.end_mark.index :]
        if isinstance(found, yaml.SequenceNode) and len(found.value) > int(rest[0]):
            item = found.value[int(rest[0])]
            return text[: item.start_mark.index] + value + text[item.end_mark.index :]
        if not isinstance(found, yaml.MappingNode):
            break
        node = found
    return text


def _inserted(text: str, node: yaml.MappingNode, keys: Sequence[str], value: str) -> str:
    """Return YAML with a new key at the end of a mapping's plain values, in the mapping's own form."""
    if node.flow_style:
        at = node.end_mark.index - 1
        inner = value
        for key in reversed(keys[1:]):
            inner = f"{{{key}: {inner}}}"
        comma = ", " if node.value else ""
        return f"{text[:at].rstrip()}{comma}{keys[0]}: {inner}{text[at:]}"
    plain = [item for _, item in node.value if isinstance(item, yaml.ScalarNode) or item.flow_style]
    column = node.value[0][0].start_mark.column
    lines = [f"{' ' * (column + 2 * depth)}{key}:" for depth, key in enumerate(keys)]
    lines[-1] += f" {value}"
    block = "\n".join(lines)
    if plain:
        end = re.compile(r"$", re.MULTILINE).search(text, plain[-1].end_mark.index)
        at = end.start() if end else len(text)
        return f"{text[:at]}\n{block}{text[at:]}"
    at = node.value[0][0].start_mark.index - column
    return f"{text[:at]}{block}\n{text[at:]}"
