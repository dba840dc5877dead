"""Reader of world folders: the shipped worlds by name, a user's own by path. It reports all mistakes at once."""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rvsg.core.documents import Document, DocumentError, Key, Problem, read_document, read_yaml, validated
from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.core.inputs import exists, is_dir
from rvsg.core.records import Pose, Record
from rvsg.world.lattice import build_world
from rvsg.world.occupancy import occupancy_from_objects, read_map
from rvsg.world.passages import route_paragraph
from rvsg.world.schema import DerivedMap, DoorsFile, LabelsFile, ObjectsFile, RouteEntry, RoutesFile, WorldFile
from rvsg.world.space import in_same_space
from rvsg.world.world import OccupancyMap, Route, SolidObject, World

SHIPPED = Path(__file__).parent / "worlds"


def shipped_worlds() -> tuple[str, ...]:
    """Return the names of the worlds that ship with RVSG."""
    return tuple(sorted(folder.name for folder in SHIPPED.iterdir() if (folder / "world.yaml").is_file()))


def load_world(name_or_path: str | Path) -> World:
    """Return a shipped world by its name, or the world in a folder (or its world.yaml).

    The name of a shipped world always means that one; `./office` is the folder.

    Raises UnknownName where there is no such world, FileError (DocumentError: everything at once) for bad files.
    """
    if isinstance(name_or_path, str) and name_or_path in shipped_worlds():
        return _shipped(name_or_path)
    return read_world(world_folder(name_or_path))


def world_folder(path: str | Path) -> Path:
    """Return the folder of a world, given by itself or by its world.yaml.

    Raises UnknownName where there is no such folder, FileError where it is a file or holds no world.
    """
    path = Path(path)
    folder = path.parent if path.name == "world.yaml" else path
    if not is_dir(folder):
        if exists(folder):
            raise FileError(
                folder, "this is a file; a world is a folder that holds a world.yaml.", code="world-is-file"
            )
        raise UnknownName("world", str(path), shipped_worlds(), hint="Or give the folder of your own world.")
    if not (folder / "world.yaml").is_file():
        message = "the folder holds no world.yaml; `rvsg world new` makes a world folder from a map"
        raise FileError(folder, message, code="world-missing")
    return folder


@lru_cache(maxsize=8)
def _shipped(name: str) -> World:
    return read_world(SHIPPED / name)


def file_names(folder: Path) -> list[str]:
    """Return the names of the files in a folder that make its world, relative to the folder.

    Raises:
        FileError: world.yaml or the map's description cannot be read.
    """
    head, _ = read_document(folder / "world.yaml", WorldFile)
    names = ["world.yaml", *(name for name in (head.objects, head.labels, head.routes, head.doors) if name is not None)]
    if isinstance(head.map, str):
        image = read_yaml(_beside(folder, head.map)).value["image"]
        names += [head.map, str(Path(head.map).parent / image)]
    return [name for name in dict.fromkeys(names) if _beside(folder, name).is_file()]


def read_world(folder: Path, problems: list[Problem] | None = None) -> World:
    """Read the world in a folder.

    With a list for `problems`, unknown waypoints, routes with a mistake and names given twice are noted there instead
    of raised.
    """
    document = read_yaml(folder / "world.yaml")
    mistakes: tuple[Problem, ...] = ()
    try:
        head = validated(document, WorldFile)
    except DocumentError as error:  # read on with what can be read, so that every mistake is reported at once
        mistakes = error.problems
        said = document.value if isinstance(document.value, dict) else {}
        files = ("objects", "labels", "routes", "doors", "map")
        names = {key: said[key] for key in files if isinstance(said.get(key), str)}
        head = WorldFile.model_validate({"name": "unreadable", "map": {"from": "objects"}, **names})
    parts = _Parts(folder, head, mistakes, noted=problems)
    object_entries, _ = parts.listed(head.objects, ObjectsFile, "objects")
    objects = tuple(entry.solid(head.lidar_height_m) for entry in object_entries)
    doors, _ = parts.listed(head.doors, DoorsFile, "doors")
    area_entries, area_document = parts.listed(head.labels, LabelsFile, "areas")
    routes, route_document = parts.routes()
    occupancy = parts.occupancy(objects, route_document, document)
    if parts.problems:
        raise DocumentError(parts.problems)
    assert occupancy is not None
    here = Pose(x=0, y=0)  # stands for named ends until the grid is known
    drafts = [
        Route(
            name=entry.name,
            start=entry.start if isinstance(entry.start, Pose) else here,
            goal=entry.goal if isinstance(entry.goal, Pose) else here,
            time_limit_s=entry.time_limit_s,
        )
        for entry in routes.values()
    ]
    try:
        world = build_world(
            name=head.name,
            title=head.title,
            objects=objects,
            occupancy=occupancy,
            areas=[entry.area() for entry in area_entries],
            routes=drafts,
            grid_spec=head.grid,
            lidar_height_m=head.lidar_height_m,
            activities=[activity if isinstance(activity, str) else activity.text for activity in head.activities],
            trolley_work={
                activity.text: activity.trolley for activity in head.activities if not isinstance(activity, str)
            },
            description=head.description,
            map_offset=head.map_offset,
            doors=doors,
            actors=head.actors,
        )
    except InputError as error:
        raise DocumentError([document.problem(str(error), "grid", code=error.code)]) from None
    return _with_waypoints(world, routes, area_document, route_document, problems)


