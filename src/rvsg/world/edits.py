"""Edits of a world's labels.yaml, routes.yaml and world.yaml that keep comments, order and layout of the file."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

import yaml

from rvsg.core.documents import parse_yaml, read_yaml, validated
from rvsg.core.errors import FileError, InputError, UnknownName, how_to_install
from rvsg.core.files import write_whole
from rvsg.core.inputs import read_text
from rvsg.core.records import Record
from rvsg.world.routes import time_limit_s
from rvsg.world.schema import DoorsFile, LabelsFile, RoutesFile, WorldFile
from rvsg.world.world import Door
from rvsg.world.world_folder import SHIPPED, world_folder

HEAD = "world.yaml"
SHAPES = ("rectangle", "outline")
DIGITS = 2
"""Decimals of metres that are written: centimetres."""
Change = Callable[[Any, Mapping[str, Any]], None]
"""Changes the values of a file; gets the values of the change."""


@dataclass(frozen=True, kw_only=True)
class Edit:
    """A change of one file of a world folder: its text before and after."""

    path: Path
    before: str
    after: str

    def apply(self) -> None:
        """Write the file; FileError where it is not as it was before."""
        self._write(self.before, self.after)

    def revert(self) -> None:
        """Write the file as it was before; FileError where somebody else has changed it since."""
        self._write(self.after, self.before)

    def _write(self, expected: str, text: str) -> None:
        if read_text(self.path) != expected:
            raise FileError(self.path, "the file has been changed elsewhere since. Load the page again.")
        write_whole(self.path, text)


def edit_world(folder: str | Path, change: Mapping[str, Any]) -> Edit:
    """Return the edit that makes one change, not yet applied: `what` is one of `CHANGES`, the rest are its values.

    Raises InputError where the change cannot be made or ruamel.yaml is not installed, FileError where a file cannot be
    read or would not be valid afterwards.
    """
    folder = world_folder(folder)
    if folder.resolve().is_relative_to(SHIPPED.resolve()):
        raise InputError("A shipped world is not changed. Make a copy of it first.")
    what = str(change.get("what"))
    if what not in CHANGES:
        raise UnknownName("change", what, CHANGES)
    key, change_it = CHANGES[what]
    name = HEAD if key == "head" else str(read_yaml(folder / HEAD).value.get(key, f"{key}.yaml"))
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        raise FileError(folder / HEAD, f"{key}: this file lies outside the world folder.")
    before = read_text(path)
    after = _changed(before, path, change_it, change)
    models: dict[str, type[Record]]
    models = {"labels": LabelsFile, "routes": RoutesFile, "head": WorldFile, "doors": DoorsFile}
    validated(parse_yaml(after, path), models[key])
    return Edit(path=path, before=before, after=after)


def begin_doors(folder: str | Path) -> None:
    """Begin the file of the doors of a world folder where it has none."""
    folder = world_folder(folder)
    head = read_text(folder / HEAD)
    if "doors" not in read_yaml(folder / HEAD).value:
        write_whole(folder / "doors.yaml", "doors: []\n")
        write_whole(folder / HEAD, head.rstrip("\n") + "\ndoors: doors.yaml\n")


def add_door(folder: str | Path, door: Door) -> None:
    """Add a door to the doors of a world folder; the first one begins the file."""
    begin_doors(folder)
    edit_world(folder, {"what": "add door", **door.model_dump(mode="json", exclude_defaults=True)}).apply()


def _changed(text: str, path: Path, change_it: Change, change: Mapping[str, Any]) -> str:
    """Return the text of a YAML file after a change of its values, with its comments."""
    try:
        from ruamel.yaml import YAML
        from ruamel.yaml.error import YAMLError
    except ImportError:
        raise InputError(f"Editing worlds needs ruamel.yaml: {how_to_install('studio')}") from None
    round_trip = YAML()
    round_trip.preserve_quotes = True
    round_trip.width = 4096  # no line that was written by hand is broken again
    round_trip.indent(mapping=2, sequence=4, offset=2)
    try:
        value = round_trip.load(text)
    except YAMLError as error:
        raise FileError(path, f"not valid YAML: {error}") from None
    dumps = []
    for changed in (False, True):
        if changed:
            change_it(value, change)
        out = io.StringIO()
        round_trip.dump(value, out)
        dumps.append(out.getvalue())
    lines = _transplanted(*(document.splitlines() for document in (text, *dumps)))
    return lines if yaml.safe_load(lines) == yaml.safe_load(dumps[1]) else dumps[1]


def _transplanted(original: Sequence[str], before: Sequence[str], after: Sequence[str]) -> str:
    """Return the text after a change with the lines of the original wherever the change left them as they were.

    `before` and `after` are the lines as ruamel.yaml lays them out without and with the change.
    """
    blocks = SequenceMatcher(None, before, original, autojunk=False).get_opcodes()
    lines: list[str] = []
    for kind, i1, i2, j1, j2 in SequenceMatcher(None, before, after, autojunk=False).get_opcodes():
        if kind != "equal":
            lines += after[j1:j2]
            continue
        for same, b1, b2, o1, o2 in blocks:
            low, high = max(b1, i1), min(b2, i2)
            if same == "equal" and low < high:
                lines += original[o1 + low - b1 : o1 + high - b1]
            elif same != "equal" and i1 <= b1 and b2 <= i2:
                lines += original[o1:o2]
            elif low < high:
                lines += before[low:high]
    return "\n".join(lines) + "\n"


# --- areas --------------------------------------------------------------------------------------------------------


def _add_area(value: Any, change: Mapping[str, Any]) -> None:
    areas = _listed(value, "areas")
    name = _new_name(change, areas)
    areas.append(_flow({"name": _text(name), "kind": _text(str(change.get("kind") or "area")), **_shape(change)}))


def _change_area(value: Any, change: Mapping[str, Any]) -> None:
    """Change name, kind, region, note or shape; with a new shape the waypoints are found from the grid again."""
    areas, index = _found(value, "areas", change)
    entry, values = areas[index], _mapping(change, "values")
    if "name" in values and values["name"] != entry["name"]:
        entry["name"] = _text(_new_name(values, areas))
    for key in ("kind", "region", "note"):
        if key in values:
            _put(entry, key, values[key])
    if any(key in values for key in SHAPES):
        _put_shape(entry, _shape(values))


def _renew_waypoints(value: Any, change: Mapping[str, Any]) -> None:
    """Leave the waypoints of an area to be found from the grid."""
    areas, index = _found(value, "areas", change)
    areas[index].pop("waypoints", None)


def _remove(key: str) -> Change:
    def remove(value: Any, change: Mapping[str, Any]) -> None:
        entries, index = _found(value, key, change)
        del entries[index]

    return remove


def _split_area(value: Any, change: Mapping[str, Any]) -> None:
    """Cut an area in two along a line; the parts are numbered."""
    from shapely import LineString, Polygon
    from shapely.ops import split

    areas, index = _found(value, "areas", change)
    entry = areas[index]
    line = _points(change.get("line"), fewest=2)
    parts = [part for part in split(_polygon(entry), LineString(line)).geoms if isinstance(part, Polygon)]
    if len(parts) != 2:
        raise InputError("The line must cross the area once, from edge to edge.")
    parts.sort(key=lambda part: (round(part.centroid.x, 3), round(part.centroid.y, 3)))
    taken = {str(area.get("name")) for area in areas}
    free = [name for k in range(1, len(taken) + 3) if (name := f"{entry['name']} {k}") not in taken]
    fields = {key: entry[key] for key in ("kind", "region", "note") if key in entry}
    areas[index] = _flow({"name": _text(free[0]), **fields, **_shape_of(parts[0])})
    areas.insert(index + 1, _flow({"name": _text(free[1]), **fields, **_shape_of(parts[1])}))


def _merge_areas(value: Any, change: Mapping[str, Any]) -> None:
    """Make one area of two that touch; it keeps the name and kind of the first."""
    from shapely import Polygon, unary_union

    areas, first = _found(value, "areas", change)
    _, second = _found(value, "areas", {"name": change.get("other")})
    if first == second:
        raise InputError("Choose two different areas to merge.")
    union = unary_union([_polygon(areas[place]) for place in (first, second)])
    if not isinstance(union, Polygon) or union.interiors:
        raise InputError("Only areas that share an edge can be merged, and the result may have no hole.")
    _put_shape(areas[first], _shape_of(union.simplify(0.001)))
    del areas[second]


# --- routes and activities ----------------------------------------------------------------------------------------


def _add_route(value: Any, change: Mapping[str, Any]) -> None:
    """Add a route over points: the first is the start, the last the goal, the robot passes those between."""
    routes = _listed(value, "routes")
    points = _points(change.get("points"), fewest=2)
    ways = list(itertools.pairwise(points))
    yaws = [round(math.atan2(b[1] - a[1], b[0] - a[0]), DIGITS) for a, b in ways]
    poses = [_flow({"x": x, "y": y, "yaw": yaw}) for (x, y), yaw in zip(points, [*yaws, yaws[-1]], strict=True)]
    entry: dict[str, Any] = {
        "name": _text(_new_name(change, routes)),
        "start": poses[0],
        "goal": poses[-1],
        "time_limit_s": _number(change.get("time_limit_s") or time_limit_s(sum(math.dist(a, b) for a, b in ways))),
    }
    if len(points) > 2:
        entry["through"] = _flow_list(poses[1:-1])
    if change.get("purpose"):
        entry["purpose"] = _text(str(change["purpose"]))
    routes.append(_block(entry))


def _change_route(value: Any, change: Mapping[str, Any]) -> None:
    routes, index = _found(value, "routes", change)
    entry, values = routes[index], _mapping(change, "values")
    if "name" in values and values["name"] != entry["name"]:
        entry["name"] = _text(_new_name(values, routes))
    for key in ("purpose", "description"):
        if key in values:
            _put(entry, key, values[key])
    if "time_limit_s" in values:
        entry["time_limit_s"] = _number(values["time_limit_s"])
    for key in ("start", "goal"):
        if key in values:
            entry[key] = _given_pose(values[key])
            entry.pop("via", None)  # it named the way from the place before
    if "through" in values:
        through = _mapping(values, "through")
        passed, place = entry.get("through"), through.get("index")
        if not isinstance(passed, list) or not isinstance(place, int) or not 0 <= place < len(passed):
            raise InputError("The route has no such pose to pass.")
        passed[place] = _given_pose(through.get("pose"))


def _set_activities(value: Any, change: Mapping[str, Any]) -> None:
    texts = change.get("values")
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise InputError("Activities are a list of texts.")
    activities = [text.strip() for text in texts if text.strip()]
    listed = value.get("activities")
    if activities and isinstance(listed, list):  # in place, so that comments between them stay
        for place, text in enumerate(activities):
            if place < len(listed):
                entry = listed[place]
                if isinstance(entry, dict):
                    entry["text"] = _text(text)
                elif entry != text:
                    listed[place] = _text(text)
            else:
                listed.append(_text(text))
        del listed[len(activities) :]
    elif activities:
        value["activities"] = [_text(text) for text in activities]
    else:
        value.pop("activities", None)


def _add_door(value: Any, change: Mapping[str, Any]) -> None:
    doors = _listed(value, "doors")
    values = {key: item for key, item in change.items() if key not in ("what", "name")}
    if not all(isinstance(values.get(key), list | tuple) for key in ("hinge", "end")):
        raise InputError("A door has a hinge and an end: [x, y] in metres.")
    ends = {key: _flow_list(values.pop(key)) for key in ("hinge", "end")}
    doors.append(_flow({"name": _text(_new_name(change, doors)), **ends, **values}))


CHANGES: dict[str, tuple[str, Change]] = {
    "add area": ("labels", _add_area),
    "change area": ("labels", _change_area),
    "renew waypoints": ("labels", _renew_waypoints),
    "remove area": ("labels", _remove("areas")),
    "split area": ("labels", _split_area),
    "merge areas": ("labels", _merge_areas),
    "add route": ("routes", _add_route),
    "change route": ("routes", _change_route),
    "remove route": ("routes", _remove("routes")),
    "set activities": ("head", _set_activities),
    "add door": ("doors", _add_door),
}
"""Every change: the file it is made in and what makes it."""


# --- parts --------------------------------------------------------------------------------------------------------


def _listed(value: Any, key: str) -> Any:
    if not isinstance(value, dict):
        raise InputError(f"The file holds no {key}.")
    if not isinstance(value.get(key), list) or not value[key]:
        value[key] = []  # also where it stands as `[]`, so that entries get lines of their own
    return value[key]


def _mapping(change: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    values = change.get(key)
    if not isinstance(values, Mapping):
        raise InputError(f"The change lacks {key!r}.")
    return values


def _found(value: Any, key: str, change: Mapping[str, Any]) -> tuple[Any, int]:
    """Return the list under a key, and where in it the entry stands that the change names."""
    entries = _listed(value, key)
    names = [str(item.get("name")) if isinstance(item, Mapping) else "" for item in entries]
    name = str(change.get("name"))
    if name not in names:
        raise UnknownName(key.removesuffix("s"), name, names)
    return entries, names.index(name)


def _new_name(change: Mapping[str, Any], entries: Any) -> str:
    name = str(change.get("name") or "").strip()
    if not name:
        raise InputError("A name must not be empty.")
    if any(isinstance(item, Mapping) and item.get("name") == name for item in entries):
        raise InputError(f'The name "{name}" is already given.')
    return name


def _shape(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the shape of an area as it is written; InputError where none or a wrong one is given."""
    rectangle = values.get("rectangle")
    if rectangle is None:
        ring = _points(values.get("outline"), fewest=3)
        return {"outline": _flow_list([_flow_list(point) for point in ring])}
    whole = isinstance(rectangle, Sequence) and not isinstance(rectangle, str) and len(rectangle) == 4
    (x0, y0), (x1, y1) = _points([rectangle[:2], rectangle[2:]] if whole else None, fewest=2)
    return {"rectangle": _flow_list([min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)])}


