"""The still charts of the report as SVG text: objectives of search and confirmation, and the course of the search.

They take their colours from the page (classes `axis`, `grid`, `limit`, `old`, `new`, `line`) and speak through
`title` elements; sizes are in pixels of the view box.
"""

from __future__ import annotations

import html
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from rvsg.campaign.attempt import Attempt, Plan
from rvsg.campaign.ranking import search_attempts
from rvsg.evaluation.verdict import Verdict, number
from rvsg.scenario.requirement import Requirement

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


def confirmation_chart(plan: Plan, selected: Attempt, confirmed: Attempt) -> str:
    """Draw the objectives of the search and of the confirmation as dots, with mean and interval."""
    old, new = selected.verdict, confirmed.verdict
    assert old is not None and new is not None
    limit = plan.requirement.threshold
    width, height = 640, 176
    x = Scale(*span([*_range(plan.requirement, (old, new)), *old.objectives, *new.objectives]), 116, width - 16)
    unit = plan.requirement.unit
    parts = [_frame(width, height, f"Objective of each run in the search and in the confirmation, {unit}")]
    for tick in ticks(x.low, x.high):
        parts.append(f'<line class="grid" x1="{x(tick):.1f}" x2="{x(tick):.1f}" y1="14" y2="138"/>')
        parts.append(f'<text class="axis" x="{x(tick):.1f}" y="154" text-anchor="middle">{number(tick)}</text>')
    axis = f"{plan.requirement.metric or 'robustness'}, {unit}" if unit else (plan.requirement.metric or "robustness")
    parts.append(f'<text class="axis" x="{(116 + width - 16) / 2}" y="171" text-anchor="middle">{_e(axis)}</text>')
    if limit is not None:
        parts.append(_limit(x(limit), limit, unit, 10, 138, room=width))
    for y, name, verdict, kind in ((48, "search", old, "old"), (104, "confirmation", new, "new")):
        parts.append(f'<text class="axis" x="104" y="{y + 4}" text-anchor="end">{name}</text>')
        parts += _dots(selected if kind == "old" else confirmed, x, y, kind, unit)
        if verdict.mean is not None:
            low, high = verdict.interval or (verdict.mean, verdict.mean)
            parts.append(f'<line class="{kind} bar" x1="{x(low):.1f}" x2="{x(high):.1f}" y1="{y + 22}" y2="{y + 22}"/>')
            parts.append(
                f'<path class="{kind} mark" d="M{x(verdict.mean):.1f} {y + 16}v12"><title>mean '
                f"{_e(number(verdict.mean, unit))}</title></path>"
            )
    return "".join([*parts, "</svg>"])


def _dots(attempt: Attempt, x: Scale, y: float, kind: str, unit: str) -> list[str]:
    """Draw a dot for each run, which opens it in the replay."""
    valued = [(m, m.objective) for m in attempt.measurements if m.objective is not None]
    found = []
    for place, (measurement, value) in enumerate(valued):
        up = y + 9 * math.sin(place * 2.4)
        said = _e(f"{number(value, unit)}, seed {measurement.seed}")
        found.append(
            f'<a href="#run={_e(measurement.run_id)}" aria-label="{said}">'
            f'<circle class="{kind}" cx="{x(value):.1f}" cy="{up:.1f}" r="4.5"><title>{said}</title></circle></a>'
        )
    return found


