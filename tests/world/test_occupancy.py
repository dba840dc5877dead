from pathlib import Path

import numpy as np
import pytest
from tests.coded import coded

from rvsg.core.errors import InputError
from rvsg.core.records import Pose
from rvsg.world.occupancy import load_nav2_map, occupancy_from_objects, write_map
from rvsg.world.schema import ObjectEntry
from rvsg.world.world import OccupancyMap, SolidObject

ROOM = ObjectEntry(
    name="room",
    footprint=((0, 0), (6, 0), (6, 5), (0, 5)),
    height=2.5,
    holes=(((0.2, 0.2), (5.8, 0.2), (5.8, 4.8), (0.2, 4.8)),),
).solid(0.21)


def box(name: str, x: float, y: float, bottom: float = 0.0) -> SolidObject:
    return ObjectEntry.model_validate(
        {"name": name, "box": {"center": [x, y, bottom + 0.5], "size": [1.0, 1.0, 1.0]}}
    ).solid(0.21)


def at(occupancy: OccupancyMap, x: float, y: float) -> int:
    column = int((x - occupancy.origin.x) / occupancy.resolution)
    return int(occupancy.cells[int((y - occupancy.origin.y) / occupancy.resolution), column])


def test_outlines_are_occupied_floor_is_free_and_insides_are_unknown() -> None:
    occupancy = occupancy_from_objects([ROOM, box("crate", 3, 2.5)])
    assert at(occupancy, 1, 1) == 0
    assert at(occupancy, 2.51, 2.5) == 100
    assert at(occupancy, 3, 2.5) == 255
    assert at(occupancy, 0.1, 2.5) == 255
    assert at(occupancy, 0.18, 2.5) in (100, 255) and at(occupancy, 0.21, 2.5) == 100


def test_what_is_above_the_lidar_plane_is_not_on_the_map() -> None:
    occupancy = occupancy_from_objects([ROOM, box("lamp", 3, 2.5, bottom=1.5)])
    assert at(occupancy, 3, 2.5) == 0


def test_the_robot_cannot_slip_through_an_outline() -> None:
    from scipy.ndimage import label

    turned = ObjectEntry.model_validate(
        {"name": "turned", "box": {"center": [3, 2.5, 0.5], "size": [2.0, 1.0, 1.0], "yaw": 0.6}}
    ).solid(0.21)
    cells = occupancy_from_objects([ROOM, turned]).cells
    parts, _ = label(cells != 100)  # in steps to the four neighbours, unknown cells allowed
    inside = parts[int(2.5 / 0.05), int(3 / 0.05)]
    assert inside != parts[20, 20]


def test_seeds_choose_the_floor_where_the_robot_drives() -> None:
    around = occupancy_from_objects([ROOM, box("far", 30, 30)])
    assert at(around, 3, 2.5) == 255  # the largest open part is outside the room
    inside = occupancy_from_objects([ROOM, box("far", 30, 30)], seeds=[(3, 2.5)])
    assert at(inside, 3, 2.5) == 0
    assert at(inside, 20, 20) == 255


def test_a_world_without_anything_for_the_lidar_is_refused() -> None:
    with pytest.raises(InputError, check=coded("map-no-object")):
        occupancy_from_objects([box("lamp", 0, 0, bottom=2)])


def test_a_map_of_absurd_size_is_refused_before_it_is_drawn() -> None:
    with pytest.raises(InputError, check=coded("map-too-large")):
        occupancy_from_objects([box("a", 0, 0), box("b", 50_000, 50_000)])


def test_a_written_map_reads_back_equal(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    cells = rng.choice(np.array([0, 100, 255], np.uint8), (31, 47))
    occupancy = OccupancyMap(cells=cells, resolution=0.05, origin=Pose(x=-1.23456789, y=2.5, yaw=0.0))
    write_map(occupancy, tmp_path)
    again = load_nav2_map(tmp_path / "map.yaml").occupancy
    assert (again.cells == cells).all()
    assert (again.resolution, again.origin) == (occupancy.resolution, occupancy.origin)
