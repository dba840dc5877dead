"""Options of verbs that ask a model outside a campaign."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

import typer

from rvsg.cli.console import console, say
from rvsg.report.terminal import describe_spending

if TYPE_CHECKING:
    from rich.status import Status

    from rvsg.generation.vlm.access import CallNews

Model = Annotated[str | None, typer.Option(help="The model, PROVIDER:NAME, e.g. openai-chat:gpt-4.1.")]
BaseUrl = Annotated[str | None, typer.Option(help="Address of an OpenAI-compatible server (key: RVSG_API_KEY).")]
Record = Annotated[Path | None, typer.Option(help="Keep every call in this folder.")]
Replay = Annotated[Path | None, typer.Option(help="Answer from the calls recorded in this folder, without a model.")]
Strict = Annotated[
    bool, typer.Option("--strict", help="With --replay, treat any difference from the record as an error.")
]
CallTimeout = Annotated[float, typer.Option(min=0.1, help="Seconds to wait for an answer.")]
BudgetCalls = Annotated[int | None, typer.Option(help="Stop before more calls of the model.")]
BudgetTokens = Annotated[int | None, typer.Option(help="Stop before more tokens.")]
BudgetUsd = Annotated[float | None, typer.Option(help="Stop before the calls cost more.")]
Prices = Annotated[
    str | None,
    typer.Option(metavar="IN,CACHED,OUT", help="Dollars per million tokens, for a model without a listed price."),
]


class CallsShown:
    """Shows the calls of a model while they run: on a terminal as a status line, else as one line per call.

    Args:
        watch: sets the receiver of every call, e.g. `Generator.watch`; None removes it.
    """

    def __init__(self, watch: Callable[[Callable[[CallNews], None] | None], None]) -> None:
        self.watch = watch
        self.status: Status | None = None

    def __enter__(self) -> Self:
        self.watch(self._show)
        return self

    def __exit__(self, *_: object) -> None:
        self.watch(None)
        self._stop()

    def _stop(self) -> None:
        if self.status is not None:
            self.status.stop()
            self.status = None

    def _show(self, news: CallNews) -> None:
        self._stop()
        if news.what == "answered":
            took = "answered from the record" if news.from_record else f"answered after {news.took_s:.0f} s"
            say(f"  {news.purpose}: {took}; {describe_spending(news.spent)} so far")
            return
        line = f"{news.model}, {news.purpose}: {news.why}" if news.why else f"Asking {news.model}: {news.purpose} ..."
        if news.what == "waiting" or not console().is_terminal:
            say(line)
        if console().is_terminal:
            self.status = console().status(line)
            self.status.start()
