"""Results as sentences, for the command line and other front ends."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from rvsg.api.evaluating import Judgement
from rvsg.generation.generator import Call, Proposal
from rvsg.generation.vlm.budget import Spending
from rvsg.report.summary import counted, interval, number, status_in_words
from rvsg.scenario.validity import warnings
from rvsg.world.world import World

NEXT_STEP = {
    "refused": "refused (by the model or a safety filter): try another model",
    "empty": "empty: try another model, or raise max_output_tokens if it spends them on thinking",
    "truncated": "cut off by the limit of tokens: raise max_output_tokens",
}

__all__ = ["counted", "interval", "number", "status_in_words"]


def describe_judgement(judged: Judgement) -> Iterator[str]:
    """Yield a line for each run, one for the verdict, and one for what can decide it."""
    for measured in judged.measurements:
        yield f"seed {measured.seed}: {number(measured.objective, judged.requirement.unit)}, {measured.outcome}"
    yield str(judged)
    if judged.more_runs:
        procedure, verdict = judged.procedure, judged.verdict
        left = procedure.max_runs - len(judged.measurements)
        fewest = procedure.fewest_for(verdict.violations, verdict.runs).items()
        each = ", ".join(f"{count} for {status.value}" for status, count in fewest if count <= left)
        can = f"More runs can decide it: at least {each}" if each else f"{left} more cannot decide it"
        yield f"{can} (budget: {procedure.max_runs} in all)."


def describe_proposal(proposal: Proposal, world: World) -> Iterator[str]:
    """Yield what was proposed and what the checker said of it."""
    if proposal.scenario is not None:
        yield proposal.scenario.description or "(no description)"
    wrong = len(proposal.first_findings)
    checked = f"{counted(wrong, 'finding')} in the first reply, {counted(proposal.corrections, 'correction')} requested"
    yield f"{proposal.generator}: {checked if wrong else 'valid in the first reply'}"
    for finding in proposal.first_findings:
        yield f"  found: {finding}"
    for repair in proposal.repairs:
        yield f"  repaired: {repair.human}, {repair.task}: {repair.what}"
    for problem in proposal.problems:
        yield f"  left: {problem}"
    if proposal.scenario is not None:
        for doubtful in warnings(proposal.scenario.people, proposal.scenario.mission, world):
            yield f"  warning: {doubtful}"


def describe_spending(spent: Spending) -> str:
    """Return what was spent, in dollars where the price is known, else in tokens."""
    if spent.unpriced:
        return f"{spent.input_tokens} input and {spent.output_tokens} output tokens"
    return f"{spent.cost_usd:.4f} USD"


def describe_unusable(calls: Iterable[Call]) -> str | None:
    """Return how many replies of a model were unusable and what to do about it; None where all were usable."""
    kinds = Counter(call.error for call in calls if call.error in NEXT_STEP)
    said = [f"{count} {'was' if count == 1 else 'were'} {NEXT_STEP[str(kind)]}" for kind, count in kinds.items()]
    return f"Of the model's answers {'; '.join(said)}." if said else None


def describe_calls(calls: Sequence[Call]) -> str:
    """Return what calls of a model cost, as one line."""
    if not calls:
        return "No call was made."
    costs = [call.cost_usd for call in calls]
    cost = f"{sum(c for c in costs if c is not None):.4f} USD" if None not in costs else "cost unknown"
    about = "about " if any(call.estimated for call in calls) else ""
    given, written = sum(call.input_tokens for call in calls), sum(call.output_tokens for call in calls)
    return (
        f"{counted(len(calls), 'call')} of {calls[0].model}: {about}{given} input and {written} output tokens, {cost}."
    )
