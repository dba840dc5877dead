"""A Gazebo world (SDF): the solid objects of a world as static models, and the people of a run as scripted actors."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import shapely

from rvsg.core.errors import InputError
from rvsg.simulation.run import Run
from rvsg.world.world import Polygon, SolidObject, World

VERSION = "1.7"
"""Read by Gazebo Classic 11 and by Gazebo Fortress and later."""

ACTOR_STEP_S = 0.5
SKIN = "https://fuel.gazebosim.org/1.0/Mingfei/models/actor/tip/files/meshes/walk.dae"


def world_sdf(world: World, run: Run | None = None, *, skin: str = SKIN) -> str:
    """Return a world as SDF.

    Args:
        world: its solid objects become static models, extruded from the floor to their height.
        run: its people become actors that repeat what they did in the run, on the run's clock; None: no people.
        skin: the file of the actors' mesh and walking animation; a `walk.dae` of Gazebo Classic or a Fuel address.
    """
    sdf = ET.Element("sdf", version=VERSION)
    root = ET.SubElement(sdf, "world", name=world.name)
    light = ET.SubElement(root, "light", name="sun", type="directional")
    _text(light, "pose", "0 0 10 0 0 0")
    _text(light, "direction", "-0.5 0.1 -0.9")
    ground = ET.SubElement(root, "model", name="ground_plane")
    _text(ground, "static", "true")
    link = ET.SubElement(ground, "link", name="link")
    for kind in ("collision", "visual"):
        plane = ET.SubElement(ET.SubElement(ET.SubElement(link, kind, name=kind), "geometry"), "plane")
        _text(plane, "normal", "0 0 1")
        _text(plane, "size", "100 100")
    for thing in world.solids:
        _model(root, thing)
    if run is not None:
        for index in range(len(run.human_names)):
            _actor(root, run, index, skin)
    ET.indent(sdf)
    return '<?xml version="1.0"?>\n' + ET.tostring(sdf, encoding="unicode") + "\n"


def _model(root: ET.Element, thing: SolidObject) -> None:
    model = ET.SubElement(root, "model", name=thing.name)
    _text(model, "static", "true")
    link = ET.SubElement(model, "link", name="link")
    bottom = thing.box.center[2] - thing.box.size[2] / 2
    _text(link, "pose", f"0 0 {max(0.0, bottom):.6g} 0 0 0")
    for number, ring in enumerate(_rings(thing)):
        for kind in ("collision", "visual"):
            name = kind if number == 0 else f"{kind}_{number}"
            polyline = ET.SubElement(ET.SubElement(ET.SubElement(link, kind, name=name), "geometry"), "polyline")
            for x, y in ring:
                _text(polyline, "point", f"{x:.6g} {y:.6g}")
            _text(polyline, "height", f"{max(0.01, thing.box.size[2]):.6g}")


def _rings(thing: SolidObject) -> list[Polygon]:
    """Return outlines without holes that together cover the object: a polyline of SDF is one closed ring."""
    if not thing.holes:
        return [thing.footprint]
    pieces = shapely.constrained_delaunay_triangles(shapely.Polygon(thing.footprint, thing.holes))
    return [tuple(piece.exterior.coords[:-1]) for piece in shapely.get_parts(pieces)]


def _actor(root: ET.Element, run: Run, index: int, skin: str) -> None:
    path = run.trajectory
    times = np.arange(0.0, float(path.t[-1]) + ACTOR_STEP_S / 2, ACTOR_STEP_S)
    if times.size < 2:
        raise InputError("The run is too short to make actors of its people.")
    x = np.interp(times, path.t, path.human_x[:, index])
    y = np.interp(times, path.t, path.human_y[:, index])
    yaw = np.interp(times, path.t, np.unwrap(path.human_yaw[:, index]))
    actor = ET.SubElement(root, "actor", name=run.human_names[index])
    _text(actor, "pose", f"{x[0]:.4f} {y[0]:.4f} 0 0 0 {yaw[0]:.4f}")
    _text(ET.SubElement(actor, "skin"), "filename", skin)
    animation = ET.SubElement(actor, "animation", name="walking")
    _text(animation, "filename", skin)
    _text(animation, "interpolate_x", "true")
    script = ET.SubElement(actor, "script")
    _text(script, "loop", "false")
    _text(script, "delay_start", "0")
    _text(script, "auto_start", "true")
    trajectory = ET.SubElement(script, "trajectory", id=str(index), type="walking")
    for k in range(times.size):
        waypoint = ET.SubElement(trajectory, "waypoint")
        _text(waypoint, "time", f"{times[k]:g}")
        _text(waypoint, "pose", f"{x[k]:.4f} {y[k]:.4f} 0 0 0 {yaw[k]:.4f}")


def _text(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text
