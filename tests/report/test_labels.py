from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis.strategies import floats, lists, tuples

from rvsg.report.stills import beside, box_around, free_place, pins, spread

INSIDE = (0.0, 0.0, 30.0, 20.0)
PLACE = tuples(floats(1.0, 29.0), floats(1.0, 19.0))


@given(lists(PLACE, max_size=8))
def test_no_marker_covers_another_one_or_leaves_the_map(points: list[tuple[float, float]]) -> None:
    radius = 0.5
    placed = spread(points, radius, INSIDE)
    for (ax, ay), (bx, by) in itertools.combinations(placed, 2):
        assert max(abs(ax - bx), abs(ay - by)) >= 2 * radius - 1e-9
    assert all(0.5 <= x <= 29.5 and 0.5 <= y <= 19.5 for x, y in placed)
    if points:
        assert placed[0] == points[0]


def test_markers_on_one_point_all_find_a_place() -> None:
    assert len({(round(x, 3), round(y, 3)) for x, y in spread([(15.0, 10.0)] * 8, 0.5, INSIDE)}) == 8


def test_a_name_stands_above_its_body_unless_that_is_taken() -> None:
    half = (1.0, 0.2)
    above = free_place(beside(10.0, 10.0, 0.4, half), half, [], INSIDE)
    assert above == (10.0, 9.4)
    below = free_place(beside(10.0, 10.0, 0.4, half), half, [box_around(*above, *half)], INSIDE)
    assert below == (10.0, 10.6)


def test_a_pin_that_moved_has_a_line_to_its_point() -> None:
    assert "leader" not in "".join(pins([(5.0, 5.0), (20.0, 5.0)], ["1", "2"], "0 0 30 20"))
    assert "".join(pins([(5.0, 5.0), (5.1, 5.0)], ["1", "2"], "0 0 30 20")).count("leader") == 1
