"""The bird's-eye picture shows heights, and what is in front hides what is behind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.coded import coded

from rvsg.core.errors import InputError, UnknownName
from rvsg.world.drawing.birdseye import birdseye
from rvsg.world.lattice import build_world
from rvsg.world.occupancy import occupancy_from_objects
from rvsg.world.schema import ObjectEntry
from rvsg.world.world_folder import load_world


def test_what_is_in_front_hides_what_is_behind() -> None:
    box = ObjectEntry(name="box", footprint=((4, 5), (5, 5), (5, 6), (4, 6)), height=0.3)
    screen = ObjectEntry(name="screen", footprint=((2, 4.5), (7, 4.5), (7, 4.6), (2, 4.6)), height=3.0)
    hole = ((0.2, 0.2), (9.8, 0.2), (9.8, 9.8), (0.2, 9.8))
    walls = ObjectEntry(name="wall", footprint=((0, 0), (10, 0), (10, 10), (0, 10)), height=1.0, holes=(hole,))
    pictures = []
    for entries in ((walls, screen), (walls, screen, box), (walls, box, screen), (walls,), (walls, box)):
        things = tuple(entry.solid(0.21) for entry in entries)
        world = build_world(name="w", objects=things, occupancy=occupancy_from_objects(things))
        pictures.append(birdseye(replace(world, objects=things), width_px=500).tobytes())
    hidden, behind, other_order, empty, alone = pictures
    assert hidden == behind == other_order
    assert empty != alone


def test_a_map_without_objects_is_raised_from_its_cells() -> None:
    world = load_world("office")
    bare = replace(world, objects=())
    image = birdseye(bare, width_px=500)
    assert (np.asarray(image).max(axis=-1) < 140).mean() > 0.02


def test_absurd_widths_and_unknown_palettes_are_refused() -> None:
    world = load_world("office")
    with pytest.raises(InputError, check=coded("picture-width")):
        birdseye(world, width_px=10)
    with pytest.raises(UnknownName):
        birdseye(world, colours="pink")
