"""What the generator is told of the configurations of its scenario, where an optimiser tunes the numbers of each."""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.campaign.racing import Candidate
from rvsg.scenario.brief import Tried, Tuning
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.variation import differences

TUNED = "tune"
"""The operator of a candidate that the generator did not write."""
LAST = 4
"""So many written configurations are listed, each with the best of its tuned forms."""


def written(candidate: Candidate) -> Candidate:
    """Return the configuration of the generator that a candidate was tuned from; itself if the generator wrote it."""
    while candidate.operator == TUNED and candidate.parent is not None:
        candidate = candidate.parent
    return candidate


def last_written(own: Sequence[Candidate]) -> Candidate | None:
    """Return the last configuration of a scenario that the generator wrote; None if all were tuned."""
    return next((candidate for candidate in reversed(own) if candidate.operator != TUNED), None)


def mean_of(candidate: Candidate, requirement: Requirement) -> float:
    """Return the mean objective of a candidate's runs."""
    return requirement.badness(candidate.mean)  # the sign turned back


def tuning_of(candidate: Candidate, own: Sequence[Candidate], requirement: Requirement) -> Tuning | None:
    """Return what was tuned of a candidate; None where nothing was tried of what the generator wrote.

    Args:
        own: The candidates of the scenario that have runs.
    """
    origin = written(candidate)
    forms = _forms(origin, own)
    if not forms:
        return None
    change = differences(origin.scenario.people, candidate.scenario.people) if candidate is not origin else ""
    return Tuning(forms=len(forms), mean=mean_of(origin, requirement), runs=origin.runs, change=change)


def tried(own: Sequence[Candidate], requirement: Requirement, *, last: int = LAST) -> tuple[Tried, ...]:
    """Return the configurations that the generator wrote, the first one first, each with the best of its tuned forms.

    What changed from the one it was made from is told in one line. There is no list of a single one: `tuning_of` says
    what became of it.
    """
    origins = [c for c in own if c.operator != TUNED]
    found: list[Tried] = []
    for origin in origins[-last:] if len(origins) > 1 else ():
        change = "first configuration"
        if origin.parent is not None:
            change = differences(origin.parent.scenario.people, origin.scenario.people)
        found.append(_tried(origin, change, requirement))
        forms = _forms(origin, own)
        if forms:
            best = max(forms, key=lambda c: (c.estimate, -c.index))
            change = differences(origin.scenario.people, best.scenario.people)
            found.append(_tried(best, change, requirement).replace(best_of=len(forms)))
    return tuple(found)


def _forms(origin: Candidate, own: Sequence[Candidate]) -> list[Candidate]:
    return [c for c in own if c is not origin and written(c) is origin]


def _tried(candidate: Candidate, change: str, requirement: Requirement) -> Tried:
    limit = requirement.threshold
    beyond = None if limit is None else sum(map(requirement.violated_by, _objectives(candidate, requirement)))
    return Tried(mean=mean_of(candidate, requirement), change=change, runs=candidate.runs, violations=beyond)


def _objectives(candidate: Candidate, requirement: Requirement) -> list[float]:
    return [requirement.badness(value) for value in candidate.badness.values()]  # the sign turned back
