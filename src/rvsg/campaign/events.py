"""Events of a running campaign, in the order they happen. An observer may ignore them: no record depends on one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rvsg.campaign.attempt import Attempt, Failure
from rvsg.campaign.measuring import FinishedRun
from rvsg.campaign.plan import Plan
from rvsg.generation.vlm.access import CallNews
from rvsg.scenario.brief import Brief

Purpose = Literal["search", "confirmation", "baseline", "removal", "shrinking"]


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happened in the campaign of this name."""

    campaign: str


@dataclass(frozen=True, kw_only=True)
class Started(Event):
    """The campaign begins, or resumes after `attempts` finished attempts with `runs` runs."""

    plan: Plan
    attempts: int
    runs: int


@dataclass(frozen=True, kw_only=True)
class Message(Event):
    """Something a person should know, e.g. that the simulator is being compiled."""

    text: str


@dataclass(frozen=True, kw_only=True)
class Proposing(Event):
    """The generator is asked for attempt `index`."""

    index: int
    brief: Brief


@dataclass(frozen=True, kw_only=True)
class ModelCall(Event):
    """A call of a language model begins, waits or is answered."""

    news: CallNews


@dataclass(frozen=True, kw_only=True)
class RunMade(Event):
    """A run of attempt `index` is finished, was already known, or could not be made."""

    index: int
    purpose: Purpose
    run: FinishedRun | Failure


@dataclass(frozen=True, kw_only=True)
class Attempted(Event):
    """An attempt is complete and stored."""

    attempt: Attempt


@dataclass(frozen=True, kw_only=True)
class Confirming(Event):
    """The confirmation of a candidate begins: number `number` of `of`, in at most `runs` runs."""

    candidate: Attempt
    number: int
    of: int
    runs: int


@dataclass(frozen=True, kw_only=True)
class Explaining(Event):
    """Runs begin that show what people contribute: those without the people in `without`; `people` are left."""

    without: tuple[str, ...]
    people: int
    runs: int


@dataclass(frozen=True, kw_only=True)
class Shrinks(Event):
    """The scenario of a confirmation is shrunk, in at most `runs` runs."""

    confirmation: Attempt
    runs: int


@dataclass(frozen=True, kw_only=True)
class Finished(Event):
    """The campaign ended; not `complete` where it was cancelled."""

    complete: bool
    attempts: int
