"""Lidar ranges against plain geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rvsg.simulation.embedded.lidar import FAR, NO_RETURN, place_legs, ray_directions, scan

VIEW = math.radians(270.0)


@pytest.mark.parametrize("seed", range(4))
def test_ranges_are_those_of_the_nearest_edge_or_leg_along_each_ray(seed: int) -> None:
    rng = np.random.default_rng(seed)
    edges = rng.uniform(-3, 3, (25, 4))
    legs = rng.uniform(-2, 2, (6, 2))
    legs = legs[np.hypot(*legs.T) > 0.2]
    bearing = float(rng.uniform(-4, 4))
    ranges = np.zeros(273)
    every = np.arange(25, dtype=np.int32)
    scan(ranges, ray_directions(273, VIEW), 0.1, -0.2, bearing, edges, every, legs, False, VIEW, 3.5)
    for k, measured in enumerate(ranges):
        angle = bearing + k * VIEW / 272
        ray = np.array([math.cos(angle), math.sin(angle)])
        hits = []
        for ax, ay, bx, by in edges - np.array([0.1, -0.2, 0.1, -0.2]):
            across = ray[0] * (by - ay) - ray[1] * (bx - ax)
            along = (ax * (by - ay) - ay * (bx - ax)) / across
            share = (ax * ray[1] - ay * ray[0]) / across
            if along > 0 and 0 <= share <= 1:
                hits.append(along)
        for leg in legs - (0.1, -0.2):
            middle = leg @ ray
            inside = 0.07**2 - (leg @ leg - middle**2)
            if inside > 0 and middle > 0:
                hits.append(middle - math.sqrt(inside))
        assert measured == (pytest.approx(min(hits), abs=1e-9) if hits else NO_RETURN)


def test_in_a_closed_place_an_open_ray_returns_from_far() -> None:
    ranges, edges, legs = np.zeros(91), np.zeros((0, 4)), np.zeros((0, 2))
    scan(ranges, ray_directions(91, VIEW), 0.0, 0.0, 0.0, edges, np.zeros(0, np.int32), legs, True, VIEW, 3.5)
    assert (ranges == FAR).all()


def test_legs_swing_against_each_other_beside_the_middle() -> None:
    legs = np.zeros((2, 2))
    one = np.ones(1)
    place_legs(legs, one * 2, one * 3, np.zeros(1), one * 0.3)
    assert np.allclose(legs, [[2.22, 3.09], [1.78, 2.91]])
