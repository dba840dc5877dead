"""The world of a scenario.

A world's identity is its declared name and its content id. Where its folder is belongs to neither: the same world
gives the same scenarios however its folder was named. Where a world was found is remembered per process, and saved
beside a scenario.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import get_args

from rvsg.core.documents import read_document
from rvsg.core.errors import InputError, RvsgError, UnknownName
from rvsg.scenario.scenario import Mission
from rvsg.scenario.variation import same_floor
from rvsg.world import world_folder
from rvsg.world.lattice import with_doors
from rvsg.world.schema import ObjectsFile
from rvsg.world.world import SolidObject, State, World

_worlds: dict[str, World] = {}
"""Worlds seen in this process by their content id."""
_folders: dict[str, Path] = {}
"""The folder of each, where it is not a shipped world."""


def load_world(name_or_path: str | Path) -> World:
    """Load a shipped world by its name, or the world in a folder.

    Raises:
        UnknownName: there is no such world.
        FileError: its files cannot be used; names every mistake with file and line.
    """
    world = world_folder.load_world(name_or_path)
    shipped = isinstance(name_or_path, str) and name_or_path in world_folder.shipped_worlds()
    return remember(world, None if shipped else world_folder.world_folder(name_or_path))


def remember(world: World, folder: Path | None = None) -> World:
    """Make a world findable by the scenarios made in it, and return it."""
    _worlds[world.id] = world
    if folder is not None:
        _folders[world.id] = folder.resolve()
    return world


def as_world(world: World | str | Path) -> World:
    """Return a world given by itself, by name or by folder."""
    return remember(world) if isinstance(world, World) else load_world(world)


def load_moved(path: str | Path, world: World) -> tuple[SolidObject, ...]:
    """Load objects that were moved into a world: a file like objects.yaml, with boxes or footprints in metres.

    Raises:
        FileError: the file is wrong; names every mistake with its line.
    """
    file, _ = read_document(Path(path), ObjectsFile)
    return tuple(entry.solid(world.lidar_height_m) for entry in file.objects)


def doors_in(world: World, states: Mapping[str, State]) -> World:
    """Return the world with some doors in other states.

    Raises:
        UnknownName: the world has no such door.
        InputError: there is no such state.
    """
    for name, state in states.items():
        if name not in {door.name for door in world.doors}:
            raise UnknownName("door", name, [door.name for door in world.doors], hint=f"World: {world.name}.")
        if state not in get_args(State):
            raise InputError(f"A door is open, closed or automatic; {name} cannot be {state!r}.", code="door-state")
    return with_doors(world, {**world.door_states, **states})


def folder_of(world_id: str) -> Path | None:
    """Return where a world that is not shipped was found; None if that is not known."""
    return _folders.get(world_id)


def world_of(mission: Mission, given: World | str | Path | None = None, *, near: tuple[Path, ...] = ()) -> World:
    """Return the world a mission takes place in.

    Args:
        given: the world, or where it is; by default it is looked for among the worlds seen in this process, the
            shipped worlds and the folders `near`.

    Raises:
        InputError: the world given is another one, or the world has changed or cannot be found.
    """
    if given is not None:
        if same_floor(mission, world := as_world(given)):
            return mission.place(world)
        raise InputError(
            f"The scenario was made for {mission.world} ({mission.world_id}), and "
            f"{world.name if isinstance(given, World) else given} is another world ({world.id}). "
            "Leave --world (in Python world=) out, or give the folder of the world it was made for.",
            code="world-other",
        )
    if mission.world_id in _worlds:
        return mission.place(_worlds[mission.world_id])
    other: World | None = None
    places: tuple[str | Path, ...] = (*near, mission.world)
    for place in places:
        try:
            loaded = load_world(place)
        except UnknownName:
            continue
        except RvsgError:
            if place in near:
                continue
            raise
        if same_floor(mission, loaded):
            return mission.place(loaded)
        other = other or loaded
    if other is None:
        raise UnknownName(
            "world",
            mission.world,
            world_folder.shipped_worlds(),
            hint="The scenario was made in this world: say with --world (in Python world=) in which folder it is.",
        )
    why = "its map or objects have changed." if mission.parts else "it does not say what it depends on."
    raise InputError(
        f"The scenario was made for {mission.world} ({mission.world_id}), but that world is now {other.id}: {why} "
        "Adapt the scenario with `rvsg scenario migrate`, or give a copy of the world it was made for with --world "
        "(in Python world=).",
        code="world-changed",
    )
