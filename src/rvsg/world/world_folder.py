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

from rvsg.core.documents import Document, DocumentError, Key, Model, Problem, read_document, read_yaml, validated
from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.core.inputs import exists, is_dir
from rvsg.core.records import Pose
from rvsg.world.lattice import build_world
from rvsg.world.occupancy import occupancy_from_objects, read_map
from rvsg.world.passages import route_paragraph
from rvsg.world.schema import DerivedMap, DoorsFile, LabelsFile, ObjectsFile, RouteEntry, RoutesFile, WorldFile
from rvsg.world.space import in_same_space
from rvsg.world.world import Area, Door, OccupancyMap, Route, SolidObject, World

SHIPPED = Path(__file__).parent / "worlds"


def shipped_worlds() -> tuple[str, ...]:
    """Return the names of the worlds that ship with RVSG."""
    return tuple(sorted(folder.name for folder in SHIPPED.iterdir() if (folder / "world.yaml").is_file()))


def load_world(name_or_path: str | Path) -> World:
    """Return a shipped world by its name, or the world in a folder (or its world.yaml).

    Raises UnknownName where there is no such world, FileError (DocumentError: everything at once) where its files
    cannot be used.
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
    if not is_dir(folder) and exists(folder):
        raise FileError(folder, "this is a file; a world is a folder that holds a world.yaml.", code="world-is-file")
    if not is_dir(folder):
        raise UnknownName("world", str(path), shipped_worlds(), hint="Or give the folder of your own world.")
    if not (folder / "world.yaml").is_file():
        raise FileError(
            folder,
            "the folder holds no world.yaml; `rvsg world new` makes a world folder from a map",
            code="world-missing",
        )
    return folder


@lru_cache(maxsize=8)
def _shipped(name: str) -> World:
    return read_world(SHIPPED / name)


def read_world(folder: Path, problems: list[Problem] | None = None) -> World:
    """Read the world in a folder.

    With a list for `problems`, names of waypoints that do not exist are noted there and left out instead of raised, as
    are routes with a mistake; objects, areas and routes whose name was given before are noted and named by their line.
    """
    head_document = read_yaml(folder / "world.yaml")
    mistakes: tuple[Problem, ...] = ()
    try:
        head = validated(head_document, WorldFile)
    except DocumentError as error:  # read on with what can be read, so that every mistake is reported at once
        head, mistakes = _readable_head(head_document), error.problems
    parts = _Parts(folder, head, mistakes, noted=problems)
    objects = parts.objects()
    doors = parts.doors()
    areas, area_document = parts.areas()
    routes, route_document = parts.routes()
    occupancy = parts.occupancy(objects, route_document, head_document)
    parts.stop_at_problems()
    assert occupancy is not None
    drafts = tuple(_draft(entry) for entry in routes.values())
    try:
        world = build_world(
            name=head.name,
            title=head.title,
            objects=objects,
            occupancy=occupancy,
            areas=areas,
            routes=drafts,
            grid_spec=head.grid,
            lidar_height_m=head.lidar_height_m,
            activities=[each if isinstance(each, str) else each.text for each in head.activities],
            trolley_work={each.text: each.trolley for each in head.activities if not isinstance(each, str)},
            description=head.description,
            map_offset=head.map_offset,
            doors=doors,
            actors=head.actors,
        )
    except InputError as error:
        raise DocumentError([head_document.problem(str(error), "grid", code=error.code)]) from None
    return _checked(world, routes, area_document, route_document, problems)


def _readable_head(document: Document) -> WorldFile:
    """Return what a faulty world.yaml still says of the files beside it; nothing else of it is used."""
    said = document.value if isinstance(document.value, dict) else {}
    names = {
        key: said[key] for key in ("objects", "labels", "routes", "doors", "map") if isinstance(said.get(key), str)
    }
    return WorldFile.model_validate({"name": "unreadable", "map": {"from": "objects"}, **names})


class _Parts:
    """The files beside a world.yaml; gathers what is wrong in any of them."""

    def __init__(
        self, folder: Path, head: WorldFile, problems: Iterable[Problem], noted: list[Problem] | None = None
    ) -> None:
        self.folder = folder
        self.head = head
        self.problems = list(problems)
        self.noted = noted
        self.doubles = self.problems if noted is None else noted  # where they are noted, the rest is judged too

    def _read(self, name: str, model: type[Model]) -> tuple[Model, Document] | None:
        try:
            return read_document(_beside(self.folder, name), model)
        except DocumentError as error:
            self.problems.extend(error.problems)
        except FileError as error:
            self.problems.append(Problem.of(error))
        return None

    def objects(self) -> tuple[SolidObject, ...]:
        if self.head.objects is None:
            return ()
        read = self._read(self.head.objects, ObjectsFile)
        if read is None:
            return ()
        names = self._no_doubles(read[1], "objects", [entry.name for entry in read[0].objects])
        solids = (entry.solid(self.head.lidar_height_m) for entry in read[0].objects)
        return tuple(solid.model_copy(update={"name": name}) for solid, name in zip(solids, names, strict=True))

    def doors(self) -> tuple[Door, ...]:
        read = None if self.head.doors is None else self._read(self.head.doors, DoorsFile)
        if read is None:
            return ()
        names = self._no_doubles(read[1], "doors", [door.name for door in read[0].doors])
        return tuple(door.model_copy(update={"name": n}) for door, n in zip(read[0].doors, names, strict=True))

    def areas(self) -> tuple[tuple[Area, ...], Document | None]:
        read = self._read(self.head.labels, LabelsFile)
        if read is None:
            return (), None
        names = self._no_doubles(read[1], "areas", [entry.name for entry in read[0].areas])
        areas = (entry.area() for entry in read[0].areas)
        return tuple(a.model_copy(update={"name": name}) for a, name in zip(areas, names, strict=True)), read[1]

    def routes(self) -> tuple[dict[int, RouteEntry], Document | None]:
        """Return the routes by their place in the file; where mistakes are noted, without those that have one."""
        try:
            document = read_yaml(_beside(self.folder, self.head.routes))
        except FileError as error:
            self.problems.append(Problem.of(error))
            return {}, None
        try:
            entries = dict(enumerate(validated(document, RoutesFile).routes))
        except DocumentError as error:
            if self.noted is None or not routes_in(document):
                self.problems.extend(error.problems)
                return {}, None
            self.noted.extend(error.problems)
            entries = _sound_routes(document)
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
        first: dict[str, int] = {}
        for index, name in enumerate(names):
            if name in first:
                line = document.line(key, first[name], "name")
                said = f'the name "{name}" is already given in line {line}'
                self.doubles.append(document.problem(said, key, index, "name", code="name-twice"))
            first.setdefault(name, index)
        return told_apart(document, key, names)

    def stop_at_problems(self) -> None:
        if self.problems:
            raise DocumentError(self.problems)


def routes_in(document: Document | None) -> list[object]:
    """Return what is listed in routes.yaml, sound or not; empty where there is no list."""
    listed = document.value.get("routes") if document and isinstance(document.value, dict) else None
    return listed if isinstance(listed, list) else []


def route_names(document: Document) -> list[str]:
    """Return the names of what is listed in routes.yaml, by their place where there is none."""
    found = [entry.get("name") if isinstance(entry, dict) else None for entry in routes_in(document)]
    return [name if isinstance(name, str) else f"routes[{index}]" for index, name in enumerate(found)]


def places_in(entry: object) -> list[tuple[Key, Pose | str]]:
    """Return every place of a route's entry that can be read, with its keys: also of one that is wrong elsewhere."""
    given = entry if isinstance(entry, dict) else {}
    listed: list[tuple[Key, object]] = [((key,), given[key]) for key in ("start", "goal") if key in given]
    for key in ("through", "via"):
        values = given.get(key)
        listed += [((key, index), value) for index, value in enumerate(values if isinstance(values, list) else [])]
    read = [(key, _place(value)) for key, value in listed if key[0] != "via" or isinstance(value, str)]
    return [(key, place) for key, place in read if place is not None]


