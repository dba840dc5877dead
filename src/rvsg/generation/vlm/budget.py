"""Budgeted: stops before the call that would pass a declared budget of calls, tokens or dollars."""

from __future__ import annotations

import threading
from typing import Annotated

from pydantic import Field

from rvsg.core.errors import BudgetSpent
from rvsg.core.records import Record
from rvsg.generation.vlm.messages import Answer, Request, Usage, estimated_input_tokens
from rvsg.generation.vlm.model import Model

NO_CALL = (
    "a budget of 0 allows no call. Leave it out for no limit; without a model --replay answers from recorded calls, "
    "and the heuristic generator needs none"
)


class Budget(Record):
    """What may be spent in a campaign, calls of earlier sittings included; None is no limit."""

    calls: Annotated[int | None, Field(default=None, ge=0)] = None
    tokens: Annotated[int | None, Field(default=None, ge=0)] = None
    usd: Annotated[float | None, Field(default=None, ge=0)] = None


class Spending(Record):
    """What was spent. `unpriced` counts calls whose cost is not known; `tokens` is input and output together."""

    calls: int = 0
    input_tokens: int = 0
    cached_tokens: int = 0
    output_tokens: int = 0
    cost_usd: float = 0.0
    unpriced: int = 0

    @property
    def tokens(self) -> int:
        """Input and output tokens."""
        return self.input_tokens + self.output_tokens

    def plus(self, usage: Usage) -> Spending:
        """With one more call."""
        return Spending(
            calls=self.calls + 1,
            input_tokens=self.input_tokens + usage.input_tokens,
            cached_tokens=self.cached_tokens + usage.cached_tokens,
            output_tokens=self.output_tokens + usage.output_tokens,
            cost_usd=self.cost_usd + (usage.cost_usd or 0.0),
            unpriced=self.unpriced + (usage.cost_usd is None),
        )


class Budgeted:
    """A model that raises BudgetSpent instead of asking, once the next call would pass the budget.

    Calls are counted exactly. Tokens and dollars are checked with what is spent plus the estimated input of the
    next call, so that a budget is passed at most by the output of one call (per call in flight).
    """

    def __init__(self, model: Model, budget: Budget, spent: Spending | None = None) -> None:
        self._model = model
        self.budget = budget
        self.spent = spent or Spending()
        self._under_way = 0
        self._lock = threading.Lock()

    @property
    def name(self) -> str:
        """The name of the model."""
        return self._model.name

    def ask(self, request: Request) -> Answer:
        """Ask, if the budget allows."""
        with self._lock:
            self._check(request)
            self._under_way += 1
        try:
            answer = self._model.ask(request)
        finally:
            with self._lock:
                self._under_way -= 1
        with self._lock:
            self.spent = self.spent.plus(answer.usage)
        return answer

    def _check(self, request: Request) -> None:
        budget, spent = self.budget, self.spent
        if budget.calls is not None and spent.calls + self._under_way >= budget.calls:
            self._stop(f"{spent.calls} of {budget.calls} calls", "--budget-calls")
        if budget.tokens is not None and spent.tokens + estimated_input_tokens(request) > budget.tokens:
            self._stop(f"{spent.tokens} of {budget.tokens} tokens", "--budget-tokens")
        if budget.usd is not None and (spent.cost_usd >= budget.usd or (spent.unpriced and not spent.cost_usd)):
            unknown = f" ({spent.unpriced} calls of unknown price)" if spent.unpriced else ""
            self._stop(f"{spent.cost_usd:.4f} of {budget.usd:.4f} USD{unknown}", "--budget-usd")

    def _stop(self, spent: str, option: str) -> None:
        raise BudgetSpent(
            f"The budget is spent: {spent} (model {self.name}). What is finished is kept; to go on, run the same "
            f"command with a larger {option}.",
            code=option.removeprefix("--"),
        )
