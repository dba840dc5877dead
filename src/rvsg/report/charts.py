"""Charts of a campaign as SVG: objectives of search and confirmation, and the course of the search.

They take their colours from the page (classes `axis`, `grid`, `limit`, `old`, `new`, `line`) and speak through
`title` elements; sizes are in pixels of the view box.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from rvsg.evaluation.verdict import Verdict, number, objective
from rvsg.findings.ranking import search_attempts
from rvsg.report.renderer import render
from rvsg.report.run_facts import judged_curve
from rvsg.runs.attempt import Attempt, Plan
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.run import Run

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#5f5f5f")
"""Distinguishable with the common kinds of colour blindness (Okabe and Ito)."""
LETTER = 6.5
"""Pixels that a letter of the words in a chart takes at most, on average."""
MOST_NAMED = 25
"""Scenarios whose numbers find room under the course of the search."""


@dataclass(frozen=True)
class Scale:
    """A linear scale from values to pixels."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        """Return the pixel of a value."""
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Return round values between low and high, at most `most` and a few."""
    step = 10.0 ** math.floor(math.log10((high - low) / most))
    step = next(step * k for k in (1, 2, 5, 10) if (high - low) / (step * k) <= most)
    first = math.ceil(low / step - 1e-9)
    return [round(k * step, 10) for k in range(first, math.floor(high / step + 1e-9) + 1)]


def span(values: Sequence[float]) -> tuple[float, float]:
    """Return the least and the greatest value with some air around them."""
    low, high = min(values), max(values)
    air = 0.08 * (high - low) or 0.1 * abs(high) or 1.0
    return low - air, high + air


def _range(requirement: Requirement, verdicts: Sequence[Verdict]) -> list[float]:
    """Return what the axis of a chart of verdicts covers at least: limit, means and ends of their intervals."""
    values = [v for verdict in verdicts for v in (verdict.mean, *(verdict.interval or ()))]
    return [value for value in (requirement.threshold, *values) if value is not None]


def confirmation_chart(plan: Plan, selected: Attempt, confirmed: Attempt) -> Markup:
    """Draw the objectives of the search and of the confirmation as dots, with mean and interval."""
    old, new = selected.verdict, confirmed.verdict
    assert old is not None and new is not None
    requirement, width = plan.requirement, 640
    x = Scale(*span([*_range(requirement, (old, new)), *old.objectives, *new.objectives]), 116, width - 16)
    metric = requirement.metric or "robustness"
    return render(
        "confirmation.svg",
        x=x,
        width=width,
        ticks=ticks(x.low, x.high),
        unit=requirement.unit,
        axis=f"{metric}, {requirement.unit}" if requirement.unit else metric,
        limit=requirement.threshold,
        rows=((48, "search", selected, "old"), (104, "confirmation", confirmed, "new")),
        sway=lambda place: 9 * math.sin(place * 2.4),
    )


def requirement_chart(requirement: Requirement, runs: Sequence[Run]) -> Markup:
    """Draw the judged value of up to three runs over time: the mildest, the worst, and the nearest to the limit.

    Runs without a value are left out; it is empty where all are.
    """
    judged = [(value, run) for run in runs if (value := objective(run, requirement)) is not None]
    judged.sort(key=lambda pair: requirement.badness(pair[0]))
    limit = requirement.threshold
    nearest = sorted(judged[1:-1], key=lambda pair: abs(pair[0] - (limit or 0.0)))[:1]
    chosen = [*judged[:1], *nearest, *judged[1:][-1:]]
    curves = [judged_curve(run, requirement, None) for _, run in chosen]
    values = [float(v) for curve in curves for v in curve.value if math.isfinite(v)]
    if not values:
        return Markup("")
    lines = []
    for (value, run), curve, colour in zip(chosen, curves, COLOURS, strict=False):
        points = list(zip(curve.t.tolist(), curve.value.tolist(), strict=True))
        parts = [list(part) for real, part in itertools.groupby(points, lambda p: math.isfinite(p[1])) if real]
        verdict = "fails" if requirement.violated_by(value) else "holds"
        words = f"{run.id}: {number(value, requirement.unit)}, {verdict}"
        lines.append({"stretches": parts, "colour": colour, "words": words})
    width, height = 760, 330 + 16 * len(lines)
    y = Scale(*span([*values, *([] if limit is None else [limit])]), 290, 30)
    x = Scale(0.0, max(float(curve.t[-1]) for curve in curves if len(curve.t)), 58, width - 90)
    unit = f", {requirement.unit}" if requirement.unit else ""
    return render(
        "requirement.svg",
        title=f"{requirement.title}: {requirement.metric or 'room of the formula'}{unit}",
        x=x,
        y=y,
        x_ticks=ticks(x.low, x.high),
        y_ticks=ticks(y.low, y.high),
        limit=limit,
        lines=lines,
        width=width,
        height=height,
    )


def search_chart(plan: Plan, attempts: Sequence[Attempt]) -> Markup:
    """Draw the mean objective of every attempt with its interval, in the order of the search."""
    done = [a for a in search_attempts(attempts) if a.verdict is not None and a.verdict.mean is not None]
    if not done:
        return Markup("")
    limit, unit = plan.requirement.threshold, plan.requirement.unit
    said = f"limit {number(limit, unit)}" if limit is not None else ""
    width, height = 960, 280
    y = Scale(*span(_range(plan.requirement, [a.verdict for a in done if a.verdict])), height - 44, 14)
    # The limit's words stand beside the data, not on them.
    x = Scale(-0.5, max(a.index for a in done) + 0.5, 58, width - 12 - LETTER * len(said))
    groups: dict[int, list[Attempt]] = {}
    for attempt in done:
        groups.setdefault(attempt.brief.scenario_index, []).append(attempt)
    whole = list(groups.values())
    # A strategy that returns to earlier scenarios has no bands, and its attempts are numbered.
    in_turn = all(one[-1].index < other[0].index for one, other in itertools.pairwise(whole))
    named = in_turn and len(groups) <= MOST_NAMED
    return render(
        "search.svg",
        x=x,
        y=y,
        width=width,
        height=height,
        unit=unit,
        limit=limit,
        said=said,
        ticks=ticks(y.low, y.high),
        bands=whole[::2] if in_turn else (),
        groups=groups,
        named=named,
        numbers=() if named else [int(tick) for tick in ticks(0, int(x.high)) if tick == int(tick)],
    )
