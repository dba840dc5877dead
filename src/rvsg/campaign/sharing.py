"""Makes attempts share what they have in common, so that a long campaign fits in memory.

Every brief names the mission and the requirement and holds what was tried before. Read from a store, or received from a
worker, each is an object of its own; equal ones are replaced by the first. Nothing that an attempt says changes.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import TypeVar, cast

from rvsg.campaign.attempt import Attempt
from rvsg.core.records import Record
from rvsg.scenario.brief import Feedback, Remembered
from rvsg.scenario.scenario import Scenario

T = TypeVar("T")


class Sharing:
    """Replaces parts of attempts by equal parts of the attempts before."""

    def __init__(self) -> None:
        self._known: dict[Hashable, list[object]] = {}
        self._given: dict[frozenset[str], set[str]] = {}

    def __call__(self, attempt: Attempt) -> Attempt:
        """Return the attempt, its parts shared."""
        brief, scenario = attempt.brief, attempt.proposal.scenario
        self._replace(brief, "mission", "requirement", "moved_by")
        if scenario is not None:
            _put(attempt.proposal, "scenario", self._scenario(scenario))
        for name in ("feedback", "untold"):
            told = getattr(brief, name)
            if isinstance(told, Feedback):
                self._feedback(told)
        _put(brief, "memory", tuple(self._remembered(earlier) for earlier in brief.memory))
        self._slim(attempt)
        return attempt

    def _slim(self, part: object) -> None:
        """Share the sets in which pydantic notes which fields were given: one of its own takes more than a record."""
        if isinstance(part, tuple):
            for each in part:
                self._slim(each)
        elif isinstance(part, dict):
            for each in part.values():
                self._slim(each)
        elif isinstance(part, Record):
            given = part.__pydantic_fields_set__
            shared = self._given.setdefault(frozenset(given), given)
            if shared is not given:
                object.__setattr__(part, "__pydantic_fields_set__", shared)
                for each in part.__dict__.values():
                    self._slim(each)

    def _feedback(self, told: Feedback) -> None:
        _put(told, "scenario", self._scenario(told.scenario))
        if told.best is not None:
            _put(told, "best", self._scenario(told.best))

    def _remembered(self, earlier: Remembered) -> Remembered:
        _put(earlier, "scenario", self._scenario(earlier.scenario))
        return self._same(earlier, (id(earlier.scenario), earlier.mean, earlier.runs, earlier.lesson))

    def _scenario(self, scenario: Scenario) -> Scenario:
        self._replace(scenario, "mission")
        for human in scenario.people.humans:
            _put(human, "tasks", tuple(self._same(task, (task.name, task.path)) for task in human.tasks))
        paces = tuple((human.speed_m_s, human.start_delay_s, len(human.tasks)) for human in scenario.people.humans)
        return self._same(scenario, (scenario.description, paces))

    def _replace(self, record: Record, *fields: str) -> None:
        for name in fields:
            _put(record, name, self._same(getattr(record, name), name))

    def _same(self, part: T, key: Hashable) -> T:
        """Return the first part that is equal to this one, among those of its key."""
        known = cast(list[T], self._known.setdefault(key, []))
        for other in known:
            if other is part or other == part:
                return other
        known.append(part)
        return part


def _put(record: Record, name: str, part: object) -> None:
    """Replace a field of a frozen record by an equal object."""
    record.__dict__[name] = part
