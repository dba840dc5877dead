"""Records of a tuning: the setting it proposes, what that changes, and what every check of it says.

The cases of a suite are split by kind of failure: what the nearest person does when the robot violates. No kind is in
both parts, so a setting that only learnt its cases shows it on the held-out part.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Literal

from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.evaluation.statistics import ShareDifference, share_difference
from rvsg.simulation.stacks.parameters import Parameter
from rvsg.suites.suite import Comparison, SuiteResult
from rvsg.suites.suite_folder import SuiteCase
from rvsg.tune.parameter_search import Score, Unsolved
from rvsg.tune.setting_runs import SettingRun
from rvsg.tune.zones import Zones

PASSES = "passes"
HELD_OUT = 1 / 3
"""The share of the cases that is held out, about."""
Check = Literal["tuned", "held out", "ordinary", "empty", "attacked"]


class Split(Record):
    """Which cases of a suite are for tuning and which are held out."""

    tuned: tuple[str, ...]
    held_out: tuple[str, ...]
    kinds: dict[str, str]
    """The kind of failure of each case."""
    note: str = ""
    """Why kinds of failure are not apart; empty where they are."""


def split(cases: Sequence[SuiteCase], before: Iterable[SettingRun]) -> Split:
    """Split cases by kind of failure before tuning; of those that pass every third is held out."""
    seen: dict[str, Counter[str]] = {case.name: Counter() for case in cases}
    for run in before:
        if run.violated:
            seen[run.case][run.kind or "fails without people"] += 1
    groups: dict[str, list[str]] = {PASSES: []}
    for name, found in sorted(seen.items()):
        kind = min(found, key=lambda kind: (-found[kind], kind)) if found else PASSES
        groups.setdefault(kind, []).append(name)
    kinds = {name: kind for kind, names in groups.items() for name in names}
    passing, held, note = groups.pop(PASSES), list[str](), ""
    by_size = sorted(groups, key=lambda kind: (-len(groups[kind]), kind))
    failing = sum(map(len, groups.values()))
    if len(groups) > 1:
        for kind in by_size[1:]:
            if not held or len(held) + len(groups[kind]) / 2 <= HELD_OUT * failing:
                held += groups[kind]
    else:
        held = groups[by_size[0]][1::3]
        note = "All failures are of one kind, so " + (
            "held-out cases are of the same kind." if held else "none is held out."
        )
    held += passing[1::3]
    tuned = tuple(case.name for case in cases if case.name not in held)
    return Split(tuned=tuned, held_out=tuple(sorted(held)), kinds=kinds, note=note)


class ProposalCheck(Record):
    """One check of the proposal."""

    name: Check
    comparison: Comparison
    """The stack before tuning and the proposal; on the same scenarios and seeds, but for an attack."""
    failures: tuple[int, int] | None = None
    """Of an attack: confirmed failures before and after."""

    @property
    def before(self) -> SuiteResult:
        """The runs before tuning."""
        return self.comparison.variants[0]

    @property
    def after(self) -> SuiteResult:
        """The runs of the proposal."""
        return self.comparison.variants[1]

    @property
    def difference(self) -> ShareDifference | None:
        """The share of violating runs after, less that before."""
        mine, theirs = self.after.flags, self.before.flags
        common = [key for key in mine if key in theirs]
        if common and self.failures is None:
            return share_difference([mine[k] for k in common], [theirs[k] for k in common], paired=True)
        return share_difference(list(mine.values()), list(theirs.values()))

    @property
    def more_time(self) -> float:
        """How much longer a run takes after than before, as a share."""
        before, after = (
            sum(case.seconds for case in each.cases) / max(1, each.runs) for each in self.comparison.variants
        )
        return after / before - 1.0 if before else 0.0


class Choice(Record):
    """A setting on the front."""

    number: int
    """The number of the setting in the search; 0 is the one before tuning."""
    values: dict[str, float]
    """The values that it changes."""
    score: Score


class ValueChange(Record):
    """A value that the proposal changes."""

    name: str
    before: float | None
    after: float
    unit: str = ""
    key: str = ""
    """The key of the parameter file; empty where there is none."""
    without: Score | None = None
    """The proposal without this change; None where the user fixed the value."""


class Sweep(Record):
    """The proposal with one parameter at other values."""

    parameter: Parameter
    proposed: float
    points: tuple[tuple[float, Score], ...]


class Tuning(Record):
    """A tuning of a stack on a suite."""

    suite: str
    stack: Spec
    by: str
    """The version of RVSG."""
    seed: int
    runs: int
    """Runs of the search."""
    settings: int
    stopped: int
    """Settings that left the race early."""
    zones: Zones | None = None
    """Where zones were tried, rather than parameters."""
    tried: tuple[Choice, ...] = ()
    """Every setting of zones."""
    failed: tuple[str, ...]
    """Settings in which the stack failed or that it refused, each with the reason."""
    parameters: tuple[Parameter, ...]
    split: Split
    before: Score
    front: tuple[Choice, ...]
    unsolved: tuple[Unsolved, ...]
    importances: dict[str, float]
    notes: tuple[str, ...] = ()
    proposal: int | None = None
    """The number of the proposed setting; None where none is better than before."""
    score: Score | None = None
    """Of the proposal, on the cases and seeds of the search."""
    changes: tuple[ValueChange, ...] = ()
    parts: tuple[ProposalCheck, ...] = ()
    sweeps: tuple[Sweep, ...] = ()
    file: str | None = None
    """The file of the proposed stack, in the folder of the tuning."""
    diff: tuple[str, ...] = ()
    """The lines of the parameter file that differ."""
    commands: tuple[str, ...] = ()
    """What to run next."""

    @property
    def helps(self) -> bool:
        """Whether the tuned cases, with other seeds, clearly fail less, and the held-out ones not clearly more."""
        parts = self.part("tuned"), self.part("held out")
        tuned, held = (part.difference if part is not None else None for part in parts)
        return tuned is not None and tuned.interval[1] < 0.0 and (held is None or held.interval[0] <= 0.0)

    def part(self, *names: Check) -> ProposalCheck | None:
        """Return the first of these checks that was made."""
        return next((each for name in names for each in self.parts if each.name == name), None)