class _Parts:
    """The files beside a world.yaml; gathers what is wrong in any of them."""

    def __init__(self, folder: Path, head: WorldFile, problems: Iterable[Problem], noted: list[Problem] | None) -> None:
        self.folder = folder
        self.head = head
        self.problems = list(problems)
        self.noted = noted
        self.doubles = self.problems if noted is None else noted  # where they are noted, the rest is judged too

    def listed(self, name: str | None, model: type[Record], key: str) -> tuple[tuple[Any, ...], Document | None]:
        """Return the entries of a file with unique names, and the file as a document."""
        if name is None:
            return (), None
        try:
            file, document = read_document(_beside(self.folder, name), model)
        except DocumentError as error:
            self.problems.extend(error.problems)
        except FileError as error:
            self.problems.append(Problem.of(error))
        else:
            entries = getattr(file, key)
            names = self._no_doubles(document, key, [entry.name for entry in entries])
            return tuple(e.model_copy(update={"name": n}) for e, n in zip(entries, names, strict=True)), document
        return (), None

    def routes(self) -> tuple[dict[int, RouteEntry], Document | None]:
        """Return the routes by their place in the file; where mistakes are noted, without those that have one."""
        entries: dict[int, RouteEntry] = {}
        try:
            document = read_yaml(_beside(self.folder, self.head.routes))
        except FileError as error:
            self.problems.append(Problem.of(error))
            return entries, None
        try:
            entries = dict(enumerate(validated(document, RoutesFile).routes))
        except DocumentError as error:
            if self.noted is None or not routes_in(document):
                self.problems.extend(error.problems)
                return entries, None
            self.noted.extend(error.problems)
            for index, entry in enumerate(routes_in(document)):
                with contextlib.suppress(ValidationError):
                    entries[index] = RouteEntry.model_validate(entry)
        names = self._no_doubles(document, "routes", route_names(document))
        return {i: entry.model_copy(update={"name": names[i]}) for i, entry in entries.items()}, document

    def occupancy(
        self, objects: tuple[SolidObject, ...], routes: Document | None, document: Document
    ) -> OccupancyMap | None:
        try:
            if isinstance(self.head.map, DerivedMap):
                if self.problems:  # what the map would be drawn from is not all known
                    return None
                places = [place for entry in routes_in(routes) for place in places_in(entry)]
                seeds = [(pose.x, pose.y) for key, pose in places if key == ("start",) and isinstance(pose, Pose)]
                return occupancy_from_objects(objects, resolution_m=self.head.map.resolution_m, seeds=seeds)
            return read_map(_beside(self.folder, self.head.map))
        except DocumentError as error:
            self.problems.extend(error.problems)
        except FileError as error:
            self.problems.append(Problem.of(error))
        except InputError as error:
            self.problems.append(document.problem(str(error), "map", code=error.code))
        return None

    def _no_doubles(self, document: Document, key: str, names: Sequence[str]) -> list[str]:
        """Report repeated names; return all names, with the repeated ones made unique."""
        for index, name in enumerate(names):
            if name in names[:index]:
                line = document.line(key, names.index(name), "name")
                said = f'the name "{name}" is already given in line {line}'
                self.doubles.append(document.problem(said, key, index, "name", code="name-twice"))
        return told_apart(document, key, names)


def routes_in(document: Document | None) -> list[object]:
    """Return what is listed in routes.yaml, sound or not; empty where there is no list."""
    listed = document.value.get("routes") if document and isinstance(document.value, dict) else None
    return listed if isinstance(listed, list) else []


def route_names(document: Document) -> list[str]:
    """Return the names of what is listed in routes.yaml, by their place where there is none."""
    names = [entry.get("name") if isinstance(entry, dict) else None for entry in routes_in(document)]
    return [name if isinstance(name, str) else f"routes[{index}]" for index, name in enumerate(names)]


def places_in(entry: object) -> list[tuple[Key, Pose | str]]:
    """Return every place of a route's entry that can be read, with its keys: also of one that is wrong elsewhere."""
    fields = entry if isinstance(entry, dict) else {}
    listed: list[tuple[Key, object]] = [((key,), fields[key]) for key in ("start", "goal") if key in fields]
    for key in ("through", "via"):
        values = fields.get(key)
        listed += [((key, index), value) for index, value in enumerate(values if isinstance(values, list) else [])]
    places = []
    for place_key, value in listed:
        if place_key[0] != "via" or isinstance(value, str):
            with contextlib.suppress(ValidationError):
                read = RouteEntry.model_validate({"name": "any", "start": value, "goal": "any", "time_limit_s": 1})
                places.append((place_key, read.start))
    return places


