"""Layout of the grid: waypoints, the bodies that fit on them, and the free straight hops between adjacent ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.world.grid import Grid, GridSpec, Waypoint
from rvsg.world.space import Space, human_space, in_same_space, inside_window, outermost, robot_space
from rvsg.world.world import Area, Description, Door, OccupancyMap, Point, Polygon, Route, SolidObject, State, World

Floats = NDArray[np.float64]

SPACINGS_M = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.5, 10.0, 15.0, 20.0)
MOST_ROWS = 26
MOST_COLUMNS = 40
MOST_WAYPOINTS = 40_000
ARM_M = 1.0


def row_letters(index: int) -> str:
    """The name of a row counted from 0: A..Z, AA, AB, .. as spreadsheets name their columns."""
    return (row_letters(index // 26 - 1) if index >= 26 else "") + chr(ord("A") + index % 26)


def build_grid(
    spec: GridSpec,
    human: Space,
    robot: Space,
    *,
    seeds: Sequence[tuple[float, float]] = (),
    floor: Space | None = None,
) -> Grid:
    """Return the grid of a specification in a world whose free space for people and robot is given.

    `seeds` are places (metres) on the main part of the floor; `floor` is where people could be with all doors open.
    Raises InputError where nobody fits on any waypoint or the grid has an absurd number of them.
    """
    rows, columns = _coordinates(spec, human)
    if len(rows) * len(columns) > MOST_WAYPOINTS:
        raise InputError(
            f"a grid of {len(rows)} x {len(columns)} waypoints is too fine to be read: give a spacing_m over "
            f"{spec.spacing_m or 0:g}, so that there are at most {MOST_WAYPOINTS} waypoints",
            code="grid-too-fine",
        )
    upright = spec.up == "y"
    at = {f"{r}{c}": (v, u) if upright else (u, v) for r, u in rows.items() for c, v in columns.items()} | spec.moved
    names, points = list(at), np.array(list(at.values()))
    _reject_far(names, points, human)
    fits = _fitting(spec, human, floor or human, points, seeds) if spec.valid is None else np.isin(names, spec.valid)
    if not fits.any():
        raise InputError(
            f"no waypoint of the grid is {spec.human_clearance_m:g} m clear of all obstacles: "
            "use a smaller spacing_m, another origin or a smaller human_clearance_m"
        )
    robot_clear = robot.clearances(points)
    robot_fits = (robot_clear > 0) & (robot_clear >= spec.robot_clearance_m)
    shape = (len(rows), len(columns))
    waypoints = tuple(
        Waypoint(name=name, x=x, y=y, row=i // shape[1], column=i % shape[1], human=h, robot=r)
        for i, (name, (x, y), h, r) in enumerate(
            zip(names, points.tolist(), fits.tolist(), robot_fits.tolist(), strict=True)
        )
    )
    hops = _hops(names, points, fits, shape, human, spec.hop_radius_m)
    return Grid(rows=tuple(rows), columns=tuple(str(c) for c in columns), waypoints=waypoints, hops=hops)


def _reject_far(names: Sequence[str], points: Floats, space: Space) -> None:
    """Refuse waypoints that lie further off the map than the map is large: a typing error, and no place."""
    low, high = space.frame.corners.min(axis=0), space.frame.corners.max(axis=0)
    size = float(np.hypot(*(high - low)))
    far = ((points < low - size) | (points > high + size)).any(axis=1)
    if far.any():
        at = int(far.argmax())
        x, y = points[at]
        raise InputError(
            f"waypoint {names[at]} at ({x:g}, {y:g}) lies far off the map, which reaches from ({low[0]:.1f}, "
            f"{low[1]:.1f}) to ({high[0]:.1f}, {high[1]:.1f}) m: correct its row, column or moved",
            code="grid-off-map",
        )


def relaid(grid: Grid, spec: GridSpec, human: Space, *, seeds: Sequence[tuple[float, float]], floor: Space) -> Grid:
    """Return the grid with who fits on its waypoints, and which hops are free, where people's space has changed."""
    points = np.array([(w.x, w.y) for w in grid.waypoints])
    names = [w.name for w in grid.waypoints]
    fits = _fitting(spec, human, floor, points, seeds) if spec.valid is None else np.isin(names, spec.valid)
    waypoints = tuple(
        w if w.human == fit else w.model_copy(update={"human": bool(fit)})
        for w, fit in zip(grid.waypoints, fits, strict=True)
    )
    hops = _hops(names, points, fits, (len(grid.rows), len(grid.columns)), human, spec.hop_radius_m)
    return grid.model_copy(update={"waypoints": waypoints, "hops": hops})


