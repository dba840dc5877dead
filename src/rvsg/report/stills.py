"""Still pictures of a run as SVG, with labels that do not cover each other.

They draw over the floor plan that the page defines once under the id `rvsg-floor`.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from rvsg.evaluation.sampled import sampled
from rvsg.evaluation.verdict import metres
from rvsg.report.replay_data import PERIOD_S, people_colours
from rvsg.report.run_facts import footprint_of, row_at
from rvsg.robots.robot import Robot
from rvsg.simulation.run import Run
from rvsg.world.drawing.sheet import DARK, LIGHT
from rvsg.world.drawing.svg import FloorPlan, floor_plan
from rvsg.world.world import World

Point = tuple[float, float]
Box = tuple[float, float, float, float]
"""Left, top, right, bottom."""

RINGS, DIRECTIONS = 5, 12


def box_around(x: float, y: float, half_width: float, half_height: float) -> Box:
    """Return the box with this middle."""
    return (x - half_width, y - half_height, x + half_width, y + half_height)


def free_place(candidates: Iterable[Point], half: Point, taken: Sequence[Box], inside: Box) -> Point:
    """Return the first candidate at which a label lies inside and covers nothing taken; without any, the first.

    Args:
        half: Half the width and half the height of the label.
    """
    first: Point | None = None
    for x, y in candidates:
        first = first or (x, y)
        left, top, right, bottom = box_around(x, y, *half)
        if left < inside[0] or top < inside[1] or right > inside[2] or bottom > inside[3]:
            continue
        if all(right <= o[0] or o[2] <= left or bottom <= o[1] or o[3] <= top for o in taken):
            return x, y
    assert first is not None, "there is a candidate"
    return first


def around(x: float, y: float, step: float) -> Iterator[Point]:
    """Yield a point and rings of points around it, the nearest ring first, each from the top on."""
    yield x, y
    for ring in range(1, RINGS + 1):
        for k in range(DIRECTIONS):
            angle = 2.0 * math.pi * k / DIRECTIONS
            yield x + ring * step * math.sin(angle), y - ring * step * math.cos(angle)


def beside(x: float, y: float, radius: float, half: Point) -> Iterator[Point]:
    """Yield the places for a name beside a round body: above, below, right, left, then farther away."""
    for away in (radius, 2.5 * radius, 4.0 * radius):
        for dx, dy in ((0, -1), (0, 1), (1, 0), (-1, 0), (1, -1), (-1, -1), (1, 1), (-1, 1)):
            yield x + dx * (away + half[0]), y + dy * (away + half[1])


def spread(points: Sequence[Point], radius: float, inside: Box) -> list[Point]:
    """Return where round markers of one size go so that none covers another one or the point of another one."""
    placed: list[Point] = []
    taken: list[Box] = []
    for x, y in points:
        place = free_place(around(x, y, 1.1 * radius), (radius, radius), taken, inside)
        placed.append(place)
        taken.append(box_around(*place, radius, radius))
    return placed


NARROW_PX = 342
"""Width of a map on a phone 390 px wide."""
SMALLEST_PX = 11.5
LETTER = 0.6
"""Width of a letter against its height."""

LINE = 1.15
"""Distance of the lines of a name against the height of a letter."""


def narrow_size(floor: FloorPlan) -> float:
    """Return the size of letters, in units of the plan, that is 11.5 px on a phone."""
    return SMALLEST_PX * float(floor.view_box.split()[2]) / NARROW_PX


def narrow_names(floor: FloorPlan) -> str:
    """Return the plan's names; those that would cover another one on a phone have the class `minor`."""
    size = narrow_size(floor)
    left, top, width, height = (float(v) for v in floor.view_box.split())
    taken: list[Box] = []
    names = []
    for word in floor.words:
        lines = word.text.split("\n")
        wide, high = max(map(len, lines)) * size * LETTER, len(lines) * size * 1.2
        half = (high / 2, wide / 2) if word.turned else (wide / 2, high / 2)
        box = box_around(*floor.middle(word), *half)
        inside = left <= box[0] and top <= box[1] and box[2] <= left + width and box[3] <= top + height
        free = inside and all(box[2] < o[0] or o[2] < box[0] or box[3] < o[1] or o[3] < box[1] for o in taken)
        taken += [box] if free else []
        names.append(floor.name(word, kind="area-name" if free else "area-name minor", apart_em=LINE))
    return "\n".join(names)


def floor_svg(world: World) -> str:
    """Return the floor plan as one SVG element for the replay component, with the colours of the areas."""
    floor = floor_plan(world, tooltips=False)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="map" viewBox="{floor.view_box}" role="img" '
        f'aria-label="Floor plan of {html.escape(world.title, quote=True)} with the robot and the people">'
        f"<style>{area_colours(world, floor)}</style>{floor.shapes}{narrow_names(floor)}</svg>"
    )


