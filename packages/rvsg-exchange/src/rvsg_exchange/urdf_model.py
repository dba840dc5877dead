"""URDF robots as SDF models."""

from __future__ import annotations

from pathlib import Path

from rvsg.core.errors import FileError
from rvsg_exchange.model_files import Element


def as_sdf_model(root: Element, path: Path) -> Element:
    """Return the SDF `<model>` of a URDF `<robot>` at the zero position of its joints; FileError for macros (xacro)."""
    if b"<xacro:" in path.read_bytes():
        message = "this is a xacro file; expand it first: xacro robot.urdf.xacro > robot.urdf"
        raise FileError(path, message, line=root.line)
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
