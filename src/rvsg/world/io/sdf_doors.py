"""Doors among the joints of an SDF file: leaves that are hinged upright or slide along themselves in a wall."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.world.doors import WIDTHS_M, Door, Point
from rvsg.world.io.mesh import Triangles
from rvsg.world.io.safe_xml import Element
from rvsg.world.io.sdf_frames import Frames, Matrix, Model
from rvsg.world.world import SolidObject

LOWEST_M, SHORTEST_M = 0.3, 1.4
"""A leaf begins at most this high above the floor, and is at least so high."""
THICKEST_M = 0.25
THIN = 0.35
"""A leaf is at most this share of its width thick."""
ALONG = 0.9
"""The cosine of the angle within which an axis counts as upright, or as along the leaf."""
AT_END = 0.3
"""The hinge of a leaf is at most this share of its width away from its end; in the middle, it is a turnstile."""
TURN_RAD = math.radians(30.0)
SLIDE = 0.5
"""A sliding leaf moves by at least this share of its width."""
WALL_M = 0.3
"""The wall or the frame is this near to the end at which a leaf is held."""
ROOM_M = 0.4
"""This far to both sides of a leaf is open floor; a cupboard has its inside on one."""


@dataclass(frozen=True)
class Leaf:
    """A link that may be the leaf of a door."""

    door: Door
    surface: Triangles
    model: str
    kind: str
    pose: Matrix


def leaves_of(
    model: Model, frames: Frames, pose: Matrix, surfaces: dict[str, Triangles], name: str, kind: str
) -> dict[str, Leaf]:
    """Return the links of a model that look like leaves, by name.

    Args:
        pose: The model's pose above the floor.
        surfaces: The collision surface of every link, above the floor.
    """
    if model.element.text_of("static").lower() in ("true", "1"):
        return {}
    found = {}
    for joint in model.element.all("joint"):
        child = joint.text_of("child").rpartition("::")[2]
        if child not in surfaces or joint.attributes.get("type") not in ("revolute", "continuous", "prismatic"):
            continue
        placed = model.frames[joint.attributes.get("name", "")]
        at = pose @ frames.pose(placed)
        door = _door(joint, at, pose, surfaces[child], name)
        if door is not None:
            found[child] = Leaf(door, surfaces[child], name, kind, pose)
    if len(found) > 1:
        found = {
            link: Leaf(leaf.door.model_copy(update={"name": f"{name} {link}"}), leaf.surface, name, kind, pose)
            for link, leaf in found.items()
        }
    return found


def _door(joint: Element, at: Matrix, model: Matrix, surface: Triangles, name: str) -> Door | None:
    """Return the door whose leaf a joint moves; None where it looks like something else."""
    ends = _ends(surface.vertices)
    if ends is None:
        return None
    a, b, thickness = ends
    axis, low, high = _axis(joint, at, model)
    width = math.dist(a, b)
    far = high if abs(high) >= abs(low) else low
    same = {"name": name, "thickness_m": round(max(thickness, 0.01), 3)}
    if joint.attributes.get("type") == "prismatic":
        along = float(np.dot(axis[:2], np.subtract(b, a))) / width * (1.0 if far >= 0 else -1.0)
        if abs(along) < ALONG or abs(far) < SLIDE * width:
            return None
        hinge, end = (b, a) if along > 0 else (a, b)
        return Door(hinge=hinge, end=end, kind="sliding", **same)
    anchor = (float(at[0, 3]), float(at[1, 3]))
    hinge, end = sorted((a, b), key=lambda point: math.dist(point, anchor))
    if abs(axis[2]) < ALONG or math.dist(hinge, anchor) > max(AT_END * width, 2 * thickness) or abs(far) < TURN_RAD:
        return None
    return Door(hinge=hinge, end=end, kind="swing", turns="left" if far * axis[2] > 0 else "right", **same)


def _ends(vertices: NDArray[np.float64]) -> tuple[Point, Point, float] | None:
    """Return the ends of a leaf's middle line and its thickness, metres; None where it is no upright leaf."""
    from shapely import MultiPoint, get_coordinates, oriented_envelope

    low, high = float(vertices[:, 2].min()), float(vertices[:, 2].max())
    if low > LOWEST_M or high - max(low, 0.0) < SHORTEST_M:
        return None
    corners = get_coordinates(oriented_envelope(MultiPoint(vertices[:, :2])))[:4]
    if len(corners) < 4:
        return None
    sides = [math.dist(corners[i], corners[i + 1]) for i in (0, 1)]
    first = 0 if sides[0] <= sides[1] else 1  # the two short sides, whose middles are the ends
    thickness, width = sides[first], sides[1 - first]
    if not WIDTHS_M[0] <= width <= WIDTHS_M[1] or thickness > min(THICKEST_M, THIN * width):
        return None
    middles = [(corners[i] + corners[(i + 1) % 4]) / 2 for i in (first, first + 2)]
    a, b = ((round(float(x), 3), round(float(y), 3)) for x, y in middles)
    return a, b, thickness


def _axis(joint: Element, at: Matrix, model: Matrix) -> tuple[NDArray[np.float64], float, float]:
    """Return the axis of a joint in the world and its limits; without limits it moves without end."""
    element = joint.find("axis")
    xyz = element.find("xyz") if element is not None else None
    numbers = [float(v) for v in xyz.text.split()] if xyz is not None and _are_numbers(xyz.text, 3) else [0.0, 0.0, 1.0]
    in_model = element is not None and element.text_of("use_parent_model_frame").lower() in ("true", "1")
    if xyz is not None and xyz.attributes.get("expressed_in") == "__model__":
        in_model = True
    direction = (model if in_model else at)[:3, :3] @ np.array(numbers)
    limit = element.find("limit") if element is not None else None
    lower, upper = (limit.text_of(key) if limit is not None else "" for key in ("lower", "upper"))
    low, high = (float(text) if _are_numbers(text, 1) else usual for text, usual in ((lower, -99.0), (upper, 99.0)))
    return direction / max(float(np.linalg.norm(direction)), 1e-12), low, high


def _are_numbers(text: str, count: int) -> bool:
    try:
        values = [float(v) for v in text.split()]
    except ValueError:
        return False
    return len(values) == count and all(math.isfinite(v) for v in values)


def in_walls(leaves: Sequence[Leaf], solids: Sequence[SolidObject]) -> list[Leaf]:
    """Return the leaves that are held by something solid and have open floor on both sides."""
    from shapely import Point as At
    from shapely import Polygon, STRtree

    shapes = [Polygon(thing.footprint, thing.holes).buffer(0) for thing in solids]
    tree = STRtree(shapes)

    def near(at: Point, reach_m: float) -> Any:
        return tree.query(At(at), predicate="dwithin", distance=reach_m)

    found = []
    for leaf in leaves:
        door = leaf.door
        (x, y), (hx, hy), (ex, ey) = door.middle, door.hinge, door.end
        out = door.thickness_m / 2 + ROOM_M
        across = (-(ey - hy) / door.width_m * out, (ex - hx) / door.width_m * out)
        sides = [(x + sign * across[0], y + sign * across[1]) for sign in (1.0, -1.0)]
        if len(near(door.hinge, WALL_M)) and not any(len(near(side, 0.0)) for side in sides):
            found.append(leaf)
    return found
