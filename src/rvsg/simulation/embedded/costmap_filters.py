"""Masks of Nav2's costmap filters, as grids over the cells of a world's map: keepout costs and shares of speed."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.robots.robot import CostmapFilter, Robot
from rvsg.simulation.costmap import LETHAL, UNKNOWN
from rvsg.world.world import OccupancyMap

Which = Literal["local", "global"]


def on_map(each: CostmapFilter, occupancy: OccupancyMap) -> NDArray[np.int16]:
    """Return the value of a mask at the centre of every cell of the map; -1 where it is unknown or does not reach.

    Raises:
        InputError: nowhere does the mask say anything.
    """
    values, lengths = np.array(each.cells, np.int64).T
    if lengths.sum() % each.columns:
        raise InputError(f"A mask of {lengths.sum()} cells has no rows of {each.columns}.")
    mask = np.repeat(values.astype(np.int16), lengths).reshape(-1, each.columns)
    size, origin = occupancy.resolution, occupancy.origin
    at = []
    for count, begin, corner in zip(occupancy.cells.shape, (origin.y, origin.x), (each.y, each.x), strict=True):
        at.append(np.floor((begin + (np.arange(count) + 0.5) * size - corner) / each.resolution_m).astype(np.int64))
    within = [(k >= 0) & (k < most) for k, most in zip(at, mask.shape, strict=True)]
    found = np.full(occupancy.cells.shape, -1, np.int16)
    found[np.ix_(*within)] = mask[np.ix_(*(k[inside] for k, inside in zip(at, within, strict=True)))]
    if (found < 0).all():
        high, wide = (count * each.resolution_m for count in mask.shape)
        name = each.kind.partition("_")[0]
        raise InputError(
            f"The mask of the {name} filter, {wide:g} x {high:g} m from ({each.x:g}, {each.y:g}) on, says nothing of "
            "the map of this world. Take the parameter file that belongs to the map."
        )
    return found


def keepout_costs(robot: Robot, occupancy: OccupancyMap, which: Which) -> NDArray[np.uint8]:
    """Return the costs that keepout filters give to the cells of the map in a costmap; empty without such a filter.

    UNKNOWN is where no mask says anything.
    """
    filters = [f for f in robot.navigation.costmap_filters if f.kind == "keepout" and which in f.costmaps]
    if not filters:
        return np.zeros((0, 0), np.uint8)
    highest = np.max([on_map(each, occupancy) for each in filters], axis=0)
    return np.where(highest < 0, UNKNOWN, np.floor(highest * (LETHAL / 100.0) + 0.5)).astype(np.uint8)


def speed_shares(robot: Robot, occupancy: OccupancyMap, which: Which) -> NDArray[np.float64]:
    """Return the highest speed in every cell of the map, as a share of that without a speed filter.

    1 where there is no limit, -1 where the limit stays what it was; empty without such a filter.
    """
    filters = [f for f in robot.navigation.costmap_filters if f.kind != "keepout" and which in f.costmaps]
    if not filters:
        return np.zeros((0, 0))
    each = filters[0]
    values = on_map(each, occupancy)
    full = 100.0 if each.kind == "speed_percent" else each.full_m_s or robot.limits.speed_m_s
    shares = (each.base + each.multiplier * values) / full
    without = (values == 0) | (shares <= 0.0) | ((each.kind == "speed_percent") & (shares > 1.0))
    return np.where(values < 0, -1.0, np.where(without, 1.0, shares))
