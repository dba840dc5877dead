"""After the search: confirm the candidates in runs with new seeds, and run the mission with fewer people.

Every candidate meets the same new seeds, which took no part in its selection. The mission without people and every
confirmed scenario without one of its people meet them, too, so that a difference is one of people, not of noise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

from rvsg.core.seeds import fresh_seeds
from rvsg.evaluation.verdict import Procedure, Status, next_repeats, violated
from rvsg.findings.findings import badness
from rvsg.findings.ranking import candidates, confirmations, search_attempts
from rvsg.runs.attempt import Attempt, Plan
from rvsg.runs.observation import FailureMode, usual
from rvsg.runs.runner import FinishedRun
from rvsg.scenario.scenario import Human, HumanConfiguration
from rvsg.search.execution import (
    AttemptFinished,
    ConfirmationStarted,
    Event,
    ExplanationStarted,
    Parts,
    Results,
    collect,
    make,
    store,
    submit,
)

FEWEST_WITHOUT_ONE = 5
"""Runs without one person, at least, however many people there are."""
WITHOUT_ONE = 20
"""Runs without one person each, of all the people of a finding together, unless that leaves too few for each."""
MOST_AHEAD = 4
"""Runs that are begun, at most, before it is known whether the verdict needs them."""


def confirm_all(plan: Plan, attempts: Iterable[Attempt], parts: Parts) -> Iterator[Event]:
    """Confirm the candidates until the budget is spent, then run the mission with fewer people.

    What is stored already is not repeated.
    """
    if plan.confirmations:
        made = Confirmations(plan, attempts, parts)
        yield from made.confirm_candidates()
        yield from made.explain()


class Confirmations:
    """The confirmations of a campaign.

    Args:
        attempts: All attempts of the campaign so far; those that are made are added.
    """

    def __init__(self, plan: Plan, attempts: Iterable[Attempt], parts: Parts) -> None:
        self.plan, self.parts = plan, parts
        self.attempts = list(attempts)

    def confirm_candidates(self) -> Iterator[Event]:
        """Confirm the candidates in order until the budget is spent.

        First comes the worst configuration of every scenario: one of every kind of failure before the second of one,
        the worst scenario first. Where none of them is shown to violate nearly always (FAIL), the other configurations
        follow until one is. Then the runs that are left decide what ended early without a verdict.
        """
        plan, procedure = self.plan, self.parts.procedure
        order = candidates(self.attempts, plan.requirement)
        scenarios = len({candidate.scenario_index for candidate in order})
        order = [*self._one_of_each_kind(order[:scenarios]), *order[scenarios:]]
        share = procedure.max_runs
        if plan.requirement.threshold is not None:
            share = max(share, plan.confirmations // max(scenarios, 1))
        for number, candidate in enumerate(order, 1):
            if self._is_confirmed(candidate):
                continue
            another = number > scenarios
            begun = self._begun()
            left = plan.confirmations - sum(attempt.runs for attempt in begun)
            if left <= 0 or (number > 1 and not procedure.replace(max_runs=left).fewest_for(0, 0)):
                break
            if another and any(_status(attempt) is Status.FAIL for attempt in self._all()):
                break
            budget = min(left, share)
            of = len(order) if another else scenarios
            yield ConfirmationStarted(campaign=plan.name, candidate=candidate, number=number, of=of, runs=budget)
            more = any(not self._is_confirmed(other) for other in order[number:])
            reserve = procedure.fewest_for(0, 0).get(Status.FAIL, 0) if more else 0
            spare = max(0, reserve - (left - budget))
            yield from self.confirm(candidate, budget=budget, reserve=spare, only_fail=another)
        yield from self._decide({candidate.index: candidate for candidate in order}, share)

    def _one_of_each_kind(self, found: Sequence[Attempt]) -> list[Attempt]:
        """Return candidates with the first of every kind of failure before the second ones, else in their order."""
        seen: Counter[FailureMode | None] = Counter()
        rank: dict[int, int] = {}
        ledger, world, requirement = self.parts.ledger, self.parts.runner.world, self.plan.requirement
        for attempt in found:
            kind = usual(ledger.failure_mode(m.run_id, world) for m in attempt.violating(requirement))
            rank[attempt.index] = seen[kind]
            seen[kind] += 1
        return sorted(found, key=lambda attempt: rank[attempt.index])

    def _decide(self, by_index: dict[int, Attempt], most: int) -> Iterator[Event]:
        """Continue the confirmations without a verdict, the worst first, where the runs that are left can decide them.

        Args:
            by_index: The candidates.
            most: Runs of one confirmation at most, unless an equal part of what is left is more.
        """
        plan, procedure = self.plan, self.parts.procedure
        undecided = [attempt for attempt in self._begun() if _status(attempt) is Status.INCONCLUSIVE]
        undecided.sort(key=lambda a: badness(a.verdict), reverse=True)
        for number, attempt in enumerate(undecided, 1):
            latest = {a.scenario_id: a for a in confirmations(self.attempts)}
            left = plan.confirmations - sum(a.runs for a in latest.values())
            part = left // (len(undecided) - number + 1)
            budget = min(attempt.runs + left, max(most, attempt.runs + part))
            if attempt.confirms not in by_index or latest[attempt.scenario_id].index != attempt.index:
                continue
            candidate = by_index[attempt.confirms]
            if not self._reachable(_objectives(attempt), procedure.replace(max_runs=max(1, budget))):
                continue
            yield ConfirmationStarted(
                campaign=plan.name, candidate=candidate, number=number, of=len(undecided), runs=budget
            )
            yield from self.confirm(candidate, budget=budget, known=attempt)

    def confirm(
        self,
        candidate: Attempt,
        *,
        budget: int,
        reserve: int = 0,
        only_fail: bool = False,
        known: Attempt | None = None,
    ) -> Iterator[Event]:
        """Repeat a candidate in at most `budget` runs with new seeds.

        Where the requirement has a limit, runs are added in batches until the sequential procedure decides. A batch is
        the fewest runs that can decide, so their number does not depend on the number of workers; workers that would
        wait begin the next runs, which are dropped where the verdict does not need them. Without a limit all of the
        budget is spent.

        Args:
            reserve: Runs of the budget in which the next candidate can be shown to violate nearly always; 0 if others
                are left for it. Where it is certain that this one violates, but not always, and telling how often would
                use them up, it ends.
            only_fail: End as soon as it cannot be shown any more, within the budget, to violate nearly always.
            known: An earlier confirmation that ended without a verdict; its runs count towards the budget.
        """
        requirement, parts = self.plan.requirement, self.parts
        used = {seed for a in search_attempts(self.attempts) for seed in a.seeds[: a.measured_runs]}
        seeds = fresh_seeds(self.plan.seed, "confirmation", budget, used=used)
        again = candidate.replace(
            index=self.next_index,
            purpose="confirmation",
            confirms=candidate.index,
            measurements=known.measurements if known else (),
            failures=known.failures if known else (),
            verdict=None,
        )
        procedure = parts.procedure.replace(max_runs=budget)
        results: Results = []
        objectives = _objectives(again)
        count = budget
        if requirement.threshold is not None:
            count = next_repeats(requirement, objectives, procedure=procedure)
        ahead = min(max(0, parts.runner.lookahead - 1), MOST_AHEAD)
        while count:
            pending = submit(again, seeds[len(objectives) : len(objectives) + count + ahead], parts)
            yield from collect(again, pending[:count], results, parts)
            objectives = _objectives(again, results)
            count = next_repeats(requirement, objectives, procedure=procedure)
            hopeless = only_fail and Status.FAIL not in self._reachable(objectives, procedure)
            # The next candidate may be worth the runs more than telling how often this one violates.
            values = [value for value in objectives if value is not None]
            violations, left = sum(map(requirement.violated_by, values)), budget - len(objectives)
            certain = violations < len(values) and procedure.violated(violations, len(values))
            if count and (hopeless or (certain and left - count < reserve <= left)):
                budget = len(objectives)
                break
        yield self._add(store(again, results, parts, budget=budget))

    def explain(self) -> Iterator[Event]:
        """Run the mission without people, and every confirmed violation without each of its people in turn."""
        confirmed = [a for a in confirmations(self.attempts) if a.measured_runs]
        if not confirmed:
            return
        longest = max(confirmed, key=lambda a: a.measured_runs)
        baselines = [a for a in self.attempts if a.purpose == "baseline"]
        if not baselines or baselines[-1].measured_runs < longest.measured_runs:
            yield from self._with_people(longest, (), "baseline")
        if self.plan.requirement.threshold is None:
            return
        removed = {(a.confirms, a.without) for a in self.attempts if a.purpose == "removal"}
        for confirmation in confirmed:
            scenario, verdict = confirmation.proposal.scenario, confirmation.verdict
            if scenario is None or verdict is None or not violated(verdict):
                continue
            humans = scenario.people.humans
            if len(humans) < 2:  # the baseline is this scenario without its only person
                continue
            for i, human in enumerate(humans):
                if (confirmation.index, (human.name,)) not in removed:
                    yield from self._with_people(confirmation, humans[:i] + humans[i + 1 :], "removal")

    def _with_people(
        self, confirmation: Attempt, people: tuple[Human, ...], purpose: Literal["baseline", "removal"]
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
            campaign=self.plan.name,
            index=self.next_index,
            purpose=purpose,
            strategy=confirmation.strategy,
            brief=confirmation.brief,
            proposal=confirmation.proposal.replace(scenario=fewer, calls=()),
            confirms=None if purpose == "baseline" else confirmation.index,
            without=without,
        )
        yield ExplanationStarted(campaign=self.plan.name, without=without, people=len(people), runs=len(seeds))
        for event in make(attempt, submit(attempt, seeds, self.parts), self.parts):
            yield self._add(event.attempt) if isinstance(event, AttemptFinished) else event

    @property
    def next_index(self) -> int:
        """The index of the next attempt."""
        return max((attempt.index for attempt in self.attempts), default=-1) + 1

    def _add(self, attempt: Attempt) -> AttemptFinished:
        self.attempts.append(attempt)
        return AttemptFinished(campaign=self.plan.name, attempt=attempt)

    def _all(self) -> list[Attempt]:
        return [attempt for attempt in self.attempts if attempt.purpose == "confirmation"]

    def _begun(self) -> list[Attempt]:
        """Return the confirmations as they first ended: what is decided from them is the same after an interruption."""
        first: dict[str | None, Attempt] = {}
        for attempt in self._all():
            first.setdefault(attempt.scenario_id, attempt)
        return list(first.values())

    def _is_confirmed(self, candidate: Attempt) -> bool:
        return any(attempt.scenario_id == candidate.scenario_id for attempt in self._all())

    def _reachable(self, objectives: Sequence[float | None], procedure: Procedure) -> dict[Status, int]:
        """Return for each status that the rest of the budget can show how many runs it takes at least."""
        known = [value for value in objectives if value is not None]
        spent = procedure.max_runs - (len(objectives) - len(known))
        violations = sum(map(self.plan.requirement.violated_by, known))
        return procedure.replace(max_runs=spent).fewest_for(violations, len(known))


def _status(attempt: Attempt) -> Status | None:
    verdict = attempt.verdict
    return verdict.status if verdict else None


def _objectives(attempt: Attempt, results: Results | None = None) -> list[float | None]:
    """Return the objectives of an attempt and of its further runs, then None for each that could not be made."""
    runs = [result for result in results or () if isinstance(result, FinishedRun)]
    failures = len(attempt.failures) + len(results or ()) - len(runs)
    measured = [*attempt.measurements, *(run.measurement for run in runs)]
    return [measurement.objective for measurement in measured] + [None] * failures
