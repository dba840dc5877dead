"""The world of the published study: the shipped warehouse with the occupancy map that the study's robot used.

And with racks as its lidars saw them. Gazebo's GPU lidar renders a model's visual mesh; the shipped world and the
study's map know the collision mesh. Where that has a solid panel, 0.21 m above the floor there are two posts and, in
the smaller racks, a cut through a diagonal brace. The robot sees through the racks to the walls, and AMCL settles
elsewhere. Measured on the public visual meshes of ShelfD_01 and ShelfF_01; ShelfE_01, which has the same panels but
other goods, is taken to stand on the same posts. The outer wall's two meshes are equal; the visual meshes of the
other objects were not at hand.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from rvsg.core.records import Pose
from rvsg.world.world import OccupancyMap, Polygon, SolidObject, World
from rvsg.world.world_folder import load_world

MAP_OFFSET_M = (0.15, 0.13)
"""World - map, from matching scans to the map."""

Span = tuple[float, float]

RACK_FRAMES_M: tuple[Span, ...] = ((-1.954, -1.909), (-0.009, 0.037), (1.909, 1.954))
RACK_DEPTHS_M: tuple[Span, ...] = ((-0.437, -0.411), (-0.310, -0.250), (0.404, 0.430))
"""ShelfD_01: x of its three frames and, of each, y of the front post, the brace and the rear post."""
LARGE_RACK_POSTS_M: tuple[Span, ...] = ((-1.043, -0.913), (0.928, 1.058))
LARGE_RACK_FRAMES_M: tuple[Span, ...] = (
    (-9.023, -8.873), (-4.554, -4.404), (-0.180, -0.030), (4.312, 4.462), (8.873, 9.023),
)  # fmt: skip
"""ShelfF_01: x of the posts of a frame and y of its five frames. All metres from the model's origin."""


def study_map(folder: Path) -> OccupancyMap:
    """The study's occupancy map from its image and YAML file (trinary, rows upwards)."""
    described = yaml.safe_load((folder / "study_warehouse.yaml").read_text())
    image = Image.open(folder / described["image"])
    grey = np.asarray(image.convert("RGB"), np.float64).mean(axis=2)
    darkness = (255.0 - grey) / 255.0
    cells = np.full(grey.shape, 255, np.uint8)
    cells[darkness > described["occupied_thresh"]] = 100
    cells[darkness < described["free_thresh"]] = 0
    x, y, _ = described["origin"]
    return OccupancyMap(
        cells=np.ascontiguousarray(cells[::-1]), resolution=float(described["resolution"]), origin=Pose(x=x, y=y)
    )


def as_seen(thing: SolidObject) -> tuple[Polygon, ...]:
    """The outlines of an object that the study's lidars saw."""
    if thing.kind in ("ShelfD_01", "ShelfE_01"):
        return _posts(thing, RACK_FRAMES_M, RACK_DEPTHS_M)
    if thing.kind == "ShelfF_01":
        return _posts(thing, LARGE_RACK_POSTS_M, LARGE_RACK_FRAMES_M)
    return thing.slices


def _posts(thing: SolidObject, columns: tuple[Span, ...], rows: tuple[Span, ...]) -> tuple[Polygon, ...]:
    x, y, _ = thing.origin
    return tuple(
        ((x + left, y + low), (x + right, y + low), (x + right, y + high), (x + left, y + high))
        for left, right in columns
        for low, high in rows
    )


def published_world(data: Path) -> World:
    """The warehouse with the study's map; `data` is the folder that holds `maps` and `published`."""
    world = load_world("warehouse")
    return World(
        name="study_warehouse",
        title=world.title,
        objects=tuple(thing.model_copy(update={"slices": as_seen(thing)}) for thing in world.objects),
        occupancy=study_map(data / "maps"),
        lidar_height_m=world.lidar_height_m,
        grid=world.grid,
        areas=world.areas,
        routes=world.routes,
        map_offset=MAP_OFFSET_M,
    )
