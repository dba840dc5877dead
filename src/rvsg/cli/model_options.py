"""Options of verbs that ask a model outside a campaign."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import typer

from rvsg.cli.console import console, say

if TYPE_CHECKING:
    from rich.status import Status

    from rvsg.generation.generator import Call
    from rvsg.generation.vlm.budget import Spending
    from rvsg.generation.vlm.watching import CallNews
    from rvsg.generation.wiring import Wiring

NEXT_STEP = {
    "refused": "refused (by the model or a safety filter): try another model",
    "empty": "empty: try another model, or raise max_output_tokens if it spends them on thinking",
    "truncated": "cut off by the limit of tokens: raise max_output_tokens",
}

Model = Annotated[str | None, typer.Option(help="The model, PROVIDER:NAME, e.g. openai-chat:gpt-4.1.")]
BaseUrl = Annotated[str | None, typer.Option(help="Address of an OpenAI-compatible server (key: RVSG_API_KEY).")]
Record = Annotated[Path | None, typer.Option(help="Keep every call in this folder.")]
Replay = Annotated[Path | None, typer.Option(help="Answer from the calls recorded in this folder, without a model.")]
Strict = Annotated[bool, typer.Option("--strict", help="With --replay: any difference from the record is an error.")]
CallTimeout = Annotated[float, typer.Option(min=0.1, help="Seconds to wait for an answer.")]
BudgetCalls = Annotated[int | None, typer.Option(help="Stop before more calls of the model.")]
BudgetTokens = Annotated[int | None, typer.Option(help="Stop before more tokens.")]
BudgetUsd = Annotated[float | None, typer.Option(help="Stop before the calls cost more.")]
Prices = Annotated[
    str | None, typer.Option(metavar="IN,CACHED,OUT", help="Dollars per million tokens, where not listed.")
]


def wiring_of(model: str | None, record: Path | None, **access: Any) -> Wiring:
    """The model that was asked for; InputError where none was."""
    from rvsg.generation.wiring import Access, wired

    given = {key: value for key, value in access.items() if value is not None}
    return wired(model, Access.of(given, record=record))


class CallsShown:
    """Shows the calls of a model while they are made: on a terminal as a moving line, else as a line for each."""

    def __init__(self, wiring: Wiring) -> None:
        self.wiring = wiring
        self.status: Status | None = None

    def __enter__(self) -> Self:
        if not self.wiring.replaying:
            self.wiring.model.tell = self._told
        return self

    def __exit__(self, *_: object) -> None:
        self.wiring.model.tell = None
        self._stop()

    def _stop(self) -> None:
        if self.status is not None:
            self.status.stop()
            self.status = None

    def _told(self, news: CallNews) -> None:
        self._stop()
        if news.what == "answered":
            took = "answered from the record" if news.from_record else f"answered after {news.took_s:.0f} s"
            say(f"  {news.purpose}: {took}; {told_spent(news.spent)} so far")
            return
        line = f"{news.model}, {news.purpose}: {news.why}" if news.why else f"Asking {news.model}: {news.purpose} ..."
        if news.what == "waiting" or not console().is_terminal:
            say(line)
        if console().is_terminal:
            self.status = console().status(line)
            self.status.start()


def told_spent(spent: Spending) -> str:
    """What was spent, in dollars where the price is known, else in tokens."""
    if spent.unpriced:
        return f"{spent.input_tokens} input and {spent.output_tokens} output tokens"
    return f"{spent.cost_usd:.4f} USD"


def told_from_record(wiring: Wiring) -> str | None:
    """That answers were taken from the record of an earlier sitting; None where none was."""
    known, recording = wiring.model.from_record, wiring.recording
    if wiring.replaying or recording is None or not known:
        return None
    calls = "1 call was" if known == 1 else f"{known} calls were"
    return f"{calls} answered at no cost from {recording.folder}; to ask anew, give another --record."


def told_unusable(calls: Iterable[Call]) -> str | None:
    """How many answers of a model were no use and what to do about it; None where all were."""
    kinds = Counter(call.error for call in calls if call.error in NEXT_STEP)
    told = [f"{count} {'was' if count == 1 else 'were'} {NEXT_STEP[str(kind)]}" for kind, count in kinds.items()]
    return f"Of the model's answers {'; '.join(told)}." if told else None


def told_calls(calls: Any) -> str:
    """One line on what calls of a model cost."""
    if not calls:
        return "No call was made."
    costs = [call.cost_usd for call in calls]
    cost = f"{sum(costs):.4f} USD" if None not in costs else "cost unknown"
    about = "about " if any(call.estimated for call in calls) else ""
    asked = "1 call" if len(calls) == 1 else f"{len(calls)} calls"
    given, written = sum(call.input_tokens for call in calls), sum(call.output_tokens for call in calls)
    return f"{asked} of {calls[0].model}: {about}{given} input and {written} output tokens, {cost}."
