"""Event records: what happened in a run, to whom, where and when.

`rvsg.evaluation.detection.events_of` computes the events of a run; every story of a run is told from them.
What a simulator measures of some of them is stored with the run (`rvsg.simulation.run`, which says why it is apart).
Every event has a `kind`, a time in seconds since the start of the run, and a place. All events are JSON-able.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Literal
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter

from rvsg.core.records import Record
from rvsg.simulation.run import Outcome
from rvsg.world.grid import Grid
from rvsg.world.world import World


class Place(Record):
    """Where an event happened."""

    x: float
    """Metres, world frame."""
    y: float
    """Metres, world frame."""
    waypoint: str = ""
    """The nearest waypoint of the world's grid; empty if the world is not given."""

    def __str__(self) -> str:
        return self.waypoint or f"({self.x:.1f}, {self.y:.1f})"


PlaceAt = Callable[[float, float], Place]
"""From x and y in metres to the place with the name of its waypoint."""


class _Event(Record):
    """The fields that all events share."""

    time_s: float
    """Seconds since the start of the run."""
    place: Place
    """Where it happened: the robot's position, or the person's for an event of a person."""


class _Lasting(_Event):
    """An event with a duration."""

    until_s: float
    """When it ended, seconds since the start of the run; the end of the run where it did not end."""

    @property
    def duration_s(self) -> float:
        """Return how long it lasted, seconds."""
        return self.until_s - self.time_s


class Contact(_Lasting):
    """The bodies of the robot and a person touch."""

    kind: Literal["contact"] = "contact"
    person: str
    closing_speed_m_s: float
    """Speed of approach along the line between the two when they first touch; 0 if they do not approach."""
    robot_speed_m_s: float
    """Largest speed of the robot while they touch."""
    bearing_rad: float
    """Direction of the person off the robot's heading at first touch; 0 ahead, positive to the left."""
    overlap_m: float
    """How far the bodies overlap at most; 0 if the simulator keeps them apart."""
    moved_by: Literal["robot", "person", "both", "neither"]
    """Who moved into whom; `both` where each contributes at least a third of the approach."""


class ObstacleContact(_Lasting):
    """The robot's body touches a wall, an object or the leaf of a door."""

    kind: Literal["obstacle_contact"] = "obstacle_contact"
    speed_m_s: float
    """The robot's speed at first touch."""
    door: Annotated[str, Field(exclude_if=lambda door: door == "")] = ""
    """The name of the door whose leaf it touches first; empty for anything else, or if the world is not given."""


class NearMiss(_Event):
    """The robot passes a person closely without touching; the time is that of the smallest gap."""

    kind: Literal["near_miss"] = "near_miss"
    person: str
    gap_m: float
    """Smallest gap between the bodies."""
    relative_speed_m_s: float
    """Speed of the robot relative to the person at that time."""
    bearing_rad: float
    """Direction of the person off the robot's heading; 0 ahead, positive to the left."""


class HardBrake(_Lasting):
    """The robot brakes hard before it arrives."""

    kind: Literal["hard_brake"] = "hard_brake"
    deceleration_m_s2: float
    """Largest mean deceleration over half a second."""
    from_speed_m_s: float
    to_speed_m_s: float
    person: str = ""
    """The nearest person if within 2 m; else empty."""


Reason = Literal[
    "contact", "obstacle_contact", "person_ahead", "person_close", "goal_taken", "obstacle", "recovery", "unknown"
]


class StandStill(_Lasting):
    """The robot neither drives nor turns for at least a second on its way."""

    kind: Literal["standstill"] = "standstill"
    reason: Reason
    """What holds it up for most of the standstill; `goal_taken`: a person stands on its goal."""
    person: str = ""
    """The person of the reason; else empty."""


class Replan(_Event):
    """The global planner returns a path that differs clearly from the one before."""

    kind: Literal["replan"] = "replan"
    length_m: float
    """Length of the new path."""
    deviation_m: float
    """Largest distance of the new path from the one before."""


