"""Worlds that ship: nothing is wrong in them, their routes can be driven, and the warehouse is the one of the study."""

from __future__ import annotations

import json
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt
from tests.published_data import published_data

from rvsg.core.records import Pose
from rvsg.world.checks import check_world
from rvsg.world.drawing import png_bytes
from rvsg.world.drawing.birdseye import birdseye
from rvsg.world.lattice import area_waypoints
from rvsg.world.occupancy import load_nav2_map
from rvsg.world.passages import describe_route, length_m, line_of, waypoints_of
from rvsg.world.space import frame_of, human_space
from rvsg.world.world_folder import SHIPPED, load_world, shipped_worlds

WORLDS = shipped_worlds()
OURS = ["hospital", "office"]


@pytest.mark.parametrize("name", WORLDS)
def test_nothing_is_wrong_in_a_world_nor_suspicious_in_ours(name: str) -> None:
    assert [str(remark) for remark in check_world(SHIPPED / name) if remark.serious or name in OURS] == []


@pytest.mark.parametrize("name", OURS)
def test_our_worlds_have_three_routes_with_sensible_time_limits_and_activities(name: str) -> None:
    world = load_world(name)
    assert len(world.routes) >= 3
    assert len(world.activities) >= 6
    for route in world.routes:
        assert 0.25 < length_m(line_of(world, route)) / route.time_limit_s < 0.6  # m/s, as the study's routes ask
        hops = {hop for a, b in world.grid.hops for hop in ((a, b), (b, a))}
        assert set(pairwise(route.via)) <= hops


@pytest.mark.parametrize("name", WORLDS)
def test_a_routes_paragraph_names_its_ends_its_waypoints_and_its_time(name: str) -> None:
    world = load_world(name)
    for route in world.routes:
        words, way = describe_route(world, route), waypoints_of(world, route)
        for told in (f"waypoint {way[0]}", f"waypoint {way[-1]}", f"within {route.time_limit_s:g} s", route.purpose):
            assert told in words
        assert describe_route(world, route) == words


def test_poses_to_pass_turns_and_narrow_places_are_told() -> None:
    office, warehouse, hospital = (load_world(name) for name in ("office", "warehouse", "hospital"))
    route = office.routes[0].model_copy(update={"via": (), "through": (office.routes[1].goal,)})
    assert "D3" in waypoints_of(office, route)
    assert "must first pass waypoint D3 in Office 1" in describe_route(office, route)
    words = describe_route(warehouse, warehouse.route("route_3"))
    assert "down first, then left from E9" in words
    assert "free width" not in words  # its aisles are 1.9 m wide: enough to pass
    assert "near L9 (free width 1.2 m)" in describe_route(hospital, hospital.route("route_2"))


def test_the_map_of_the_warehouse_shows_what_the_lidar_plane_cuts() -> None:
    cells = load_world("warehouse").occupancy.cells
    assert set(np.unique(cells)) == {0, 100, 255}
    assert cells.shape == (420, 280)
    for x, y, value in (
        (4.746, 0.5, 100),  # a leg of shelf 1
        (3.8, 0.5, 0),  # under shelf 1
        (-1.574, 2.302, 255),  # inside a pile of boxes
        (6.95, 0.0, 255),  # inside the wall
        (6.88, 0.0, 100),  # its inner face
    ):
        assert cells[int((y + 10.5) / 0.05), int((x + 7.0) / 0.05)] == value


@pytest.mark.parametrize(
    "name", [name if name == "office" else pytest.param(name, marks=pytest.mark.exhaustive) for name in WORLDS]
)
def test_the_birds_eye_picture_is_the_same_every_time_and_shows_more_than_the_floor(name: str) -> None:
    world = load_world(name)
    image = birdseye(world, width_px=500, route=world.routes[0])
    assert image.width == 500
    assert png_bytes(image) == png_bytes(birdseye(world, width_px=500, route=world.routes[0]))
    assert len(image.getcolors(maxcolors=1_000_000) or []) > 50


def test_the_warehouse_ships_with_what_the_study_had() -> None:
    world = load_world("warehouse")
    assert "warehouse" in shipped_worlds()
    assert len(world.grid.waypoints) == 13 * 22
    assert len(world.grid.valid) == 189
    assert len(world.areas) == 20
    assert [route.name for route in world.routes] == ["route_1", "route_2", "route_3", "route_4", "route_5"]
    assert world.route("route_1").goal == Pose(x=1.75, y=-8.6, yaw=4.5)
    assert world.map_offset == (0.0, 0.0)


def test_the_proposal_finds_nearly_all_waypoints_from_which_the_study_worked_the_areas() -> None:
    world = load_world("warehouse")
    given = found = 0
    for area in world.areas:
        proposed = area_waypoints(area.outline, world.grid, human_space(world), objects=world.objects)
        given += len(area.waypoints)
        found += len(set(area.waypoints) & set(proposed))
    assert given == 140
    assert found >= 0.95 * given


DATA = published_data()
published = pytest.mark.skipif(DATA is None, reason="the published study's data is not there")


@published
def test_88_percent_of_the_published_hops_are_between_neighbours() -> None:
    assert DATA is not None
    grid = load_world("warehouse").grid
    counted: Counter[str] = Counter()
    for requirement in ("distance", "jerk", "reach"):
        for path in (DATA / "published" / requirement).glob(f"route_*/*/{requirement}_gpt-4.1-2025-04-14_?.json"):
            for tasks in json.loads(path.read_text()).values():
                for task in tasks:
                    names = task["Path"]
                    for a, b in pairwise(names):
                        if a != b and a in grid.valid and b in grid.valid:
                            counted["neighbours" if b in grid.neighbours[a] else "others"] += 1
    share = counted["neighbours"] / counted.total()
    assert counted.total() > 30_000
    assert 0.87 <= share <= 0.90


@published
def test_the_map_drawn_from_the_objects_is_the_map_the_study_recorded() -> None:
    """The recorded map is shifted by about 0.15 m against the world, and shows only what the robot came to see."""
    assert DATA is not None
    drawn = load_world("warehouse").occupancy
    recorded = load_nav2_map(DATA / "maps" / "study_warehouse.yaml")[0]
    shift = np.array([0.15, 0.15])
    to_obstacle = distance_transform_edt(drawn.cells != 100) * drawn.resolution

    def places(value: int) -> np.ndarray:
        return frame_of(recorded).to_metres(np.argwhere(recorded.cells == value)[:, ::-1] + 0.5) + shift

    near = frame_of(drawn).looked_up(1 + to_obstacle, places(100))  # 0: off the map
    assert ((near > 0) & (near <= 1.101)).mean() > 0.96
    free = frame_of(drawn).looked_up((drawn.cells == 0).astype(np.uint8), places(0))
    assert free.mean() > 0.96
