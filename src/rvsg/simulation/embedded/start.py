"""Checks before a run: the robot's start against the map, the objects that lidars see, and people."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Pose
from rvsg.robots.polygons import rectangle
from rvsg.simulation.embedded.contact import overlap_at_start
from rvsg.simulation.embedded.navigation.costmap import LETHAL
from rvsg.simulation.embedded.people.crowd import Crowd
from rvsg.simulation.embedded.scene import Scene, Surroundings
from rvsg.simulation.embedded.walls import free_pose

Floats = NDArray[np.float64]

KEPT_STARTS = 8
"""The runs of a campaign have few starts, and what is in the way there does not change."""
START_OVERLAP_M = 0.01
"""In the default profile a run does not start where the robot's body and a person overlap by more than this."""


def is_blocked(around: Surroundings, scene: Scene, start: Pose, offset: tuple[float, float]) -> bool:
    """Whether the robot's footprint at the start lies on an occupied cell, off the map, or in what a lidar sees.

    So it is where a lidar is inside something solid, from where it would see through walls.
    """
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    (rear, right), (front, left) = rectangle(around.robot.footprint)
    resolution, static = scene.resolution, scene.static
    n = max(3, int((front - rear) / (0.5 * resolution)))
    ahead, aside = np.meshgrid(np.linspace(rear, front, n), np.linspace(right, left, n))
    x = start.x + ahead * cos - aside * sin
    y = start.y + ahead * sin + aside * cos
    columns = np.floor((x - offset[0] - scene.origin_x) / resolution).astype(int)
    rows = np.floor((y - offset[1] - scene.origin_y) / resolution).astype(int)
    if rows.min() < 0 or columns.min() < 0 or rows.max() >= static.shape[0] or columns.max() >= static.shape[1]:
        return True
    if (static[rows, columns] == LETHAL).any():
        return True
    return _is_in_solid(around, start)


@lru_cache(maxsize=KEPT_STARTS)
def free_start(around: Surroundings, start: Pose) -> Pose | None:
    """Return the pose nearest to `start` at which the robot's body overlaps nothing; None where there is none."""
    return free_pose(around.walls(), start)


@lru_cache(maxsize=KEPT_STARTS)
def _is_in_solid(around: Surroundings, start: Pose) -> bool:
    """Whether the robot's footprint or a lidar is in what the lidar plane cuts."""
    if around.is_inside_solid(start.x, start.y) or _has_lidar_in_solid(around, start):
        return True
    (rear, right), (front, left) = rectangle(around.robot.footprint)
    return _crosses(around.edges, start, (rear, front), (right, left))


def _crosses(edges: Floats, start: Pose, length: tuple[float, float], width: tuple[float, float]) -> bool:
    """Whether any edge meets the rectangle of the robot (clipping each edge to it, in the robot's frame)."""
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    a = edges[:, :2] - (start.x, start.y)
    d = edges[:, 2:] - edges[:, :2]
    enter = np.zeros(len(edges))
    leave = np.ones(len(edges))
    for (ux, uy), (low, high) in (((cos, sin), length), ((-sin, cos), width)):
        begin = a[:, 0] * ux + a[:, 1] * uy
        step = d[:, 0] * ux + d[:, 1] * uy
        still = np.abs(step) < 1e-12
        safe = np.where(still, 1.0, step)
        one, two = (low - begin) / safe, (high - begin) / safe
        enter = np.where(
            still, np.where((low <= begin) & (begin <= high), enter, 2.0), np.maximum(enter, np.minimum(one, two))
        )
        leave = np.where(still, leave, np.minimum(leave, np.maximum(one, two)))
    return bool((enter <= leave).any())


def _has_lidar_in_solid(around: Surroundings, start: Pose) -> bool:
    """Whether a lidar is inside a wall or an object; one on a mast that stands out of the footprint may be."""
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    return any(
        around.is_inside_solid(start.x + cos * q.x - sin * q.y, start.y + sin * q.x + cos * q.y)
        for q in around.robot.lidars
    )


def stands_on_person(crowd: Crowd, start: Pose) -> bool:
    """Whether the robot's body at the start overlaps a person by more than `START_OVERLAP_M`."""
    people = np.column_stack([crowd.x, crowd.y])
    return overlap_at_start(crowd.outline, people, crowd.radius, start.x, start.y, start.yaw) > START_OVERLAP_M
