"""Several navigation stacks on the same scenarios and seeds: shares of violating runs, differences, ranking."""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.core.records import Record
from rvsg.evaluation.statistics import ShareDifference, share_difference, wilson


class ScoredRun(Record):
    """One run of a stack, judged by one requirement."""

    case: str
    """Scenario and requirement."""
    seed: int
    violated: bool | None
    """None if the run holds no judgement."""
    outcome: str
    contact: bool
    """Whether the robot touches a person."""
    at: tuple[float, float] | None = None
    """Where the robot is at the decisive moment of a violation, m."""


class StackScore(Record):
    """A stack over all cases."""

    label: str
    """The stack as the user named it, and the robot where there are several."""
    name: str
    version: str
    runs: tuple[ScoredRun, ...]
    failed: int = 0
    """Runs in which the stack itself failed."""

    @property
    def flags(self) -> dict[tuple[str, int], bool]:
        """Whether each judged run violates its requirement, by case and seed."""
        return {(run.case, run.seed): run.violated for run in self.runs if run.violated is not None}

    @property
    def violated(self) -> int:
        """Violating runs."""
        return sum(self.flags.values())

    @property
    def judged(self) -> int:
        """Runs with a judgement."""
        return len(self.flags)

    @property
    def share(self) -> float:
        """The share of judged runs that violate; 0 of none."""
        return self.violated / self.judged if self.judged else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's interval of the share."""
        return wilson(self.violated, self.judged) if self.judged else (0.0, 1.0)

    @property
    def contacts(self) -> int:
        """Runs in which the robot touches a person."""
        return sum(run.contact for run in self.runs)

    @property
    def arrived(self) -> int:
        """Runs that reach the goal in time."""
        return sum(run.outcome == "REACHED" for run in self.runs)

    def of_case(self, case: str) -> tuple[int, int]:
        """Return violating and judged runs of a case."""
        flags = [violated for (name, _), violated in self.flags.items() if name == case]
        return sum(flags), len(flags)


class StackPair(Record):
    """Two stacks on the same scenarios and seeds."""

    first: str
    second: str
    difference: ShareDifference | None
    """Share of the first less that of the second; None without a common run."""


class StackScores(Record):
    """The comparison: stacks from the least share of violating runs to the largest, and every pair of them."""

    source: str
    cases: tuple[str, ...]
    seeds: int
    scores: tuple[StackScore, ...]
    pairs: tuple[StackPair, ...]


def score_stacks(source: str, cases: Sequence[str], seeds: int, scores: Sequence[StackScore]) -> StackScores:
    """Rank stacks and compare every pair of them on their common runs."""
    ranked = sorted(scores, key=lambda score: (score.share, score.failed, score.label))
    pairs = []
    for k, first in enumerate(ranked):
        for second in ranked[k + 1 :]:
            common = sorted(first.flags.keys() & second.flags.keys())
            flags = [[score.flags[key] for key in common] for score in (first, second)]
            difference = share_difference(*flags, paired=True) if common else None
            pairs.append(StackPair(first=first.label, second=second.label, difference=difference))
    return StackScores(source=source, cases=tuple(cases), seeds=seeds, scores=tuple(ranked), pairs=tuple(pairs))