def _shape_of(polygon: Any) -> dict[str, Any]:
    """Return a polygon as a rectangle where it is one along the axes, else as an outline."""
    x0, y0, x1, y1 = polygon.bounds
    if abs((x1 - x0) * (y1 - y0) - polygon.area) < 1e-6:
        return _shape({"rectangle": [x0, y0, x1, y1]})
    return _shape({"outline": list(polygon.exterior.coords)[:-1]})


def _put_shape(entry: Any, shape: Mapping[str, Any]) -> None:
    for key in {*SHAPES, "waypoints"} - set(shape):
        entry.pop(key, None)
    entry.update(shape)


def _polygon(entry: Mapping[str, Any]) -> Any:
    from shapely import Polygon, box

    return Polygon(entry.get("outline", ())) if entry.get("rectangle") is None else box(*entry["rectangle"])


def _points(values: Any, *, fewest: int) -> list[tuple[float, float]]:
    if not isinstance(values, Sequence) or isinstance(values, str) or len(values) < fewest:
        raise InputError(f"Give at least {fewest} points [x, y] in metres.")
    written = []
    for point in values:
        if not isinstance(point, Sequence) or isinstance(point, str) or len(point) != 2:
            raise InputError("A point is [x, y] in metres.")
        written.append((round(_number(point[0]), DIGITS), round(_number(point[1]), DIGITS)))
    return written


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"Expected a number, got {str(value)[:40]!r}.")
    return float(value)


