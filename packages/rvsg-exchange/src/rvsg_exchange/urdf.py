"""Reader of URDF files: outline of the collision shapes, lidars, speed of the wheels."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPoint, Polygon

from rvsg.core.errors import FileError
from rvsg_exchange.model_files import Element, read_xml

Floats = NDArray[np.float64]

ROOTS = ("base_footprint", "base_link")
SIDES = 16
TALLEST_M = 2.5


@dataclass(frozen=True)
class FromUrdf:
    """A robot file in the making."""

    values: dict[str, Any]
    """Keys of a robot file that the URDF determines."""
    missing: tuple[str, ...]
    """What to add, one sentence each."""


def read_urdf(path: Path) -> FromUrdf:
    """Read a URDF file.

    Shapes are boxes, cylinders and spheres; their outline in the frame of `base_footprint`, or else of `base_link` or
    the root link, becomes the footprint.

    Raises:
        FileError: the file is not a URDF, or still a xacro file.
    """
    root = read_xml(path)
    if root.tag != "robot":
        raise FileError(path, f"expected a URDF file, whose first element is <robot>, got <{root.tag}>")
    if b"<xacro:" in path.read_bytes():
        raise FileError(path, "this is a xacro file; expand it first: xacro robot.urdf.xacro > robot.urdf")
    try:
        return _read(root, path)
    except ValueError as error:
        raise FileError(path, f"a number of the URDF cannot be read: {error}") from None


def _read(root: Element, path: Path) -> FromUrdf:
    poses = _poses(root, path)
    missing: list[str] = []
    values: dict[str, Any] = {
        "name": _name(root.attributes.get("name") or path.stem),
        "source": f"URDF file {path.name}",
    }
    points, meshes = _points(root, poses)
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
    speed = _wheel_speed(root)
    known = {"speed_m_s": speed, "reverse_m_s": speed} if speed else {}
    values["limits"] = {name: round(value, 3) for name, value in known.items()}
    wanted = ("speed_m_s", "reverse_m_s", "yaw_rate_rad_s", "acceleration_m_s2", "deceleration_m_s2")
    absent = [name for name in (*wanted, "yaw_acceleration_rad_s2") if name not in known]
    missing.append(f"limits: a URDF does not say {', '.join(absent)}")
    values["lidars"] = list(_lidars(root, poses))
    if not values["lidars"]:
        missing.append("lidars: no sensor of the type ray, gpu_ray, lidar or gpu_lidar; give at least one")
    missing.append("drive: differential is assumed; say so if it is omnidirectional or ackermann")
    return FromUrdf(values=values, missing=tuple(missing))


def _name(text: str) -> str:
    kept = "".join(c if c.isascii() and (c.isalnum() or c in "_.-") else "_" for c in text)
    return kept if kept[:1].isalnum() else f"robot{kept}"


def _matrix(origin: Element | None) -> Floats:
    """Return the transform of an <origin> element."""
    found = np.eye(4)
    if origin is None:
        return found
    roll, pitch, yaw = _numbers(origin.attributes.get("rpy"), 3)
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    found[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    found[:3, 3] = _numbers(origin.attributes.get("xyz"), 3)
    return found


def _numbers(text: str | None, count: int) -> list[float]:
    values = [float(part) for part in (text or " ".join(["0"] * count)).split()]
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise ValueError(f"expected {count} numbers, got {text!r}")
    return values


def _poses(root: Element, path: Path) -> dict[str, Floats]:
    """Return every link's pose in the frame of the base, all joints at zero."""
    links = {link.attributes.get("name", "") for link in root.all("link")}
    joints = [j for j in root.all("joint") if j.find("parent") is not None and j.find("child") is not None]
    edges: dict[str, list[tuple[str, Floats]]] = {}
    for joint in joints:
        ends = (joint.find("parent"), joint.find("child"))
        parent, child = (end.attributes.get("link", "") for end in ends if end is not None)
        edges.setdefault(parent, []).append((child, _matrix(joint.find("origin"))))
    children = {child for found in edges.values() for child, _ in found}
    base = next((name for name in ROOTS if name in links), next(iter(sorted(links - children)), None))
    if base is None:
        raise FileError(path, "the URDF has no link")
    poses, waiting = {base: np.eye(4)}, [base]
    while waiting:
        at = waiting.pop()
        for child, matrix in edges.get(at, []):
            if child not in poses:
                poses[child] = poses[at] @ matrix
                waiting.append(child)
    return poses


