"""An exploration of ranges as pictures and as a page: the violation probability, its boundary, what each range does."""

from __future__ import annotations

import html
from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

import rvsg
from rvsg.campaign.exploration import Exploration
from rvsg.evaluation.response import Surface
from rvsg.evaluation.wording import number
from rvsg.report.charts import Scale, ticks
from rvsg.report.page import environment
from rvsg.scenario.variation import Range

Floats = NDArray[np.float64]
WIDTH, HEIGHT = 460, 380
LEFT, RIGHT, TOP, BOTTOM = 62, 442, 30, 326
CELLS = 48
MOST_PAIRS = 6
BOUNDARY = 0.5
STYLE = (
    "text{font:12px system-ui,sans-serif;fill:#5a6675}.bad{fill:#b3261e;stroke:#fff}.good{fill:#1b7a3d;stroke:#fff}"
    ".boundary{fill:none;stroke:#1b2430;stroke-width:2}.curve{fill:none;stroke:#1559c9;stroke-width:2}"
    ".spread{fill:#1559c9;opacity:.18}.grid{stroke:#dfe4ea}"
)


def response_svg(found: Exploration, *, alone: bool = False) -> str:
    """Return the picture of an exploration: a curve for one range, a map for each pair of the ranges that matter most.

    Args:
        alone: whether the picture is a file of its own rather than a part of a page.
    """
    panels = _panels(found)
    across = min(2, len(panels))
    rows = -(-len(panels) // across)
    parts = [
        f'<g transform="translate({k % across * WIDTH} {k // across * HEIGHT})">{panel}</g>'
        for k, panel in enumerate(panels)
    ]
    size = f'viewBox="0 0 {across * WIDTH} {rows * HEIGHT}"'
    opening = f'<svg xmlns="http://www.w3.org/2000/svg" {size}' if alone else f'<svg class="response" {size}'
    ground = f"<style>{STYLE}</style>" + ('<rect width="100%" height="100%" fill="#fff"/>' if alone else "")
    return f'{opening} role="img" aria-label="Violation probability over the ranges">{ground}{"".join(parts)}</svg>'


def response_page(found: Exploration) -> str:
    """Return an exploration as an HTML page that loads nothing."""
    low, high = found.interval
    ordered = sorted(found.sensitivities, key=lambda each: -each.share)
    degree = None if found.surface is None else found.surface.degree
    values = {
        "found": found,
        "picture": Markup(response_svg(found)),  # noqa: S704  (made above; every name in it is escaped)
        "probability": f"{found.violations / found.runs:.0%}",
        "interval": f"{low:.0%} to {high:.0%}",
        "limit": number(found.requirement.threshold or 0.0, found.requirement.unit),
        "rows": [(next(r for r in found.ranges if r.name == each.name), each) for each in ordered],
        "degree": degree,
        "invalid": sum(bool(point.problems) for point in found.points),
        "version": rvsg.__version__,
    }
    return environment().get_template("response.html").render(**values)


def _panels(found: Exploration) -> list[str]:
    surface = found.surface
    if len(found.ranges) == 1:
        return [_curve(found, surface)]
    order = sorted(range(len(found.ranges)), key=lambda k: (-_share(found, k), k))[:4]
    return [_map(found, surface, a, b) for a, b in list(combinations(order, 2))[:MOST_PAIRS]]


def _share(found: Exploration, index: int) -> float:
    return found.sensitivities[index].share if found.sensitivities else 0.0


def _map(found: Exploration, surface: Surface | None, a: int, b: int) -> str:
    """Draw the probability over two ranges, the others at their middles, with the boundary and the runs."""
    first, second = found.ranges[a], found.ranges[b]
    parts = [_title(f"{first.name} and {second.name}")]
    if surface is not None:
        edges = np.linspace(0.0, 1.0, CELLS + 1)
        centres = (edges[1:] + edges[:-1]) / 2
        cells = surface.probability(_plane(len(found.ranges), a, b, centres)).reshape(CELLS, CELLS)
        wide, high = (RIGHT - LEFT) / CELLS, (BOTTOM - TOP) / CELLS
        parts += [
            f'<rect x="{LEFT + i * wide:.2f}" y="{BOTTOM - (j + 1) * high:.2f}" width="{wide + 0.4:.2f}" '
            f'height="{high + 0.4:.2f}" fill="{_colour(float(cells[j, i]))}"/>'
            for j in range(CELLS)
            for i in range(CELLS)
        ]
        corners = surface.probability(_plane(len(found.ranges), a, b, edges)).reshape(CELLS + 1, CELLS + 1)
        parts.append(_boundary(corners))
    x, y = Scale(first.low, first.high, LEFT, RIGHT), Scale(second.low, second.high, BOTTOM, TOP)
    for point in found.judged:
        parts.append(_dot(x(point.values[a]), y(point.values[b]), point.violated, _said(found, point.values)))
    return "".join([*parts, *_axes(first, second.name, x, y, ticks(second.low, second.high))])


def _curve(found: Exploration, surface: Surface | None) -> str:
    """Draw the probability over one range with its 95 % interval; runs lie at 1 where they violate, else at 0."""
    (only,) = found.ranges
    x, y = Scale(only.low, only.high, LEFT, RIGHT), Scale(0.0, 1.0, BOTTOM, TOP)
    parts = [_title(only.name)]
    if surface is not None:
        shares = np.linspace(0.0, 1.0, 101)[:, None]
        low, high = surface.interval(shares)
        middle = surface.probability(shares)
        along = [x(only.at(float(s))) for s in shares[:, 0]]
        ring = [*zip(along, (y(float(v)) for v in high), strict=True)]
        ring += reversed([*zip(along, (y(float(v)) for v in low), strict=True)])
        parts.append(f'<polygon class="spread" points="{_points(ring)}"/>')
        curve = _points([*zip(along, (y(float(v)) for v in middle), strict=True)])
        parts.append(f'<polyline class="curve" points="{curve}"/>')
    parts += [
        _dot(x(p.values[0]), y(float(bool(p.violated))), p.violated, _said(found, p.values)) for p in found.judged
    ]
    return "".join([*parts, *_axes(only, "violation probability", x, y, [0.0, 0.25, 0.5, 0.75, 1.0])])


def _boundary(values: Floats) -> str:
    """Return where the probability is `BOUNDARY` as line segments, by marching squares over corner values (N, N)."""
    steps = len(values) - 1
    wide, high = (RIGHT - LEFT) / steps, (BOTTOM - TOP) / steps
    path = []
    for j in range(steps):
        for i in range(steps):
            corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1), (i, j)]
            cut = [
                (x0 + t * (x1 - x0), y0 + t * (y1 - y0))
                for (x0, y0), (x1, y1) in pairwise(corners)
                if (values[y0, x0] < BOUNDARY) != (values[y1, x1] < BOUNDARY)
                for t in [(BOUNDARY - values[y0, x0]) / (values[y1, x1] - values[y0, x0])]
            ]
            for (ax, ay), (bx, by) in zip(cut[::2], cut[1::2], strict=True):
                path.append(
                    f"M{LEFT + ax * wide:.1f} {BOTTOM - ay * high:.1f}L{LEFT + bx * wide:.1f} {BOTTOM - by * high:.1f}"
                )
    return f'<path class="boundary" d="{"".join(path)}"><title>probability 0.5</title></path>' if path else ""