def told_apart(document: Document, key: str, names: Sequence[str]) -> list[str]:
    """Return the names of the entries under a key; a repeated name carries its line, which makes it unique."""
    return [
        f"{name} (line {document.line(key, index)})" if name in names[:index] else name
        for index, name in enumerate(names)
    ]


def _beside(folder: Path, name: str) -> Path:
    """Return a file of the world folder; a world is moved and shared as a whole, so it holds its files."""
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        raise FileError(
            folder / "world.yaml", f'the file "{name}" lies outside the world folder; copy it into {folder}'
        )
    return path


def _with_waypoints(
    world: World,
    entries: dict[int, RouteEntry],
    areas: Document | None,
    routes: Document | None,
    noted: list[Problem] | None,
) -> World:
    """Return the world with the waypoints of its routes looked up; DocumentError names every unknown waypoint."""
    problems: list[Problem] = []
    for i, area in enumerate(world.areas):
        for j, name in enumerate(area.waypoints):
            problems += _waypoint_problems(world, name, areas, ("areas", i, "waypoints", j))

    def pose(place: Pose | str) -> Pose:
        if isinstance(place, Pose):
            return place
        x, y = world.grid.position(place)
        return Pose(x=x, y=y)

    finished = []
    for i, route in enumerate(routes_in(routes)):
        named = [(key, place) for key, place in places_in(route) if isinstance(place, str)]
        found = [p for key, name in named for p in _waypoint_problems(world, name, routes, ("routes", i, *key))]
        problems += found
        if not found and i in entries:
            entry = entries[i]
            poses = {"start": pose(entry.start), "goal": pose(entry.goal), "through": tuple(map(pose, entry.through))}
            finished.append(Route.model_validate(dict(entry) | poses))
    if problems and noted is None:
        raise DocumentError(problems)
    changed = replace(world, routes=tuple(finished))
    if noted is not None and problems:
        noted += problems
        standable = [tuple(w for w in area.waypoints if w in world.grid.valid) for area in world.areas]
        kept = (a.model_copy(update={"waypoints": w}) for a, w in zip(world.areas, standable, strict=True))
        changed = replace(changed, areas=tuple(kept))
    return in_same_space(changed, world)


def _waypoint_problems(world: World, name: str, document: Document | None, key: tuple[str | int, ...]) -> list[Problem]:
    waypoint = world.grid.by_name.get(name)
    if document is None or (waypoint is not None and waypoint.human):
        return []
    if waypoint is not None:
        message = f'nobody can stand on waypoint "{name}": it is not clear of obstacles'
        return [document.problem(message, *key, code="waypoint-closed")]
    near = difflib.get_close_matches(name, world.grid.valid, n=1, cutoff=0.5)
    asked = f' Did you mean "{near[0]}"?' if near else ""
    rows, columns = world.grid.rows, world.grid.columns
    ends = f"The grid has rows {rows[0]} to {rows[-1]} and columns 1 to {len(columns)}."
    return [document.problem(f'there is no waypoint "{name}".{asked} {ends}', *key, code="unknown-waypoint")]


def folder_named(name: str) -> Path:
    """Return the folder of a world: that of the shipped world of this name, else the named one."""
    return SHIPPED / name if name in shipped_worlds() else Path(name)


def as_named(folder: Path) -> str:
    """Return how a world folder is named in a command: with `./` before the name of a shipped world."""
    return f"./{folder}" if str(folder) in shipped_worlds() else str(folder)


def size_m(world: World) -> tuple[float, float]:
    """Return the width and the height of a world's map in metres."""
    rows, columns = world.occupancy.cells.shape
    return columns * world.occupancy.resolution, rows * world.occupancy.resolution


def world_summary(world: World) -> dict[str, Any]:
    """Return what a world holds, as plain data."""
    wide, high = size_m(world)
    return {
        "name": world.name,
        "title": world.title,
        "id": world.id,
        "size_m": [round(wide, 3), round(high, 3)],
        "objects": len(world.objects),
        "grid": {
            "rows": list(world.grid.rows),
            "columns": list(world.grid.columns),
            "valid_waypoints": len(world.grid.valid),
            "hops": len(world.grid.hops),
        },
        "areas": [a.model_dump(mode="json", include={"name", "kind", "region", "waypoints"}) for a in world.areas],
        "routes": [
            {
                "name": r.name,
                "purpose": r.purpose,
                "time_limit_s": r.time_limit_s,
                "description": route_paragraph(world, r),
            }
            for r in world.routes
        ],
        "doors": [
            {"name": d.name, "kind": d.kind, "state": d.state, "width_m": round(d.width_m, 3)} for d in world.doors
        ],
        "activities": list(world.activities),
    }
