"""The warehouse against the study: the paths its model wrote, and the map its robot recorded."""

import json
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt
from tests.published_data import published_data

from rvsg.world.occupancy import load_nav2_map
from rvsg.world.space import frame_of
from rvsg.world.world_folder import load_world

DATA = published_data()
pytestmark = pytest.mark.skipif(DATA is None, reason="the published study's data is not there")


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


def test_the_map_drawn_from_the_objects_is_the_map_the_study_recorded() -> None:
    """The recorded map is shifted by about 0.15 m against the world, and shows only what the robot came to see."""
    assert DATA is not None
    drawn = load_world("warehouse").occupancy
    recorded = load_nav2_map(DATA / "maps" / "study_warehouse.yaml").occupancy
    shift = np.array([0.15, 0.15])
    to_obstacle = distance_transform_edt(drawn.cells != 100) * drawn.resolution

    def places(value: int) -> np.ndarray:
        return frame_of(recorded).to_metres(np.argwhere(recorded.cells == value)[:, ::-1] + 0.5) + shift

    near = frame_of(drawn).looked_up(1 + to_obstacle, places(100))  # 0: off the map
    assert ((near > 0) & (near <= 1.101)).mean() > 0.96
    free = frame_of(drawn).looked_up((drawn.cells == 0).astype(np.uint8), places(0))
    assert free.mean() > 0.96