def _fitting(
    spec: GridSpec, human: Space, floor: Space, points: Floats, seeds: Sequence[tuple[float, float]]
) -> NDArray[np.bool_]:
    """Return where a person fits, on the main part of the floor or on all parts."""
    clear = human.clearances(points)
    fits = (clear > 0) & (clear >= spec.human_clearance_m)
    if not spec.isolated_parts:
        parts = floor.parts(min(spec.hop_radius_m, spec.human_clearance_m))
        main = {int(part) for part in floor.frame.looked_up(parts, np.array(seeds).reshape(-1, 2))} - {0} or {1}
        fits &= np.isin(floor.frame.looked_up(parts, points), sorted(main))
    return fits


def _coordinates(spec: GridSpec, space: Space) -> tuple[dict[str, float], dict[int, float]]:
    """Rows with their coordinate along the up axis (descending), columns along the other axis."""
    if spec.rows is not None and spec.columns is not None:
        return spec.rows, spec.columns
    free = outermost((space.field >= spec.human_clearance_m) & (space.field > 0))
    if len(free) == 0:
        raise InputError(
            f"the map has no place that is {spec.human_clearance_m:g} m clear of obstacles: is it inverted (negate) or "
            "all unknown? Else use a smaller human_clearance_m",
            code="grid-no-room",
        )
    points = space.frame.to_metres(free.astype(float) + 0.5)
    low, high = points.min(axis=0), points.max(axis=0)
    up, right = (0, 1) if spec.up == "x" else (1, 0)
    spacing = spec.spacing_m or fitting_spacing(float(high[up] - low[up]), float(high[right] - low[right]))
    origin = spec.origin
    ups = _ticks(low[up], high[up], spacing, None if origin is None else origin[up])[::-1]
    rights = _ticks(low[right], high[right], spacing, None if origin is None else origin[right])
    if spec.up == "x":  # with x up, y points to the left
        rights = rights[::-1]
    return {row_letters(i): u for i, u in enumerate(ups)}, {i + 1: v for i, v in enumerate(rights)}


def fitting_spacing(height_m: float, width_m: float) -> float:
    """The spacing of an even grid that a reader still takes in: at most 26 rows and 40 columns, 1 m as a rule."""
    for spacing in SPACINGS_M:
        if spacing < 1.0 and max(height_m, width_m) > 8.0:
            continue
        if height_m / spacing < MOST_ROWS and width_m / spacing < MOST_COLUMNS:
            return spacing
    return float(math.ceil(max(height_m / MOST_ROWS, width_m / MOST_COLUMNS)))


def _ticks(low: float, high: float, spacing: float, through: float | None) -> list[float]:
    """Evenly spaced coordinates from low to high: centred, or through a given coordinate."""
    if through is None:
        count = int((high - low) / spacing + 1e-9) + 1
        first = (low + high) / 2 - (count - 1) * spacing / 2
        first = round(first / 0.05) * 0.05  # readable numbers
    else:
        first = through + math.ceil((low - through) / spacing - 1e-9) * spacing
        count = int((high - first) / spacing + 1e-9) + 1
    return [round(first + i * spacing, 6) for i in range(max(count, 1))]


def _hops(
    names: Sequence[str],
    points: Floats,
    fits: NDArray[np.bool_],
    shape: tuple[int, int],
    human: Space,
    radius: float,
) -> tuple[tuple[str, str], ...]:
    """Return pairs of adjacent valid waypoints (eight neighbours) between which the straight way is free."""
    index = np.arange(len(points)).reshape(shape)
    sides = (index[:, :-1], index[:, 1:]), (index[:-1], index[1:]), (index[:-1, :-1], index[1:, 1:])
    pairs = np.concatenate([np.stack([a.ravel(), b.ravel()], 1) for a, b in (*sides, (index[:-1, 1:], index[1:, :-1]))])
    pairs = pairs[fits[pairs].all(axis=1)]
    free = human.segments_free(points[pairs[:, 0]], points[pairs[:, 1]], radius)
    return tuple((names[a], names[b]) for a, b in sorted(pairs[free].tolist()))


def area_waypoints(
    outline: Sequence[tuple[float, float]], grid: Grid, human: Space, *, objects: Sequence[SolidObject] = ()
) -> tuple[str, ...]:
    """Propose the waypoints from which an area is worked; may be empty.

    Of open floor they are those inside it, of a thing those within arm's length of its border with nothing but the
    `objects` that stand on the area in between, else the nearest such waypoint within three times that.
    """
    import shapely

    shape = shapely.Polygon(outline)
    shapely.prepare(shape)
    valid = [w for w in grid.waypoints if w.human]
    if not valid:
        return ()
    places = shapely.points([(w.x, w.y) for w in valid])
    away = shape.distance(places)
    inside = away == 0.0
    if open_share(outline, human) > 0.5 and inside.any():
        return tuple(w.name for w, chosen in zip(valid, inside, strict=True) if chosen)
    near = np.flatnonzero(away <= 3 * ARM_M)
    own = _with_what_stands_on_it(shape, objects).buffer(1.5 * human.frame.resolution)
    near = near[np.array([_in_reach(shape, valid[i], human, own) for i in near], bool)]
    chosen = near[away[near] <= ARM_M]
    if not len(chosen) and len(near):
        chosen = near[away[near] <= away[near].min() + 1e-9]
    return tuple(valid[i].name for i in chosen)


