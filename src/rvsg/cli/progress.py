"""Progress of a campaign on standard error: a bar with an estimate on a terminal, else a line per scenario."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column

from rvsg.campaign.attempt import Attempt, Plan
from rvsg.campaign.execution import (
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
from rvsg.cli.console import console, say
from rvsg.evaluation.verdict import counted, number, status_in_words
from rvsg.generation.vlm.access import CallNews
from rvsg.generation.vlm.model import Spending
from rvsg.report.terminal import describe_spending
from rvsg.scenario.brief import Brief


class CampaignProgress:
    """Shows how far a campaign is; give it every event of the campaign.

    Args:
        attempts: the attempts stored earlier.
        name: of a campaign that runs beside others; prefixes its lines, and no bar is shown.
        check: called with every event; it may raise KeyboardInterrupt.
    """

    def __init__(
        self,
        plan: Plan,
        attempts: list[Attempt],
        *,
        name: str = "",
        check: Callable[[], None] = lambda: None,
    ) -> None:
        self.plan = plan
        self.check = check
        self.worst: float | None = None
        self.known = {m.run_id for a in attempts for m in a.measurements}
        self.runs = len(self.known) + sum(len(a.failures) for a in attempts)
        self.made = 0
        self.total = plan.runs
        self.begin: float | None = None
        self.place = ""
        self.spent: Spending | None = None
        for attempt in attempts:
            self._note(attempt)
        live = console().is_terminal and not name
        self.name = f"{name}: " if name else ""
        self.bar: Progress | None = None
        if live:
            self.bar = Progress(
                BarColumn(bar_width=14),
                MofNCompleteColumn(table_column=Column(no_wrap=True)),
                TextColumn("runs,", table_column=Column(no_wrap=True)),
                TimeRemainingColumn(table_column=Column(no_wrap=True)),
                TextColumn("left", table_column=Column(no_wrap=True)),
                # On a narrow terminal, shorten the description and keep the numbers.
                TextColumn("{task.description}", table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis")),
                console=console(),
                transient=True,
                expand=True,
            )
            self.task = self.bar.add_task("starting", total=self.total, completed=self.runs)

    def __enter__(self) -> Self:
        if self.bar:
            self.bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self.bar:
            self.bar.stop()

    def __call__(self, event: Event) -> None:
        """Show an event."""
        self.check()
        if self.begin is None and isinstance(event, ProposalStarted | RunFinished):
            self.begin = time.monotonic()  # campaigns of a matrix are prepared together and start one after the other
        match event:
            case Message():
                say(f"{self.name}{event.text}")
            case ProposalStarted():
                self._proposing(event.brief)
            case ModelCall():
                self._calling(event.news)
            case RunFinished():
                self._made(event)
            case AttemptFinished():
                self._attempted(event.attempt)
            case ConfirmationStarted():
                self._describe(f"confirming {event.number} of {event.of}")
            case ExplanationStarted():
                which = "without people" if event.people == 0 else f"without {', '.join(event.without)}"
                self._after_confirming(which, event.runs)
            case ReductionStarted():
                self._after_confirming("shrinking a failure", event.runs)

    def _made(self, event: RunFinished) -> None:
        """Count a run, unless an earlier attempt made it."""
        run_id = getattr(event.run, "id", None)
        if run_id is not None and run_id in self.known:
            return
        if run_id is not None:
            self.known.add(run_id)
        self.runs += 1
        self.made += 1
        if self.bar:
            self.bar.update(self.task, completed=self.runs, total=max(self.total, self.runs))

    def _after_confirming(self, text: str, runs: int) -> None:
        """Show the beginning of runs that explain or shrink a finding, which the plan does not count."""
        self.total = self.runs + runs
        if self.bar:
            self.bar.update(self.task, description=text, total=self.total)
        else:
            say(f"{self.name}{counted(self.runs, 'run')}; {text}: at most {runs} more")

    def _describe(self, text: str) -> None:
        if self.bar:
            self.place = text
            self.bar.update(self.task, description=self.place)

    def _proposing(self, brief: Brief) -> None:
        """Show the configuration in progress."""
        if self.bar:
            place = f"scenario {brief.scenario_index + 1}"
            if self.plan.refinements:
                place += f", configuration {brief.configuration_index + 1}"
            worst = (
                f" (worst so far {number(self.worst, self.plan.requirement.unit)})" if self.worst is not None else ""
            )
            self.place = place + worst
            self.bar.update(self.task, description=self.place + self._spent())

    def _calling(self, news: CallNews) -> None:
        """Show a call of a model in the bar; print a line when it waits."""
        self.spent = news.spent
        if self.bar:
            doing = {"asked": f": asking {news.model}", "waiting": f": waiting for {news.model}", "answered": ""}
            self.bar.update(self.task, description=self.place + doing[news.what] + self._spent())
        if news.what == "waiting":
            say(f"{self.name}{news.model}, {news.purpose}: {news.why}")

    def _spent(self) -> str:
        return f"; model {describe_spending(self.spent)}" if self.spent is not None and self.spent.calls else ""

    def _attempted(self, attempt: Attempt) -> None:
        """Without a terminal, print a line with an estimate after every scenario."""
        if attempt.same_as is not None:
            say(f"{self.name}Attempt {attempt.index} repeats attempt {attempt.same_as} and shares its runs.")
        self._note(attempt)
        if attempt.purpose == "confirmation" and not self.bar and attempt.verdict is not None:
            verdict = attempt.verdict
            say(
                f"{self.name}{self.runs} runs; scenario {attempt.brief.scenario_index + 1} confirmed in "
                f"{counted(verdict.runs, 'run')}: {status_in_words(verdict)}"
            )
        last = (attempt.index + 1) % self.plan.configurations == 0
        if self.bar or attempt.purpose != "search" or not last:
            return
        spent = time.monotonic() - self.begin if self.begin is not None else 0.0
        left = spent / self.made * max(0, self.plan.runs - self.runs) if self.made else 0.0
        lasts = f"{left:.0f} s" if left < 120 else f"{left / 60:.0f} min"
        say(
            f"{self.name}{self.runs} of {self.plan.runs} runs; {self.plan.requirement.name} at worst "
            f"{number(self.worst, self.plan.requirement.unit)}; about {lasts} left{self._spent()}"
        )

    def _note(self, attempt: Attempt) -> None:
        if attempt.purpose == "search" and attempt.mean is not None:
            self.worst = attempt.mean if self.worst is None else self.plan.requirement.worst(self.worst, attempt.mean)
