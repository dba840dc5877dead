"""Limits of a valid configuration, and the findings and repairs of the checker."""

from __future__ import annotations

from rvsg.core.records import Record

MAX_HUMANS = 100
"""More people than this in one configuration are refused (Brief allows as many)."""

SPEED_RANGE_M_S = (0.3, 2.0)
"""Walking, not running: an ambling and a fast walk. HuNavSim's sample people walk at up to 1.5 m/s."""

ROBOT_RADIUS_M = 0.35
"""Radius of the disc that stands for a robot known by name only, and for the robot in the study's metrics."""

START_CLEARANCE_M = 0.5
"""Gap that RVSG's generators keep between robot and people at the start: the clearance that ISO 3691-4 requires beside
a driverless truck."""


class Finding(Record):
    """One reason why a configuration is not valid."""

    rule: str
    """The rule it breaks, a row of `docs/reference/validity-rules.md`."""
    human: str | None = None
    """The name of the person."""
    task: str | None = None
    """The name of the person's task."""
    position: int | None = None
    """The index in the path of the task, from 0."""
    reason: str
    suggestion: str = ""
    """How to correct it."""

    def __str__(self) -> str:
        place = ", ".join(
            part
            for part in (
                self.human,
                f'task "{self.task}"' if self.task else None,
                f"waypoint {self.position + 1}" if self.position is not None else None,
            )
            if part
        )
        return f"{place + ': ' if place else ''}{self.reason}{' ' + self.suggestion if self.suggestion else ''}"


class Repair(Record):
    """One change made by a repair."""

    human: str
    task: str
    what: str
    """The change in words."""
    before: tuple[str, ...]
    """The path before; both paths are empty if no path changed."""
    after: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.human}{f', task {chr(34)}{self.task}{chr(34)}' if self.task else ''}: {self.what}"
