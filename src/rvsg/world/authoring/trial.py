"""What a trial of a world in a simulator tells: how the robot drives a route alone, and who arrives on a hop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from rvsg.core.records import Record
from rvsg.world.world import Route, World

Hop = tuple[str, str]


class Drive(Record):
    """How the robot drives a route with nobody about."""

    arrived: bool
    outcome: str
    """How the run ended, in words."""
    time_s: float
    """When the run ended: on arrival, or at the time limit of the trial."""
    x: float
    """Where the robot is at the end, metres, world frame."""
    y: float
    """Where the robot is at the end, metres, world frame."""
    touched_s: tuple[float, ...] = ()
    """When the robot's body touches an obstacle."""
    way: tuple[tuple[float, float], ...] = ()
    """Points of the way it drove, metres, world frame; empty where it is not known."""


class Trial(Protocol):
    """Tries a world out in a simulator. The world folders do not import the simulator; the caller passes it in."""

    def drive(self, world: World, route: Route) -> Drive:
        """Drive a route once, with nobody about. A bad start or an unreachable goal is an outcome."""
        ...

    def not_walked(self, world: World, hops: Sequence[Hop]) -> tuple[Hop, ...]:
        """Return the hops, each as (from, to), on which a person who walks alone does not arrive in time."""
        ...
