"""The figures of `benchmarks/people.py` as SVG: meetings, closest distances, and speed over density."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

INK, GREY = "#222222", "#8a8a8a"
COLOURS = {"recorded": "#222222", "held out": "#8a8a8a", "default": "#2b6ca3", "hunavsim": "#c23b22"}
BEFORE_S = (3.2, 2.4, 2.0, 1.6, 1.2, 0.8)
WIDE, HIGH, TOP, LEFT = 250, 200, 56, 46


class Panel:
    """A set of axes at `left`, as parts of an SVG."""

    def __init__(self, left: float, title: str, x: tuple[float, float], y: tuple[float, float]) -> None:
        self.left, self.x, self.y = left, x, y
        self.parts = [f'<text x="{left}" y="{TOP - 12}" font-weight="bold">{title}</text>']

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return where a point of the data lies in the picture."""
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        up = (y - self.y[0]) / (self.y[1] - self.y[0])
        return round(self.left + WIDE * across, 1), round(TOP + HIGH * (1.0 - up), 1)

    def axes(self, xs: Sequence[float], ys: Sequence[float], label: str) -> None:
        """Draw horizontal lines, the numbers of both axes and the words below."""
        for y in ys:
            a, b = self.at(self.x[0], y)
            self.parts.append(f'<path d="M{a} {b}h{WIDE}" stroke="#e3e3e3"/>')
            self.parts.append(f'<text x="{a - 6}" y="{b + 4}" text-anchor="end" fill="{GREY}">{y:g}</text>')
        for x in xs:
            a, b = self.at(x, self.y[0])
            self.parts.append(f'<text x="{a}" y="{b + 16}" text-anchor="middle" fill="{GREY}">{x:g}</text>')
        middle = self.left + WIDE / 2
        self.parts.append(f'<text x="{middle}" y="{TOP + HIGH + 34}" text-anchor="middle">{label}</text>')

    def line(self, xs: Sequence[float], ys: Sequence[float], colour: str, dashes: str = "") -> None:
        """Draw a line through points."""
        points = " ".join("{},{}".format(*self.at(x, y)) for x, y in zip(xs, ys, strict=True))
        dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
        self.parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"{dashed}/>')

    def box(self, row: float, values: dict[str, float], colour: str) -> None:
        """Draw percentiles on a row: a line from the 5th to the 95th, a box of the quartiles, and the median."""
        low, first, middle, third, high = (self.at(values[p], row)[0] for p in ("p5", "p25", "p50", "p75", "p95"))
        y, high = self.at(0.0, row)[1], min(high, self.left + WIDE)
        self.parts.append(f'<path d="M{low} {y}H{high}" stroke="{colour}"/>')
        self.parts.append(
            f'<rect x="{first}" y="{y - 5}" width="{max(third - first, 1):.1f}" height="10" fill="{colour}" '
            f'opacity=".45"/><rect x="{middle - 1}" y="{y - 7}" width="2" height="14" fill="{colour}"/>'
        )


def plot(found: dict[str, Any], recorded: dict[str, Any]) -> str:
    """Return the picture of the figures of both profiles beside the recorded ones."""
    met = {"recorded": recorded["meetings"]["fit"], "held out": recorded["meetings"]["held_out"]}
    met |= {name: each["meetings"] for name, each in found.items()}
    meeting = Panel(LEFT, "Predicted closest distance, head-on, m", (3.3, 0.7), (0.0, 1.2))
    meeting.axes((3.2, 2.4, 1.6, 0.8), (0, 0.4, 0.8, 1.2), "seconds before the closest approach")
    closest = Panel(2 * LEFT + WIDE + 24, "Closest distance of centres, m", (0.0, 3.0), (0.0, 9.0))
    closest.axes((0, 1, 2, 3), (), "line: 5 to 95 % (cut at 3 m), box: quartiles")
    for k, kind in enumerate(("head_on", "crossing")):
        x, y = closest.at(0.0, 8.6 - 4.5 * k)
        closest.parts.append(f'<text x="{x}" y="{y}" fill="{GREY}">{kind.replace("_", "-")}</text>')
        for row, (name, values) in enumerate(met.items()):
            closest.box(7.8 - 4.5 * k - 0.95 * row, values[kind]["closest_centres_m"], COLOURS[name])
    for name, values in met.items():
        meeting.line(BEFORE_S, values["head_on"]["median_predicted_closest_m"], COLOURS[name])
    speed = Panel(3 * LEFT + 2 * WIDE + 30, "Speed, m/s (dashed: two ways)", (0.0, 2.5), (0.0, 1.6))
    speed.axes((0, 0.5, 1, 1.5, 2, 2.5), (0, 0.4, 0.8, 1.2, 1.6), "people per m²")
    flows = {"recorded": recorded["speed_at_density"]} | {n: each["speed_at_density"] for n, each in found.items()}
    for name, ways in flows.items():
        for key, dashes in (("one_way", ""), ("two_way", "5 4")):
            middles = [sum(map(float, density.split("-"))) / 2 for density in ways[key]]
            speed.line(middles, [value["speed_m_s"] for value in ways[key].values()], COLOURS[name], dashes)
    width, height = 3 * (LEFT + WIDE) + 50, TOP + HIGH + 46
    labels = {"recorded": "recorded", "held out": "recorded, not used for the fit", "default": "RVSG",
              "hunavsim": "HuNavSim"}  # fmt: skip
    key, x = [], LEFT
    for name, label in labels.items():
        key.append(f'<rect x="{x}" y="12" width="16" height="4" fill="{COLOURS[name]}"/>')
        key.append(f'<text x="{x + 22}" y="18">{label}</text>')
        x += 50 + 7 * len(label)
    start = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" '
    start += f'font-size="13" fill="{INK}"><rect width="{width}" height="{height}" fill="white"/>'
    return "\n".join([start, *key, *meeting.parts, *closest.parts, *speed.parts, "</svg>"]) + "\n"
