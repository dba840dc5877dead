"""The places people work at: the labelled areas with those of their waypoints that can be reached."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rvsg.core.records import Pose
from rvsg.world.grid import Grid
from rvsg.world.world import World


@dataclass(frozen=True)
class Place:
    """A place people work at: the name and kind of a labelled area, and where people stand to work it."""

    name: str
    kind: str
    waypoints: tuple[str, ...]


GOODS = frozenset(
    {
        *("shelf", "shelves", "rack", "racks", "boxes", "box", "pallet", "pallets", "crate", "crates", "store"),
        *("storage", "goods", "machine", "machines", "equipment", "loading", "dock", "packing", "waste", "workshop"),
        *("warehouse", "area", "waypoint"),
    }
)
"""Words in the kinds of places where people handle goods; elsewhere nobody is said to sort them or push them about."""


def handles_goods(places: Sequence[Place]) -> bool:
    """Return whether the kinds of most places are kinds of a place of goods."""
    kinds = [place for place in places if GOODS & set(place.kind.lower().split())]
    return 2 * len(kinds) >= len(places)


def reachable(grid: Grid, start: str) -> frozenset[str]:
    """The waypoints that can be walked to from a valid one."""
    found, pending = {start}, [start]
    while pending:
        for other in grid.neighbours[pending.pop()]:
            if other not in found:
                found.add(other)
                pending.append(other)
    return frozenset(found)


def places_of(world: World, *, reachable_from: Pose) -> tuple[Place, ...]:
    """The places of the part of the world the robot starts in; where nothing is labelled, every waypoint is one."""
    if not world.grid.valid:
        return ()
    near = reachable(world.grid, world.grid.nearest(reachable_from.x, reachable_from.y))
    places = tuple(
        Place(area.name, area.kind, names)
        for area in world.areas
        if (names := tuple(name for name in area.waypoints if name in near))
    )
    if len({name for place in places for name in place.waypoints}) >= 3 and len(places) >= 2:
        return places
    return tuple(Place(name, "waypoint", (name,)) for name in (w.name for w in world.grid.waypoints) if name in near)
