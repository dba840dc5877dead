import numpy as np
import pytest
from tests.coded import nearest

from rvsg.core.errors import UnknownName
from rvsg.core.records import Pose
from rvsg.world.lattice import area_waypoints
from rvsg.world.space import human_space, robot_space
from rvsg.world.world_folder import load_world, shipped_worlds


def test_the_warehouse_ships_with_what_the_study_had() -> None:
    world = load_world("warehouse")
    assert "warehouse" in shipped_worlds()
    assert len(world.grid.waypoints) == 13 * 22
    assert len(world.grid.valid) == 189
    assert len(world.areas) == 20
    assert [route.name for route in world.routes] == ["route_1", "route_2", "route_3", "route_4", "route_5"]
    assert world.route("route_1").goal == Pose(x=1.75, y=-8.6, yaw=4.5)
    assert world.map_offset == (0.0, 0.0)


def test_the_map_of_the_warehouse_shows_what_the_lidar_plane_cuts() -> None:
    world = load_world("warehouse")
    cells = world.occupancy.cells
    assert set(np.unique(cells)) == {0, 100, 255}
    assert cells.shape == (420, 280)

    def cell(x: float, y: float) -> int:
        return int(cells[int((y + 10.5) / 0.05), int((x + 7.0) / 0.05)])

    assert cell(4.746, 0.5) == 100  # a leg of shelf 1
    assert cell(3.8, 0.5) == 0  # under shelf 1
    assert cell(-1.574, 2.302) == 255  # inside a pile of boxes
    assert cell(6.95, 0.0) == 255  # inside the wall
    assert cell(6.88, 0.0) == 100  # its inner face


def test_a_person_cannot_walk_through_a_shelf_under_which_the_robot_can_look() -> None:
    world = load_world("warehouse")
    through_shelf_1 = ((3.8, 2.1), (3.8, -0.35))
    assert not human_space(world).segment_free(*through_shelf_1)
    assert robot_space(world).segment_free(*through_shelf_1, 0.3)


def test_every_valid_waypoint_is_free_and_reachable_from_every_other() -> None:
    world = load_world("warehouse")
    space = human_space(world)
    assert all(space.is_free(*world.grid.position(name), 0.15) for name in world.grid.valid)
    assert all(world.grid.shortest_path("A1", name) for name in world.grid.valid)


def test_every_hop_joins_adjacent_waypoints() -> None:
    grid = load_world("warehouse").grid
    for a, b in grid.hops:
        first, second = grid.by_name[a], grid.by_name[b]
        assert max(abs(first.row - second.row), abs(first.column - second.column)) == 1


def test_an_unknown_world_is_answered_with_the_nearest_name() -> None:
    with pytest.raises(UnknownName, check=nearest("warehouse")):
        load_world("warehuose")


def test_the_proposal_finds_nearly_all_waypoints_from_which_the_study_worked_the_areas() -> None:
    world = load_world("warehouse")
    given = found = 0
    for area in world.areas:
        proposed = area_waypoints(area.outline, world.grid, human_space(world), objects=world.objects)
        given += len(area.waypoints)
        found += len(set(area.waypoints) & set(proposed))
    assert given == 140
    assert found >= 0.95 * given
