"""After the search: confirm the candidates in runs with new seeds, and run the mission with fewer people.

Every candidate meets the same new seeds, which took no part in its selection. The mission without people and every
confirmed scenario without one of its people meet them, too, so that a difference is one of people, not of noise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial

from rvsg.campaign.attempt import Attempt, Plan
from rvsg.campaign.execution import Attempted, Confirming, Event, Explaining, Made, Parts, collect, store, submit
from rvsg.campaign.findings import badness
from rvsg.campaign.ledger import whole
from rvsg.campaign.observation import FailureMode, usual
from rvsg.campaign.ranking import candidates, confirmations, search_attempts
from rvsg.core.seeds import fresh_seeds
from rvsg.evaluation.verdict import Procedure, Status, next_repeats, violated
from rvsg.scenario.scenario import Human, HumanConfiguration

FEWEST_WITHOUT_ONE = 5
"""Runs without one person, at least, however many people there are."""
WITHOUT_ONE = 20
"""Runs without one person each, of all the people of a finding together, unless that leaves too few for each."""
MOST_AHEAD = 4
"""Runs that are begun, at most, before it is known whether the verdict needs them."""


def confirm_all(plan: Plan, attempts: Sequence[Attempt], parts: Parts) -> Iterator[Event]:
    """Confirm the candidates in order until the budget is spent, then run the mission with fewer people.

    First comes the worst configuration of every scenario: one of every kind of failure before the second of one, the
    worst scenario first. Where none of them is shown to violate nearly always (FAIL), the other configurations follow
    until one is. Then the runs that are left decide what ended early without a verdict. What is stored already is not
    repeated.
    """
    done = list(attempts)
    if not plan.confirmations:
        return
    order_of = candidates(done, plan.requirement)
    scenarios = len({candidate.scenario_index for candidate in order_of})
    order_of = [*_one_of_each_kind(plan, order_of[:scenarios], parts), *order_of[scenarios:]]
    share = parts.procedure.max_runs
    if plan.requirement.threshold is not None:
        share = max(share, plan.confirmations // max(scenarios, 1))
    for number, candidate in enumerate(order_of, 1):
        if _is_confirmed(candidate, done):
            continue
        another = number > scenarios
        left = plan.confirmations - sum(a.runs for a in _begun(done))
        if left <= 0 or (number > 1 and not parts.procedure.replace(max_runs=left).fewest_for(0, 0)):
            break
        if another and any(_fails(attempt) for attempt in done):
            break
        budget = min(left, share)
        of = len(order_of) if another else scenarios
        yield Confirming(campaign=plan.name, candidate=whole(candidate), number=number, of=of, runs=budget)
        more = any(not _is_confirmed(other, done) for other in order_of[number:])
        reserve = parts.procedure.fewest_for(0, 0).get(Status.FAIL, 0) if more else 0
        spare = max(0, reserve - (left - budget))
        run = confirm(plan, candidate, done, parts, budget=budget, reserve=spare, only_fail=another)
        yield from _noted(run, done)
    yield from _noted(_decide(plan, order_of, done, parts, share), done)
    yield from _noted(explain(plan, done, parts), done)


def _one_of_each_kind(plan: Plan, found: Sequence[Attempt], parts: Parts) -> list[Attempt]:
    """Return candidates with the first of every kind of failure before the second ones, else in their order."""
    seen: Counter[FailureMode | None] = Counter()
    rank: dict[int, int] = {}
    mode = partial(parts.ledger.failure_mode, world=parts.runner.world)
    for attempt in found:
        values = [(m.run_id, m.objective) for m in attempt.measurements]
        violating = [run for run, value in values if value is not None and plan.requirement.violated_by(value)]
        kind = usual(map(mode, violating))
        rank[attempt.index] = seen[kind]
        seen[kind] += 1
    return sorted(found, key=lambda attempt: rank[attempt.index])


def _decide(
    plan: Plan, order_of: Sequence[Attempt], attempts: Sequence[Attempt], parts: Parts, most: int
) -> Iterator[Event]:
    """Continue the confirmations without a verdict, the worst first, where the runs that are left can decide them.

    Args:
        most: runs of one confirmation at most, unless an equal part of what is left is more.
    """
    done, by_index = list(attempts), {candidate.index: candidate for candidate in order_of}
    undecided = [a for a in _begun(done) if a.verdict is not None and a.verdict.status is Status.INCONCLUSIVE]
    undecided.sort(key=lambda a: badness(a.verdict, parts.procedure), reverse=True)
    latest = {a.confirms: a for a in confirmations(done)}
    for number, attempt in enumerate(undecided, 1):
        candidate = by_index.get(attempt.confirms if attempt.confirms is not None else -1)
        left = plan.confirmations - sum(a.runs for a in latest.values())
        part = left // (len(undecided) - number + 1)
        budget = min(attempt.runs + left, max(most, attempt.runs + part))
        if candidate is None or latest[attempt.confirms] is not attempt:
            continue
        if not _reachable(plan, _objectives(attempt), parts.procedure.replace(max_runs=max(1, budget))):
            continue
        yield Confirming(campaign=plan.name, candidate=whole(candidate), number=number, of=len(undecided), runs=budget)
        run = confirm(plan, candidate, done, parts, budget=budget, known=attempt)
        yield from _noted(run, done)
        latest[attempt.confirms] = done[-1]


def confirm(
    plan: Plan,
    candidate: Attempt,
    attempts: Sequence[Attempt],
    parts: Parts,
    *,
    budget: int,
    reserve: int = 0,
    only_fail: bool = False,
    known: Attempt | None = None,
) -> Iterator[Event]:
    """Repeat a candidate in at most `budget` runs with new seeds.

    Where the requirement has a limit, runs are added in batches until the sequential procedure decides. A batch is
    the fewest runs that can decide, so their number does not depend on the number of workers; workers that would
    wait begin the next runs, which are dropped where the verdict does not need them. Without a limit all of the budget
    is spent.

    Args:
        reserve: Runs of the budget in which the next candidate can be shown to violate nearly always; 0 if others
            are left for it. Where it is certain that this one violates, but not always, and telling how often would use
            them up, it ends.
        only_fail: End as soon as it cannot be shown any more, within the budget, to violate nearly always.
        known: An earlier confirmation that ended without a verdict; its runs count towards the budget.
    """
    seeds = confirmation_seeds(plan, attempts, budget)
    again = candidate.replace(
        index=_next_index(attempts),
        purpose="confirmation",
        confirms=candidate.index,
        measurements=(),
        failures=(),
        verdict=None,
    )
    procedure = parts.procedure.replace(max_runs=budget)
    judged = plan.requirement.threshold is not None
    made = Made(measurements=list(known.measurements), failures=list(known.failures)) if known else Made()
    objectives = _objectives(known) if known else []
    count = next_repeats(plan.requirement, objectives, procedure=procedure) if judged else budget
    ahead = min(max(0, parts.runner.lookahead - 1), MOST_AHEAD)
    while count:
        pending = submit(again, seeds[made.count : made.count + count + ahead], parts)
        yield from collect(again, pending[:count], made, parts)
        objectives = [m.objective for m in made.measurements] + [None] * len(made.failures)
        count = next_repeats(plan.requirement, objectives, procedure=procedure)
        if not count:
            break
        if only_fail and Status.FAIL not in _reachable(plan, objectives, procedure):
            budget = made.count
            break
        if reserve and _leaves_open(plan, objectives, procedure, count, reserve):
            budget = made.count
            break
    yield Attempted(campaign=plan.name, attempt=store(again, made, parts, budget=budget))


def _objectives(attempt: Attempt) -> list[float | None]:
    return [m.objective for m in attempt.measurements] + [None] * len(attempt.failures)


def _begun(attempts: Sequence[Attempt]) -> list[Attempt]:
    """Return the confirmations as they first ended: what is decided from them is the same after an interruption."""
    first: dict[int | None, Attempt] = {}
    for attempt in attempts:
        if attempt.purpose == "confirmation":
            first.setdefault(attempt.confirms, attempt)
    return list(first.values())


def _reachable(plan: Plan, objectives: Sequence[float | None], procedure: Procedure) -> dict[Status, int]:
    """Return for each status that the rest of the budget can show how many runs it takes at least."""
    known = [value for value in objectives if value is not None]
    spent = procedure.max_runs - (len(objectives) - len(known))
    return procedure.replace(max_runs=spent).fewest_for(sum(map(plan.requirement.violated_by, known)), len(known))


def _leaves_open(
    plan: Plan, objectives: Sequence[float | None], procedure: Procedure, count: int, reserve: int
) -> bool:
    """Return whether the next candidate is worth the runs more than telling how often this one violates."""
    known = [value for value in objectives if value is not None]
    violations = sum(plan.requirement.violated_by(value) for value in known)
    left = procedure.max_runs - len(objectives)
    certain = violations < len(known) and procedure.violated(violations, len(known))
    return certain and left - count < reserve <= left


def _fails(attempt: Attempt) -> bool:
    return attempt.purpose == "confirmation" and attempt.verdict is not None and attempt.verdict.status is Status.FAIL


def _is_confirmed(candidate: Attempt, attempts: Sequence[Attempt]) -> bool:
    return any(a.purpose == "confirmation" and a.confirms == candidate.index for a in attempts)


def explain(plan: Plan, attempts: Sequence[Attempt], parts: Parts) -> Iterator[Event]:
    """Run the mission without people, and every confirmed violation without each of its people in turn."""
    done = list(attempts)
    confirmed = [a for a in confirmations(done) if a.measurements]
    if not confirmed:
        return
    longest = max(confirmed, key=lambda a: len(a.measurements))
    known = [a for a in done if a.purpose == "baseline"]
    if not known or len(known[-1].measurements) < len(longest.measurements):
        yield from _noted(_with_people(plan, longest, (), "baseline", done, parts), done)
    if plan.requirement.threshold is None:
        return
    for confirmation in confirmed:
        scenario, verdict = confirmation.proposal.scenario, confirmation.verdict
        if scenario is None or verdict is None or not violated(verdict, procedure=parts.procedure):
            continue
        humans = scenario.people.humans
        if len(humans) < 2:  # the baseline is this scenario without its only person
            continue
        for i, human in enumerate(humans):
            if any(a.confirms == confirmation.index and a.without == (human.name,) for a in done):
                continue
            rest = humans[:i] + humans[i + 1 :]
            yield from _noted(_with_people(plan, confirmation, rest, "removal", done, parts), done)


def _with_people(
    plan: Plan, confirmation: Attempt, people: tuple[Human, ...], purpose: str, done: Sequence[Attempt], parts: Parts
) -> Iterator[Event]:
    """Repeat a confirmation on its own seeds with only these people."""
    scenario = confirmation.proposal.scenario
    assert scenario is not None
    humans = scenario.people.humans
    without = tuple(human.name for human in humans if human not in people)
    seeds = [m.seed for m in confirmation.measurements]
    if purpose == "removal":
        seeds = seeds[: max(FEWEST_WITHOUT_ONE, WITHOUT_ONE // len(humans))]
    fewer = scenario.replace(people=HumanConfiguration(humans=people))
    attempt = Attempt(
        campaign=plan.name,
        index=_next_index(done),
        purpose="baseline" if purpose == "baseline" else "removal",
        strategy=confirmation.strategy,
        brief=confirmation.brief,
        proposal=confirmation.proposal.replace(scenario=fewer, calls=()),
        confirms=None if purpose == "baseline" else confirmation.index,
        without=without,
    )
    yield Explaining(campaign=plan.name, without=without, people=len(people), runs=len(seeds))
    made = Made()
    yield from collect(attempt, submit(attempt, seeds, parts), made, parts)
    yield Attempted(campaign=plan.name, attempt=store(attempt, made, parts))


def confirmation_seeds(plan: Plan, attempts: Sequence[Attempt], count: int) -> tuple[int, ...]:
    """Return the first `count` seeds of a campaign's confirmations: none of them took part in the search."""
    used = {seed for attempt in search_attempts(attempts) for seed in attempt.seeds[: attempt.measured_runs]}
    return fresh_seeds(plan.seed, "confirmation", count, used=used)


def _next_index(attempts: Sequence[Attempt]) -> int:
    return max((attempt.index for attempt in attempts), default=-1) + 1


def _noted(events: Iterator[Event], done: list[Attempt]) -> Iterator[Event]:
    for event in events:
        if isinstance(event, Attempted):
            done.append(event.attempt)
        yield event