def _given_pose(value: Any) -> Any:
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 3:
        raise InputError("A pose is [x, y, yaw] in metres and radians.")
    (x, y), yaw = _points([value[:2]], fewest=1)[0], value[2]
    return _flow({"x": x, "y": y, "yaw": round(_number(yaw), DIGITS)})


def _put(entry: Any, key: str, given: Any) -> None:
    text = str(given or "").strip()
    if text:
        entry[key] = _text(text)
    else:
        entry.pop(key, None)


def _text(text: str) -> Any:
    """Return a text that reads back as that text in YAML 1.1, too, where `no` is a truth value."""
    from ruamel.yaml.scalarstring import DoubleQuotedScalarString

    try:
        plain = yaml.safe_load(text) == text and "\n" not in text
    except (yaml.YAMLError, ValueError, RecursionError):  # a date with month 13, a thousand brackets
        plain = False
    return text if plain else DoubleQuotedScalarString(text)


def _block(values: Mapping[str, Any]) -> Any:
    from ruamel.yaml.comments import CommentedMap

    return CommentedMap(values)


def _flow(values: Mapping[str, Any]) -> Any:
    block = _block(values)
    block.fa.set_flow_style()
    return block


def _flow_list(values: Sequence[Any]) -> Any:
    from ruamel.yaml.comments import CommentedSeq

    sequence = CommentedSeq(values)
    sequence.fa.set_flow_style()
    return sequence
