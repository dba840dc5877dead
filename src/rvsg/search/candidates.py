"""Candidates of a search, the one order of those of a scenario, and what a model is told of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from rvsg.findings.ranking import REHEARSAL, badness_of, measured
from rvsg.runs.attempt import Attempt
from rvsg.scenario.brief import Feedback, Tried, Tuning
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.variation import NO_CHANGE, differences, objects_changed

BOUND = 1.645
"""Half-width of the interval of an estimate in standard deviations: 95 % on either side."""


@dataclass(eq=False)
class Candidate:
    """One configuration in the race: what it was changed from, and the badness of its runs by seed."""

    attempt: Attempt
    """Its first attempt."""
    parent: Candidate | None = None
    operator: str = "new"
    badness: dict[int, float] = field(default_factory=dict)
    estimate: float = -math.inf
    deviation: float = math.inf
    repeats: list[int] = field(default_factory=list)
    """Attempts of other configurations that are the same up to the end of the drive."""
    reached: dict[str, int] = field(default_factory=dict)
    """The last goal that people reached in any of its runs."""
    decided: dict[str, int] = field(default_factory=dict)
    """The same until the moment that decided each run; what acts later is not worth a change."""
    last: Attempt = field(init=False)
    """Its last attempt: the one with the most runs."""

    def __post_init__(self) -> None:
        self.last = self.attempt

    @property
    def index(self) -> int:
        """The index of its first attempt."""
        return self.attempt.index

    @property
    def scenario_index(self) -> int:
        """The number of its scenario."""
        return self.attempt.scenario_index

    @property
    def scenario(self) -> Scenario:
        """The scenario that is run."""
        scenario = self.attempt.proposal.scenario
        assert scenario is not None
        return scenario

    @property
    def runs(self) -> int:
        """Return how many runs have an objective, a rehearsal left out."""
        return len(self.badness.keys() - {REHEARSAL})

    @property
    def mean(self) -> float:
        """The mean badness of the runs."""
        return math.fsum(self.badness.values()) / len(self.badness)

    @property
    def upper(self) -> float:
        """The upper bound of the estimate."""
        return self.estimate + BOUND * self.deviation

    @property
    def lower(self) -> float:
        """The lower bound of the estimate."""
        return self.estimate - BOUND * self.deviation


TUNED = "tune"
"""The operator of a candidate that the generator did not write."""
LAST, MOST_LISTED = 2, 4
"""The last so many written configurations are listed, and the first so many of all."""


def in_order(own: Sequence[Candidate]) -> list[Candidate]:
    """Return configurations in the order of all that is said of them: by estimate, the worst for the robot first.

    The one to go on from, "best", "behind" and the list of a prompt follow it; the earlier of equals comes first.
    """
    return sorted(own, key=lambda c: (-c.estimate, c.index))


def written(candidate: Candidate) -> Candidate:
    """Return the configuration of the generator that a candidate was tuned from; itself if the generator wrote it."""
    while candidate.operator == TUNED and candidate.parent is not None:
        candidate = candidate.parent
    return candidate


def made_from(candidate: Candidate) -> Candidate | None:
    """Return what a change of a candidate is told against: what was refined, or what was tuned as it was written."""
    origin = written(candidate)
    return candidate.parent if origin is candidate else origin


def last_written(own: Sequence[Candidate]) -> Candidate | None:
    """Return the configuration of a scenario that the generator answered last; None if all were tuned."""
    answers = [(index, c) for c in own for index in (*c.repeats, *((c.index,) if c.operator != TUNED else ()))]
    return max(answers, key=lambda each: each[0])[1] if answers else None


def mean_of(candidate: Candidate, requirement: Requirement) -> float:
    """Return the mean objective of a candidate's runs."""
    return requirement.badness(candidate.mean)  # the sign turned back


def tuning_of(candidate: Candidate, own: Sequence[Candidate], requirement: Requirement) -> Tuning | None:
    """Return what was tuned of a candidate; None where nothing was tried of what the generator wrote.

    Args:
        own: The candidates of the scenario that have runs.
    """
    origin = written(candidate)
    forms = forms_of(origin, own)
    if not forms:
        return None
    change = _difference(origin.scenario, candidate.scenario) if candidate is not origin else ""
    told = tried(origin, own, requirement)
    return Tuning(forms=len(forms), mean=told.mean, runs=told.runs, change=change, origin=told)