def search_chart(plan: Plan, attempts: Sequence[Attempt]) -> str:
    """Draw the mean objective of every attempt with its interval, in the order of the search."""
    done = [a for a in search_attempts(attempts) if a.verdict is not None and a.verdict.mean is not None]
    if not done:
        return ""
    limit, unit = plan.requirement.threshold, plan.requirement.unit
    said = f"limit {number(limit, unit)}" if limit is not None else ""
    width, height = 960, 280
    y = Scale(*span(_range(plan.requirement, [a.verdict for a in done if a.verdict])), height - 44, 14)
    right = width - 12 - LETTER * len(said)  # the limit's words stand beside the data, not on them
    x = Scale(-0.5, max(a.index for a in done) + 0.5, 58, right)
    groups: dict[int, list[Attempt]] = {}
    for attempt in done:
        groups.setdefault(attempt.brief.scenario_index, []).append(attempt)
    parts = [_frame(width, height, f"Mean objective of every attempt in the order of the search, {unit}")]
    whole = list(groups.values())
    in_turn = all(one[-1].index < other[0].index for one, other in itertools.pairwise(whole))
    named = in_turn and len(groups) <= MOST_NAMED
    parts += [_band(group, x, y) for group in whole[::2] if in_turn]
    for tick in ticks(y.low, y.high):
        parts.append(f'<line class="grid" x1="58" x2="{right:.1f}" y1="{y(tick):.1f}" y2="{y(tick):.1f}"/>')
        parts.append(f'<text class="axis" x="50" y="{y(tick) + 4:.1f}" text-anchor="end">{number(tick)}</text>')
    if limit is not None:
        parts.append(
            f'<line class="limit" x1="58" x2="{right:.1f}" y1="{y(limit):.1f}" y2="{y(limit):.1f}"/>'
            f'<text class="limit" x="{right + 6:.1f}" y="{y(limit) + 4:.1f}">{_e(said)}</text>'
        )
    parts += [_course(scenario, group, x, y, unit, named=named) for scenario, group in groups.items()]
    parts += [] if named else _numbers(x, y.start + 16, int(x.high))
    axis = "scenario" if named else "attempt, in the order of the search"
    parts.append(f'<text class="axis" x="{width / 2}" y="{height - 6}" text-anchor="middle">{axis}</text>')
    return "".join([*parts, "</svg>"])


def _course(scenario: int, group: Sequence[Attempt], x: Scale, y: Scale, unit: str, *, named: bool) -> str:
    """Draw one scenario's attempts in the order of its configurations, with its number where it is `named`."""
    parts = []
    points = " ".join(f"{x(a.index):.1f},{y(a.mean):.1f}" for a in group if a.mean is not None)
    parts.append(f'<polyline class="line" points="{points}"/>')
    for attempt in group:
        verdict = attempt.verdict
        assert verdict is not None and verdict.mean is not None
        at = x(attempt.index)
        if verdict.interval:
            low, high = verdict.interval
            parts.append(f'<line class="spread" x1="{at:.1f}" x2="{at:.1f}" y1="{y(low):.1f}" y2="{y(high):.1f}"/>')
        parts.append(
            f'<circle class="new" cx="{at:.1f}" cy="{y(verdict.mean):.1f}" r="3.5"><title>scenario {scenario + 1}, '
            f"configuration {attempt.brief.configuration_index + 1}: {_e(number(verdict.mean, unit))}</title></circle>"
        )
    if named:
        middle = x((group[0].index + group[-1].index) / 2)
        parts.append(
            f'<text class="axis" x="{middle:.1f}" y="{y.start + 16:.1f}" text-anchor="middle">{scenario + 1}</text>'
        )
    return "".join(parts)


def _numbers(x: Scale, y: float, last: int) -> list[str]:
    """Draw the numbers of attempts under the chart, for a strategy that returns to earlier scenarios."""
    shown = [int(tick) for tick in ticks(0, last) if tick == int(tick)]
    return [f'<text class="axis" x="{x(k):.1f}" y="{y:.1f}" text-anchor="middle">{k}</text>' for k in shown]


def _band(group: Sequence[Attempt], x: Scale, y: Scale) -> str:
    """Draw the ground under the attempts of a scenario, which separates it from its neighbours."""
    first, last = x(group[0].index - 0.5), x(group[-1].index + 0.5)
    top = y.end
    return f'<rect class="band" x="{first:.1f}" y="{top}" width="{last - first:.1f}" height="{y.start - top:.1f}"/>'


def _frame(width: int, height: int, title: str) -> str:
    return f'<svg class="chart" viewBox="0 0 {width} {height}" role="group" aria-label="{_e(title)}">'


def _limit(x: float, limit: float, unit: str, top: float, bottom: float, *, room: float) -> str:
    """Draw the limit as a line with its words, on the side that has room for them up to the pixel `room`."""
    side = f'x="{x + 5:.1f}"' if x + 90 < room else f'x="{x - 5:.1f}" text-anchor="end"'
    return (
        f'<line class="limit" x1="{x:.1f}" x2="{x:.1f}" y1="{top}" y2="{bottom}"/>'
        f'<text class="limit" {side} y="{top + 8}">{_e(f"limit {number(limit, unit)}")}</text>'
    )


def _e(text: str) -> str:
    return html.escape(text, quote=True)


COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#5f5f5f")
"""Distinguishable with the common kinds of colour blindness (Okabe and Ito)."""