def plan_markup(world: World, floor: FloorPlan, *, within: str = "") -> dict[str, Any]:
    """Return the parts of a floor plan that templates put together: box, floor, names and the style of the areas."""
    return {
        "box": floor.view_box,
        "floor": Markup(floor.shapes),  # noqa: S704 - made by us, its names escaped
        "names": Markup(narrow_names(floor)),  # noqa: S704
        "look": Markup(area_colours(world, floor, within=within)),  # noqa: S704
    }


def area_colours(world: World, floor: FloorPlan, *, within: str = "") -> str:
    """Return the style of the areas, as in `rvsg world draw`, and of their names on a narrow screen.

    Args:
        within: The selector of the element that holds the plan, on a page with several.
    """
    at = f"{within} " if within else ""
    kinds = (area.kind for area in world.areas)
    names = list(dict.fromkeys(kinds))
    rules = []
    for ink, wrap in ((LIGHT, "{}"), (DARK, "@media (prefers-color-scheme: dark){{{}}}")):
        colours = ink.kind_colours(names).values()
        tints = "".join(
            f"{at}.plan .kind-{place}{{fill:{css};stroke:{css};fill-opacity:{ink.tint}}}"
            for place, css in enumerate("#{:02x}{:02x}{:02x}".format(*colour) for colour in colours)
        )
        rules.append(wrap.format(tints))
    size = narrow_size(floor)
    words = ",".join(f"{at}{selector}" for selector in (".still .area-name", ".map .area-name", ".pin text"))
    rules.append(
        f"@media (max-width:640px){{{words}{{font-size:{size:.3f}px}}{at}.pin circle{{r:{0.8 * size:.3f}px}}}}"
    )
    return "".join(rules)


Floats = NDArray[np.float64]
Outline = Sequence[tuple[float, float]]

ACROSS_M = 7.5
HIGH_M = 5.0
LETTER_M = 0.32
"""Height of letters in a frame, metres: 11 px and more where a frame is at least 300 px wide."""
GREY = "#8a94a0"
SMALLEST_PIN_M = 0.34
TRAIL_S = 6.0
SHOWN_PEOPLE = 4
"""In a crowd, names and trails of more people cover each other."""


@dataclass(frozen=True, kw_only=True)
class Look:
    """What a still picture draws with: the floor plan, the robot's outline, people's colours by name."""

    plan: FloorPlan
    outline: Outline
    colours: Mapping[str, str | None]


def look_of(runs: Sequence[Run], plan: FloorPlan, robot: Robot | None) -> Look:
    """Return how still pictures of these runs are drawn."""
    return Look(plan=plan, outline=footprint_of(runs[0], robot), colours=people_colours(runs))


def frame(run: Run, t_s: float, look: Look, label: str) -> str:
    """Draw the surroundings of the robot at one moment, with the trails up to it."""
    path = run.trajectory
    row = row_at(run, t_s)
    x, y = look.plan.transform.point(float(path.x[row]), float(path.y[row]))
    left, top, width, height = (float(v) for v in look.plan.view_box.split())
    x0 = _kept(x - ACROSS_M / 2, left, left + width - ACROSS_M)
    y0 = _kept(y - HIGH_M / 2, top, top + height - HIGH_M)
    parts = [
        f'<svg class="still" viewBox="{x0:.2f} {y0:.2f} {ACROSS_M:g} {HIGH_M:g}" role="img" aria-label="{_e(label)}">',
        '<use href="#rvsg-floor"/>',
        *_trails(run, max(0, row - _samples(run, TRAIL_S)), row + 1, look, nearest(run, row)),
        *_bodies(run, row, look, nearest(run, row), (x0, y0, x0 + ACROSS_M, y0 + HIGH_M)),
        "</svg>",
    ]
    return "".join(parts)


def pin_radius(view_box: str) -> float:
    """Return the radius of a numbered pin, in units of the plan: its number can be read on a phone."""
    return max(SMALLEST_PIN_M, 0.75 * SMALLEST_PX * float(view_box.split()[2]) / NARROW_PX)


def _kept(value: float, low: float, high: float) -> float:
    return min(max(value, low), high) if high > low else (low + high) / 2


def nearest(run: Run, row: int | None = None) -> list[int]:
    """Return the people who come nearest to the robot, or are nearest at a sample: as many as a picture can show."""
    if not run.human_names:
        return []
    gap = sampled(run).gap
    at = gap.min(axis=0) if row is None else gap[row]
    return [int(h) for h in np.argsort(at, kind="stable")[:SHOWN_PEOPLE]]


