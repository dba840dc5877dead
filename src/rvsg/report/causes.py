"""Causes of a violation: the same seeds without people, and without each person in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rvsg.campaign.findings import Finding
from rvsg.report.facts import AttemptFacts, RunFacts


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair:
    """Runs of a finding and runs on the same seeds with fewer people. `without` names who is left out."""

    without: str
    runs: tuple[RunFacts, ...]
    before: tuple[RunFacts, ...]

    @property
    def violating(self) -> tuple[RunFacts, ...]:
        """The runs with fewer people that violate the requirement."""
        return tuple(run for run in self.runs if run.violated)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cause:
    """What leaving people out does to a finding, with the runs that show it."""

    finding: Finding
    nobody: Pair | None
    each: tuple[Pair, ...]


def cause_of(finding: Finding, confirmed: AttemptFacts, facts: Sequence[AttemptFacts]) -> Cause:
    """Return what the baseline and the removals say about the people of a finding."""
    baseline = next((f for f in reversed(facts) if f.attempt.purpose == "baseline"), None)
    removals = [f for f in facts if f.attempt.purpose == "removal" and f.attempt.confirms == confirmed.attempt.index]
    each = tuple(pair for f in removals if (pair := _pair(", ".join(f.attempt.without), confirmed, f)) is not None)
    return Cause(
        finding=finding,
        nobody=_pair("anybody", confirmed, baseline) if baseline is not None else None,
        each=each,
    )


def _pair(without: str, confirmed: AttemptFacts, fewer: AttemptFacts) -> Pair | None:
    """Pair the runs by seed; None where no seed was run both ways."""
    known = {run.run.seed: run for run in fewer.runs}
    both = [(run, known[run.run.seed]) for run in confirmed.runs if run.run.seed in known]
    if not both:
        return None
    return Pair(without=without, runs=tuple(b for _, b in both), before=tuple(a for a, _ in both))