def _in_reach(area: Any, waypoint: Waypoint, human: Space, own: Any) -> bool:
    """Return whether nothing but what belongs to the area (`own`) is between a waypoint and the area's border."""
    from shapely import LineString, Point, contains_xy, shortest_line

    line: LineString = shortest_line(Point(waypoint.x, waypoint.y), area)
    steps = np.linspace(0.0, 1.0, max(2, int(line.length / human.frame.resolution * 2) + 1))[:, None]
    ends = np.array(line.coords)
    samples = ends[0] + (ends[1] - ends[0]) * steps
    blocked = samples[human.clearances(samples) == 0.0]
    return bool(contains_xy(own, blocked[:, 0], blocked[:, 1]).all())


def _with_what_stands_on_it(area: Any, objects: Sequence[SolidObject]) -> Any:
    """An area and the objects that cover it, or that it covers, by half or more."""
    from shapely import unary_union

    x0, y0, x1, y1 = area.bounds
    parts = [area]
    for thing in objects:
        xs, ys = [p[0] for p in thing.footprint], [p[1] for p in thing.footprint]
        if max(xs) >= x0 and min(xs) <= x1 and max(ys) >= y0 and min(ys) <= y1:
            footprint = _polygon(thing.footprint, thing.holes)
            if footprint.intersection(area).area >= 0.5 * min(footprint.area, area.area):
                parts.append(footprint)
    return unary_union(parts)


@lru_cache(maxsize=256)
def _polygon(footprint: Polygon, holes: tuple[Polygon, ...]) -> Any:
    import shapely

    return shapely.Polygon(footprint, holes).buffer(0)


def open_share(outline: Sequence[tuple[float, float]], space: Space) -> float:
    """Return the share of an area's cells that is free of obstacles."""
    window, cells = inside_window(outline, space.frame)
    count = int(np.count_nonzero(cells))
    return float(np.count_nonzero(space.field[window][cells] > 0) / count) if count else 0.0


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
    """Return the world with its doors in these states, the others as the world has them; its id stays the same."""
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
    import shapely

    closed = [door for door in world.staged_doors if door.state == "closed"]
    line = shapely.LineString([a, b]) if closed else None
    return next((door for door in closed if shapely.Polygon(door.leaf(0.0)).distance(line) <= clearance_m), None)


LIDAR_HEIGHT_M = 0.21


def build_world(
    *,
    name: str,
    occupancy: OccupancyMap,
    objects: Sequence[SolidObject] = (),
    areas: Sequence[Area] = (),
    routes: Sequence[Route] = (),
    grid_spec: GridSpec | None = None,
    title: str = "",
    lidar_height_m: float = LIDAR_HEIGHT_M,
    activities: Sequence[str] = (),
    description: Description | None = None,
    map_offset: Point = (0.0, 0.0),
    doors: Sequence[Door] = (),
    actors: Sequence[str] = (),
    trolley_work: Mapping[str, bool] | None = None,
) -> World:
    """Lay the grid and give every area without waypoints the ones it is worked from; metres in the world frame.

    The occupancy map lies in the map frame (world = map + `map_offset`). Raises InputError where no grid can be laid.
    """
    spec = grid_spec or GridSpec()
    world = World(
        name=name,
        title=title or name,
        objects=tuple(objects),
        occupancy=occupancy,
        lidar_height_m=lidar_height_m,
        grid=Grid(rows=(), columns=(), waypoints=(), hops=()),
        areas=tuple(areas),
        routes=tuple(routes),
        activities=tuple(activities),
        description=description,
        map_offset=map_offset,
        grid_spec=spec,
        doors=tuple(doors),
        actors=tuple(actors),
        trolley_work=dict(trolley_work or {}),
    )
    human, robot = human_space(world), robot_space(world)
    seeds = [(route.start.x, route.start.y) for route in routes]
    grid = build_grid(spec, human, robot, seeds=seeds, floor=floor_with_open_doors(world))
    filled = list(areas)
    for index, area in enumerate(areas):
        if not area.waypoints:
            worked_from = area_waypoints(area.outline, grid, human, objects=world.objects)
            filled[index] = area.model_copy(update={"waypoints": worked_from})
    return in_same_space(replace(world, grid=grid, areas=tuple(filled)), world)
