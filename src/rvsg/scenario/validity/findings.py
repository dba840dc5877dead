"""Findings of the checker, and Repairs, the changes of the repair."""

from __future__ import annotations

from rvsg.core.records import Record


class Finding(Record):
    """One reason why a configuration is not valid."""

    rule: str
    """The rule it breaks, a key of `RULES`."""
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