def _points(root: Element, poses: dict[str, Floats]) -> tuple[Floats, set[str]]:
    """Return corner points of all collision shapes in the frame of the base, and the links whose shape is a mesh."""
    found: list[Floats] = []
    meshes: set[str] = set()
    for link in root.all("link"):
        name = link.attributes.get("name", "")
        if name not in poses:
            continue
        for collision in link.all("collision"):
            geometry = collision.find("geometry")
            if geometry is None:
                continue
            if geometry.find("mesh") is not None:
                meshes.add(name)
            matrix = poses[name] @ _matrix(collision.find("origin"))
            found += [(matrix @ np.array([*point, 1.0]))[:3] for point in _corners(geometry)]
    points = np.array(found).reshape(-1, 3)
    return points[points[:, 2] <= TALLEST_M], meshes


def _corners(geometry: Element) -> Iterator[tuple[float, float, float]]:
    box, cylinder, sphere = (geometry.find(kind) for kind in ("box", "cylinder", "sphere"))
    if box is not None:
        x, y, z = (0.5 * size for size in _numbers(box.attributes.get("size"), 3))
        yield from ((i * x, j * y, k * z) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1))
    round_one = cylinder if cylinder is not None else sphere
    if round_one is not None:
        radius = _numbers(round_one.attributes.get("radius"), 1)[0]
        half = 0.5 * _numbers(cylinder.attributes.get("length"), 1)[0] if cylinder is not None else radius
        for k in range(SIDES):
            angle = 2.0 * math.pi * k / SIDES
            yield from ((radius * math.cos(angle), radius * math.sin(angle), z) for z in (-half, half))


def _wheel_speed(root: Element) -> float | None:
    """Return the forward speed that the velocity limits of the wheels' joints allow, m/s; None without limits."""
    radii = {}
    for link in root.all("link"):
        cylinder = _below(link, "collision", "geometry", "cylinder")
        if cylinder is not None:
            radii[link.attributes.get("name", "")] = _numbers(cylinder.attributes.get("radius"), 1)[0]
    speeds = []
    for joint in root.all("joint"):
        limit, child = joint.find("limit"), joint.find("child")
        radius = radii.get(child.attributes.get("link", "")) if child is not None else None
        if (
            joint.attributes.get("type") == "continuous"
            and limit is not None
            and limit.attributes.get("velocity")
            and radius
        ):
            speeds.append(_numbers(limit.attributes.get("velocity"), 1)[0] * radius)
    return min((speed for speed in speeds if speed > 0.0), default=None)


def _lidars(root: Element, poses: dict[str, Floats]) -> Iterator[dict[str, Any]]:
    for block in root.all("gazebo"):
        matrix = poses.get(block.attributes.get("reference", ""))
        for sensor in block.all("sensor"):
            ray = sensor.find("ray") if sensor.find("ray") is not None else sensor.find("lidar")
            horizontal = _below(ray, "scan", "horizontal") if ray is not None else None
            if matrix is None or ray is None or horizontal is None:
                continue
            low, high = (float(horizontal.text_of(key, "0")) for key in ("min_angle", "max_angle"))
            heading = math.atan2(matrix[1, 0], matrix[0, 0])
            yield {
                "name": _name(sensor.attributes.get("name") or block.attributes.get("reference", "lidar")),
                "x": round(float(matrix[0, 3]), 4),
                "y": round(float(matrix[1, 3]), 4),
                "yaw": round(heading + 0.5 * (low + high), 6),
                "height_m": round(max(0.01, float(matrix[2, 3])), 3),
                "field_of_view_rad": round(min(2 * math.pi, high - low), 6),
                "rays": int(float(horizontal.text_of("samples", "360"))),
                "min_range_m": _number(ray, "range", "min", 0.05),
                "max_range_m": _number(ray, "range", "max", 10),
                "rate_hz": float(sensor.text_of("update_rate", "10")),
                "noise_m": _number(ray, "noise", "stddev", 0.01),
            }


