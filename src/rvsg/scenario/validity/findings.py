"""Findings, what the checker says, and Repairs, what the mending changed."""

from __future__ import annotations

from rvsg.core.records import Record


class Finding(Record):
    """One reason why a configuration is not valid: who, which task, where in the path, why, and what would help.

    `rule` is a key of `RULES`; `position` counts from 0 in the task's path.
    """

    rule: str
    human: str | None = None
    task: str | None = None
    position: int | None = None
    reason: str
    suggestion: str = ""

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
    """What a repair changed, in words and as the path before and after (both empty where no path changed)."""

    human: str
    task: str
    what: str
    before: tuple[str, ...]
    after: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.human}{f', task {chr(34)}{self.task}{chr(34)}' if self.task else ''}: {self.what}"
