"""Occupancy maps: as nav2_map_server reads them, as a lidar draws them, and every refusal."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy.ndimage import label
from tests.coded import coded
from tests.published_data import published_data
from tests.world.parts import map_of

from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError, InputError
from rvsg.core.records import Pose
from rvsg.world.occupancy import load_nav2_map, occupancy_from_objects, upright, write_map
from rvsg.world.schema import ObjectEntry
from rvsg.world.world import FREE, OCCUPIED, UNKNOWN, OccupancyMap, OrientedBox, SolidObject

HEADER = {"image": "map.pgm", "resolution": 0.05, "origin": "[0, 0, 0]", "negate": 0, "occupied_thresh": 0.65,
          "free_thresh": 0.196}  # fmt: skip


def write_header(folder: Path, **header: Any) -> Path:
    """Write map.yaml; `header` overrides a line, or drops it with None."""
    path = folder / "map.yaml"
    path.write_text("".join(f"{k}: {v}\n" for k, v in {**HEADER, **header}.items() if v is not None))
    return path


def write_pixels(folder: Path, pixels: np.ndarray, *, image: str = "map.pgm", **header: Any) -> Path:
    Image.fromarray(pixels).save(folder / image)
    return write_header(folder, image=image, **header)


def grey(*rows: list[int]) -> np.ndarray:
    return np.array(rows, np.uint8)


RGBA = [(0, 0, 0, 255), (90, 90, 90, 255), (147, 147, 147, 255), (255, 255, 255, 254)]
CASES: dict[str, tuple[np.ndarray, dict[str, Any], list[int], str]] = {
    "trinary": (grey([0, 89, 90, 147, 205, 206, 255]), {}, [100, 100, 255, 255, 255, 0, 0], ""),
    "negate": (grey([0, 49, 50, 165, 166, 255]), {"negate": 1}, [0, 0, 255, 255, 100, 100], ""),
    "raw": (grey([0, 99, 100, 101, 255]), {"mode": "raw"}, [0, 0, 100, 255, 255], ""),
    "scale": (np.array([RGBA], np.uint8), {"mode": "scale"}, [100, 0, 0, 255], ""),  # unknown where transparent
    # averaged: a third bright is 0.67 occupied, two thirds are unknown
    "colours": (np.array([[(255, 255, 255), (255, 0, 0), (255, 255, 0)]], np.uint8), {}, [0, 100, 255], "coloured"),
    # averaged with the colours, as Nav2 does: grey 205 comes out as 217.5
    "alpha": (np.array([[(v, v, v, 255) for v in (0, 205, 254)]], np.uint8), {}, [100, 0, 0], "alpha"),
    "unknown-as-free": (grey([0, 205, 254]), {"free_thresh": 0.25}, [100, 0, 0], "205"),
    "text": (grey([0, 254]), {"resolution": "5e-2", "negate": "false"}, [100, 0], ""),  # as Nav2 reads YAML
}


@pytest.mark.parametrize("case", CASES)
def test_pixels_become_cells_as_in_nav2(tmp_path: Path, case: str) -> None:
    pixels, header, cells, note = CASES[case]
    read, notes = load_nav2_map(write_pixels(tmp_path, np.vstack([pixels, pixels]), image="m.png", **header))
    assert (read.cells.tolist(), read.resolution) == ([cells, cells], 0.05)
    assert not note or any(note in said for said in notes)


def test_row_zero_is_the_lowest_the_origin_is_kept_and_thresholds_can_be_overridden(tmp_path: Path) -> None:
    path = write_pixels(tmp_path, grey([0, 205], [254, 254]), origin="[-1.5, 2, 0.25]", free_thresh=0.25)
    occupancy = load_nav2_map(path)[0]
    assert occupancy.cells.tolist() == [[0, 0], [100, 0]]
    assert occupancy.origin == Pose(x=-1.5, y=2.0, yaw=0.25)
    assert load_nav2_map(path, free_thresh=0.196)[0].cells[1, 1] == UNKNOWN


@pytest.mark.parametrize(
    ("header", "lines"),
    [
        ({"image": "gone.pgm"}, [1]),
        ({"image": None}, [1]),
        ({"resolution": 0}, [2]),
        ({"resolution": "nan"}, [2]),
        ({"resolution": None}, [1]),
        ({"resolution": 1.0}, [2]),  # absurdly wide
        ({"origin": "[1, 2]"}, [3]),
        ({"origin": "[1, .nan, 0]"}, [3]),
        ({"origin": "north"}, [3]),
        ({"origin": "[9e9, 0, 0]"}, [3]),
        ({"origin": "[0, 0, 90]"}, [3]),
        ({"negate": 2}, [4]),
        ({"occupied_thresh": 65}, [5]),
        ({"free_thresh": 0.7}, [6]),
        ({"mode": "binary"}, [7]),
        ({"resolution": -1, "origin": "[0]", "negate": "maybe"}, [2, 3, 4]),
    ],
)
def test_a_wrong_header_is_refused_at_its_keys(tmp_path: Path, header: dict[str, Any], lines: list[int]) -> None:
    path = write_pixels(tmp_path, np.full((2, 1500), 254, np.uint8))
    with pytest.raises(DocumentError) as caught:
        load_nav2_map(write_header(path.parent, **header))
    assert [(problem.line, problem.key) for problem in caught.value.problems] == [
        (line, (key,)) for line, key in zip(lines, header, strict=True)
    ]


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (np.zeros((3, 3), np.uint8), "map-no-floor"),
        (np.full((3, 3), 205, np.uint8), "map-no-floor"),
        (np.full((3, 3), 40000, np.uint16), "map-depth"),
        (np.full((1, 9), 254, np.uint8), "map-too-small"),
        (b"P5\n2 2\n65535\n" + bytes(8), "map-depth"),
        (b"P5\n90000 90000\n255\n", "map-too-large"),
        (b"", "file"),
        (b"no image", "file"),
        (b"P5\n100 100\n255\n123", "file"),
        (b"P5\n0 0\n255\n", "file"),
    ],
)
def test_an_image_that_is_no_map_is_refused(tmp_path: Path, content: np.ndarray | bytes, code: str) -> None:
    if isinstance(content, bytes):
        (tmp_path / "m.png").write_bytes(content)
    else:
        Image.fromarray(content).save(tmp_path / "m.png")
    with pytest.raises(FileError, check=coded(code)) as caught:
        load_nav2_map(write_header(tmp_path, image="m.png"))
    assert caught.value.path.name == "m.png"


@pytest.mark.parametrize("text", ["", "just words", "[1, 2]", "a: [1", "image: a\nimage: b\n", "\x00"])
def test_a_header_that_is_no_mapping_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(FileError):
        load_nav2_map(tmp_path / "map.yaml")


@pytest.mark.parametrize(("name", "code"), [("map.pgm", "map-picture"), ("none.yaml", None), (".", None)])
def test_what_is_given_instead_of_the_header_is_refused(tmp_path: Path, name: str, code: str | None) -> None:
    write_pixels(tmp_path, grey([0, 254], [254, 254]))
    with pytest.raises(FileError) as caught:
        load_nav2_map(tmp_path / name)
    assert code is None or caught.value.code == code


@given(yaw=st.floats(-3.1, 3.1), x=st.floats(-50, 50), y=st.floats(-50, 50))
def test_an_upright_map_holds_the_same_things_at_the_same_places(yaw: float, x: float, y: float) -> None:
    cells = np.zeros((40, 30), np.uint8)
    cells[10:16, 20:28] = OCCUPIED
    cells[30:36, 2:10] = UNKNOWN
    flat = upright(map_of(cells, 0.1, x=x, y=y, yaw=yaw))
    assert flat.origin.yaw == 0.0
    for row, column in ((13, 24), (33, 6), (5, 5), (22, 15)):  # cells well inside their patch
        u, v = (column + 0.5) * 0.1, (row + 0.5) * 0.1
        px = x + math.cos(yaw) * u - math.sin(yaw) * v
        py = y + math.sin(yaw) * u + math.cos(yaw) * v
        there = flat.cells[int((py - flat.origin.y) / 0.1), int((px - flat.origin.x) / 0.1)]
        assert there == cells[row, column]


@pytest.mark.skipif(published_data() is None, reason="the public maps are not here")
def test_every_public_map_reads() -> None:
    data = published_data()
    assert data is not None
    for path in sorted((data / "maps").glob("*.yaml")):
        occupancy = upright(load_nav2_map(path)[0])
        assert np.count_nonzero(occupancy.cells == FREE) > 50
        assert np.count_nonzero(occupancy.cells == OCCUPIED) > 20


ROOM = ObjectEntry(
    name="room", footprint=((0, 0), (6, 0), (6, 5), (0, 5)), height=2.5,
    holes=(((0.2, 0.2), (5.8, 0.2), (5.8, 4.8), (0.2, 4.8)),),
).solid(0.21)  # fmt: skip


def box(x: float, y: float, bottom: float = 0.0, *, length: float = 1.0, yaw: float = 0.0) -> SolidObject:
    placed = OrientedBox(center=(x, y, bottom + 0.5), size=(length, 1.0, 1.0), yaw=yaw)
    return ObjectEntry(name=f"box {x:g}", box=placed).solid(0.21)


def at(occupancy: OccupancyMap, x: float, y: float) -> int:
    column = int((x - occupancy.origin.x) / occupancy.resolution)
    return int(occupancy.cells[int((y - occupancy.origin.y) / occupancy.resolution), column])


@pytest.mark.parametrize(
    ("things", "seeds", "expected"),
    [
        ([box(3, 2.5)], (), {(1, 1): 0, (2.51, 2.5): 100, (3, 2.5): 255, (0.1, 2.5): 255, (0.21, 2.5): 100}),
        ([box(3, 2.5, bottom=1.5)], (), {(3, 2.5): 0}),  # above the lidar plane
        ([box(30, 30)], (), {(3, 2.5): 255}),  # the largest open part is outside the room
        ([box(30, 30)], [(3, 2.5)], {(3, 2.5): 0, (20, 20): 255}),
    ],
    ids=["crate", "lamp", "far", "seed"],
)
def test_outlines_are_occupied_floor_is_free_and_insides_are_unknown(
    things: list[SolidObject], seeds: list[tuple[float, float]], expected: dict[tuple[float, float], int]
) -> None:
    occupancy = occupancy_from_objects([ROOM, *things], seeds=seeds)
    assert {place: at(occupancy, *place) for place in expected} == expected


def test_the_robot_cannot_slip_through_an_outline() -> None:
    cells = occupancy_from_objects([ROOM, box(3, 2.5, length=2.0, yaw=0.6)]).cells
    parts, _ = label(cells != 100)  # in steps to the four neighbours, unknown cells allowed
    assert parts[int(2.5 / 0.05), int(3 / 0.05)] != parts[20, 20]


@pytest.mark.parametrize(
    ("things", "code"),
    [([box(0, 0, bottom=2)], "map-no-object"), ([box(0, 0), box(50_000, 50_000)], "map-too-large")],
)
def test_objects_that_make_no_map_are_refused(things: list[SolidObject], code: str) -> None:
    with pytest.raises(InputError, check=coded(code)):
        occupancy_from_objects(things)


def test_a_written_map_reads_back_equal(tmp_path: Path) -> None:
    cells = np.random.default_rng(3).choice(np.array([0, 100, 255], np.uint8), (31, 47))
    occupancy = map_of(cells, x=-1.23456789, y=2.5)
    write_map(occupancy, tmp_path)
    again = load_nav2_map(tmp_path / "map.yaml")[0]
    assert (again.cells == cells).all()
    assert (again.resolution, again.origin) == (occupancy.resolution, occupancy.origin)
