"""What a URDF file says of a robot: outline, lidars, speed of the wheels."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPoint, Polygon

from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError
from rvsg_exchange.model_files import Element, ModelFiles, Problems, read_xml
from rvsg_exchange.sdf_tree import Frames, Model, Placed, SdfTree

Floats = NDArray[np.float64]

ROOTS = ("base_footprint", "base_link")
SIDES = 16
TALLEST_M = 2.5


def read_urdf(path: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the keys of a robot file that a URDF file determines, and what to add, one sentence each.

    The footprint is the outline of boxes, cylinders and spheres in the frame of `base_footprint`, `base_link` or the
    root link. Raises FileError for another file, a xacro file, or with the line of every mistake.
    """
    root = read_xml(path).set_path(path)
    if root.tag != "robot":
        raise FileError(path, f"expected a URDF file, whose first element is <robot>, got <{root.tag}>")
    tree = SdfTree(ModelFiles(path))
    (model,) = tree.read(path)
    base = next((name for name in ROOTS if name in model.links), None)
    if base is None:
        base = next((name for name, link in sorted(model.links.items()) if not link.relative_to), None)
    if base is None:
        raise FileError(path, "the URDF has no link")
    frames = Frames.of(model, tree.problems)
    origin = np.linalg.inv(frames.pose(model.links[base]))
    poses = {n: origin @ frames.pose(link) for n, link in model.links.items() if _is_below(model.links, n, base)}
    points: list[Floats] = [np.empty((0, 3))]
    meshes: set[str] = set()
    for name, pose in poses.items():
        for collision in model.links[name].element.all("collision"):
            geometry = collision.find("geometry")
            if geometry is not None and geometry.find("mesh") is not None:
                meshes.add(name)
            corners = np.array(list(_corners(geometry, tree.problems)) if geometry is not None else [])
            placed = pose @ tree.placed(collision).matrix
            points.append(corners.reshape(-1, 3) @ placed[:3, :3].T + placed[:3, 3])
    lidars = list(_lidars(root, poses, tree.problems))
    speed = _wheel_speed(model, tree.problems)
    if tree.problems:
        raise DocumentError(tree.problems)
    whole = np.concatenate(points)
    return _robot_file(root, path, whole[whole[:, 2] <= TALLEST_M], meshes, lidars, speed)


def _robot_file(
    root: Element, path: Path, points: Floats, meshes: set[str], lidars: list[dict[str, Any]], speed: float | None
) -> tuple[dict[str, Any], tuple[str, ...]]:
    missing: list[str] = []
    values: dict[str, Any] = {
        "name": _name(root.attributes.get("name") or path.stem),
        "source": f"URDF file {path.name}",
    }
    if meshes:
        missing.append(f"footprint: the collision meshes of {', '.join(sorted(meshes))} are not read; check it")
    hull = MultiPoint(points[:, :2]).convex_hull if len(points) else Polygon()
    if isinstance(hull, Polygon) and not hull.is_empty:
        corners = list(hull.simplify(0.002).exterior.coords)[:-1]
        values["footprint"] = [[round(x, 4), round(y, 4)] for x, y in corners]
        values["body_height_m"] = round(float(points[:, 2].max()), 3)
    else:
        missing.append("footprint: no collision shape is a box, a cylinder or a sphere; give its corners")
        missing.append("body_height_m: not in the file")
    known = {"speed_m_s": speed, "reverse_m_s": speed} if speed else {}
    values["limits"] = {name: round(value, 3) for name, value in known.items()}
    wanted = ("speed_m_s", "reverse_m_s", "yaw_rate_rad_s", "acceleration_m_s2", "deceleration_m_s2")
    absent = [name for name in (*wanted, "yaw_acceleration_rad_s2") if name not in known]
    missing.append(f"limits: a URDF does not say {', '.join(absent)}")
    values["lidars"] = lidars
    if not lidars:
        missing.append("lidars: no sensor of the type ray, gpu_ray, lidar or gpu_lidar; give at least one")
    missing.append("drive: differential is assumed; say so if it is omnidirectional or ackermann")
    return values, tuple(missing)


