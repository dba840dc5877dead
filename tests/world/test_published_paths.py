"""The grid against the paths that the study's model wrote: what is usual there is a neighbour here."""

import json
from collections import Counter
from itertools import pairwise

import pytest
from tests.published_data import published_data

from rvsg.world.load import load_world

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
