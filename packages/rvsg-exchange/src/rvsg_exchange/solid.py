"""Solid objects from a surface: the part that the lidar plane cuts, the part that stops a person, and the box round it.

A closed and consistently oriented surface is filled where it winds about a place, so that walls may meet, overlap and
share faces; any other by the even-odd rule. Numbers in metres, world frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from rvsg.world.world import OrientedBox, Polygon, SolidObject
from rvsg_exchange.mesh import Floats, Triangles

FLOOR_M = 0.05  # what ends below is floor
HEAD_M = 2.0  # what begins above lets a person pass
SHEET_M = 0.01  # thickness given to an open surface, so that the lidar sees it
MANY_FACES = 20_000
SQUARE_M = 0.05
ROOM_M2 = 20.0  # a surface this large that is open at the top is a room, not a container
FLOOR_M2 = 4.0  # a hole this large in a footprint is floor
SAMPLES = 24
STEEP = 0.5  # a face that leans more than 60 degrees is a wall
_WELD_M = 1e-5
_GRID_M = 1e-6


def solid_objects(
    name: str, kind: str, pose: Floats, surface: Triangles, *, lidar_height_m: float
) -> tuple[SolidObject, ...]:
    """Return the solid objects of one model; none where all of it is floor or hangs above people.

    Parts that stand far apart become objects of their own, "name 1", "name 2", ... `pose` is 4 x 4, all in the world.
    """
    low, high = float(surface.vertices[:, 2].min()), float(surface.vertices[:, 2].max())
    if high <= FLOOR_M or low >= HEAD_M:
        return ()
    bodies = connected(surface)
    if not bodies:
        return ()  # smaller than the accuracy of the import
    footprint = _footprint(bodies, max(low, FLOOR_M), min(high, HEAD_M))
    sliced = cut(bodies, lidar_height_m)
    yaw = math.atan2(pose[1, 0], pose[0, 0])
    yaw = 0.0 if abs(yaw) < 1e-12 else yaw
    origin = (float(pose[0, 3]), float(pose[1, 3]), float(pose[2, 3]))
    parts = _standing_apart(footprint)
    found = []
    for number, part in enumerate(parts, start=1):
        whole = len(parts) == 1
        near = part.buffer(0.02, join_style="mitre")
        chosen = surface.vertices if whole else _vertices_within(surface.vertices, near)
        slices = sliced if whole else shapely.intersection(sliced, near)
        found.append(
            SolidObject(
                name=name if whole else f"{name} {number}",
                kind=kind,
                origin=origin,
                box=bounding_box(chosen, yaw),
                footprint=ring(part.exterior),
                holes=tuple(ring(hole) for hole in part.interiors),
                slices=rings(slices),
            )
        )
    return tuple(found)


def overhead(surface: Triangles) -> Floats:
    """Return the faces of a surface that hang over people's heads and are no walls, seen from above (n, 3, 2)."""
    corners = surface.vertices[surface.faces]
    corners = corners[(corners[..., 2] >= HEAD_M - 1e-6).all(axis=1)]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = np.abs(across[:, 2]) > np.maximum(STEEP * np.linalg.norm(across, axis=1), 1e-6)
    seen: Floats = corners[flat][..., :2]
    return seen


