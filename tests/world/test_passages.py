"""Free widths are measured from wall to wall across the direction of travel."""

import math

import numpy as np
import pytest
from tests.world.parts import map_of, walled

from rvsg.core.records import Pose
from rvsg.robots.robot import load_robot
from rvsg.world.grid import GridSpec
from rvsg.world.lattice import build_world
from rvsg.world.passages import (
    describe_route,
    free_width_m,
    least_widths_m,
    narrow_passages,
    narrowest_passage,
    passing_m,
    widths_m,
)
from rvsg.world.space import human_space
from rvsg.world.world import Area, Route, World

RESOLUTION_M = 0.05


def two_rooms(up: str = "y") -> World:
    """Two rooms of 5 x 5 m side by side along x; a doorway 1.2 m wide (y 2.0 to 3.2) in the wall between them."""
    cells = walled(100, 204)
    cells[:, 100:104] = 100
    cells[40:64, 100:104] = 0
    post = Area(name="Post", kind="shelf", outline=((5.0, 0.1), (5.2, 0.1), (5.2, 2.0), (5.0, 2.0)), waypoints=())
    floor = Area(name="Hall", kind="floor", outline=((0.2, 0.2), (4.8, 0.2), (4.8, 4.8), (0.2, 4.8)), waypoints=())
    start, middle, goal = (Pose(x=x, y=2.6) for x in (1.0, 5.1, 9.0))
    route = Route(name="through", start=start, goal=goal, time_limit_s=30, through=(middle,))
    return build_world(
        name="two_rooms",
        occupancy=map_of(cells),
        areas=(post, floor),
        routes=(route,),
        grid_spec=GridSpec(up="x" if up == "x" else "y", spacing_m=0.5, origin=(0.1, 0.1)),
    )


WAY = np.array([(1.0, 2.6), (9.0, 2.6)])


def test_the_width_is_that_between_walls_not_twice_the_clearance_also_for_a_way_askew() -> None:
    world = two_rooms()
    assert free_width_m(world, 2.5, 0.7, yaw=0.0) == pytest.approx(4.9, abs=2 * RESOLUTION_M)
    assert free_width_m(world, 2.5, 0.7) > 3 * human_space(world).clearance(2.5, 0.7)
    assert free_width_m(world, 5.1, 1.0, yaw=0.0) == 0.0  # in the wall
    askew = widths_m(human_space(world), np.array([(5.1, 2.6)]), np.array([math.radians(25)]))
    assert askew[0] == pytest.approx(1.2, abs=0.15)


def test_the_narrow_place_of_a_way_is_the_doorway_with_what_bounds_it_left_and_right() -> None:
    world = two_rooms()
    (passage,) = narrow_passages(world, WAY)
    assert passage.width_m == pytest.approx(1.2, abs=2 * RESOLUTION_M)
    assert passage.x == pytest.approx(5.1, abs=0.15)
    assert passage.left is None and passage.right == "Post"  # driving along +x the post is on the right
    assert narrowest_passage(world, WAY) == passage
    (back,) = narrow_passages(world, WAY[::-1])
    assert (back.left, back.right) == ("Post", None)
    assert narrow_passages(world, np.array([(0.6, 0.7), (4.4, 0.7), (4.4, 4.3)])) == ()
    assert narrow_passages(world, WAY, robot=load_robot("turtlebot3_waffle")) == ()


def test_the_widths_of_the_parts_of_a_drive_are_those_that_its_description_tells() -> None:
    world = two_rooms()
    x = np.array([1.0, 1.0, 2.5, 4.0, 4.9, 6.2, 7.7, 9.0])
    driven = np.column_stack([x, 2.6 + 0.05 * np.sin(x)])
    widths = least_widths_m(world, driven, [0, 1, 3, 5, 7])
    words = describe_route(world, world.route("through"), driven)
    assert f"(free width {min(widths):.1f} m)" in words
    assert [width < 2.0 for width in widths] == [False, False, True, False, False]
    assert least_widths_m(world, driven[:2], [0, 1]) == [widths[0]] * 2  # it stands


@pytest.mark.parametrize("up", ["x", "y"])
def test_positions_and_directions_follow_the_axis_that_points_up(up: str) -> None:
    world = two_rooms(up)
    grid = world.grid
    for waypoint in grid.waypoints:
        row, column = grid.rows[waypoint.row], grid.columns[waypoint.column]
        assert grid.row_positions[row] == getattr(waypoint, up)
        assert grid.column_positions[column] == getattr(waypoint, grid.across)
    words = describe_route(world, world.route("through"))
    assert f"it drives {'up' if up == 'x' else 'right'} " in words
    assert "beside Post (free width 1.2 m)" in words


@pytest.mark.parametrize(
    ("robot", "width_m"), [("tiago_omni", 1.3), ("industrial_amr", 1.65), ("turtlebot3_waffle", 1.18)]
)
def test_the_width_to_pass_follows_the_robot(robot: str, width_m: float) -> None:
    """Measured: the default robot passes from 1.3 m on, the AMR, which cannot step aside, from 1.7 m on."""
    assert passing_m(load_robot(robot)) == pytest.approx(width_m, abs=0.03)
