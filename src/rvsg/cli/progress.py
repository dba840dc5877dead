"""Progress of a campaign on standard error: its stages with what is left, in a line on a terminal.

Redirected, a line for the beginning of each stage and for every tenth of it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType
from typing import Literal, Self

from rich.status import Status

from rvsg.cli.console import console, say
from rvsg.evaluation.verdict import number, violated
from rvsg.generation.vlm.access import CallNews
from rvsg.generation.vlm.model import Spending
from rvsg.report.terminal import describe_spending
from rvsg.runs.attempt import Attempt, Plan
from rvsg.runs.runner import FinishedRun
from rvsg.search.confirmation import FEWEST_WITHOUT_ONE, WITHOUT_ONE
from rvsg.search.execution import (
    AloneStarted,
    AttemptFinished,
    ConfirmationStarted,
    Event,
    ExplanationStarted,
    Message,
    ModelCall,
    ProposalStarted,
    ReductionStarted,
    RunFinished,
)

Stage = Literal["prepare", "alone", "search", "confirm", "cause", "shrink"]
STAGES: tuple[Stage, ...] = ("prepare", "alone", "search", "confirm", "cause", "shrink")
AFTERWARDS = 2
"""Runs that name causes and shrink failures, at most, as a multiple of the confirmation runs; until they are known."""


class CampaignProgress:
    """Shows how far a campaign is; give it every event of the campaign.

    Args:
        attempts: the attempts stored earlier.
        name: of a campaign that runs beside others; prefixes its lines, which are not drawn over each other.
        check: called with every event; it may raise KeyboardInterrupt.
    """

    def __init__(
        self, plan: Plan, attempts: list[Attempt], *, name: str = "", check: Callable[[], None] = lambda: None
    ) -> None:
        self.plan = plan
        self.check = check
        self.name = f"{name}: " if name else ""
        self.worst: float | None = None
        self.known = {m.run_id for a in attempts for m in a.measurements}
        self.confirmed: list[Attempt] = []
        self.stage: Stage = "prepare"
        self.done, self.total = 0, 0
        """Runs of the stage, and the most that it can need; of shrinking, failures."""
        self.searched = 0
        self.spent: Spending | None = None
        self.made, self.begin = 0, time.monotonic()
        """Runs of this session, and when the first of them began."""
        for attempt in attempts:
            self._note(attempt)
        self.line = Status("", console=console()) if console().is_terminal and not name else None

    def __enter__(self) -> Self:
        if self.line:
            self.line.start()
        self._enter("prepare", 0)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self.line:
            self.line.stop()

    def __call__(self, event: Event) -> None:
        """Show an event."""
        self.check()
        match event:
            case Message():
                say(f"{self.name}{event.text}")
            case AloneStarted():
                self._enter("alone", event.runs)
            case ProposalStarted():
                self._enter("search", self.plan.search_runs, self.searched)
            case ModelCall():
                self._calling(event.news)
            case RunFinished():
                self._made(event)
            case AttemptFinished():
                self._note(event.attempt)
                if event.attempt.same_as is not None:
                    same = f"Attempt {event.attempt.index} repeats attempt {event.attempt.same_as}"
                    say(f"{self.name}{same} and shares its runs.")
            case ConfirmationStarted():
                self._enter("confirm", self.plan.confirmations, sum(a.runs for a in self.confirmed))
            case ExplanationStarted():
                self._enter("cause", self._most_of_cause())
            case ReductionStarted():
                self._enter("shrink", event.of)
                self.done = event.number - 1
                self._show()

    def text(self) -> str:
        """Return the stages with what the current one has done, and the time left."""
        ahead = STAGES[STAGES.index(self.stage) + 1 :]
        if not self.plan.confirmations:
            ahead = tuple(stage for stage in ahead if stage in ("alone", "search"))
        now = f"{self.stage} {self.done}/{self.total}" if self.total else self.stage
        worst = f"   worst mean {number(self.worst, self.plan.requirement.unit)}" if self.worst is not None else ""
        model = f"   model {describe_spending(self.spent)}" if self.spent is not None and self.spent.calls else ""
        return f"{self.name}{' · '.join([now, *ahead])}{self._left()}{worst}{model}"

    def _enter(self, stage: Stage, total: int, done: int = 0) -> None:
        """Begin a stage; what it can need at most is said once and does not grow."""
        if stage == self.stage and self.total:
            return
        if stage == "search" and self.stage in ("prepare", "alone"):
            self.made, self.begin = 0, time.monotonic()  # campaigns of a matrix wait for each other
        self.stage, self.total, self.done = stage, total, min(done, total)
        self._show(line=True)

    def _made(self, event: RunFinished) -> None:
        """Count a run, unless an earlier attempt made it."""
        if event.purpose == "search" and self.stage in ("prepare", "alone"):
            self._enter("search", self.plan.search_runs, self.searched)
        run_id = event.run.id if isinstance(event.run, FinishedRun) else None
        if run_id in self.known:
            return
        if run_id is not None:
            self.known.add(run_id)
        self.made += 1
        self.searched += event.purpose == "search"
        if self.stage == "shrink":
            return
        before, self.done = self.done, min(self.done + 1, self.total)
        tenth = 10 * self.done // max(1, self.total) > 10 * before // max(1, self.total)
        self._show(line=tenth and self.stage != "alone")

    def _show(self, *, line: bool = False) -> None:
        if self.line:
            self.line.update(self.text())
        elif line:
            say(self.text())

    def _left(self) -> str:
        """Return the time left: a range, whose upper end counts what the later stages may need."""
        if not self.made or self.stage in ("prepare", "alone"):
            return ""
        attempt_s, here = (time.monotonic() - self.begin) / self.made, self.total - self.done
        if self.stage == "shrink":
            return ""
        after = {"search": self.plan.confirmations * (1 + AFTERWARDS), "confirm": self.plan.confirmations * AFTERWARDS}
        low, high = attempt_s * (here if self.stage == "search" else 0), attempt_s * (here + after.get(self.stage, 0))
        return f"   {_span(low, high)} left"

    def _most_of_cause(self) -> int:
        """Return the most runs that name the causes of what is confirmed."""
        confirmed = [a for a in self.confirmed if a.verdict is not None and a.proposal.scenario is not None]
        bad = [a.proposal.scenario for a in confirmed if a.verdict is not None and violated(a.verdict)]
        people = [len(scenario.people.humans) for scenario in bad if scenario is not None]
        removals = sum(n * max(FEWEST_WITHOUT_ONE, WITHOUT_ONE // n) for n in people if n > 1)
        return max((a.measured_runs for a in confirmed), default=0) + removals

    def _calling(self, news: CallNews) -> None:
        """Show what the model spent; print a line when it waits."""
        self.spent = news.spent
        if news.what == "waiting":
            say(f"{self.name}{news.model}, {news.purpose}: {news.why}")
        self._show()

    def _note(self, attempt: Attempt) -> None:
        if attempt.purpose == "confirmation":
            self.confirmed = [a for a in self.confirmed if a.confirms != attempt.confirms] + [attempt]
        if attempt.purpose == "search" and attempt.mean is not None:
            self.worst = attempt.mean if self.worst is None else self.plan.requirement.worst(self.worst, attempt.mean)


def _span(low: float, high: float) -> str:
    """Return a range of seconds in words, e.g. `40-90 s` or `2-5 min`."""
    unit, scale = ("s", 1.0) if high < 120.0 else ("min", 60.0)
    a, b = round(low / scale), max(1, round(high / scale))
    return f"{a}-{b} {unit}" if 0 < a < b else f"{'at most ' if a < b else ''}{b} {unit}"