def _plane(dimensions: int, a: int, b: int, shares: Floats) -> Floats:
    """Return points (N * N, D): rows of `b`, columns of `a`, the other parameters at their middles."""
    columns, rows = np.meshgrid(shares, shares)
    points = np.full((columns.size, dimensions), 0.5)
    points[:, a], points[:, b] = columns.ravel(), rows.ravel()
    return points


def _axes(across: Range, up_name: str, x: Scale, y: Scale, up_ticks: Sequence[float]) -> list[str]:
    parts = [
        f'<text x="{x(tick):.1f}" y="{BOTTOM + 17}" text-anchor="middle">{number(tick)}</text>'
        for tick in ticks(across.low, across.high)
    ]
    parts += [
        f'<text x="{LEFT - 7}" y="{y(tick) + 4:.1f}" text-anchor="end">{number(tick)}</text>' for tick in up_ticks
    ]
    middle = (TOP + BOTTOM) / 2
    parts.append(f'<text x="{(LEFT + RIGHT) / 2}" y="{BOTTOM + 38}" text-anchor="middle">{_e(across.name)}</text>')
    parts.append(
        f'<text transform="translate(14 {middle}) rotate(-90)" text-anchor="middle">{_e(up_name)}</text>'
        f'<rect x="{LEFT}" y="{TOP}" width="{RIGHT - LEFT}" height="{BOTTOM - TOP}" fill="none" stroke="#5a6675"/>'
    )
    return parts


def _dot(x: float, y: float, violated: bool | None, said: str) -> str:
    kind = "bad" if violated else "good"
    words = f"{said}: {'violated' if violated else 'not violated'}"
    return f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="4"><title>{_e(words)}</title></circle>'


def _said(found: Exploration, values: Sequence[float]) -> str:
    return ", ".join(f"{each.name} {value:.3g}" for each, value in zip(found.ranges, values, strict=True))


def _title(text: str) -> str:
    return f'<text x="{LEFT}" y="18">{_e(text)}</text>'


def _colour(probability: float) -> str:
    """Return a colour from white for 0 to red for 1."""
    red, green, blue = (round(255 + probability * (end - 255)) for end in (222, 92, 80))
    return f"#{red:02x}{green:02x}{blue:02x}"


def _points(points: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _e(text: str) -> str:
    return html.escape(text, quote=True)
