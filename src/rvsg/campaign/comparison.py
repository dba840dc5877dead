"""Paired comparison of variants of the system under test on the same scenarios and seeds.

A variant is what ran a set of cases: a version of the robot, a navigation stack, or the simulator of a campaign.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from itertools import combinations

from rvsg.campaign.suite import CaseResult, SuiteResult
from rvsg.core.records import Record
from rvsg.evaluation.statistics import ShareDifference, holm, share_difference
from rvsg.evaluation.verdict import Status, Verdict, violated


class Change(str, Enum):
    """What became of a case from one variant to another."""

    FIXED = "fixed"
    BROKEN = "broken"
    UNCHANGED = "unchanged"
    UNCLEAR = "unclear"
    MISSING = "only in one version"


class CaseChange(Record):
    """A case of two variants, compared on the seeds that both were run with."""

    case: str
    title: str
    requirement: str
    change: Change
    seeds: int = 0
    violations: tuple[int, int] = (0, 0)
    """Violating runs of the first and of the second variant, on these seeds."""
    only_first: int = 0
    """Seeds that violate in the first variant alone."""
    only_second: int = 0
    """Seeds that violate in the second variant alone."""
    difference: float | None = None
    """Share of violating runs, second minus first."""
    interval: tuple[float, float] | None = None
    """95 % interval of the difference, paired."""
    p: float | None = None
    """Exact McNemar test."""
    p_corrected: float | None = None
    """By Holm over all cases of the two variants."""


class VariantPair(Record):
    """Two variants on the same scenarios and seeds."""

    first: str
    second: str
    difference: ShareDifference | None
    """Share of violating runs of the first less that of the second over all cases; None without a common run."""
    changes: tuple[CaseChange, ...]


class Comparison(Record):
    """Variants, and every pair of them."""

    source: str
    """The suite or the campaigns whose scenarios were run."""
    variants: tuple[SuiteResult, ...]
    pairs: tuple[VariantPair, ...]

    @property
    def cases(self) -> tuple[tuple[str, str], ...]:
        """Name and requirement of every case, in order."""
        return tuple(dict.fromkeys(case.key for variant in self.variants for case in variant.cases))

    @property
    def changes(self) -> tuple[CaseChange, ...]:
        """What changed from the first variant to the second."""
        return self.pairs[0].changes if self.pairs else ()

    @property
    def broken(self) -> tuple[CaseChange, ...]:
        """The cases that the second variant breaks."""
        return tuple(each for each in self.changes if each.change is Change.BROKEN)


def compare(
    variants: Sequence[SuiteResult], *, source: str = "", error_rate: float = 0.05, ranked: bool = False
) -> Comparison:
    """Compare every pair of variants, over all their common runs and case by case.

    Args:
        error_rate: probability of one false alarm among the cases of a pair.
        ranked: order the variants from the least share of violating runs to the largest.
    """
    if ranked:
        variants = sorted(variants, key=lambda each: (each.share, each.failed, each.version))
    pairs = tuple(_pair(first, second, error_rate) for first, second in combinations(variants, 2))
    return Comparison(source=source or variants[0].suite, variants=tuple(variants), pairs=pairs)


def _pair(first: SuiteResult, second: SuiteResult, error_rate: float) -> VariantPair:
    mine, theirs = first.flags, second.flags
    common = [key for key in mine if key in theirs]
    difference = share_difference([mine[key] for key in common], [theirs[key] for key in common], paired=True)
    changes = changes_of(first, second, error_rate=error_rate)
    return VariantPair(first=first.version, second=second.version, difference=difference, changes=changes)


def changes_of(first: SuiteResult, second: SuiteResult, *, error_rate: float = 0.05) -> tuple[CaseChange, ...]:
    """Compare two variants case by case, on the same seeds.

    A case is fixed or broken where the exact McNemar test, corrected by Holm over all cases, is below `error_rate`;
    so the chance of one false alarm in the whole comparison is at most that. It is unchanged where the verdicts agree,
    and unclear where they do not and the test is not sure.
    """
    mine, theirs = ({case.key: case for case in result.cases} for result in (first, second))
    found = [_change(case, theirs.get(key)) for key, case in mine.items()]
    found += [_change(case, None) for key, case in theirs.items() if key not in mine]
    corrected = holm({str(k): each.p for k, each in enumerate(found) if each.p is not None})
    return tuple(
        each if each.p is None else _corrected(each, corrected[str(k)], error_rate) for k, each in enumerate(found)
    )


def _change(case: CaseResult, other: CaseResult | None) -> CaseChange:
    """Return a case as the verdicts alone say it; `_corrected` adds what the test says."""
    named = {"case": case.case, "title": case.title, "requirement": case.requirement}
    if other is None:
        return CaseChange(**named, change=Change.MISSING)
    theirs = other.flags
    pairs = [(flag, theirs[seed]) for seed, flag in case.flags.items() if seed in theirs]
    before, after = [a for a, _ in pairs], [b for _, b in pairs]
    only_first, only_second = sum(a and not b for a, b in pairs), sum(b and not a for a, b in pairs)
    agree = only_first == only_second == 0 or _settled(case.verdict) == _settled(other.verdict) is not None
    difference = share_difference(after, before, paired=True)
    return CaseChange(
        **named,
        change=Change.UNCHANGED if agree else Change.UNCLEAR,
        seeds=len(pairs),
        violations=(sum(before), sum(after)),
        only_first=only_first,
        only_second=only_second,
        difference=difference.difference if difference else None,
        interval=difference.interval if difference else None,
        p=_mcnemar(only_first, only_second),
    )


def _corrected(each: CaseChange, p: float, error_rate: float) -> CaseChange:
    change = each.change
    if p < error_rate:
        change = Change.BROKEN if each.only_second > each.only_first else Change.FIXED
    return each.replace(p_corrected=p, change=change)


def _mcnemar(only_first: int, only_second: int) -> float:
    """The exact two-sided McNemar test (McNemar 1947): the discordant pairs are a fair coin if nothing changed."""
    from scipy import stats

    discordant = only_first + only_second
    return float(stats.binomtest(only_second, discordant, 0.5).pvalue) if discordant else 1.0


def _settled(verdict: Verdict) -> bool | None:
    """Return whether a verdict says violated (True), passed (False) or neither (None)."""
    if verdict.status is Status.PASS:
        return False
    return True if violated(verdict) else None


def counts(changes: Sequence[CaseChange]) -> dict[Change, int]:
    """Return how many cases changed how; every kind is there."""
    return {change: sum(each.change is change for each in changes) for change in Change}
