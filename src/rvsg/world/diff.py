"""Differences between two versions of a world, and their effect on scenarios saved in the first."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence, Set
from typing import Literal

import numpy as np

from rvsg.core.records import Record
from rvsg.world.space import frame_of, world_map
from rvsg.world.world import FREE, OCCUPIED, Area, Door, Route, SolidObject, World

Part = Literal["map", "objects", "doors", "waypoints", "areas", "routes", "activities"]
MOVED_M = 1e-6
MOST_NAMED = 8


class Difference(Record):
    """One difference between two worlds; `matters` says whether a scenario can depend on it.

    A change of the floor always does, of a waypoint if somebody uses it; labels, activities and routes do not, as a
    scenario holds its own route.
    """

    part: Part
    message: str
    matters: bool


def differences(old: World, new: World) -> tuple[Difference, ...]:
    """Return every difference between two worlds, those that matter to scenarios first in each part."""
    return (
        *_map(old, new),
        *_named("objects", "object", old.objects, new.objects, matters=True, without={"name", "kind"}),
        *_named("doors", "door", old.doors, new.doors, matters=True),
        *_waypoints(old, new),
        *_areas(old, new),
        *_routes(old, new),
        *(
            Difference(part="activities", message=f'The activity "{text}" is {said}.', matters=False)
            for said, these, those in (("gone", old, new), ("new", new, old))
            for text in these.activities
            if text not in those.activities
        ),
    )


def _map(old: World, new: World) -> Iterator[Difference]:
    a, b = world_map(old), world_map(new)
    if frame_of(a) == frame_of(b) and (a.cells == b.cells).all() and old.lidar_height_m == new.lidar_height_m:
        return
    frame = frame_of(a)
    rows, columns = np.indices(frame.shape)
    middles = frame.to_metres(np.stack([columns + 0.5, rows + 0.5], axis=-1).astype(float))
    on_map = frame_of(b).looked_up(np.ones(b.cells.shape, bool), middles)  # off the map nothing is free
    there = np.where(on_map, frame_of(b).looked_up(b.cells, middles), OCCUPIED)
    size = frame.resolution**2
    closed = float(((a.cells == FREE) & (there != FREE)).sum() * size)
    opened = float(((a.cells != FREE) & (there == FREE)).sum() * size)
    parts = [f"{closed:.1f} m² of floor closed" if closed else "", f"{opened:.1f} m² opened" if opened else ""]
    said = " and ".join(part for part in parts if part) or "the frame, the resolution or the lidar height changed"
    yield Difference(part="map", message=f"The map changed: {said}.", matters=True)


def _waypoints(old: World, new: World) -> Iterator[Difference]:
    before = {w.name: w for w in old.grid.waypoints if w.human}
    now = {w.name: w for w in new.grid.waypoints if w.human}
    gone = [name for name in before if name not in now]
    added = [name for name in now if name not in before]
    moved = {n: math.dist((before[n].x, before[n].y), (now[n].x, now[n].y)) for n in before if n in now}
    moved = {name: away for name, away in moved.items() if away > MOVED_M}
    for name, away in list(moved.items())[:MOST_NAMED]:
        yield Difference(part="waypoints", message=f"Waypoint {name} moved by {_metres(away)}.", matters=True)
    if len(moved) > MOST_NAMED:
        more = f"{len(moved) - MOST_NAMED} more waypoints moved, by up to {_metres(max(moved.values()))}."
        yield Difference(part="waypoints", message=more, matters=True)
    if gone:
        yield Difference(part="waypoints", message=f"People can no longer stand on {_some(gone)}.", matters=True)
    if added:
        yield Difference(part="waypoints", message=f"People can now also stand on {_some(added)}.", matters=False)
    hops = {frozenset(hop) for hop in old.grid.hops} - {frozenset(hop) for hop in new.grid.hops}
    lost = sorted("-".join(sorted(hop)) for hop in hops if all(n in now and n not in moved for n in hop))
    if lost:
        yield Difference(part="waypoints", message=f"The straight way is no longer free: {_some(lost)}.", matters=True)


def _areas(old: World, new: World) -> Iterator[Difference]:
    by_outline = {area.outline: area.name for area in new.areas}
    now = {area.name for area in new.areas}
    renamed = {a.name: by_outline[a.outline] for a in old.areas if a.name not in now and a.outline in by_outline}
    for before, after in renamed.items():
        yield Difference(part="areas", message=f'Area "{before}" is now called "{after}".', matters=False)
    before_others = [area for area in old.areas if area.name not in renamed]
    others = [area for area in new.areas if area.name not in renamed.values()]
    yield from _named("areas", "area", before_others, others, matters=False)


def _routes(old: World, new: World) -> Iterator[Difference]:
    yield from _named("routes", "route", old.routes, new.routes, matters=False)
    now = {route.name: route for route in new.routes}
    for before in old.routes:
        after = now.get(before.name, before)
        for end, a, b in (("start", before.start, after.start), ("goal", before.goal, after.goal)):
            if a != b:
                moved = _metres(math.dist((a.x, a.y), (b.x, b.y)))
                yield Difference(part="routes", message=f"The {end} of {before.name} moved by {moved}.", matters=False)


def _named(
    part: Part,
    word: str,
    old: Sequence[SolidObject | Door | Area | Route],
    new: Sequence[SolidObject | Door | Area | Route],
    *,
    matters: bool,
    without: Set[str] = frozenset({"name"}),
) -> Iterator[Difference]:
    """Yield which named things are gone, new or changed, but for these keys of theirs."""
    before, now = ({thing.name: thing.model_dump(exclude=set(without)) for thing in things} for things in (old, new))
    lists = (
        ("is gone", "are gone", [name for name in before if name not in now]),
        ("is new", "are new", [name for name in now if name not in before]),
        ("changed", "changed", [name for name in before if name in now and before[name] != now[name]]),
    )
    for one, many, names in lists:
        if names:
            said = (
                f"{word.capitalize()}{'s' if len(names) > 1 else ''} {_some(names)} {one if len(names) == 1 else many}."
            )
            yield Difference(part=part, message=said, matters=matters)


def _metres(distance: float) -> str:
    return f"{distance:.1f} m" if distance >= 0.1 else f"{distance * 100:.1g} cm"


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:MOST_NAMED]) + (f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else "")
