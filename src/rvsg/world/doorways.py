"""The doors of a world in the states that a scenario gives them, and where people then walk."""

from __future__ import annotations

from collections.abc import Mapping
from weakref import WeakKeyDictionary

from rvsg.world.doors import Door, Point, State
from rvsg.world.grid import GridSpec
from rvsg.world.lattice import relaid
from rvsg.world.space import Space, human_space
from rvsg.world.world import SolidObject, World

_staged: WeakKeyDictionary[World, tuple[object, World]] = WeakKeyDictionary()
"""The last place made of each world: what is computed of its space is kept while one scenario follows another."""


def place_of(world: World, moved: tuple[SolidObject, ...], states: Mapping[str, State]) -> World:
    """Return the world with these objects moved into it and its doors in these states, and no others."""
    if moved == world.moved and dict(states) == dict(world.door_states):
        return world
    key = (moved, dict(states))
    if world not in _staged or _staged[world][0] != key:
        _staged[world] = (key, with_doors(world, states).with_moved(moved))
    return _staged[world][1]


def with_doors(world: World, states: Mapping[str, State]) -> World:
    """Return the world with its doors in these states, the others as the world has them; its id stays the same.

    People can stand and walk where the leaves leave room. A name that the world does not have changes nothing.
    """
    if dict(states) == dict(world.door_states):
        return world
    changed = world.staged(door_states=dict(states))
    if changed.staged_doors == world.staged_doors:
        return changed
    bare = changed.staged(moved=())
    grid = relaid(
        world.grid,
        world.grid_spec or GridSpec(),
        human_space(bare),
        seeds=[(route.start.x, route.start.y) for route in world.routes],
        floor=floor_with_open_doors(bare),
    )
    return changed.staged(grid=grid)


def floor_with_open_doors(world: World) -> Space:
    """Return where people could be if no door were closed."""
    closed = {door.name: "automatic" for door in world.staged_doors if door.state == "closed"}
    return human_space(world.staged(door_states={**world.door_states, **closed}) if closed else world)


def closed_between(world: World, a: Point, b: Point, clearance_m: float = 0.0) -> Door | None:
    """Return a closed door whose leaf is this near to the straight line between two points; None where none is."""
    from shapely import LineString, Polygon

    closed = [door for door in world.staged_doors if door.state == "closed"]
    line = LineString([a, b]) if closed else None
    return next((door for door in closed if Polygon(door.leaf(0.0)).distance(line) <= clearance_m), None)
