"""Which configurations did worst by the robot: the best of each scenario, the scenarios in order."""

from __future__ import annotations

from collections.abc import Iterable

from rvsg.campaign.attempt import Attempt
from rvsg.scenario.brief import Remembered
from rvsg.scenario.requirement import Requirement


def search_attempts(attempts: Iterable[Attempt]) -> list[Attempt]:
    """The attempts of the search; a confirmation never takes part in a selection."""
    return [attempt for attempt in attempts if attempt.purpose == "search"]


def best_attempt(attempts: Iterable[Attempt], requirement: Requirement) -> Attempt | None:
    """The search attempt whose mean objective is worst for the robot; the earliest of equals; None without any."""
    measured = [(attempt, attempt.mean) for attempt in search_attempts(attempts)]
    candidates = [
        (requirement.badness(mean), -attempt.index, attempt) for attempt, mean in measured if mean is not None
    ]
    return max(candidates, key=lambda c: c[:2])[2] if candidates else None


def best_of_each_scenario(attempts: Iterable[Attempt], requirement: Requirement) -> list[Attempt]:
    """The best attempt of every scenario that has one, in the order of the scenarios."""
    groups: dict[int, list[Attempt]] = {}
    for attempt in search_attempts(attempts):
        groups.setdefault(attempt.brief.scenario_index, []).append(attempt)
    best = (best_attempt(group, requirement) for _, group in sorted(groups.items()))
    return [attempt for attempt in best if attempt is not None]


def ranking(attempts: Iterable[Attempt], requirement: Requirement) -> list[Attempt]:
    """The best attempt of every scenario, the one that is worst for the robot first."""

    def key(attempt: Attempt) -> tuple[float, int]:
        assert attempt.mean is not None
        return (-requirement.badness(attempt.mean), attempt.index)

    return sorted(best_of_each_scenario(attempts, requirement), key=key)


def remember(attempts: Iterable[Attempt], requirement: Requirement, *, last: int) -> tuple[Remembered, ...]:
    """The memory a new scenario is told of: the `last` scenarios, each by its best configuration."""
    found = []
    for attempt in best_of_each_scenario(attempts, requirement):
        scenario, verdict = attempt.proposal.scenario, attempt.verdict
        assert scenario is not None and verdict is not None and verdict.mean is not None
        found.append(
            Remembered(
                description=scenario.description,
                tasks={human.name: tuple(task.name for task in human.tasks) for human in scenario.people.humans},
                mean=verdict.mean,
                interval=verdict.interval or (verdict.mean, verdict.mean),
                scenario=scenario,
            )
        )
    return tuple(found[-last:]) if last else ()