class Recovery(_Lasting):
    """The navigation runs a recovery behaviour."""

    kind: Literal["recovery"] = "recovery"
    action: Literal["clear_costmaps", "spin", "wait", "back_up", "other"]


class BlockedGoal(_Lasting):
    """A person stands so near the goal that the robot cannot take its place there, while the robot is near."""

    kind: Literal["blocked_goal"] = "blocked_goal"
    person: str


class PersonStuck(_Lasting):
    """A person who has somewhere to go stays on the spot, for at least 5 s."""

    kind: Literal["person_stuck"] = "person_stuck"
    person: str
    reason: Literal["robot", "person", "unknown"]
    """Who stands next to the person when it begins."""


class PersonReached(_Event):
    """A person reaches the end of a task for the first time."""

    kind: Literal["person_reached"] = "person_reached"
    person: str
    task: str
    """Name of the task."""


class PersonPaused(_Lasting):
    """A person stands at a waypoint as the task says."""

    kind: Literal["person_paused"] = "person_paused"
    person: str


class PersonReacted(_Lasting):
    """The robot's presence triggers a person's behaviour."""

    kind: Literal["person_reacted"] = "person_reacted"
    person: str
    behaviour: str
    """The behaviour, e.g. `surprised`."""


class TimeOut(_Event):
    """The time limit passes before the robot reaches its goal."""

    kind: Literal["time_out"] = "time_out"
    remaining_m: float
    """Straight distance from the robot to its goal."""


class Abort(_Event):
    """The run ends before the goal and before the time limit."""

    kind: Literal["abort"] = "abort"
    outcome: Outcome
    """Why: navigation gave up, no path was found, or the robot could not start."""
    remaining_m: float
    """Straight distance from the robot to its goal."""


class Arrival(_Event):
    """The robot reaches its goal."""

    kind: Literal["arrival"] = "arrival"


Event = Annotated[
    Contact
    | ObstacleContact
    | NearMiss
    | HardBrake
    | StandStill
    | Replan
    | Recovery
    | BlockedGoal
    | PersonStuck
    | PersonReached
    | PersonPaused
    | PersonReacted
    | TimeOut
    | Abort
    | Arrival,
    Field(discriminator="kind"),
]
Events = tuple[Event, ...]

EVENTS: TypeAdapter[Events] = TypeAdapter(Events)
"""Reads and writes a list of events: `EVENTS.dump_json(events)`, `EVENTS.validate_json(text)`."""


Floats = NDArray[np.float64]


class WaypointNames:
    """Looks up the valid waypoint nearest to a point; ties go to the earlier in grid order, as in `Grid.nearest`."""

    def __init__(self, grid: Grid) -> None:
        valid = [w for w in grid.waypoints if w.human]
        self.names = [w.name for w in valid]
        self.at = np.array([(w.x, w.y) for w in valid]).reshape(-1, 2)

    def nearest(self, x: Floats, y: Floats) -> list[str]:
        """Return one name for each of the points x (K,), y (K,), metres; empty names where the grid has no waypoint."""
        if not self.names:
            return [""] * len(x)
        squared = (self.at[None, :, 0] - x[:, None]) ** 2 + (self.at[None, :, 1] - y[:, None]) ** 2
        return [self.names[i] for i in squared.argmin(axis=1)]


def place_name(world: World, x: float, y: float) -> str:
    """Return the name by which findings, failures and maps speak of a position (m).

    It is the labelled area whose waypoints are nearest; where nothing is labelled, the nearest waypoint.
    """
    if world not in _areas:
        grid = world.grid
        at = [(area.name, [grid.position(w) for w in area.waypoints if w in grid.by_name]) for area in world.areas]
        _areas[world] = [(name, points) for name, points in at if points]
    nearest = [(min(math.dist((x, y), at) for at in points), name) for name, points in _areas[world]]
    return min(nearest)[1] if nearest else world.grid.nearest(x, y)


_areas: WeakKeyDictionary[World, list[tuple[str, list[tuple[float, float]]]]] = WeakKeyDictionary()
"""The labelled areas of worlds that have waypoints, with where these are."""
