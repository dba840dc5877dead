"""The world of the published study: the shipped warehouse with the occupancy map that the study's robot used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from rvsg.world.load import load_world
from rvsg.world.records import Pose
from rvsg.world.world import OccupancyMap, World

MAP_OFFSET_M = (0.15, 0.13)
"""World - map, from matching scans to the map."""


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


def published_world(data: Path) -> World:
    """The warehouse with the study's map; `data` is the folder that holds `maps` and `published`."""
    world = load_world("warehouse")
    return World(
        name="study_warehouse",
        title=world.title,
        objects=world.objects,
        occupancy=study_map(data / "maps"),
        lidar_height_m=world.lidar_height_m,
        grid=world.grid,
        areas=world.areas,
        routes=world.routes,
        map_offset=MAP_OFFSET_M,
    )
