"""Zones drawn where a stack fails: discs in which Nav2's filters limit the speed, or which the robot keeps out of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Record
from rvsg.simulation.stacks.parameters import Parameter
from rvsg.world.occupancy import runs_of

MOST = 3
REACH_M = 2.0
"""Failures this near to one another are of one place."""
MARGIN_M = 0.5
SMALLEST_M, LARGEST_M = 1.5, 2.5
"""Radii of discs: as far as failures lie from their middle, and a margin."""
LEAST_RUNS, LEAST_SHARE = 2, 0.1
"""A disc holds so many violating runs, and such a share of them."""
PERCENT = (50.0, 30.0)
"""Speed limits that are tried, of the highest speed of the local planner."""
COSTMAPS = {"keepout": ["local", "global"], "speed_percent": ["global"]}
"""Where each filter belongs, as in Nav2's own parameter files."""


class Zone(Record):
    """A disc around failures."""

    x: float
    """Its middle in the map frame, m."""
    y: float
    radius_m: float
    runs: int
    """Violating runs before tuning whose decisive moment is of it."""


class Zones(Record):
    """The zones of a map, and what settings of them mean to Nav2."""

    zones: tuple[Zone, ...]
    found: int
    """Violating runs before tuning."""
    x: float
    """Lower left corner of the masks in the map frame, m; they have the cells of the map."""
    y: float
    resolution_m: float
    rows: int
    columns: int

    @property
    def sources(self) -> list[str]:
        """Why and where each zone is tried."""
        return [
            f"{each.runs} of {self.found} violating runs, {each.radius_m:g} m around ({each.x:g}, {each.y:g})"
            for each in self.zones
        ]

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the two numbers of each zone: its speed limit, 100 % without one, and whether it is kept out of."""
        found = []
        for k, source in enumerate(self.sources, 1):
            of = partial(Parameter, group=f"zone {k}", source=source)
            found.append(of(name=f"zone_{k}.speed_percent", low=10.0, high=100.0, present=100.0, unit="%"))
            found.append(of(name=f"zone_{k}.keepout", low=0.0, high=1.0, present=0.0, whole=True))
        return tuple(found)

    def settings(self) -> list[dict[str, float]]:
        """Return what is tried: each limit in each zone and in all of them, and each zone to be kept out of."""
        numbers = range(1, len(self.zones) + 1)
        limits = [{f"zone_{k}.speed_percent": percent} for k in numbers for percent in PERCENT]
        together = [{f"zone_{k}.speed_percent": percent for k in numbers} for percent in PERCENT]
        keepouts = [{f"zone_{k}.keepout": 1.0} for k in numbers]
        return [*limits, *(together if len(self.zones) > 1 else ()), *keepouts]

    def masks(self, values: Mapping[str, float]) -> dict[str, NDArray[np.int16]]:
        """Return the masks of a setting (rows, columns), the lowest y first, by kind; none that limits nothing."""
        y, x = np.ogrid[: self.rows, : self.columns]
        speed, keepout = np.zeros((2, self.rows, self.columns), np.int16)
        for k, each in enumerate(self.zones, 1):
            dx = self.x + (x + 0.5) * self.resolution_m - each.x
            dy = self.y + (y + 0.5) * self.resolution_m - each.y
            disc = dx * dx + dy * dy <= each.radius_m**2
            percent = round(values.get(f"zone_{k}.speed_percent", 100.0))
            if percent < 100:
                speed[disc] = np.where(speed[disc] > 0, np.minimum(speed[disc], percent), percent)
            if values.get(f"zone_{k}.keepout", 0.0):
                keepout[disc] = 100
        return {kind: mask for kind, mask in (("keepout", keepout), ("speed_percent", speed)) if mask.any()}

    def filters(self, values: Mapping[str, float]) -> list[dict[str, Any]]:
        """Return the option `costmap_filters` of a setting."""
        place = {"x": self.x, "y": self.y, "resolution_m": self.resolution_m, "columns": self.columns}
        return [
            {"kind": kind, "costmaps": COSTMAPS[kind], **place, "cells": runs_of(mask)}
            for kind, mask in self.masks(values).items()
        ]


def zones_around(places: Sequence[tuple[float, float]]) -> tuple[Zone, ...]:
    """Return discs around places where most failures are near one another, at most `MOST`, the fullest first."""
    points, found = np.array(places, np.float64).reshape(-1, 2), list[Zone]()
    least = max(LEAST_RUNS, LEAST_SHARE * len(points))
    while len(points) and len(found) < MOST:
        near = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1)) <= REACH_M
        of_one = near[near.sum(axis=1).argmax()]
        if of_one.sum() < least:
            break
        x, y = np.round(points[of_one].mean(axis=0), 2)
        farthest = float(np.hypot(*(points[of_one] - (x, y)).T).max())
        radius = round(min(LARGEST_M, max(SMALLEST_M, farthest + MARGIN_M)), 1)
        found.append(Zone(x=float(x), y=float(y), radius_m=radius, runs=int(of_one.sum())))
        points = points[~of_one]
    return tuple(found)