def connected(surface: Triangles) -> list[Triangles]:
    """Return the surface's connected parts, their vertices welded where they lie within a hundredth of a millimetre."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    keys = np.round(surface.vertices / _WELD_M).astype(np.int64)
    _, first, index = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    vertices = surface.vertices[first]
    faces = index.reshape(-1)[surface.faces]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])]
    a = np.concatenate([faces[:, 0], faces[:, 1]])
    b = np.concatenate([faces[:, 1], faces[:, 2]])
    graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(len(vertices), len(vertices)))
    _, label = connected_components(graph, directed=False)
    of_face = label[faces[:, 0]]
    order = np.argsort(of_face, kind="stable")
    borders = np.flatnonzero(np.diff(of_face[order])) + 1
    return [Triangles(vertices=vertices, faces=part) for part in np.split(faces[order], borders) if len(part)]


def cut(bodies: Sequence[Triangles], height: float) -> Any:
    """Return the region that the bodies fill at a height; a large body open at the top is a room of thin walls."""
    solid: list[Any] = []
    hollow: list[Any] = []
    for body in bodies:
        region = _cut_one(body, height)
        if region is None:
            continue
        if region.area > ROOM_M2 and _is_open_above(body, region, height):
            solid.append(region.boundary.buffer(SHEET_M / 2))
        else:
            (hollow if body.volume < -1e-9 else solid).append(region)
    if not solid:
        solid, hollow = hollow, []
    if not solid:
        return shapely.Polygon()
    filled = shapely.union_all(solid, grid_size=_GRID_M)
    return shapely.difference(filled, shapely.union_all(hollow)) if hollow else filled


def _is_open_above(body: Triangles, region: Any, height: float) -> bool:
    """Return whether most of a region has no face of the body above it."""
    x0, y0, x1, y1 = region.bounds
    grid = np.stack(np.meshgrid(np.linspace(x0, x1, SAMPLES), np.linspace(y0, y1, SAMPLES)), -1).reshape(-1, 2)
    inside = grid[shapely.contains_xy(region, grid[:, 0], grid[:, 1])]
    if not len(inside):
        return False
    corners = body.vertices[body.faces]
    above = corners[(corners[..., 2] > height + _GRID_M).all(axis=1)][..., :2]
    flat = shapely.polygons(above)
    flat = flat[shapely.area(flat) > 1e-8]
    if not len(flat):
        return True
    covered = np.unique(shapely.STRtree(flat).query(shapely.points(inside), predicate="intersects")[0])
    return bool(len(covered) < 0.5 * len(inside))


def _cut_one(body: Triangles, height: float) -> Any | None:
    segments = _segments(body, height)
    if not len(segments):
        return None
    lines = shapely.union_all(_chains(segments), grid_size=_GRID_M)
    faces, cuts, dangles, _ = shapely.polygonize_full(shapely.get_parts(lines))
    is_inside, edges = (_wound, segments) if body.is_oriented else (_odd, _edges(lines))
    inside = [face for face in shapely.get_parts(faces) if is_inside(face, edges)]
    if not inside and is_inside is _wound:  # a sheet whose faces are there from both sides
        edges = _edges(lines)
        inside = [face for face in shapely.get_parts(faces) if _odd(face, edges)]
    open_lines = [g for g in (cuts, dangles) if not g.is_empty]
    inside += [line.buffer(SHEET_M / 2, cap_style="flat") for line in open_lines]
    return shapely.union_all(inside) if inside else None


def _chains(segments: Floats) -> Any:
    """Return segments (K, 2, 2) as lines without straight corners: a wall of thousands of small faces is one piece."""
    ends = np.round(segments / _GRID_M).astype(np.int64)
    swapped = (ends[:, 0] > ends[:, 1])[:, 0] | ((ends[:, 0, 0] == ends[:, 1, 0]) & (ends[:, 0, 1] > ends[:, 1, 1]))
    ends[swapped] = ends[swapped, ::-1]
    pieces = shapely.linestrings(np.unique(ends.reshape(-1, 4), axis=0).reshape(-1, 2, 2) * _GRID_M)
    return shapely.simplify(shapely.get_parts(shapely.line_merge(shapely.multilinestrings(pieces))), _GRID_M)


def _edges(lines: Any) -> Floats:
    """Return all straight pieces of some lines as (K, 2, 2)."""
    points, line = shapely.get_coordinates(shapely.get_parts(lines), return_index=True)
    joined = line[:-1] == line[1:]
    return np.stack([points[:-1][joined], points[1:][joined]], axis=1)


def _odd(face: Any, edges: Floats) -> bool:
    """Return whether a ray from inside the face to the right crosses the edges (K, 2, 2) an odd number of times."""
    point = face.representative_point()
    crossing = edges[(edges[:, 0, 1] > point.y) != (edges[:, 1, 1] > point.y)]
    (x0, y0), (x1, y1) = crossing[:, 0].T, crossing[:, 1].T
    return bool(np.count_nonzero(x0 + (point.y - y0) / (y1 - y0) * (x1 - x0) > point.x) % 2)


def _wound(face: Any, segments: Floats) -> bool:
    """Return whether segments (K, 2, 2) with their inside on the left wind about the inside of a face."""
    point = face.representative_point()
    low, high = segments[:, 0, 1] > point.y, segments[:, 1, 1] > point.y
    crossing = segments[low != high]
    (x0, y0), (x1, y1) = crossing[:, 0].T, crossing[:, 1].T
    right = x0 + (point.y - y0) / (y1 - y0) * (x1 - x0) > point.x
    return bool(np.sign(y1 - y0)[right].sum() != 0)


def _segments(body: Triangles, height: float) -> Any:
    """Return where the faces cross a height, (K, 2, 2) with the inside on their left; a shared edge gives one point."""
    z = body.vertices[:, 2]
    above = z[body.faces] > height
    count = above.sum(axis=1)
    faces = body.faces[(count == 1) | (count == 2)]
    if not len(faces):
        return np.empty((0, 2, 2))
    above = z[faces] > height
    lone = np.where((above.sum(axis=1) == 1)[:, None], above, ~above).argmax(axis=1)
    row = np.arange(len(faces))
    tip, left, right = faces[row, lone], faces[row, (lone + 1) % 3], faces[row, (lone + 2) % 3]
    ends = []
    for other in (left, right):
        a, b = np.minimum(tip, other), np.maximum(tip, other)
        share = ((height - z[a]) / (z[b] - z[a]))[:, None]
        ends.append(body.vertices[a, :2] * (1.0 - share) + body.vertices[b, :2] * share)
    segments = np.stack(ends, axis=1)
    below = ~above[row, lone]
    segments[below] = segments[below, ::-1]
    longer: NDArray[np.bool_] = np.abs(segments[:, 0] - segments[:, 1]).max(axis=1) > _GRID_M
    return segments[longer]


def _footprint(bodies: Sequence[Triangles], low: float, high: float) -> Any:
    """What the bodies fill between two heights, seen from above: cuts between the vertices' heights, and faces."""
    z = np.unique(np.concatenate([body.vertices[np.unique(body.faces), 2] for body in bodies]).round(3))
    levels = np.concatenate([[low], z[(z > low + 1e-3) & (z < high - 1e-3)], [high]])
    if len(levels) > 25:
        levels = np.linspace(low, high, 21)
    regions = [cut(bodies, float(height)) for height in (levels[:-1] + levels[1:]) / 2.0]
    regions.append(_seen_from_above(bodies, low, high))
    whole = shapely.union_all([shapely.make_valid(r) for r in regions], grid_size=_GRID_M)
    closed = whole.buffer(0.01, join_style="mitre").buffer(-0.01, join_style="mitre")
    areas = [part for part in shapely.get_parts(closed) if part.geom_type == "Polygon" and part.area > 1e-4]
    if not areas:
        areas = list(shapely.get_parts(whole.buffer(SHEET_M / 2)))
    return shapely.union_all([part.simplify(0.002) for part in areas])


