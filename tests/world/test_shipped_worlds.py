"""Every world that ships is whole: nothing is wrong in it, its routes can be driven, its areas be reached."""

from __future__ import annotations

from itertools import pairwise

import pytest

from rvsg.world.checks import check_world
from rvsg.world.drawing import png_bytes
from rvsg.world.drawing.birdseye import birdseye
from rvsg.world.passages import describe_route, length_m, line_of, route_paragraph, waypoints_of
from rvsg.world.world_folder import SHIPPED, load_world, shipped_worlds

WORLDS = shipped_worlds()
OURS = [name for name in WORLDS if name != "warehouse"]


def test_three_worlds_ship() -> None:
    assert {"hospital", "office", "warehouse"} <= set(WORLDS)


@pytest.mark.parametrize("name", OURS)
def test_nothing_is_wrong_or_suspicious_in_our_worlds(name: str) -> None:
    assert [str(remark) for remark in check_world(SHIPPED / name)] == []


@pytest.mark.parametrize("name", WORLDS)
def test_nothing_is_seriously_wrong_in_any(name: str) -> None:
    assert [str(remark) for remark in check_world(SHIPPED / name) if remark.serious] == []


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
        words = describe_route(world, route)
        way = waypoints_of(world, route)
        assert f"waypoint {way[0]}" in words
        assert f"waypoint {way[-1]}" in words
        assert f"within {route.time_limit_s:g} s" in words
        assert route.purpose in words
        assert describe_route(world, route) == words


def test_the_users_own_description_of_a_route_wins() -> None:
    world = load_world("office")
    route = world.routes[0].model_copy(update={"description": "Straight on."})
    assert route_paragraph(world, route) == "Straight on."
    assert route_paragraph(world, world.routes[0]) == describe_route(world, world.routes[0])


def test_poses_to_pass_lead_the_way_and_the_words() -> None:
    world = load_world("office")
    route = world.routes[0].model_copy(update={"via": (), "through": (world.routes[1].goal,)})
    assert "D3" in waypoints_of(world, route)
    assert "must first pass waypoint D3 in Office 1" in describe_route(world, route)


def test_turns_and_narrow_places_are_told() -> None:
    words = describe_route(load_world("warehouse"), load_world("warehouse").route("route_3"))
    assert "down first, then left from E9" in words
    assert "free width" not in words  # its aisles are 1.9 m wide: enough to pass
    doors = describe_route(load_world("hospital"), load_world("hospital").route("route_2"))
    assert "near L9 (free width 1.2 m)" in doors


@pytest.mark.parametrize(
    "name", [name if name == "office" else pytest.param(name, marks=pytest.mark.exhaustive) for name in WORLDS]
)
def test_the_birds_eye_picture_is_the_same_every_time_and_shows_more_than_the_floor(name: str) -> None:
    world = load_world(name)
    image = birdseye(world, width_px=500, route=world.routes[0])
    assert image.width == 500
    assert png_bytes(image) == png_bytes(birdseye(world, width_px=500, route=world.routes[0]))
    assert len(image.getcolors(maxcolors=1_000_000) or []) > 50
