"""Writes a world as a folder that a person can read and edit, and that `load_world` reads back equal."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from rvsg.core.errors import FileError, InputError
from rvsg.core.records import Record
from rvsg.world.io.files import AreaEntry, ObjectEntry, RouteEntry
from rvsg.world.occupancy import write_map
from rvsg.world.world import World

WIDE = 116


def save_world(world: World, folder: str | Path) -> None:
    """Write world.yaml, map.yaml with map.png, objects.yaml, labels.yaml and routes.yaml into a folder.

    The folder is made where it does not exist; files of these names in it are replaced, each whole or not at all.
    Raises FileError where it cannot be written, InputError for a world without the specification of its grid.
    """
    if world.grid_spec is None:
        raise InputError(f'the world "{world.name}" does not hold the specification of its grid, so it cannot be saved')
    folder = Path(folder)
    try:
        files = world_files(world)  # all of them before the first is written
    except ValidationError as error:
        raise InputError(f'the world "{world.name}" cannot be saved: {_first_of(error)}') from None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_map(world.occupancy, folder)
        for name, text in files.items():
            _replace(folder / name, text)
    except OSError as error:
        raise FileError(
            folder, f"the world cannot be written here: {error.strerror}", code="world-not-written"
        ) from None


def world_files(world: World) -> dict[str, str]:
    """Return the text of every file of the world's folder but the map, by file name."""
    files = {
        "world.yaml": _world_text(world),
        "labels.yaml": _entries_text(
            "areas",
            (AreaEntry.of(area) for area in world.areas),
            f"Labelled areas of {world.title}. rectangle: [x_min, y_min, x_max, y_max] in metres, world frame.\n"
            "waypoints: from where people work the area; leave them out, and they are proposed from the grid.",
        ),
        "routes.yaml": _entries_text(
            "routes",
            (RouteEntry.of(route) for route in world.routes),
            f"What the robot is asked to drive in {world.title}. Poses in metres and radians, world frame; a pose may\n"
            "also be the name of a waypoint. via: waypoints it roughly passes; through: poses it must pass, in order.",
        ),
    }
    if world.doors:
        files["doors.yaml"] = _entries_text(
            "doors",
            world.doors,
            f"Doors of {world.title}. hinge and end: the ends of the closed leaf, metres, world frame. state: open,\n"
            "closed or automatic.",
        )
    if world.objects:
        files["objects.yaml"] = _entries_text(
            "objects",
            (ObjectEntry.of(thing) for thing in world.objects),
            f"Solid objects of {world.title}: metres and radians, world frame, z up. box: the oriented bounding box;\n"
            "footprint (not given: the box seen from above): what a person cannot walk through; slices: what the\n"
            "lidar plane cuts.",
        )
    return files


def _first_of(error: ValidationError) -> str:
    """Return the first mistake of a record, with the name of the thing it is of."""
    found = error.errors(include_url=False)[0]
    given = found["input"]
    thing = given.get("name", "") if isinstance(given, dict) else given
    place = ".".join(str(part) for part in found["loc"])
    said = found["msg"].removeprefix("Value error, ")
    return f"{error.title} {str(thing)[:60]!r}{f', {place}' if place else ''}: {said}"


def _world_text(world: World) -> str:
    head: list[tuple[str, Any]] = [("format", 1), ("name", world.name), ("title", world.title)]
    head.append(("map", "map.yaml"))
    if world.objects:
        head.append(("objects", "objects.yaml"))
    if world.doors:
        head.append(("doors", "doors.yaml"))
    head += [("labels", "labels.yaml"), ("routes", "routes.yaml"), ("lidar_height_m", world.lidar_height_m)]
    if world.map_offset != (0.0, 0.0):
        head.append(("map_offset", list(world.map_offset)))
    if world.actors:
        head.append(("actors", list(world.actors)))
    lines = [f"# {one_line(world.title)}. Metres and radians, world frame."]
    lines += [f"{key}: {_flow(value)}" for key, value in head]
    if world.grid_spec is not None:
        grid = world.grid_spec.model_dump(mode="json", exclude_defaults=True)
        lines += ["grid:", *(_block(key, value, "  ") for key, value in grid.items())] if grid else ["grid: {}"]
    if world.activities:
        lines += ["activities:", *(f"  - {_flow(_activity(world, text))}" for text in world.activities)]
    if world.description is not None:
        text = yaml.safe_dump(
            world.description.model_dump(mode="json"), sort_keys=False, allow_unicode=True, width=WIDE
        )
        lines += ["description:", *(f"  {line}" if line else "" for line in text.splitlines())]
    return "\n".join(lines) + "\n"


def _entries_text(key: str, entries: Iterable[Record], comment: str) -> str:
    lines = [f"# {line}" for line in comment.splitlines()]
    body = []
    for entry in entries:
        values = {k: v for k, v in entry.model_dump(mode="json").items() if v is not None and not _is_default(entry, k)}
        items = [_block(name, value, "    ") for name, value in values.items()]
        body.append("  - " + "\n".join(items)[4:])
    lines += [f"{key}:", *body] if body else [f"{key}: []"]
    return "\n".join(lines) + "\n"


def _is_default(entry: Record, key: str) -> bool:
    field = type(entry).model_fields[key]
    return not field.is_required() and getattr(entry, key) == field.get_default(call_default_factory=True)


def _block(key: str, value: Any, indent: str) -> str:
    """`key: value` in flow style, broken after commas where the line is long."""
    return "\n".join(_wrapped(f"{indent}{key}: {_flow(value)}", indent + "  "))


def _wrapped(line: str, indent: str) -> Iterable[str]:
    if len(line) <= WIDE or line.rstrip()[-1:] not in "]}":
        return [line]
    pieces = re.split(r"(?<=[\]}\w\"],) ", line)
    lines = [pieces[0]]
    for piece in pieces[1:]:
        if len(lines[-1]) + 1 + len(piece) <= WIDE:
            lines[-1] += " " + piece
        else:
            lines.append(indent + piece)
    return lines


def _flow(value: Any) -> str:
    """Return a value in YAML's flow style on one line, strings quoted where they must be."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_flow(k)}: {_flow(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(item) for item in value) + "]"
    if isinstance(value, str):
        plain = re.fullmatch(r"[A-Za-z][A-Za-z0-9_ ./()-]*[A-Za-z0-9_.)]|[A-Za-z]", value)
        return value if plain and yaml.safe_load(value) == value else json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    return repr(value)


def one_line(text: str) -> str:
    """Return the text without line breaks, fit for a comment."""
    return " ".join(text.split())


def _replace(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    draft = path.with_name(path.name + ".new")
    draft.write_text(text, encoding="utf-8")
    draft.replace(path)


def _activity(world: World, text: str) -> object:
    """Return an activity as world.yaml holds it: its text, and whether it is done with a trolley where that is said."""
    return {"text": text, "trolley": world.trolley_work[text]} if text in world.trolley_work else text
