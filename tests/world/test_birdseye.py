"""The bird's-eye picture shows heights, and what is in front hides what is behind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.coded import coded

from rvsg.core.errors import InputError, UnknownName
from rvsg.world.drawing.birdseye import Canvas, Oblique, birdseye
from rvsg.world.world import World
from rvsg.world.world_folder import load_world

RED, BLUE = (255, 0, 0), (0, 0, 255)


def square(x: float, y: float, z: float, side: float = 1.0) -> np.ndarray:
    return np.array([(x, y, z), (x + side, y, z), (x + side, y + side, z), (x, y + side, z)])


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_nearer_face_hides_the_farther_whichever_is_drawn_first(order: tuple[int, int]) -> None:
    faces = [(square(0, 0, 0.05), RED), (square(0.2, 0.2, 0.3, 0.5), BLUE)]
    view = Oblique("y", 100.0, 60.0, 160.0)
    canvas = Canvas(view, np.full((220, 220, 3), 255, np.uint8))
    for index in order:
        canvas.face(*faces[index])
    across, down, _ = view.project(np.array([0.45, 0.45, 0.3]))
    assert tuple(canvas.pixels[int(down), int(across)]) == BLUE
    across, down, _ = view.project(np.array([0.9, 0.1, 0.05]))
    assert tuple(canvas.pixels[int(down), int(across)]) == RED


@pytest.mark.parametrize("up", ["x", "y"])
def test_the_floor_under_a_pixel_is_the_floor_that_is_drawn_there(up: str) -> None:
    view = Oblique(up, 40.0, 300.0, 250.0)  # type: ignore[arg-type]
    points = np.array([(1.0, 2.0), (-3.0, 0.5), (4.0, -2.0)])
    seen = view.project(np.column_stack([points, np.zeros(3)]))
    assert np.allclose(view.floor_at(seen[:, :2]), points)


def heightened(world: World, factor: float) -> World:
    things = tuple(
        t.model_copy(update={"box": t.box.model_copy(update={
            "size": (*t.box.size[:2], t.box.size[2] * factor),
            "center": (*t.box.center[:2], t.box.center[2] * factor)})})
        for t in world.objects
    )  # fmt: skip
    return replace(world, objects=things)


def test_lower_furniture_gives_another_picture_and_the_way_up_stays_up() -> None:
    world = load_world("office")
    tall, low = (np.asarray(birdseye(w, width_px=500)).astype(int) for w in (world, heightened(world, 0.3)))
    rows = min(len(tall), len(low))
    assert (np.abs(tall[:rows] - low[:rows]).max(axis=-1) > 20).mean() > 0.02


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
