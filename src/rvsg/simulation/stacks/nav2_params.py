"""The reader of a robot's nav2_params.yaml: the stack it asks for, and what becomes of every key."""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Never

from pydantic import BaseModel, ValidationError

from rvsg.core.documents import Document, DocumentError, parse_yaml, problems_of
from rvsg.core.errors import FileError
from rvsg.core.inputs import read_text
from rvsg.robots.robot import MonitorPolygon
from rvsg.simulation.stacks.mppi import CRITICS as MPPI_CRITICS
from rvsg.simulation.stacks.mppi import MppiSettings
from rvsg.simulation.stacks.nav2_keys import (
    ACTIONS,
    AS_SIMULATED,
    CHECKERS,
    CONTROLLERS,
    CRITICS,
    FIXED,
    IDLE,
    LAYERS,
    OPTIONS,
    OUTSIDE,
    SAME_AS,
    SERVERS,
    SIDEWAYS,
    SIDEWAYS_NOTE,
    SPEED_FILTERS,
)
from rvsg.simulation.stacks.nav2_stack import DwbSettings, Nav2Settings
from rvsg.simulation.stacks.pure_pursuit import PurePursuitSettings
from rvsg.world.occupancy import read_mask, runs_of

Key = tuple[str, ...]
State = Literal["honoured", "no effect", "not supported"]
STATES: tuple[State, ...] = ("honoured", "no effect", "not supported")
SETTINGS: dict[str, type[Nav2Settings]] = {
    "nav2-dwb": DwbSettings,
    "nav2-rpp": PurePursuitSettings,
    "nav2-mppi": MppiSettings,
}
POLYGON = MonitorPolygon.model_fields.keys() - {"name", "action_type", "points"}
"""Fields of a polygon that are numbers, under Nav2's names."""


@dataclass(frozen=True)
class Entry:
    """One key of the file."""

    key: str
    line: int
    """In the file."""
    value: str
    state: State
    note: str = ""


@dataclass
class Nav2File:
    """A parameter file, read: the stack it asks for, and what becomes of every key."""

    path: Path
    stack: str
    options: dict[str, Any]
    entries: list[Entry] = field(default_factory=list)
    places: dict[str, Key] = field(default_factory=dict)
    """The keys under which the file sets an option, or would set it, by the path of the option."""

    def counts(self) -> dict[str, int]:
        """Return how many keys are in each state."""
        return {state: sum(entry.state == state for entry in self.entries) for state in STATES}

    def messages(self) -> list[str]:
        """Return what a user has to know: the counts, and every key that is not supported, by reason."""
        counts = self.counts()
        lines = [
            f"{self.path}: {self.stack}; of {len(self.entries)} keys {counts['honoured']} are honoured, "
            f"{counts['no effect']} have no effect here, {counts['not supported']} are not supported. "
            f"`rvsg stacks {self.path} --verbose` lists all of them."
        ]
        reasons: dict[str, list[str]] = {}
        for entry in self.entries:
            if entry.state == "not supported":
                reasons.setdefault(entry.note, []).append(f"{entry.key} (line {entry.line})")
        lines += [f"not supported: {', '.join(keys)}: {reason}" for reason, keys in reasons.items()]
        return lines


