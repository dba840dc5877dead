"""Contacts of the robot with trolleys and wheelchairs, told from those with walls."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal, cast

import numpy as np
import shapely
from numpy.typing import NDArray

from rvsg.simulation.embedded import base
from rvsg.simulation.embedded.walls import AGAIN_S, FROM, PLACE_X, PLACE_Y, SPEED, UNTIL, Walls
from rvsg.simulation.events import RobotContact

Floats = NDArray[np.float64]

TOUCH_M = 0.01
ON_IT_M = 0.05
"""A contact of the base within this of a trolley is one with the trolley."""


class Touches:
    """The contacts of a run. `names`: each person with what they sit in or push."""

    def __init__(self, names: Sequence[tuple[str, str]], walls: Walls) -> None:
        self._names, self._walls = names, walls
        self._found: dict[int, list[RobotContact]] = {}

    def look(self, i: int, t: float, shape: Any, robot: Any, body: Floats, velocity: tuple[float, float]) -> None:
        """Note a contact where a shape touches the robot; `velocity` is the person's before they are held back."""
        if shape.distance(robot) > TOUCH_M:
            return
        px, py = shapely.get_coordinates(shapely.shortest_line(shape, robot))[0]
        cx, cy = shape.centroid.coords[0]
        nx, ny = cx - float(body[base.X]), cy - float(body[base.Y])
        length = max(1e-9, math.hypot(nx, ny))
        nx, ny = nx / length, ny / length
        yaw, v, side, w = (float(body[part]) for part in (base.YAW, base.V, base.SIDE, base.W))
        at_x, at_y = px - float(body[base.X]), py - float(body[base.Y])
        cos, sin = math.cos(yaw), math.sin(yaw)
        robot_part = (v * cos - side * sin - w * at_y) * nx + (v * sin + side * cos + w * at_x) * ny
        overlap = math.sqrt(shape.intersection(robot).area) if shape.intersects(robot) else 0.0
        self._note(i, t, (px, py), robot_part, -(velocity[0] * nx + velocity[1] * ny), body, overlap)

    def sort_out(self, t: float, placed: Mapping[int, Any]) -> None:
        """Take the contacts that are with a trolley out of those with walls; `placed`: where the trolleys were."""
        contacts, counts = self._walls.contacts, self._walls.counts
        kept = int(counts[0])
        while kept and contacts[kept - 1, UNTIL] > t - 0.15:
            row = contacts[kept - 1]
            place = shapely.Point(row[PLACE_X], row[PLACE_Y])
            whose = [i for i, shape in placed.items() if shape.distance(place) < ON_IT_M]
            if not whose or t - row[FROM] > AGAIN_S:
                break
            kept -= 1
            counts[0] = kept
            self._note(whose[0], float(row[FROM]), (float(row[PLACE_X]), float(row[PLACE_Y])), float(row[SPEED]), 0.0)

    def events(self) -> tuple[RobotContact, ...]:
        """Return the contacts of the run."""
        return tuple(contact for found in self._found.values() for contact in found)

    def _note(
        self, i: int, t: float, place: tuple[float, float], robot_part: float, person_part: float,
        body: Floats | None = None, overlap: float = 0.0,
    ) -> None:  # fmt: skip
        """Begin a contact, or let the last one of the person go on."""
        found = self._found.setdefault(i, [])
        if found and t - found[-1].until_s < AGAIN_S:
            last = found[-1]
            deepest = max(last.overlap_m, round(overlap, 3))
            found[-1] = last.model_copy(update={"until_s": max(last.until_s, round(t, 3)), "overlap_m": deepest})
            return
        bearing = 0.0
        if body is not None:
            bearing = float(base.wrap(math.atan2(place[1] - body[base.Y], place[0] - body[base.X]) - body[base.YAW]))
        name, part = self._names[i]
        found.append(
            RobotContact(
                time_s=round(t, 3), x=round(place[0], 3), y=round(place[1], 3), person=name, until_s=round(t, 3),
                closing_speed_m_s=round(max(0.0, robot_part + person_part), 3), robot_part_m_s=round(robot_part, 3),
                person_part_m_s=round(person_part, 3), bearing_rad=round(bearing, 3), overlap_m=round(overlap, 3),
                part=cast(Literal["trolley", "wheelchair"], part),
            )
        )  # fmt: skip
