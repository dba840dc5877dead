"""A hall of 100 x 100 m: 2000 x 2000 cells, sixty labelled areas."""

import time
from pathlib import Path

import numpy as np
import pytest
from tests.coded import coded

from rvsg.core.errors import InputError
from rvsg.core.records import Pose
from rvsg.world.drawing import png_bytes
from rvsg.world.drawing.floor_plan import GRID, LABELLED, Picture, draw_plan, tiles
from rvsg.world.grid import GridSpec
from rvsg.world.lattice import build_world
from rvsg.world.occupancy import load_nav2_map, write_map
from rvsg.world.world import Area, OccupancyMap


def overlaps(picture: Picture) -> list[tuple[str, str]]:
    boxes = np.array([word.box for word in picture.words])
    a, b = np.triu_indices(len(boxes), 1)
    hit = (boxes[a, :2] < boxes[b, 2:]).all(axis=1) & (boxes[b, :2] < boxes[a, 2:]).all(axis=1)
    return [(picture.words[i].text, picture.words[j].text) for i, j in zip(a[hit], b[hit], strict=True)]


@pytest.fixture(scope="module")
def hall() -> tuple[OccupancyMap, list[Area]]:
    rng = np.random.default_rng(3)
    cells = np.zeros((2000, 2000), np.uint8)
    cells[:3] = cells[-3:] = cells[:, :3] = cells[:, -3:] = 100
    areas = []
    for i in range(60):
        (x, y), (w, h) = rng.integers(50, 1850, 2), rng.integers(20, 140, 2)
        cells[y : y + h, x : x + w] = 100
        x0, y0, x1, y1 = (float(v) * 0.05 for v in (x, y, x + w, y + h))
        outline = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
        areas.append(Area(name=f"Store {i + 1}", kind=("shelf", "desk")[i % 2], outline=outline, waypoints=()))
    return OccupancyMap(cells=cells, resolution=0.05, origin=Pose(x=0, y=0)), areas


@pytest.mark.slow
def test_a_map_of_2000_by_2000_cells_is_read_gridded_and_drawn_in_seconds(
    hall: tuple[OccupancyMap, list[Area]], tmp_path: Path
) -> None:
    write_map(hall[0], tmp_path)
    began = time.process_time()
    world = build_world(name="hall", occupancy=load_nav2_map(tmp_path / "map.yaml").occupancy, areas=hall[1])
    pictures = [draw_plan(world, show=show) for show in (LABELLED, GRID)]
    assert all(png_bytes(picture.image) for picture in pictures)
    assert time.process_time() - began < 20.0  # far from quadratic; a busy machine takes longer
    assert world.grid.spacing_m == 4.0  # coarser, so that it can be read
    named = {word.text.replace("\n", " ") for word in pictures[1].words}
    assert world.grid.valid <= named
    assert {area.name for area in world.areas} <= {w.text.replace("\n", " ") for w in pictures[0].words}
    assert any("Waypoints 4 m apart." in word.text for word in pictures[1].words)


def test_a_grid_too_fine_for_one_picture_is_drawn_in_tiles_that_name_every_waypoint(
    hall: tuple[OccupancyMap, list[Area]],
) -> None:
    corner = OccupancyMap(cells=hall[0].cells[:400, :400], resolution=0.05, origin=Pose(x=0, y=0))
    areas = [area for area in hall[1] if max(max(point) for point in area.outline) < 19]
    world = build_world(name="hall", occupancy=corner, areas=areas, grid_spec=GridSpec(spacing_m=0.5))
    whole = draw_plan(world, show=GRID, width_px=900)
    assert any("too dense" in note for note in whole.notes)
    assert any("too dense" in word.text for word in whole.words)
    parts = tiles(world, width_px=900)
    assert len(parts) == 4
    named = {word.text for tile in parts.values() for word in tile.words}
    assert world.grid.valid <= named
    assert overlaps(parts[0, 0]) == []


def test_tiles_without_end_are_refused(hall: tuple[OccupancyMap, list[Area]]) -> None:
    world = build_world(name="hall", occupancy=hall[0], grid_spec=GridSpec(spacing_m=0.6))
    with pytest.raises(InputError, check=coded("tiles-too-many")):
        tiles(world, width_px=500)


def test_a_room_of_5_by_5_metres_is_one_picture_with_every_name() -> None:
    cells = np.zeros((100, 100), np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    world = build_world(name="room", occupancy=OccupancyMap(cells=cells, resolution=0.05, origin=Pose(x=0, y=0)))
    only = tiles(world)[0, 0]
    assert world.grid.spacing_m == 0.5
    assert world.grid.valid <= {word.text for word in only.words}