class Section:
    """The parameters of a node or a plug-in; remembers which of them were used."""

    def __init__(self, reader: _Reader, place: Key, values: Any) -> None:
        self._reader, self.place = reader, place
        self.values: Mapping[str, Any] = values if isinstance(values, Mapping) else {}

    def get(self, key: str, default: Any = None, note: str = "") -> Any:
        """Return a parameter and mark it as honoured; `a.b` may be nested or spelled with the dot."""
        parts = key.split(".")
        found: Any = self.values
        for part in parts:
            found = found.get(part) if isinstance(found, Mapping) else None
        if found is None and key in self.values:
            found, parts = self.values[key], [key]
        if found is None:
            return default
        self._reader.used[(*self.place, *parts)] = note
        return found

    def number(self, key: str, default: float | None = None) -> Any:
        """Return a number; FileError names the key where it is none."""
        value = self.get(key, default)
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
            self._reader.wrong((*self.place, key), f"expected a number, got {value!r}")
        return value

    def list(self, key: str) -> Any:
        """Return a list, empty where it is not given; FileError names the key where it is none."""
        value = self.get(key, [])
        if not isinstance(value, list):
            self._reader.wrong((*self.place, key), f"expected a list, got {value!r}")
        return value

    def take(self, kind: str) -> None:
        """Set the options that the table has for a kind of section to the numbers of this one."""
        for name, option in OPTIONS[kind].items():
            key, _, index = name.partition(".")
            value = self.vector(key)[int(index)] if index else self.number(key)
            section, _, inner = option.partition(".")
            self._reader.places[option] = (*self.place, *name.split("."))
            if value is not None:
                self._reader.options[section][inner] = abs(value) if index else value

    def vector(self, key: str) -> Any:
        """Return three numbers, or three times None where there are none; FileError names the key."""
        value = self.get(key, [None, None, None])
        if not isinstance(value, list) or len(value) != 3 or not all(isinstance(v, int | float | None) for v in value):
            self._reader.wrong((*self.place, key), f"expected three numbers [x, y, yaw], got {value!r}")
        if value[1]:
            self.get(key, note="forward and turning; sideways, the robot's limits.lateral_m_s holds")
        return value

    def inner(self, key: str) -> Section:
        """Return a plug-in's section."""
        return Section(self._reader, (*self.place, key), self.values.get(key))


def circle(radius: float) -> tuple[tuple[float, float], ...]:
    """Return Nav2's outline of a round robot: a polygon of 16 corners."""
    angles = [2.0 * math.pi * k / 16 for k in range(16)]
    return tuple((radius * math.cos(a), radius * math.sin(a)) for a in angles)


def points_of(values: Mapping[str, Any]) -> tuple[tuple[float, float], ...] | None:
    """Return the corners of a polygon of the collision monitor: Humble lists numbers, later releases a text."""
    if values.get("type") == "circle" and isinstance(values.get("radius"), int | float):
        return circle(float(values["radius"]))
    given: Any = values.get("points")
    try:
        found = json.loads(given) if isinstance(given, str) else given
        if isinstance(found, list) and found and isinstance(found[0], int | float):
            found = list(zip(found[::2], found[1::2], strict=True))
        return tuple((float(x), float(y)) for x, y in found) if found else None
    except (ValueError, TypeError):
        return None


def _is_like(value: Any, example: Any) -> bool:
    """Return whether a value has the type of an example: a number may have a fraction or not."""
    if isinstance(example, list):
        return isinstance(value, list) and len(value) == len(example) and all(map(_is_like, value, example))
    if isinstance(example, bool) or isinstance(value, bool) or isinstance(example, str):
        return type(value) is type(example)
    return isinstance(value, int | float)


