"""What is wrong or suspicious in the map and the grid of a world: floor, aisles and hops that people cannot walk."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.world.authoring.remarks import Subject, listed_names
from rvsg.world.authoring.trial import Trial
from rvsg.world.passages import free_widths_m
from rvsg.world.raster import outermost
from rvsg.world.route_words import nearest_area
from rvsg.world.space import Space, main_floor, world_map
from rvsg.world.world import Area

AISLE_WIDEST_M = 3.0
AISLE_LENGTH_M = 1.5
AISLE_SAMPLES = 9  # points at which an aisle's width is measured
PART_M2 = 2.0
MANY_WAYPOINTS = 1000
MOST_OF_A_KIND = 12


def walk_hops(s: Subject, trial: Trial) -> None:
    """Walk every hop, and say on which a person does not arrive in time."""
    hops = s.world.grid.hops
    blocked = trial.not_walked(s.world, [*hops, *((b, a) for a, b in hops)])
    pairs = sorted({(min(hop), max(hop)) for hop in blocked})
    if pairs:
        listed = ", ".join(f"{a} to {b}" for a, b in pairs[:MOST_OF_A_KIND])
        more = f" and {len(pairs) - MOST_OF_A_KIND} more" if len(pairs) > MOST_OF_A_KIND else ""
        message = (
            f"a person who walks alone does not get from {listed}{more} in time, although the line between the "
            "waypoints is free. A larger human_clearance_m leaves such a hop out"
        )
        s.say(s.head, "grid-hop-blocked", message, "grid")


def reachable_parts(s: Subject) -> list[set[str]]:
    """Return the waypoints in groups between which people can walk, the largest first."""
    neighbours = s.world.grid.neighbours
    left = set(neighbours)
    parts = []
    for name in neighbours:
        if name not in left:
            continue
        part, stack = {name}, [name]
        while stack:
            for other in neighbours[stack.pop()]:
                if other not in part:
                    part.add(other)
                    stack.append(other)
        left -= part
        parts.append(part)
    return sorted(parts, key=lambda part: (-len(part), min(part)))


def check_parts(s: Subject, parts: list[set[str]]) -> None:
    """Say which waypoints cannot be walked to from the others."""
    for part in parts[1 : 1 + MOST_OF_A_KIND]:
        message = (
            f"waypoint{'s' * (len(part) > 1)} {listed_names(sorted(part))} cannot be walked to from the other "
            f"{len(parts[0])}: an isolated part of the map, or the grid is too coarse for the way there"
        )
        s.say(s.head, "grid-isolated", message, "grid")
    if len(parts) > 1 + MOST_OF_A_KIND:
        s.say(
            s.head, "grid-isolated", f"and {len(parts) - 1 - MOST_OF_A_KIND} more isolated groups of waypoints", "grid"
        )


def check_isolated_floor(s: Subject) -> None:
    """Floor that nobody can walk to from the main part."""
    parts = s.human.parts(min(s.spec.human_clearance_m, s.spec.hop_radius_m))
    sizes = np.bincount(parts.ravel()) * s.human.frame.resolution**2
    for number in [n for n in range(2, len(sizes)) if sizes[n] >= PART_M2][:MOST_OF_A_KIND]:
        rows, columns = np.nonzero(parts == number)
        middle = len(rows) // 2
        x, y = s.human.frame.to_metres(np.array([columns[middle] + 0.5, rows[middle] + 0.5]))
        message = (
            f"{sizes[number]:.0f} m² of floor about ({x:.1f}, {y:.1f}) are cut off from the rest: people cannot "
            "walk there" + (", and it holds no waypoint" if not s.spec.isolated_parts else "")
        )
        s.say(s.head, "floor-isolated", message, "map")


def check_aisles(s: Subject) -> None:
    """Say which aisles and which open floor the grid misses."""
    from shapely import Point

    named = list(_narrow_aisles(s))
    for first, second, width in named:
        message = (
            f"no waypoint lies in the aisle between {first} and {second} ({width:.1f} m wide): the grid is too "
            f"coarse for it. A spacing of {max(0.3, math.floor(width * 5) / 10):g} m, another origin, or rows and "
            "columns of your own would reach it"
        )
        s.say(s.head, "aisle-missed", message, "grid")
    covered = [_strip(s, first, second) for first, second, _ in named]
    for x, y, size in _unreached_floor(s):
        if any(strip.distance(Point(x, y)) < 0.5 for strip in covered):
            continue
        area, away = nearest_area(s.world.areas, x, y)
        near = f" near {area.name}" if area is not None and away < 5.0 else ""
        message = f"{size:.0f} m² of open floor about ({x:.1f}, {y:.1f}){near} hold no waypoint"
        s.say(s.head, "floor-missed", message, "grid")


def _strip(s: Subject, first: str, second: str) -> Any:
    """Return the floor between two areas."""
    both = s.shapes[first].union(s.shapes[second])
    return both.convex_hull.difference(both)


def _narrow_aisles(s: Subject) -> Iterator[tuple[str, str, float]]:
    from shapely import contains_xy, points

    things = [a.name for a in s.world.areas if not _is_floor(s, a)]
    valid = np.array([[w.x, w.y] for w in s.world.grid.waypoints if w.human]).reshape(-1, 2)
    for first, second in combinations(things, 2):
        a, b = s.shapes[first], s.shapes[second]
        width = float(a.distance(b))
        if not 2 * s.spec.human_clearance_m <= width <= AISLE_WIDEST_M:
            continue
        strip = _strip(s, first, second)
        length = float(strip.area) / width
        if length < AISLE_LENGTH_M or any(
            strip.intersection(s.shapes[other]).area > 0.1 * strip.area
            for other in things
            if other not in (first, second)
        ):
            continue
        x0, y0, x1, y1 = strip.bounds
        samples = np.stack(np.meshgrid(np.arange(x0, x1, 0.1), np.arange(y0, y1, 0.1)), -1).reshape(-1, 2)
        samples = samples[contains_xy(strip, samples[:, 0], samples[:, 1])]
        if len(samples) == 0 or (s.human.clearances(samples) > 0).mean() < 0.7:
            continue
        width = _free_width_m(s, samples)
        if not 2 * s.spec.human_clearance_m <= width <= AISLE_WIDEST_M:
            continue
        if not len(valid) or not (strip.buffer(0.05).contains(points(valid))).any():
            yield first, second, width


def _free_width_m(s: Subject, samples: NDArray[np.float64]) -> float:
    """Return the width from wall to wall of an aisle given by points in it (N, 2); labels may end before walls."""
    clear = s.human.clearances(samples)
    middle = samples[clear >= np.quantile(clear, 0.8)]
    chosen = middle[:: max(1, len(middle) // AISLE_SAMPLES)]
    return float(np.median(free_widths_m(s.world, chosen)))


def _is_floor(s: Subject, area: Area) -> bool:
    from rvsg.world.lattice import open_share

    return open_share(area.outline, s.human) > 0.5


def _unreached_floor(s: Subject) -> list[tuple[float, float, float]]:
    """Middle (x, y) and size in m² of open floor farther from every waypoint than the grid is wide."""
    from scipy.ndimage import binary_opening, label

    space = _coarser(s.human)
    walkable = main_floor(space, s.spec.human_clearance_m)
    away = _distance_to_waypoints(s, space)
    missed = walkable & (away > 1.2 * max(s.world.grid.spacing_m, 0.5))
    missed = binary_opening(missed, np.ones((3, 3)))
    parts, count = label(missed)
    found = []
    for number in range(1, count + 1):
        rows, columns = np.nonzero(parts == number)
        size = len(rows) * space.frame.resolution**2
        if size >= PART_M2:
            middle = len(rows) // 2
            x, y = space.frame.to_metres(np.array([columns[middle] + 0.5, rows[middle] + 0.5]))
            found.append((float(x), float(y), size))
    return sorted(found, key=lambda part: -part[2])[:MOST_OF_A_KIND]


def _distance_to_waypoints(s: Subject, space: Space) -> NDArray[np.float64]:
    from scipy.ndimage import distance_transform_edt

    rows, columns = space.frame.shape
    none = np.ones((rows, columns), np.bool_)
    points = np.array([[w.x, w.y] for w in s.world.grid.waypoints if w.human])
    at = np.floor(space.frame.to_cells(points)).astype(int)
    none[np.clip(at[:, 1], 0, rows - 1), np.clip(at[:, 0], 0, columns - 1)] = False
    return np.asarray(distance_transform_edt(none)) * space.frame.resolution


def check_unknown(s: Subject) -> None:
    """Say so if much of the map around the floor is unknown."""
    cells = world_map(s.world).cells
    free = outermost(cells == 0)
    (left, low), (right, high) = free.min(axis=0), free.max(axis=0) + 1
    within = cells[low:high, left:right]
    unknown = float((within == 255).mean())
    if unknown > 0.3:
        message = (
            f"{unknown:.0%} of the map around the free space is unknown; unknown space counts as closed for people "
            "and robot"
        )
        s.say(s.head, "map-unknown", message, "map")


def check_size(s: Subject) -> None:
    """Say so if there are more waypoints than a picture shows."""
    count = len(s.world.grid.valid)
    if count > MANY_WAYPOINTS:
        message = f"the grid has {count} valid waypoints; a VLM reads a picture of some hundred. Use a coarser one"
        s.say(s.head, "grid-large", message, "grid")


def _coarser(space: Space) -> Space:
    """Return the space in cells of at least 0.1 m and at most a million of them, each as clear as its clearest cell."""
    from rvsg.world.raster import Frame

    rows, columns = space.field.shape
    step = max(1, round(0.1 / space.frame.resolution), math.ceil(math.sqrt(rows * columns / 1e6)))
    high, wide = rows // step, columns // step
    if step == 1 or not (high and wide):
        return space
    field = space.field[: high * step, : wide * step].reshape(high, step, wide, step).max(axis=(1, 3))
    return Space(Frame(space.frame.origin, space.frame.resolution * step, (high, wide)), field)
