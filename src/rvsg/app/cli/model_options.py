"""Options of verbs that ask a model outside a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rvsg.generation.wiring import Wiring

Model = Annotated[str | None, typer.Option(help="The model, PROVIDER:NAME, e.g. openai-chat:gpt-4.1.")]
BaseUrl = Annotated[str | None, typer.Option(help="Address of an OpenAI-compatible server (key: RVSG_API_KEY).")]
Record = Annotated[Path | None, typer.Option(help="Keep every call in this folder.")]
Replay = Annotated[Path | None, typer.Option(help="Answer from the calls recorded in this folder, without a model.")]
Strict = Annotated[bool, typer.Option("--strict", help="With --replay: any difference from the record is an error.")]
CallTimeout = Annotated[float, typer.Option(min=0.1, help="Seconds to wait for an answer.")]
BudgetCalls = Annotated[int | None, typer.Option(min=1, help="Stop before more calls of the model.")]
BudgetTokens = Annotated[int | None, typer.Option(min=1, help="Stop before more tokens.")]
BudgetUsd = Annotated[float | None, typer.Option(min=0.0, help="Stop before the calls cost more.")]
Prices = Annotated[
    str | None, typer.Option(metavar="IN,CACHED,OUT", help="Dollars per million tokens, where not listed.")
]


def wiring_of(model: str | None, record: Path | None, **access: Any) -> Wiring:
    """The model that was asked for; InputError where none was."""
    from rvsg.generation.wiring import Access, wired

    given = {key: value for key, value in access.items() if value is not None}
    return wired(model, Access.of(given, record=record))


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