def leaves_of(value: Any, key: Key) -> Iterator[tuple[Key, Any]]:
    """Yield every value of a tree with the keys that lead to it."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from leaves_of(inner, (*key, str(name)))
    else:
        yield key, value


def read_nav2_params(path: str | Path) -> Nav2File:
    """Read a parameter file of Nav2 (Humble and later).

    Raises:
        FileError: it cannot be read, is of another program, or asks for a plug-in that is not simulated.
    """
    return read_nav2_text(read_text(Path(path)), Path(path))


def read_nav2_text(text: str, path: Path) -> Nav2File:
    """Read the text of a parameter file of Nav2, which is or will be at `path`; as `read_nav2_params`."""
    document = parse_yaml(text, path)
    if not isinstance(document.value, Mapping) or not any(name in document.value for name in SERVERS):
        raise FileError(
            path, "this is no parameter file of Nav2: none of the nodes "
            f"{', '.join(SERVERS[:5])} ... is in it."
        )  # fmt: skip
    return _Reader(document).read()


class _Reader:
    """Reads every node of a parameter file; keeps what was used and what is not supported."""

    def __init__(self, document: Document) -> None:
        self.path, self.document, self.source = document.path, document.value, document
        self.used: dict[Key, str] = {}
        self.refused: dict[Key, str] = {}
        self.places: dict[str, Key] = {}
        self.idle: dict[Key, str] = {}
        """Sections that change nothing, and why."""
        self.filters: dict[str, dict[str, Any]] = {}
        """Costmap filters, by the topic of their filter info."""
        self.options: dict[str, Any] = {"smoother": {}, "costmaps": {}, "behaviours": {}}
        """Of the stack, as far as the file gives them."""

    def wrong(self, key: Key, message: str, code: str = "document") -> Never:
        """Raise what is wrong with a key."""
        error = DocumentError([self.source.problem(f"{'.'.join(map(str, key))}: {message}", *key, code=code)])
        error.code = code
        raise error

    def node(self, *names: str) -> Section:
        """Return the section of a node, with the wild card of a namespace or not."""
        found: Any = self.document
        for name in (*names, "ros__parameters"):
            found = found.get(name) if isinstance(found, Mapping) else None
        return Section(self, (*names, "ros__parameters"), found)

    def kind_of(self, section: Section, known: tuple[str, ...] | Mapping[str, str], what: str) -> str:
        """Return the class of a plug-in, without its package; refuse one that is not simulated."""
        plugin = str(section.get("plugin", ""))
        kind = re.split(r"::|/", plugin)[-1]
        if kind not in known:
            near = difflib.get_close_matches(kind, list(known), n=1, cutoff=0.0)
            self.wrong(
                (*section.place, "plugin"),
                f"the {what} {plugin or '(no plugin)'} is not simulated. The nearest that is: "
                f"{near[0] if near else '-'}. Simulated: {', '.join(known)}. To test yours as it is, use "
                "--stack ros2 or exec:COMMAND.",
                "not-simulated",
            )
        return kind

    def first_of(self, section: Section, *keys: str, default: str) -> str:
        """Return the name of the first plug-in that a key lists."""
        for key in keys:
            names = section.get(key)
            if names:
                if isinstance(names, list) and len(names) > 1:
                    self.refused[(*section.place, key)] = f"only the first is simulated: {names[0]}"
                return str(names[0] if isinstance(names, list) else names)
        return default

    def read(self) -> Nav2File:
        """Read every node; return the file."""
        controller = self.node("controller_server")
        stack = self._controller(controller)
        self._costmaps()
        self._checkers(controller)
        self._planner()
        self._behaviours()
        self._smoother()
        self._monitor()
        options = {key: value for key, value in self.options.items() if value not in ({}, ())}
        return Nav2File(self.path, stack, options, list(self._entries()), self.places)

    def _controller(self, server: Section) -> str:
        server.take("controller_server")
        section = server.inner(self.first_of(server, "controller_plugins", default="FollowPath"))
        stack = CONTROLLERS[self.kind_of(section, CONTROLLERS, "controller")]
        without = {"nav2-dwb": self._dwb, "nav2-rpp": self._rpp, "nav2-mppi": self._mppi}[stack](section)
        values = self._fields(section, SETTINGS[stack], without)
        handler = server.inner(self.first_of(server, "path_handler_plugins", default="PathHandler"))
        if stack == "nav2-mppi" and handler.number("prune_distance") is not None:
            values["prune_distance"] = handler.number("prune_distance")
        try:
            SETTINGS[stack].model_validate(values)
        except ValidationError as error:
            raise DocumentError(problems_of(error, self.source, SETTINGS[stack], section.place)) from None
        self.options |= values
        return stack

    def _fields(
        self, section: Section, kind: type[BaseModel], without: Sequence[str] = (), critic: str = ""
    ) -> dict[str, Any]:
        """Return the parameters of a plug-in that are fields of a record, and those of its critics."""
        values: dict[str, Any] = {}
        for name, info in kind.model_fields.items():
            if name in Nav2Settings.model_fields or name in without:
                continue
            inner = info.annotation
            self.places[critic + name] = (*section.place, *f"{critic}{name}".split("."))
            if isinstance(inner, type) and issubclass(inner, BaseModel):
                value: Any = self._fields(section, inner, critic=f"{name}.")
            else:
                value = section.get(critic + name)
            if value not in (None, {}):
                values[name] = value
        if not critic and (critics := section.get("critics")) is not None and kind is MppiSettings:
            for name in MPPI_CRITICS:
                inner = values.get(name, {})
                values[name] = {**inner, "enabled": inner.get("enabled", True) if name in critics else False}
        return values

    def _critics(self, section: Section, known: Sequence[str], planner: str) -> None:
        """Refuse a critic that is not simulated."""
        for name in section.list("critics"):
            if name not in known:
                near = difflib.get_close_matches(str(name), known, n=1, cutoff=0.0)[0]
                message = f"{planner}'s critic {name} is not simulated. The nearest: {near}."
                self.wrong((*section.place, "critics"), message)

    def _dwb(self, section: Section) -> Sequence[str]:
        """Read what DWB's record does not hold; return the fields that have no effect."""
        self._critics(section, CRITICS, "DWB")
        lateral = bool(section.values.get("max_vel_y"))
        for name, other in SAME_AS.items():
            if name.endswith("_y") and not lateral:
                continue
            value, same = section.number(name), section.number(other)
            if value is not None and abs(value) != abs(same or 0.0):
                self.refused[(*section.place, *name.split("."))] = f"it is that of {other}"
        if not lateral:
            return "max_vel_y", "vy_samples"
        section.get("max_vel_y", note="as far as the robot's limits.lateral_m_s allows; to the right as to the left")
        return ()

    def _rpp(self, section: Section) -> Sequence[str]:
        """Take the name of the speed of later releases."""
        if (speed := section.number("max_linear_vel")) is None:
            return ()
        self.options["desired_linear_vel"] = speed
        self.places["desired_linear_vel"] = (*section.place, "max_linear_vel")
        return ("desired_linear_vel",)

    def _mppi(self, section: Section) -> Sequence[str]:
        """Refuse a motion model or a critic that is not simulated."""
        model = str(section.get("motion_model", "DiffDrive"))
        if model.replace("_", "").lower() != "diffdrive":
            self.wrong(
                (*section.place, "motion_model"), f"the motion model {model} is not simulated. Nearest: DiffDrive."
            )
        section.inner(model).get("plugin")
        self._critics(section, MPPI_CRITICS, "MPPI")
        return ()

    def _costmaps(self) -> None:
        local, world = (self.node(name, name) for name in ("local_costmap", "global_costmap"))
        local.take("local_costmap")
        world.take("global_costmap")
        if local.values.get("height", local.values.get("width")) != local.values.get("width"):
            self.refused[(*local.place, "height")] = "a square of the width is simulated"
        elif "height" in local.values:
            self.used[(*local.place, "height")] = ""
        for section, prefix in ((local, "local"), (world, "global")):
            self._layers(section, prefix)
        self.options["costmap_filters"] = tuple(self.filters.values())
        self._footprint(local)
        for key in ("robot_radius", "footprint", "footprint_padding"):
            if key in world.values and world.values[key] == local.values.get(key):
                self.used[(*world.place, key)] = ""
            elif key in world.values:
                self.refused[(*world.place, key)] = "the footprint of the local costmap holds for both"

    def _layers(self, section: Section, prefix: str) -> None:
        for name in section.list("plugins"):
            layer = section.inner(str(name))
            kind = self.kind_of(layer, LAYERS, "costmap layer")
            layer.get("enabled")
            if kind == "InflationLayer":
                layer.take(f"{prefix} InflationLayer")
            elif kind == "StaticLayer":
                self.idle[(*section.place, "resolution")] = "a static layer takes the resolution of the map"
            elif kind in ("ObstacleLayer", "VoxelLayer"):
                self._sources(layer, prefix)
        listed = {str(name) for key in ("plugins", "filters") for name in section.list(key)}
        for name, values in section.values.items():
            if isinstance(values, Mapping) and name not in listed:
                self.idle[(*section.place, name)] = f"{name} is not among the plug-ins of the costmap"
        for name in section.list("filters"):
            layer = section.inner(str(name))
            if layer.values.get("enabled") is False:
                self.idle[layer.place] = "this filter is off"
            elif why := self._filter(layer, prefix):
                self.refused[(*section.place, "filters")] = f"{name}: {why}"
                for key, _ in leaves_of(layer.values, layer.place):
                    self.refused[key] = why

    def _filter(self, layer: Section, prefix: str) -> str:
        """Read a costmap filter with its mask; return why it is not simulated."""
        plugin = re.split(r"::|/", str(layer.values.get("plugin")))[-1]
        topic = str(layer.values.get("filter_info_topic")).strip("/")
        info = self._server("filter_info_topic", topic)
        server = info and self._server("topic_name", str(info.get("mask_topic", "filter_mask")).strip("/"))
        if plugin not in ("KeepoutFilter", "SpeedFilter"):
            return "of Nav2's costmap filters, keepout and speed filters are simulated"
        if info is None or server is None or not server.values.get("yaml_filename"):
            return "no mask: expected servers whose filter_info_topic and topic_name lead to a yaml_filename"
        kind = "keepout" if plugin == "KeepoutFilter" else SPEED_FILTERS.get(info.get("type"))
        if kind is None:
            return "expected a filter info of type 1 (percent) or 2 (m/s)"
        if kind != "keepout" and any(each["kind"] != "keepout" for key, each in self.filters.items() if key != topic):
            return "one speed filter is simulated"
        for key in ("plugin", "enabled", "filter_info_topic"):
            layer.get(key)
        if topic not in self.filters:
            file = self.path.parent / str(server.get("yaml_filename"))
            if not file.is_file():
                self.wrong((*server.place, "yaml_filename"), f"there is no {file}. Expected the yaml file of a mask")
            cells, resolution, origin = read_mask(file)
            self.filters[topic] = {
                "kind": kind, "costmaps": [], "x": origin.x, "y": origin.y, "resolution_m": resolution,
                "columns": cells.shape[1], "cells": runs_of(cells), "base": info.number("base", 0.0),
                "multiplier": info.number("multiplier", 1.0),
            }  # fmt: skip
        self.filters[topic]["costmaps"].append(prefix)
        return ""

    def _server(self, key: str, topic: str) -> Section | None:
        """Return the node that publishes a topic."""
        for name in self.document:
            section = self.node(str(name))
            if key in section.values and str(section.values[key]).strip("/") == topic:
                section.get(key)
                return section
        return None

    def _sources(self, layer: Section, prefix: str) -> None:
        names = str(layer.get("observation_sources", "")).split()
        if len(names) > 1:
            self.refused[(*layer.place, "observation_sources")] = f"the ranges of {names[0]} are taken for every lidar"
        for name in names[:1]:
            source = layer.inner(name)
            for key in ("marking", "clearing"):
                if source.values.get(key) is False:
                    self.refused[(*source.place, key)] = "every lidar marks and clears"
            if prefix == "local":
                source.take("local source")
                continue
            for key, option in OPTIONS["local source"].items():
                same = self.options["costmaps"].get(option.partition(".")[2])
                if source.number(key, same) != same:
                    self.refused[(*source.place, key)] = "the ranges of the local costmap hold for both"

    def _footprint(self, local: Section) -> None:
        radius, text = local.values.get("robot_radius"), local.values.get("footprint")
        if text and text != "[]":
            local.get("footprint")
            try:
                points = json.loads(text) if isinstance(text, str) else text
                self.options["footprint"] = tuple((float(x), float(y)) for x, y in points)
            except (ValueError, TypeError):
                self.wrong((*local.place, "footprint"), f"expected a list of points [[x, y], ...], got {text!r:.60}")
        elif radius is not None:
            self.options["footprint"] = circle(local.number("robot_radius"))
        if (padding := local.number("footprint_padding")) is not None:
            self.options["padding_m"] = padding

    def _checkers(self, server: Section) -> None:
        progress = server.inner(
            self.first_of(server, "progress_checker_plugins", "progress_checker_plugin", default="progress_checker")
        )
        if progress.values:
            self.kind_of(progress, CHECKERS, "progress checker")
            progress.take("progress checker")
        goal = server.inner(
            self.first_of(server, "goal_checker_plugins", "goal_checker_plugin", default="goal_checker")
        )
        if goal.values:
            self.kind_of(goal, CHECKERS, "goal checker")
            goal.take("goal checker")

    def _planner(self) -> None:
        server = self.node("planner_server")
        if not server.values:
            return
        section = server.inner(self.first_of(server, "planner_plugins", default="GridBased"))
        self.kind_of(section, ("NavfnPlanner",), "planner")
        section.take("planner")

    def _behaviours(self) -> None:
        server = self.node("behavior_server")
        server = server if server.values else self.node("recoveries_server")
        self.options["behaviours"]["waits_for_costmaps"] = True
        server.take("behavior_server")
        for name in server.list("behavior_plugins") or server.list("recovery_plugins"):
            plugin = server.inner(str(name))
            if kind := str(plugin.values.get("plugin", "")):
                is_jazzy = "::" in kind
                self.options["behaviours"] |= {"smoothed": is_jazzy, "gives_up_without_plan": is_jazzy}
                way = "through" if is_jazzy else "past"
                release = "from Jazzy on" if is_jazzy else "in Humble"
                plugin.get("plugin", note=f"recoveries drive {way} the velocity smoother, as {release}")
            for key in plugin.values.keys() - {"plugin"}:
                self.refused[(*plugin.place, str(key))] = "recoveries move as those of Humble do"
        tree = self.node("bt_navigator")
        for name in tree.list("navigators"):
            tree.inner(str(name)).get("plugin")
        for key in ("default_nav_to_pose_bt_xml", "default_nav_through_poses_bt_xml", "default_bt_xml_filename"):
            if tree.values.get(key):
                self.refused[(*tree.place, key)] = "Nav2's default tree with replanning and recovery is simulated"

    def _smoother(self) -> None:
        section = self.node("velocity_smoother")
        if section.values:
            section.take("velocity_smoother")

    def _monitor(self) -> None:
        section = self.node("collision_monitor")
        polygons: list[dict[str, Any]] = []
        sources = section.list("observation_sources")
        for name in section.list("polygons"):
            polygon = section.inner(str(name))
            action, points = str(polygon.values.get("action_type")), points_of(polygon.values)
            if polygon.values.get("enabled", True) is False or action == "none":
                self.idle[polygon.place] = "this polygon changes no command"
                continue
            polygon.get("enabled")
            kind = polygon.get("type")
            if action not in ACTIONS or kind == "velocity_polygon" or (points is None and action != "approach"):
                self.refused[(*polygon.place, "type")] = "a polygon of a topic or by speed is not simulated"
                continue
            if polygon.values.get("sources_names", sources) != sources:
                self.refused[(*polygon.place, "sources_names")] = "every polygon sees every lidar"
            polygon.get("action_type", note="" if points else "the polygon is the padded footprint")
            polygon.get("points")
            polygon.get("radius")
            at = f"collision_monitor.{len(polygons)}"
            self.places |= {f"{at}.{key}": (*polygon.place, key) for key in POLYGON}
            found = {key: polygon.number(key) for key in POLYGON if key in polygon.values}
            if "max_points" in polygon.values:
                found["min_points"] = polygon.number("max_points") + 1
            polygons.append({"name": str(name), "action_type": action, "points": points, **found})
        for name in sources:
            source = section.inner(str(name))
            only_scans = source.get("type", "scan") == "scan" and source.get("enabled", True) is not False
            if polygons and not only_scans:
                self.refused[(*source.place, "type")] = "the monitor sees the scans of every lidar, and nothing else"
        self.options["collision_monitor"] = tuple(polygons)

    def _entries(self) -> Iterator[Entry]:
        for key, value in leaves_of(self.document, ()):
            name = ".".join(part for part in key if part != "ros__parameters")
            shown = (name, self.source.line(*key) or 0, f"{value!r:.60}")
            if key in self.refused:
                yield Entry(*shown, "not supported", self.refused[key])
            elif idle := next((why for place, why in self.idle.items() if key[: len(place)] == place), ""):
                yield Entry(*shown, "no effect", idle)
            elif any(key[: len(used)] == used for used in self.used):
                note = next(self.used[used] for used in self.used if key[: len(used)] == used)
                yield Entry(*shown, "honoured", note)
            elif key[0].strip("/").partition("/")[0] in OUTSIDE:
                yield Entry(*shown, "no effect", f"{key[0]} has no part in a run here")
            elif why := next((why for pattern, why in IDLE if pattern.search(key[-1])), ""):
                yield Entry(*shown, "no effect", why)
            elif (last := key[-1].rpartition(".")[2]) in FIXED and value != FIXED[last][0]:
                if not _is_like(value, FIXED[last][0]):
                    self.wrong(key, f"expected a value such as {FIXED[last][0]!r}, got {value!r:.60}")
                yield Entry(*shown, "not supported", FIXED[last][1])
            elif any(map(SIDEWAYS.search, key[-2:-1])):
                yield Entry(*shown, "no effect", SIDEWAYS_NOTE)
            elif last in FIXED or AS_SIMULATED.get(last, ...) == value:
                yield Entry(*shown, "honoured", "this is what is simulated")
            else:
                yield Entry(*shown, "not supported", "not simulated; Nav2's default holds")