def _below(element: Element, *tags: str) -> Element | None:
    """Return the element that a path of tags leads to."""
    found: Element | None = element
    for tag in tags:
        found = found.find(tag) if found is not None else None
    return found


def _number(element: Element, outer: str, inner: str, otherwise: float) -> float:
    found = _below(element, outer, inner)
    return float(found.text) if found is not None else otherwise


def as_sdf_model(root: Element, path: Path) -> Element:
    """Return the SDF `<model>` of a URDF `<robot>`.

    Links become links, placed by the joints that lead to them at their zero position; visual elements, inertia and
    transmissions are left out. Raises FileError for macros (xacro), which have to be expanded first.
    """
    if any(":" in key for key in root.attributes) and _has_macros(root):
        raise FileError(path, "this is a xacro file; expand it first: xacro FILE > room.urdf", line=root.line)
    model = Element("model", {"name": root.attributes.get("name", path.stem)}, root.line)
    joints = {_child(joint): joint for joint in root.all("joint") if _child(joint)}
    for link in root.all("link"):
        name = link.attributes.get("name", "")
        made = Element("link", {"name": name}, link.line)
        joint = joints.get(name)
        if joint is not None:
            parent = joint.find("parent")
            made.children.append(_pose(joint.find("origin"), joint, parent.attributes.get("link") if parent else None))
        for number, collision in enumerate(link.all("collision")):
            made.children.append(_collision(collision, number))
        model.children.append(made)
        if joint is not None and joint.attributes.get("type") != "fixed":
            model.children.append(_joint(joint, name))
    return model


def _has_macros(element: Element) -> bool:
    return element.tag in ("macro", "property", "xacro") or any(_has_macros(child) for child in element.children)


def _child(joint: Element) -> str | None:
    child = joint.find("child")
    return child.attributes.get("link") if child is not None else None


def _pose(origin: Element | None, near: Element, relative_to: str | None = None) -> Element:
    attributes = origin.attributes if origin is not None else {}
    text = f"{attributes.get('xyz', '0 0 0')} {attributes.get('rpy', '0 0 0')}"
    line = origin.line if origin is not None else near.line
    return Element("pose", {"relative_to": relative_to} if relative_to else {}, line, text=text)


def _collision(collision: Element, number: int) -> Element:
    made = Element("collision", {"name": collision.attributes.get("name", f"collision_{number}")}, collision.line)
    made.children.append(_pose(collision.find("origin"), collision))
    geometry = collision.find("geometry")
    if geometry is not None:
        shapes = [_shape(shape) for shape in geometry.children]
        made.children.append(Element("geometry", {}, geometry.line, children=shapes))
    return made


def _joint(joint: Element, child: str) -> Element:
    """Return a joint with its axis and limits; it lies in the frame of its child, as in SDF."""
    axis, limit = joint.find("axis"), joint.find("limit")
    xyz = axis.attributes.get("xyz", "1 0 0") if axis is not None else "1 0 0"
    ends = [] if limit is None else [Element(k, {}, joint.line, text=v) for k, v in limit.attributes.items()]
    parts = [Element("xyz", {}, joint.line, text=xyz), Element("limit", {}, joint.line, children=ends)]
    children = [Element("child", {}, joint.line, text=child), Element("axis", {}, joint.line, children=parts)]
    attributes = {"name": f"joint of {child}", "type": joint.attributes.get("type", "")}
    return Element("joint", attributes, joint.line, children=children)


_NAMES = {"filename": "uri"}


def _shape(shape: Element) -> Element:
    """Return a shape whose attributes have become child elements, as SDF writes them."""
    children = [Element(_NAMES.get(key, key), {}, shape.line, text=value) for key, value in shape.attributes.items()]
    return Element(shape.tag, {}, shape.line, children=children)
