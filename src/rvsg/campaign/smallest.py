"""At the end of a campaign: the smallest scenario that still shows each distinct failure.

The worst confirmed scenario of every distinct failure is shrunk on seeds of its own, and what is left meets the seeds
of the confirmation, so that both have met the same noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.events import Attempted, Event, Shrinks
from rvsg.campaign.failures import modes_in
from rvsg.campaign.filing import whole
from rvsg.campaign.finding import distinct_failures, findings
from rvsg.campaign.parts import Made, Parts, collect, store, submit
from rvsg.campaign.plan import Plan
from rvsg.campaign.shrink import Shrinking, Simplification

REPEATS = 6
"""Runs of every simpler scenario: at most as many as tell that a failure that nearly always happens is gone."""
CHECKED = 10
"""Runs of what is left, on the seeds of the confirmation, at most."""


def shrink_all(plan: Plan, attempts: Sequence[Attempt], parts: Parts) -> Iterator[Event]:
    """Shrink the worst confirmed scenario of every distinct failure; none gets more than its part of the runs left.

    What is stored already is not repeated.
    """
    if not parts.shrink_runs or plan.requirement.threshold is None:
        return
    done = list(attempts)
    world = parts.simulations.world
    runs, modes = parts.ledger.run, modes_in(parts.ledger, world)
    found = findings(plan, done, run_of=runs, world=world, procedure=parts.procedure, mode_of_run=modes)
    confirmations = {finding.attempt: finding.confirmation for finding in found}
    worst = [confirmations[failure.attempts[0]] for failure in distinct_failures(found)]
    for place, index in enumerate(worst):
        if any(a.purpose == "shrinking" and a.confirms == index for a in done):
            continue
        spent = sum(a.trial_runs + a.runs for a in done if a.purpose == "shrinking")
        share = (parts.shrink_runs - spent) // (len(worst) - place)
        if share < REPEATS + CHECKED:
            continue
        confirmation = next(a for a in done if a.index == index)
        for event in _shrunk(plan, confirmation, done, parts, share):
            if isinstance(event, Attempted):
                done.append(event.attempt)
            yield event


def _shrunk(plan: Plan, confirmation: Attempt, done: Sequence[Attempt], parts: Parts, runs: int) -> Iterator[Event]:
    """Shrink one confirmed scenario in at most `runs` runs, the check at the end included."""
    scenario = confirmation.proposal.scenario
    assert scenario is not None
    yield Shrinks(campaign=plan.name, confirmation=whole(confirmation), runs=runs)
    seeds = [m.seed for m in confirmation.measurements][:CHECKED]

    def watch(_: Simplification) -> None:
        parts.check()

    shrinking = Shrinking(
        requirement=plan.requirement,
        simulations=parts.simulations,
        judge=parts.judge,
        seed=plan.seed,
        repeats=REPEATS,
        limit=runs - len(seeds),
        watch=watch,
    )
    smallest, steps = shrinking.smallest(scenario)
    attempt = Attempt(
        campaign=plan.name,
        index=max(a.index for a in done) + 1,
        purpose="shrinking",
        strategy=confirmation.strategy,
        brief=confirmation.brief,
        proposal=confirmation.proposal.replace(scenario=smallest, calls=()),
        confirms=confirmation.index,
        taken_away=tuple(step.what for step in steps if step.kept),
        trial_runs=shrinking.runs,
    )
    made = Made()
    yield from collect(attempt, submit(attempt, seeds, parts), made, parts)
    yield Attempted(campaign=plan.name, attempt=store(attempt, made, parts))