def _place(given: object) -> Pose | str | None:
    """Return a pose or the name of a waypoint as a route may hold it; None for anything else."""
    try:
        return RouteEntry.model_validate({"name": "any", "start": given, "goal": "any", "time_limit_s": 1}).start
    except ValidationError:
        return None


def _sound_routes(document: Document) -> dict[int, RouteEntry]:
    """Return the entries of routes.yaml that have no mistake, by their place in the file."""
    found = {}
    for index, entry in enumerate(routes_in(document)):
        with contextlib.suppress(ValidationError):
            found[index] = RouteEntry.model_validate(entry)
    return found


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


def _draft(entry: RouteEntry) -> Route:
    """Return the route with named ends not yet looked up; `_checked` replaces them once the grid is known."""
    here = Pose(x=0, y=0)
    start = entry.start if isinstance(entry.start, Pose) else here
    goal = entry.goal if isinstance(entry.goal, Pose) else here
    return Route(name=entry.name, start=start, goal=goal, time_limit_s=entry.time_limit_s)


def _checked(
    world: World,
    entries: dict[int, RouteEntry],
    areas: Document | None,
    routes: Document | None,
    noted: list[Problem] | None,
) -> World:
    """Return the world with the waypoints of its routes looked up; DocumentError names every unknown waypoint."""
    problems: list[Problem] = []
    if areas is not None:
        for i, area in enumerate(world.areas):
            for j, name in enumerate(area.waypoints):
                problems += _waypoint_problems(world, name, areas, ("areas", i, "waypoints", j))
    finished = []
    for i, given in enumerate(routes_in(routes)):
        named = [(key, place) for key, place in places_in(given) if isinstance(place, str)]
        found = [p for key, name in named for p in _waypoint_problems(world, name, routes, ("routes", i, *key))]
        problems += found
        if not found and i in entries:
            finished.append(_route(entries[i], world))
    if problems and noted is None:
        raise DocumentError(problems)
    if noted is not None and problems:
        noted += problems
        standable = set(world.grid.valid)
        kept = tuple(
            a.model_copy(update={"waypoints": tuple(w for w in a.waypoints if w in standable)}) for a in world.areas
        )
        world = replace(world, areas=kept)
    return in_same_space(replace(world, routes=tuple(finished)), world)