def tried(candidate: Candidate, own: Sequence[Candidate], requirement: Requirement) -> Tried:
    """Return what a candidate measured, and what it changed: of the one it was made from, or as it was written."""
    origin, before = written(candidate), made_from(candidate)
    values = tuple(requirement.badness(b) for b in candidate.badness.values())  # the sign turned back
    now, rehearsals = candidate.scenario, candidate.attempt.proposal.rehearsals
    certain = math.isfinite(candidate.deviation)
    return Tried(
        mean=mean_of(candidate, requirement),
        change=_difference(before.scenario, now) if before is not None else "first configuration",
        runs=len(values),
        violations=sum(map(requirement.violated_by, values)) if requirement.threshold is not None else None,
        best_of=len(forms_of(origin, own)) if origin is not candidate else 0,
        number=candidate.index,
        made_from=before.index if before is not None else None,
        objectives=values,
        estimate=requirement.badness(candidate.estimate) if certain else None,
        margin=BOUND * candidate.deviation if certain else None,
        repeats=len(candidate.repeats),
        rehearsed=tuple((value, _difference(e, now)) for e, value in rehearsals if e.situation != now.situation),
    )


def listed(own: Sequence[Candidate], requirement: Requirement) -> tuple[tuple[Tried, ...], tuple[float, ...]]:
    """Return the configurations of a scenario in their order, and the means of those that are left out.

    The first ones are listed, the last that the generator wrote, and all that they were made from. A single one is
    not listed.
    """
    ordered = in_order(own)
    numbers = set[int]()
    for candidate in [*ordered[:MOST_LISTED], *[c for c in own if c.operator != TUNED][-LAST:]]:
        each: Candidate | None = candidate
        while each is not None and each.index not in numbers:
            numbers.add(each.index)
            each = made_from(each)
    kept = [c for c in ordered if c.index in numbers]
    rest = tuple(mean_of(c, requirement) for c in ordered if c.index not in numbers)
    return (tuple(tried(c, own, requirement) for c in kept), rest) if len(own) > 1 else ((), ())


def _difference(before: Scenario, after: Scenario) -> str:
    people = differences(before.people, after.people)
    objects = objects_changed(before.mission, after.mission)
    return people if not objects else objects if people == NO_CHANGE else f"{objects}; {people}"


def forms_of(origin: Candidate, own: Sequence[Candidate]) -> list[Candidate]:
    """Return the forms with other numbers of a configuration that the generator wrote."""
    return [c for c in own if c is not origin and written(c) is origin]


def with_history(feedback: Feedback, attempts: Sequence[Attempt], requirement: Requirement) -> Feedback:
    """Return the feedback with what was tried in its scenario, in order, where the mean of the runs orders.

    Args:
        attempts: The attempts of the scenario, in order.
    """
    own: list[Candidate] = []
    for attempt in measured(attempts):
        own.append(Candidate(attempt, own[-1] if own else None, badness=badness_of(attempt, requirement)))
        own[-1].estimate = own[-1].mean
    (*_, last) = (c for c in own if c.scenario.id == feedback.scenario.id)
    return with_others(feedback, last, own, requirement)


def with_others(
    feedback: Feedback, candidate: Candidate, own: Sequence[Candidate], requirement: Requirement
) -> Feedback:
    """Return the feedback on a candidate with where it stands among those of its scenario, and the first of them."""
    first = in_order(own)[0]
    shown, rest = listed(own, requirement)
    parent = candidate.parent
    return feedback.replace(
        tuning=tuning_of(candidate, own, requirement),
        standing=tried(candidate, own, requirement),
        best=first.scenario if first is not candidate else None,
        previous_mean=None if parent is None or feedback.previous_mean is None else mean_of(parent, requirement),
        best_mean=mean_of(first, requirement),
        best_runs=len(first.badness),
        tried=shown,
        untried=rest,
    )
