"""Maps as nav2_map_server reads them, and every refusal of a map that cannot be used."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from tests.coded import at_key, coded
from tests.published_data import published_data

from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError
from rvsg.core.records import Pose
from rvsg.world.occupancy import load_nav2_map, upright
from rvsg.world.world import FREE, OCCUPIED, UNKNOWN, OccupancyMap


def write_map(folder: Path, pixels: np.ndarray, *, image: str = "map.pgm", **header) -> Path:
    """A map folder; `header` overrides or (None) drops a line of map.yaml."""
    Image.fromarray(pixels).save(folder / image)
    return write_header(folder, image=image, **header)


def write_header(folder: Path, **header) -> Path:
    given = {
        "image": "map.pgm",
        "resolution": 0.05,
        "origin": "[0, 0, 0]",
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
        **header,
    }
    path = folder / "map.yaml"
    path.write_text("".join(f"{k}: {v}\n" for k, v in given.items() if v is not None))
    return path


def grey(*rows: list[int]) -> np.ndarray:
    return np.array(rows, np.uint8)


GRADIENT = np.vstack([np.arange(256, dtype=np.uint8), np.full(256, 254, np.uint8)])


def test_trinary_classes_end_at_the_same_greys_as_in_nav2(tmp_path: Path) -> None:
    cells = load_nav2_map(write_map(tmp_path, GRADIENT)).occupancy.cells[1]
    assert [int(cells[g]) for g in (0, 89, 90, 147, 205, 206, 255)] == [100, 100, 255, 255, 255, 0, 0]


def test_negate_turns_the_greys_round(tmp_path: Path) -> None:
    cells = load_nav2_map(write_map(tmp_path, GRADIENT, negate=1)).occupancy.cells[1]
    assert [int(cells[g]) for g in (0, 49, 50, 165, 166, 255)] == [0, 0, 255, 255, 100, 100]


def test_scale_mode_is_free_below_the_lethal_value_and_unknown_where_transparent(tmp_path: Path) -> None:
    rgba = np.zeros((2, 4, 4), np.uint8)
    rgba[..., :3] = np.array([0, 90, 147, 255])[None, :, None]
    rgba[..., 3] = 255
    rgba[0, 3, 3] = 254
    cells = load_nav2_map(write_map(tmp_path, rgba, image="m.png", mode="scale")).occupancy.cells
    assert cells.tolist() == [[100, 0, 0, 0], [100, 0, 0, 255]]


def test_raw_mode_takes_the_pixel_as_the_value(tmp_path: Path) -> None:
    cells = load_nav2_map(
        write_map(tmp_path, grey([0, 99, 100, 101, 255], [0, 0, 0, 0, 0]), mode="raw")
    ).occupancy.cells
    assert cells[1].tolist() == [0, 0, 100, 255, 255]


def test_colours_are_averaged_and_the_map_says_so(tmp_path: Path) -> None:
    rgb = np.zeros((2, 3, 3), np.uint8)
    rgb[:, 0] = (255, 255, 255)
    rgb[:, 1] = (255, 0, 0)  # a third bright: 0.67 occupied
    rgb[:, 2] = (255, 255, 0)  # 0.33 occupied: unknown
    read = load_nav2_map(write_map(tmp_path, rgb, image="m.png"))
    assert read.occupancy.cells[0].tolist() == [FREE, OCCUPIED, UNKNOWN]
    assert any("coloured" in note for note in read.notes)


def test_alpha_is_averaged_in_trinary_mode_as_nav2_does(tmp_path: Path) -> None:
    la = np.zeros((2, 3, 4), np.uint8)
    la[..., :3] = np.array([0, 205, 254])[None, :, None]
    la[..., 3] = 255
    read = load_nav2_map(write_map(tmp_path, la, image="m.png"))
    assert read.occupancy.cells[0].tolist() == [OCCUPIED, FREE, FREE]  # grey 205 comes out as 217.5
    assert any("alpha" in note for note in read.notes)


def test_row_zero_is_the_lowest_and_the_origin_is_kept(tmp_path: Path) -> None:
    occupancy = load_nav2_map(write_map(tmp_path, grey([0, 0], [254, 254]), origin="[-1.5, 2, 0.25]")).occupancy
    assert occupancy.cells.tolist() == [[0, 0], [100, 100]]
    assert occupancy.origin == Pose(x=-1.5, y=2.0, yaw=0.25)


def test_numbers_that_yaml_takes_for_text_are_read_as_nav2_reads_them(tmp_path: Path) -> None:
    path = write_map(tmp_path, grey([0, 254], [254, 254]), resolution="5e-2", negate="false")
    assert load_nav2_map(path).occupancy.resolution == 0.05


def test_the_unknown_grey_read_as_free_is_pointed_out_and_can_be_overridden(tmp_path: Path) -> None:
    path = write_map(tmp_path, grey([0, 205], [254, 254]), free_thresh=0.25)
    assert any("205" in note for note in load_nav2_map(path).notes)
    assert load_nav2_map(path, free_thresh=0.196).occupancy.cells[1, 1] == UNKNOWN


@pytest.mark.parametrize(
    ("header", "line"),
    [
        ({"image": "gone.pgm"}, 1),
        ({"image": None}, 1),
        ({"resolution": 0}, 2),
        ({"resolution": "nan"}, 2),
        ({"resolution": None}, 1),
        ({"origin": "[1, 2]"}, 3),
        ({"origin": "[1, .nan, 0]"}, 3),
        ({"origin": "north"}, 3),
        ({"origin": "[9e9, 0, 0]"}, 3),
        ({"origin": "[0, 0, 90]"}, 3),
        ({"negate": 2}, 4),
        ({"occupied_thresh": 65}, 5),
        ({"free_thresh": 0.7}, 6),
        ({"mode": "binary"}, 7),
    ],
)
def test_a_wrong_header_is_refused_at_its_key_and_line(tmp_path: Path, header: dict, line: int) -> None:
    path = write_map(tmp_path, grey([0, 254], [254, 254]))
    with pytest.raises(DocumentError) as caught:
        load_nav2_map(write_header(path.parent, **header))
    (problem,) = caught.value.problems
    assert (problem.line, problem.key) == (line, tuple(header))


def test_all_problems_of_a_header_are_told_at_once(tmp_path: Path) -> None:
    path = write_header(tmp_path, resolution=-1, origin="[0]", negate="maybe")
    with pytest.raises(FileError) as caught:
        load_nav2_map(path)
    assert [problem.line for problem in caught.value.problems] == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("pixels", "code"),
    [
        (np.zeros((3, 3), np.uint8), "map-no-floor"),
        (np.full((3, 3), 205, np.uint8), "map-no-floor"),
        (np.full((3, 3), 40000, np.uint16), "map-depth"),
        (np.full((1, 9), 254, np.uint8), "map-too-small"),
    ],
)
def test_an_image_that_is_no_map_is_refused(tmp_path: Path, pixels: np.ndarray, code: str) -> None:
    with pytest.raises(FileError, check=coded(code)):
        load_nav2_map(write_map(tmp_path, pixels, image="m.png"))


def test_sixteen_bit_pgm_is_refused(tmp_path: Path) -> None:
    (tmp_path / "map.pgm").write_bytes(b"P5\n2 2\n65535\n" + bytes(8))
    with pytest.raises(FileError, check=coded("map-depth")):
        load_nav2_map(write_header(tmp_path))


@pytest.mark.parametrize("content", [b"", b"no image", b"P5\n100 100\n255\n123", b"P5\n0 0\n255\n"])
def test_a_broken_image_is_refused_in_one_sentence(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "map.pgm").write_bytes(content)
    with pytest.raises(FileError) as caught:
        load_nav2_map(write_header(tmp_path))
    assert caught.value.path.name == "map.pgm"


def test_an_absurdly_large_image_is_refused_before_it_is_read(tmp_path: Path) -> None:
    (tmp_path / "map.pgm").write_bytes(b"P5\n90000 90000\n255\n")
    with pytest.raises(FileError, check=coded("map-too-large")):
        load_nav2_map(write_header(tmp_path))


def test_an_absurdly_wide_map_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, check=at_key("resolution")):
        load_nav2_map(write_map(tmp_path, np.full((2, 1500), 254, np.uint8), resolution=1.0))


@pytest.mark.parametrize("text", ["", "just words", "[1, 2]", "a: [1", "image: a\nimage: b\n", "\x00"])
def test_a_header_that_is_no_mapping_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(FileError):
        load_nav2_map(tmp_path / "map.yaml")


def test_the_picture_given_instead_of_its_header_is_told(tmp_path: Path) -> None:
    write_map(tmp_path, grey([0, 254], [254, 254]))
    with pytest.raises(FileError, check=coded("map-picture")):
        load_nav2_map(tmp_path / "map.pgm")


def test_a_missing_header_and_a_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "none.yaml", tmp_path):
        with pytest.raises(FileError):
            load_nav2_map(path)


@given(yaw=st.floats(-3.1, 3.1), x=st.floats(-50, 50), y=st.floats(-50, 50))
def test_an_upright_map_holds_the_same_things_at_the_same_places(yaw: float, x: float, y: float) -> None:
    cells = np.zeros((40, 30), np.uint8)
    cells[10:16, 20:28] = OCCUPIED
    cells[30:36, 2:10] = UNKNOWN
    turned = OccupancyMap(cells=cells, resolution=0.1, origin=Pose(x=x, y=y, yaw=yaw))
    flat = upright(turned)
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
        occupancy = upright(load_nav2_map(path).occupancy)
        assert np.count_nonzero(occupancy.cells == FREE) > 50
        assert np.count_nonzero(occupancy.cells == OCCUPIED) > 20
