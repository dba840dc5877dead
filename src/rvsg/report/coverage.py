"""Coverage as a map and as a page."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

import rvsg
from rvsg.campaign.exploration import Coverage
from rvsg.report.page import environment
from rvsg.world.drawing import png_bytes
from rvsg.world.drawing.floor_plan import draw_plan
from rvsg.world.drawing.sheet import font
from rvsg.world.passages import line_of
from rvsg.world.world import World

Floats = NDArray[np.float64]
PASSED = (21, 89, 201)
MET = (201, 60, 20)
ROUTE = (90, 102, 117)
QUIET = (150, 158, 168)
UNTESTED = (179, 38, 30)
INK = (27, 36, 48)
LEGEND_PX = 54
LAYERS = frozenset({"objects", "areas", "title"})
KINDS = {
    "routes": "Routes without a scenario",
    "pairs": "Routes that have a scenario, but none judged by the requirement",
    "areas": "Areas where no person walks",
    "encounters": "Encounters that no run shows",
    "behaviours": "Behaviours that no person has",
    "requirements": "Requirements that judge no scenario",
}


def coverage_map(coverage: Coverage, world: World, *, width_px: int = 1400) -> Image.Image:
    """Return the floor plan with what was exercised on it.

    Blue discs are waypoints that people pass, larger where more scenarios do. Orange rings are places where the robot
    met people, larger where it met more. Lines are the routes. What is untested, a route or an area where nobody walks,
    is dashed in red; a waypoint that nobody passes is a small grey dot.
    """
    plan = draw_plan(world, show=LAYERS, width_px=width_px, title=f"{world.title}: what is tested")
    image = plan.image.convert("RGB")
    draw = ImageDraw.Draw(image, "RGBA")
    unit = width_px / 1400
    untested = {each.name for each in coverage.areas if not each.tested}
    for area in world.areas:
        if area.name in untested:
            corners = plan.view.pixels(np.array([*area.outline, area.outline[0]], float))
            _dashed(draw, corners, max(2, round(3 * unit)))
    tested = {each.route for each in coverage.routes if each.scenarios}
    for route in world.routes:
        way = plan.view.pixels(line_of(world, route))
        if route.name in tested:
            draw.line([(float(x), float(y)) for x, y in way], fill=(*ROUTE, 150), width=max(2, round(3 * unit)))
        else:
            _dashed(draw, way, max(2, round(3 * unit)))
    most = max(coverage.waypoints.values(), default=0)
    for name, count in coverage.waypoints.items():
        if not count:
            _disc(draw, plan.view.pixels(np.array(world.grid.position(name))), 2.5 * unit, QUIET)
        else:
            _disc(draw, plan.view.pixels(np.array(world.grid.position(name))), (3 + 7 * (count / most) ** 0.5) * unit)
    most_met = max((each.encounters for each in coverage.met_at), default=0)
    for met in coverage.met_at:
        at = plan.view.pixels(np.array(world.grid.position(met.waypoint)))
        _ring(draw, at, (8 + 16 * (met.encounters / most_met) ** 0.5) * unit, max(2, round(3 * unit)))
    return _with_legend(image, unit)


def coverage_page(coverages: Sequence[tuple[Coverage, World]]) -> str:
    """Return the coverage of one or more worlds as an HTML page that loads nothing."""
    worlds = [
        {
            "title": world.title,
            "coverage": coverage,
            "picture": _data_uri(coverage_map(coverage, world)),
            "untested": [(KINDS[kind], names) for kind, names in coverage.untested.items()],
            "requirements": [each.name for each in coverage.requirements],
            "encounters": [each.name for each in coverage.encounters],
        }
        for coverage, world in coverages
    ]
    return environment().get_template("coverage.html").render(worlds=worlds, version=rvsg.__version__)


def coverage_text(coverage: Coverage) -> str:
    """Return the coverage of a world as lines for a terminal."""
    width = max((len(each.route) for each in coverage.routes), default=0)
    lines = [f"{coverage.world}: {coverage.scenarios} scenarios, {coverage.runs} runs read for encounters", ""]
    for each in coverage.routes:
        judged = ", ".join(f"{name} {count}" for name, count in each.requirements.items() if count)
        met = ", ".join(f"{name} {count}" for name, count in each.encounters.items() if count)
        lines.append(f"  {each.route:{width}}  {each.scenarios:3} scenarios  {judged or 'no requirement'}")
        if met:
            lines.append(f"  {'':{width}}  runs with: {met}")
    lines += ["", "Untested:" if coverage.untested else "Everything listed is tested."]
    lines += [f"  {KINDS[kind]}: {', '.join(names)}" for kind, names in coverage.untested.items()]
    return "\n".join(lines)


def _disc(draw: ImageDraw.ImageDraw, at: Floats, radius: float, colour: tuple[int, int, int] = PASSED) -> None:
    x, y = (float(v) for v in at)
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=(*colour, 190))


def _ring(draw: ImageDraw.ImageDraw, at: Floats, radius: float, width: int) -> None:
    x, y = (float(v) for v in at)
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), outline=(*MET, 235), width=width)


def _dashed(draw: ImageDraw.ImageDraw, corners: Floats, width: int, dash: float = 10.0) -> None:
    for start, end in pairwise(corners):
        length = float(np.hypot(*(end - start)))
        for k in range(0, int(length // dash) + 1, 2):
            a, b = (start + (end - start) * min(1.0, n * dash / length) for n in (k, k + 1))
            draw.line((float(a[0]), float(a[1]), float(b[0]), float(b[1])), fill=UNTESTED, width=width)


def _with_legend(image: Image.Image, unit: float) -> Image.Image:
    height = round(LEGEND_PX * unit)
    page = Image.new("RGB", (image.width, image.height + height), "white")
    page.paste(image, (0, 0))
    draw = ImageDraw.Draw(page, "RGBA")
    y, x = image.height + height / 2, 24 * unit
    size = max(10, round(17 * unit))
    for kind, words in (
        ("disc", "people walk here"),
        ("ring", "the robot meets people"),
        ("dash", "untested route or area"),
    ):
        if kind == "dash":
            _dashed(draw, np.array([[x - 12 * unit, y], [x + 14 * unit, y]]), max(2, round(3 * unit)), 8 * unit)
        elif kind == "disc":
            _disc(draw, np.array([x, y]), 8 * unit)
        else:
            _ring(draw, np.array([x, y]), 11 * unit, max(2, round(3 * unit)))
        draw.text((x + 22 * unit, y), words, fill=INK, font=font(size), anchor="lm")
        x += 60 * unit + font(size).getlength(words)
    return page


def _data_uri(image: Image.Image) -> str:
    return f"data:image/png;base64,{base64.b64encode(png_bytes(image)).decode()}"