def nearest_in_words(run: Run, t_s: float, away: str) -> str:
    """Return who is nearest in the tenth of a second that ends at a time, e.g. `in contact with Human 1`.

    Args:
        away: How it reads without a contact, with `{who}` and `{gap}`.
    """
    t, seen = run.trajectory.t, sampled(run)
    row = row_at(run, t_s)
    before = min(int(np.searchsorted(t, t_s - PERIOD_S + 1e-9)), row)
    gap = np.where(seen.touching[before : row + 1], 0.0, seen.gap[before : row + 1])
    least = np.unravel_index(int(gap.argmin()), gap.shape)
    who = run.human_names[int(least[1])]
    return f"in contact with {who}" if gap[least] <= 0.0 else away.format(who=who, gap=metres(float(gap[least])))


def _samples(run: Run, seconds: float) -> int:
    """Return how many samples of the run a time in seconds takes."""
    step = float(np.median(np.diff(run.trajectory.t))) if len(run.trajectory) > 2 else 1.0
    return max(1, round(seconds / max(1e-6, step)))


def _trails(run: Run, begin: int, end: int, look: Look, people: Sequence[int]) -> list[str]:
    path = run.trajectory
    rows = np.unique(np.append(np.arange(begin, end, _samples(run, 0.25)), end - 1))
    lines = [f'<polyline class="way of-robot" points="{_line(path.x[rows], path.y[rows], look.plan)}"/>']
    for h in people:
        colour = look.colours.get(run.human_names[h])
        if colour:
            points = _line(path.human_x[rows, h], path.human_y[rows, h], look.plan)
            lines.append(f'<polyline class="way" stroke="{colour}" points="{points}"/>')
    return lines


def _bodies(run: Run, row: int, look: Look, people: Sequence[int], inside: Box) -> list[str]:
    path = run.trajectory
    bodies, names = [], []
    robot = look.plan.transform.point(float(path.x[row]), float(path.y[row]))
    across = max(math.hypot(*corner) for corner in look.outline)
    taken = [box_around(*robot, across, across)]
    for h in people:
        radius = run.human_radius_m[h]
        taken.append(
            box_around(
                *look.plan.transform.point(float(path.human_x[row, h]), float(path.human_y[row, h])), radius, radius
            )
        )
    for h, name in enumerate(run.human_names):
        colour = look.colours.get(name)
        x, y, radius = float(path.human_x[row, h]), float(path.human_y[row, h]), run.human_radius_m[h]
        nose = f"M{radius * 0.95:.2f} 0L{radius * 0.2:.2f} {radius * 0.6:.2f}L{radius * 0.2:.2f} {-radius * 0.6:.2f}Z"
        pushed = run.human_outlines[h] if run.human_outlines else ()
        outline = " ".join(f"{px:g},{py:g}" for px, py in pushed)
        body = f'<polygon fill="{colour or GREY}" fill-opacity=".55" points="{outline}"/>' if pushed else ""
        bodies.append(
            f'<g transform="{look.plan.transform.placed(x, y, float(path.human_yaw[row, h]))}">{body}'
            f'<circle r="{radius:g}" fill="{colour or GREY}"/><path class="nose" d="{nose}"/></g>'
        )
        px, py = look.plan.transform.point(x, y)
        if colour and h in people and inside[0] <= px <= inside[2] and inside[1] <= py <= inside[3]:
            half = (len(name) * LETTER_M * LETTER / 2, LETTER_M * 0.6)
            at = free_place(beside(px, py, radius + 0.04, half), half, taken, inside)
            taken.append(box_around(*at, *half))
            if math.hypot(at[0] - px, at[1] - py) > radius + max(half) + 0.2:
                names.append(
                    f'<path class="leader" style="stroke:{colour}" d="M{px:.2f} {py:.2f}L{at[0]:.2f} {at[1]:.2f}"/>'
                )
            names.append(
                f'<text class="who" x="{at[0]:.2f}" y="{at[1] + LETTER_M * 0.35:.2f}" font-size="{LETTER_M}" '
                f'fill="{colour}">{_e(name)}</text>'
            )
    front = max(x for x, _ in look.outline)
    nose = f"M{front * 0.9:.2f} 0L{front * 0.1:.2f} {front * 0.5:.2f}L{front * 0.1:.2f} {-front * 0.5:.2f}Z"
    corners = " ".join(f"{x:.3f},{y:.3f}" for x, y in look.outline)
    pose = look.plan.transform.placed(float(path.x[row]), float(path.y[row]), float(path.yaw[row]))
    bodies.append(
        f'<g transform="{pose}"><polygon class="robot" points="{corners}"/><path class="nose" d="{nose}"/></g>'
    )
    return bodies + names


def _line(x: Floats, y: Floats, plan: FloorPlan) -> str:
    return " ".join(f"{a:.2f},{b:.2f}" for a, b in zip(*plan.transform.point(x, y), strict=True))


def _e(text: str) -> str:
    return html.escape(text, quote=True)