def _seen_from_above(bodies: Sequence[Triangles], low: float, high: float) -> Any:
    """Return the faces that lie wholly between two heights, seen from above; very many of them as 5 cm squares."""
    corners = np.concatenate([body.vertices[body.faces] for body in bodies])
    corners = corners[((corners[..., 2] >= low) & (corners[..., 2] <= high)).all(axis=1)][..., :2]
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    corners = corners[np.abs(ax * by - ay * bx) > 2e-8]  # the cuts show the upright faces
    if len(corners) <= MANY_FACES:
        return shapely.union_all(shapely.make_valid(shapely.polygons(corners)))
    points = np.concatenate([corners.reshape(-1, 2), corners.mean(axis=1)])
    cells = np.unique(np.floor(points / SQUARE_M).astype(np.int64), axis=0) * SQUARE_M
    return shapely.union_all(shapely.box(cells[:, 0], cells[:, 1], cells[:, 0] + SQUARE_M, cells[:, 1] + SQUARE_M))


def _standing_apart(footprint: Any) -> list[Any]:
    """The footprint as one polygon (a table's legs become its outline) or, where it is spread wide, its parts."""
    parts = [part for part in shapely.get_parts(footprint) if part.geom_type == "Polygon" and not part.is_empty]
    if len(parts) <= 1:
        return parts
    if any(shapely.Polygon(hole).area >= FLOOR_M2 for part in parts for hole in part.interiors):
        return sorted(parts, key=lambda part: part.bounds)  # a room and what stands in it
    hull = shapely.union_all(parts).convex_hull
    if hull.area <= 6.0 or sum(part.area for part in parts) >= 0.25 * hull.area:
        return [hull]
    return sorted(parts, key=lambda part: part.bounds)


def _vertices_within(vertices: Floats, region: Any) -> Floats:
    chosen: Floats = vertices[shapely.contains_xy(region, vertices[:, 0], vertices[:, 1])]
    if len(chosen):
        return chosen
    corners = shapely.get_coordinates(region)
    ends = vertices[:, 2].min(), vertices[:, 2].max()
    return np.concatenate([np.column_stack([corners, np.full(len(corners), z)]) for z in ends])


def bounding_box(vertices: Floats, yaw: float) -> OrientedBox:
    """Return the box turned by `yaw` that holds the vertices (N, 3)."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    u = cos * vertices[:, 0] + sin * vertices[:, 1]
    v = cos * vertices[:, 1] - sin * vertices[:, 0]
    z = vertices[:, 2]
    mu, mv, mz = ((float(a.min()) + float(a.max())) / 2.0 for a in (u, v, z))
    return OrientedBox(
        center=(cos * mu - sin * mv, sin * mu + cos * mv, mz),
        size=(float(np.ptp(u)), float(np.ptp(v)), float(np.ptp(z))),
        yaw=yaw,
    )


def ring(line: Any) -> Polygon:
    """Return the corners of a closed shapely ring, the last not repeated, rounded to a hundredth of a millimetre."""
    return tuple((round(float(x), 5), round(float(y), 5)) for x, y in shapely.get_coordinates(line)[:-1])


def rings(region: Any) -> tuple[Polygon, ...]:
    """Return all rings of a region; filled by the even-odd rule they give it back. Straight corners are dropped."""
    found = []
    for part in shapely.get_parts(region):
        if part.geom_type != "Polygon" or part.area < 1e-7:
            continue
        tidy = part.simplify(1e-5)
        found += [ring(tidy.exterior), *(ring(hole) for hole in tidy.interiors)]
    return tuple(sorted(found))