def _waypoint_problems(world: World, name: str, document: Document | None, key: tuple[str | int, ...]) -> list[Problem]:
    waypoint = world.grid.by_name.get(name)
    if document is None or (waypoint is not None and waypoint.human):
        return []
    if waypoint is not None:
        return [
            document.problem(
                f'nobody can stand on waypoint "{name}": it is not clear of obstacles', *key, code="waypoint-closed"
            )
        ]
    near = difflib.get_close_matches(name, world.grid.valid, n=1, cutoff=0.5)
    asked = f' Did you mean "{near[0]}"?' if near else ""
    ends = (
        f"The grid has rows {world.grid.rows[0]} to {world.grid.rows[-1]} and columns 1 to {len(world.grid.columns)}."
    )
    return [document.problem(f'there is no waypoint "{name}".{asked} {ends}', *key, code="unknown-waypoint")]


def _route(entry: RouteEntry, world: World) -> Route:
    def pose(place: Pose | str) -> Pose:
        if isinstance(place, Pose):
            return place
        x, y = world.grid.position(place)
        return Pose(x=x, y=y)

    return Route(
        name=entry.name,
        start=pose(entry.start),
        goal=pose(entry.goal),
        time_limit_s=entry.time_limit_s,
        via=entry.via,
        through=tuple(pose(place) for place in entry.through),
        purpose=entry.purpose,
        description=entry.description,
    )


def folder_named(name: Path) -> Path:
    """Return the folder of a world: the named one, or that of the shipped world of this name."""
    shipped = str(name) in shipped_worlds() and not (name / "world.yaml").is_file()
    return SHIPPED / str(name) if shipped else name


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
        "areas": [
            {"name": a.name, "kind": a.kind, "region": a.region, "waypoints": list(a.waypoints)} for a in world.areas
        ],
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