def _name(text: str) -> str:
    kept = "".join(c if c.isascii() and (c.isalnum() or c in "_.-") else "_" for c in text)
    return kept if kept[:1].isalnum() else f"robot{kept}"


def _is_below(links: Mapping[str, Placed], name: str, base: str) -> bool:
    """Return whether joints lead from the base to a link."""
    for _ in links:
        if name == base:
            return True
        name = links[name].relative_to or ""
        if name not in links:
            return False
    return False


def _corners(geometry: Element, problems: Problems) -> Iterator[tuple[float, float, float]]:
    """Yield corner points of a box, cylinder or sphere in its own frame."""
    box, cylinder, sphere = (geometry.find(kind) for kind in ("box", "cylinder", "sphere"))
    if box is not None:
        x, y, z = (0.5 * size for size in problems.numbers_of(box, "size", (0.0, 0.0, 0.0)))
        yield from ((i * x, j * y, k * z) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1))
    round_one = cylinder if cylinder is not None else sphere
    if round_one is not None:
        (radius,) = problems.numbers_of(round_one, "radius", (0.0,))
        length = problems.numbers_of(cylinder, "length", (0.0,))[0] if cylinder else 2 * radius
        for k in range(SIDES):
            angle = 2.0 * math.pi * k / SIDES
            across, along = radius * math.cos(angle), radius * math.sin(angle)
            yield from ((across, along, z) for z in (-0.5 * length, 0.5 * length))


def _wheel_speed(model: Model, problems: Problems) -> float | None:
    """Return the forward speed that the velocity limits of the wheels' joints allow, m/s; None without limits."""
    speeds = []
    for joint in model.element.all("joint"):
        link, limit = model.links.get(joint.text_of("child")), _below(joint, "axis", "limit")
        wheel = _below(link.element, "collision", "geometry", "cylinder") if link is not None else None
        if joint.attributes.get("type") == "continuous" and limit is not None and wheel is not None:
            (velocity,) = problems.numbers_of(limit, "velocity", (0.0,))
            speeds.append(velocity * problems.numbers_of(wheel, "radius", (0.0,))[0])
    return min((speed for speed in speeds if speed > 0.0), default=None)


def _lidars(root: Element, poses: Mapping[str, Floats], problems: Problems) -> Iterator[dict[str, Any]]:
    def number(element: Element | None, otherwise: float, *tags: str) -> float:
        found = _below(element, *tags) if element is not None else None
        return problems.numbers(found, 1)[0] if found is not None else otherwise

    for block in root.all("gazebo"):
        matrix = poses.get(block.attributes.get("reference", ""))
        for sensor in block.all("sensor"):
            ray = sensor.find("ray") or sensor.find("lidar")
            horizontal = _below(ray, "scan", "horizontal") if ray is not None else None
            if matrix is None or horizontal is None:
                continue
            low, high = (number(horizontal, 0.0, key) for key in ("min_angle", "max_angle"))
            heading = math.atan2(matrix[1, 0], matrix[0, 0])
            yield {
                "name": _name(sensor.attributes.get("name") or block.attributes.get("reference", "lidar")),
                "x": round(float(matrix[0, 3]), 4),
                "y": round(float(matrix[1, 3]), 4),
                "yaw": round(heading + 0.5 * (low + high), 6),
                "height_m": round(max(0.01, float(matrix[2, 3])), 3),
                "field_of_view_rad": round(min(2 * math.pi, high - low), 6),
                "rays": int(number(horizontal, 360, "samples")),
                "min_range_m": number(ray, 0.05, "range", "min"),
                "max_range_m": number(ray, 10, "range", "max"),
                "rate_hz": number(sensor, 10.0, "update_rate"),
                "noise_m": number(ray, 0.01, "noise", "stddev"),
            }


def _below(element: Element | None, *tags: str) -> Element | None:
    """Return the element that a path of tags leads to."""
    for tag in tags:
        element = element.find(tag) if element is not None else None
    return element
