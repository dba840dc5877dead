"""The figure of a comparison: the best value of the search against the runs spent, and the confirmed value."""

from __future__ import annotations

import html
import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from rvsg.report.charts import Scale, span, ticks

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#5f5f5f")
"""Distinguishable with the common kinds of colour blindness (Okabe and Ito)."""
PANEL_W, PANEL_H, LEGEND_H = 300, 220, 28
LEFT, RIGHT, TOP, BOTTOM = 44, PANEL_W - 16, 22, PANEL_H - 34
"""The edges of the plot in a panel, pixels."""


@dataclass(frozen=True)
class Line:
    """One method in one panel: for each seed the steps (runs, best value so far), and the confirmed values."""

    panel: str
    method: str
    steps: tuple[tuple[tuple[int, float], ...], ...]
    confirmed: tuple[float, ...]


COLUMNS = 3


def figure(lines: Sequence[Line]) -> str:
    """Return an SVG with a panel for each route and requirement.

    A curve is the mean over seeds of the best value so far; a dot is the mean confirmed value.
    """
    panels: dict[str, list[Line]] = defaultdict(list)
    for line in lines:
        panels[line.panel].append(line)
    methods = list(dict.fromkeys(line.method for line in lines))
    colours = {method: COLOURS[k % len(COLOURS)] for k, method in enumerate(methods)}
    rows = math.ceil(len(panels) / COLUMNS)
    width, height = PANEL_W * min(COLUMNS, max(1, len(panels))), PANEL_H * rows + LEGEND_H
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" '
        f'font-size="11"><rect width="{width}" height="{height}" fill="white"/>'
    ]
    for k, method in enumerate(methods):
        x = 10 + k * max(90, (width - 20) // max(1, len(methods)))
        parts.append(f'<line x1="{x}" x2="{x + 18}" y1="14" y2="14" stroke="{colours[method]}" stroke-width="2"/>')
        parts.append(f'<text x="{x + 23}" y="18">{html.escape(method)}</text>')
    for k, (name, drawn) in enumerate(panels.items()):
        left, top = PANEL_W * (k % COLUMNS), LEGEND_H + PANEL_H * (k // COLUMNS)
        parts.append(f'<g transform="translate({left},{top})">{_panel(name, drawn, colours)}</g>')
    return "".join([*parts, "</svg>\n"])


def _panel(name: str, lines: Sequence[Line], colours: dict[str, str]) -> str:
    values = [v for line in lines for steps in line.steps for _, v in steps[1:] or steps]
    values += [v for line in lines for v in line.confirmed]
    most = max((steps[-1][0] for line in lines for steps in line.steps if steps), default=1)
    if not values:
        return f'<text x="{LEFT}" y="14">{html.escape(name)}: nothing measured</text>'
    x, y = Scale(0.0, 1.05 * most, LEFT, RIGHT), Scale(*span(values), BOTTOM, TOP)
    parts = [f'<text x="{LEFT}" y="14" font-weight="bold">{html.escape(name)}</text>']
    for tick in ticks(y.low, y.high, 5):
        parts.append(f'<line x1="{LEFT}" x2="{RIGHT}" y1="{y(tick):.1f}" y2="{y(tick):.1f}" stroke="#ddd"/>')
        parts.append(f'<text x="{LEFT - 5}" y="{y(tick) + 4:.1f}" text-anchor="end">{tick:g}</text>')
    parts += [
        f'<text x="{x(tick):.1f}" y="{PANEL_H - 19}" text-anchor="middle">{tick:g}</text>'
        for tick in ticks(0.0, 1.05 * most, 5)
    ]
    parts.append(
        f'<text x="{(LEFT + PANEL_W) / 2:.0f}" y="{PANEL_H - 5}" text-anchor="middle">runs of the search</text>'
    )
    for line in lines:
        points = _mean_steps(line.steps, most)
        path = " ".join(f"{x(runs):.1f},{min(max(y(value), 20), PANEL_H - 32):.1f}" for runs, value in points)
        colour = colours[line.method]
        parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        if line.confirmed:
            mean = math.fsum(line.confirmed) / len(line.confirmed)
            parts.append(f'<circle cx="{x(1.02 * most):.1f}" cy="{y(mean):.1f}" r="4" fill="{colour}"/>')
    return "".join(parts)


def _mean_steps(steps: Sequence[Sequence[tuple[int, float]]], most: int) -> list[tuple[int, float]]:
    """Return the mean over seeds of step functions, at every run at which one changes and all are known."""
    known = [s for s in steps if s]
    if not known:
        return []
    first = max(s[0][0] for s in known)
    marks = sorted({first, most, *(runs for s in known for runs, _ in s if runs > first)})
    return [
        (mark, math.fsum(next(v for r, v in reversed(s) if r <= mark) for s in known) / len(known)) for mark in marks
    ]
