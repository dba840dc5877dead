"""Progress of a campaign on standard error: a bar with an estimate on a terminal, a line per scenario elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from rvsg.campaign.attempt import Attempt, Failure
from rvsg.campaign.plan import Plan
from rvsg.cli.console import console, say
from rvsg.cli.model_options import told_spent
from rvsg.generation.vlm.budget import Spending
from rvsg.generation.vlm.watching import CallNews
from rvsg.report.summary import number
from rvsg.scenario.brief import Brief
from rvsg.simulation.run import Run


class CampaignProgress:
    """Watches a campaign and shows how far it is; `attempts` were made before.

    `check` is called between runs: it may raise KeyboardInterrupt.
    """

    def __init__(
        self,
        plan: Plan,
        attempts: list[Attempt],
        *,
        quiet: bool = False,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        self.plan = plan
        self.check = check
        self.worst: float | None = None
        self.runs = sum(len(a.measurements) + len(a.failures) for a in attempts)
        self.made = 0
        self.begin = time.monotonic()
        self.place = ""
        self.spent: Spending | None = None
        for attempt in attempts:
            self._note(attempt)
        live = console().is_terminal and not quiet
        self.quiet = quiet
        self.bar: Progress | None = None
        if live:
            self.bar = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("runs"),
                TimeElapsedColumn(),
                TextColumn("left"),
                TimeRemainingColumn(),
                console=console(),
                transient=True,
            )
            self.task = self.bar.add_task("starting", total=plan.runs, completed=self.runs)

    def __enter__(self) -> Self:
        if self.bar:
            self.bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self.bar:
            self.bar.stop()

    def proposing(self, brief: Brief) -> None:
        """Show which configuration is under way."""
        self.check()
        if self.bar:
            place = f"scenario {brief.scenario_index + 1}"
            if self.plan.refinements:
                place += f", configuration {brief.configuration_index + 1}"
            worst = (
                f" (worst so far {number(self.worst, self.plan.requirement.unit)})" if self.worst is not None else ""
            )
            self.place = place + worst
            self.bar.update(self.task, description=self.place + self._spent())

    def calling(self, news: CallNews) -> None:
        """A call of a model: shown in the bar; that it waits for another try, and why, is a line of its own."""
        self.spent = news.spent
        if self.bar:
            doing = {"asked": f": asks {news.model}", "waiting": f": waits for {news.model}", "answered": ""}
            self.bar.update(self.task, description=self.place + doing[news.what] + self._spent())
        if news.what == "waiting" and not self.quiet:
            say(f"{news.model}, {news.purpose}: {news.why}")

    def _spent(self) -> str:
        return f"; model {told_spent(self.spent)}" if self.spent is not None and self.spent.calls else ""

    def ran(self, run: Run | Failure) -> None:
        """One run more."""
        self.check()
        self.runs += 1
        self.made += 1
        if self.bar:
            self.bar.advance(self.task)

    def attempted(self, attempt: Attempt) -> None:
        """An attempt more; without a terminal a line at the end of every scenario, with an estimate."""
        self._note(attempt)
        last = (attempt.index + 1) % self.plan.configurations == 0
        if self.bar or self.quiet or attempt.purpose == "confirmation" or not last:
            return
        spent = time.monotonic() - self.begin
        left = spent / self.made * (self.plan.runs - self.runs) if self.made else 0.0
        say(
            f"{self.runs} of {self.plan.runs} runs; {self.plan.requirement.name} at worst "
            f"{number(self.worst, self.plan.requirement.unit)}; about {left:.0f} s left{self._spent()}"
        )

    def _note(self, attempt: Attempt) -> None:
        if attempt.purpose == "search" and attempt.mean is not None:
            self.worst = attempt.mean if self.worst is None else self.plan.requirement.worst(self.worst, attempt.mean)
