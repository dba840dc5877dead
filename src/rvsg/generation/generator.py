"""The Generator protocol and its answer, the Proposal."""

from __future__ import annotations

from typing import Any, Protocol

from pydantic import Field

from rvsg.core.records import Record
from rvsg.generation.rehearsal import Rehearse
from rvsg.generation.vlm.watching import Tell
from rvsg.scenario.brief import Brief
from rvsg.scenario.rules import Finding, Repair
from rvsg.scenario.scenario import Scenario
from rvsg.world.world import World


class Call(Record):
    """One call of a model, as it is kept: what it was for, what it cost, and the key of its recording.

    `estimated` where the service did not count the tokens itself.
    """

    purpose: str
    model: str
    input_tokens: int = 0
    cached_tokens: int = 0
    output_tokens: int = 0
    cost_usd: float | None = None
    latency_s: float = 0.0
    recording: str | None = None
    error: str | None = None
    estimated: bool = False


class Proposal(Record):
    """A generator's answer. `scenario` is None where nothing valid came of it; the problems say why.

    `first_findings` are what the checker said of the very first answer, `problems` what was left at the end,
    `repairs` what was changed to make it valid.
    """

    generator: str
    scenario: Scenario | None
    reasoning: str = ""
    lesson: str = ""
    """What the generator learnt from the measurements so far, in one to three sentences; empty where it says nothing.
    The next scenarios are told of it."""
    plan: dict[str, dict[str, float]] = Field(default_factory=dict)
    """When the generator means each person to reach which waypoint, in seconds: name, waypoint, time."""
    first_findings: tuple[Finding, ...] = ()
    problems: tuple[Finding, ...] = ()
    repairs: tuple[Repair, ...] = ()
    corrections: int = 0
    calls: tuple[Call, ...] = ()
    extra: dict[str, Any] = Field(default_factory=dict)


class Generator(Protocol):
    """Anything that answers a Brief.

    It is deterministic: an equal brief (its seed included) gives an equal proposal, except where an outside model
    answers, which is then recorded. Derive a generator from this class: everything but `name` and `propose` has a
    default.
    """

    @property
    def name(self) -> str:
        """The registered name."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know after the last proposal, e.g. where a replay diverged from its record."""
        return ()

    @property
    def asks_a_model(self) -> bool:
        """Whether a proposal costs calls of a model, so that a strategy should ask for few of them."""
        return False

    def watch(self, tell: Tell | None) -> None:
        """Tell of every call of a model while it is made; None ends it. Without a model there is nothing to tell."""
        return

    def allow_rehearsals(self, rehearse: Rehearse) -> None:
        """Accept a function that simulates a configuration once, for generators that try an answer before giving it."""
        return

    def propose(self, brief: Brief, world: World) -> Proposal:
        """Answer the brief; a bad answer is a Proposal with problems, only a missing one is a GenerationError."""
        ...

    def close(self) -> None:
        """Release every resource. May be called again."""
        return
