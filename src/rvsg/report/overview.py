"""The overview of several campaigns as one HTML page that leads to the report of each.

As with a report, the page is a function of the records, and of where the reports are.
"""

from __future__ import annotations

import base64
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from markupsafe import escape
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rvsg.core.errors import InputError
from rvsg.core.files import check_writable, write_whole
from rvsg.evaluation.verdict import counted
from rvsg.report.answer_row import AnswerRow
from rvsg.report.renderer import render
from rvsg.report.result import Result
from rvsg.report.run_facts import row_at
from rvsg.report.stills import pin_radius, plan_markup, spread
from rvsg.report.words import limit_in_words, robot_words, shown_at
from rvsg.search.exploration import Coverage
from rvsg.world.drawing import png_bytes
from rvsg.world.drawing.floor_plan import draw_plan
from rvsg.world.drawing.sheet import font
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.passages import line_of
from rvsg.world.world import World

Reported = tuple[str, Result]
"""Where the report of a campaign is, seen from the overview's folder, and what it is of."""


@dataclass(frozen=True, kw_only=True)
class Pin:
    """A failure and where it happens: the robot's position (m) at the moment that its row shows."""

    link: str
    """The report, seen from the overview's folder."""
    campaign: str
    x: float
    y: float
    world: World
    row: AnswerRow

    @property
    def address(self) -> str:
        """The report, with the part of its address that opens that moment."""
        return f"{quote(self.link)}#run={self.row.run}&t={shown_at(self.row.moment_s)}"


def pins_of(link: str, result: Result) -> list[Pin]:
    """Return a pin for every failure of a campaign, the most severe first."""
    campaign, pins = f"{result.plan.mission.route.name}, {result.requirement.name}", []
    for row in result.answer.failures:
        run = result.run_of(row.run)
        k, path = row_at(run, row.moment_s), run.trajectory
        x, y = float(path.x[k]), float(path.y[k])
        pins.append(Pin(link=link, campaign=campaign, x=x, y=y, world=result.world, row=row))
    return pins


def write_overview(path: Path, reported: Sequence[Reported], **how: Any) -> None:
    """Write the page to a file, whole or not at all; `how` as for `render_overview`."""
    write_whole(path, render_overview(reported, **how))


def render_overview(
    reported: Sequence[Reported],
    *,
    command: str,
    missing: int = 0,
    pins: Sequence[Pin] = (),
) -> str:
    """Return the page of one or more campaigns of one command, finished or not.

    Args:
        command: The command that repeats them all.
        missing: How many more have not begun.
        pins: Where the findings happen; the page has a map for each of their worlds.
    """
    missions = [result.plan.mission for _, result in reported]
    return render(
        "overview.html",
        title=f"{counted(len(reported), 'campaign')} in {' and '.join(_worlds(reported))}",
        robot="; ".join(dict.fromkeys(robot_words(mission) for mission in missions)),
        stack="; ".join(dict.fromkeys(stack for _, result in reported for stack in result.answer.setup[3:])),
        missing=missing,
        headline=_headline(reported),
        matrix=_matrix(reported),
        maps=_maps(pins),
        pins=pins,
        rows=[_row(link, result) for link, result in reported],
        several=len(_worlds(reported)) > 1,
        command=escape(command),
    )


def _worlds(reported: Sequence[Reported]) -> list[str]:
    return list(dict.fromkeys(Path(result.plan.mission.world).name for _, result in reported))


def _matrix(reported: Sequence[Reported]) -> dict[str, Any]:
    """Return routes by requirements: what each campaign found, with its badges."""
    several = len(_worlds(reported)) > 1
    requirements = list(dict.fromkeys(result.requirement.name for _, result in reported))
    cells: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for link, result in reported:
        mission = result.plan.mission
        route = f"{Path(mission.world).name}, {mission.route.name}" if several else mission.route.name
        cells.setdefault(route, {}).setdefault(result.requirement.name, []).append(
            {"link": quote(link), "answer": result.answer}
        )
    rows = [
        {"route": route, "cells": [by_requirement.get(name, []) for name in requirements]}
        for route, by_requirement in cells.items()
    ]
    return {"requirements": requirements, "rows": rows}


def _maps(pins: Sequence[Pin]) -> list[dict[str, Any]]:
    """Draw the plan of each world in which there are findings, with a numbered pin for each of them."""
    worlds = {pin.world.id: pin.world for pin in pins}
    numbered = list(enumerate(pins, 1))
    return [
        _map(f"map-{place}", world, [(k, pin) for k, pin in numbered if pin.world.id == world.id])
        for place, world in enumerate(worlds.values(), 1)
    ]


def _map(id_: str, world: World, pins: Sequence[tuple[int, Pin]]) -> dict[str, Any]:
    plan = floor_plan(world, tooltips=False)
    left, top, width, height = (float(v) for v in plan.view_box.split())
    points = [plan.transform.point(pin.x, pin.y) for _, pin in pins]
    radius = pin_radius(plan.view_box)
    places = spread(points, radius, (left, top, left + width, top + height))
    marks = [
        {
            "number": number_,
            "name": f"{pin.campaign}: {pin.row.number} {pin.row.name}",
            "link": pin.address,
            "x": f"{px:.2f}",
            "y": f"{py:.2f}",
            "from": f"{x:.2f} {y:.2f}" if (px, py) != (x, y) else "",
        }
        for (number_, pin), (x, y), (px, py) in zip(pins, points, places, strict=True)
    ]
    return {
        "id": id_,
        "title": world.title,
        **plan_markup(world, plan, within=f"#{id_}"),
        "pins": marks,
        "radius": f"{radius:.2f}",
        "letter": f"{1.35 * radius:.2f}",
    }


def _headline(reported: Sequence[Reported]) -> dict[str, str]:
    """Return how many campaigns violate their requirement, and how many do not, with and without contact."""
    answers = [result.answer for _, result in reported]
    ends = Counter("contact" if a.violated == "no" and a.tone == "warn" else a.violated for a in answers)
    kinds = (
        ("yes", "bad", "violated"),
        ("contact", "warn", "not violated, but with contact"),
        ("open", "quiet", "open"),
        ("no limit", "quiet", "without a limit"),
        ("no", "good", "not violated"),
    )
    said = [f"{ends[end]} {words}" for end, _, words in kinds if ends[end]]
    tone, chip = next((tone, words) for end, tone, words in kinds if ends[end])
    accounts = [result.accounting for _, result in reported]
    runs = counted(sum(account.search_runs + account.confirmation_runs for account in accounts), "simulated run")
    text = f"Of {counted(len(reported), 'campaign')}: {'; '.join(said)}. {runs}."
    return {"tone": tone, "chip": chip, "text": text}


def _row(link: str, result: Result) -> dict[str, Any]:
    """Return the row of a campaign: its most severe configuration."""
    account, answer, mission = result.accounting, result.answer, result.plan.mission
    return {
        "link": quote(link),
        "world": Path(mission.world).name,
        "route": mission.route.name,
        "answer": answer,
        "first": answer.rows[0] if answer.rows else None,
        "limit": limit_in_words(result.requirement) or "–",
        "runs": f"{account.search_runs} + {account.confirmation_runs}",
    }


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


def coverage_map(coverage: Coverage, world: World) -> Image.Image:
    """Return the floor plan with what was exercised on it.

    Blue discs are waypoints that people pass, larger where more scenarios do. Orange rings are places where the robot
    met people, larger where it met more. Lines are the routes. What is untested, a route or an area where nobody walks,
    is dashed in red; a waypoint that nobody passes is a small grey dot.
    """
    plan = draw_plan(world, show=LAYERS, width_px=1400, title=f"{world.title}: what is tested")
    image = plan.image.convert("RGB")
    draw = ImageDraw.Draw(image, "RGBA")
    untested = {entry.name for entry in coverage.areas if not entry.tested}
    for area in world.areas:
        if area.name in untested:
            corners = plan.view.pixels(np.array([*area.outline, area.outline[0]], float))
            _dashed(draw, corners, 3)
    tested = {entry.route for entry in coverage.routes if entry.scenarios}
    for route in world.routes:
        way = plan.view.pixels(line_of(world, route))
        if route.name in tested:
            draw.line([(float(x), float(y)) for x, y in way], fill=(*ROUTE, 150), width=3)
        else:
            _dashed(draw, way, 3)
    most = max(coverage.waypoints.values(), default=0)
    for name, count in coverage.waypoints.items():
        if not count:
            _disc(draw, plan.view.pixels(np.array(world.grid.position(name))), 2.5, QUIET)
        else:
            _disc(draw, plan.view.pixels(np.array(world.grid.position(name))), 3 + 7 * (count / most) ** 0.5)
    most_met = max((entry.encounters for entry in coverage.met_at), default=0)
    for met in coverage.met_at:
        at = plan.view.pixels(np.array(world.grid.position(met.waypoint)))
        _ring(draw, at, 8 + 16 * (met.encounters / most_met) ** 0.5, 3)
    return _with_legend(image)


def coverage_page(coverages: Sequence[tuple[Coverage, World]]) -> str:
    """Return the coverage of one or more worlds as an HTML page that loads nothing."""
    worlds = [
        {
            "title": world.title,
            "coverage": coverage,
            "picture": f"data:image/png;base64,{base64.b64encode(png_bytes(coverage_map(coverage, world))).decode()}",
            "untested": [(KINDS[kind], names) for kind, names in coverage.untested.items()],
            "requirements": [entry.name for entry in coverage.requirements],
            "encounters": [entry.name for entry in coverage.encounters],
        }
        for coverage, world in coverages
    ]
    return render("coverage.html", worlds=worlds)


def coverage_text(coverage: Coverage) -> str:
    """Return the coverage of a world as lines for a terminal."""
    width = max((len(entry.route) for entry in coverage.routes), default=0)
    held, read = counted(coverage.scenarios, "scenario"), counted(coverage.runs, "run")
    lines = [f"{coverage.world}: {held}, {read} read for encounters", ""]
    for entry in coverage.routes:
        judged = ", ".join(f"{name} {count}" for name, count in entry.requirements.items() if count)
        met = ", ".join(f"{name} {count}" for name, count in entry.encounters.items() if count)
        lines.append(
            f"  {entry.route:{width}}  {counted(entry.scenarios, 'scenario'):>13}  {judged or 'no requirement'}"
        )
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


def _with_legend(image: Image.Image) -> Image.Image:
    page = Image.new("RGB", (image.width, image.height + LEGEND_PX), "white")
    page.paste(image, (0, 0))
    draw = ImageDraw.Draw(page, "RGBA")
    y, x = image.height + LEGEND_PX / 2, 24.0
    for kind, words in (
        ("disc", "people walk here"),
        ("ring", "the robot meets people"),
        ("dash", "untested route or area"),
    ):
        if kind == "dash":
            _dashed(draw, np.array([[x - 12, y], [x + 14, y]]), 3, 8)
        elif kind == "disc":
            _disc(draw, np.array([x, y]), 8)
        else:
            _ring(draw, np.array([x, y]), 11, 3)
        draw.text((x + 22, y), words, fill=INK, font=font(17), anchor="lm")
        x += 60 + font(17).getlength(words)
    return page


COVERAGE_FORMATS = (".html", ".png", ".json")


@dataclass(frozen=True)
class WorldCoverage:
    """What was exercised of a world, with the world."""

    coverage: Coverage
    world: World

    @property
    def text(self) -> str:
        """The coverage as lines for a terminal."""
        return coverage_text(self.coverage)


def write_coverage(path: str | Path, worlds: Iterable[WorldCoverage]) -> None:
    """Write coverage to a file: .html, .png (of one world) or .json.

    Raises:
        InputError: another ending, or a picture of several worlds.
    """
    path, worlds = Path(path), tuple(worlds)
    kind = path.suffix.lower()
    check_coverage_file(path)
    if kind == ".json":
        values = [covered.coverage.model_dump(mode="json") for covered in worlds]
        write_whole(path, json.dumps(values, indent=2, ensure_ascii=False) + "\n")
    elif kind == ".html":
        write_whole(path, coverage_page([(covered.coverage, covered.world) for covered in worlds]))
    elif len(worlds) == 1:
        write_whole(path, png_bytes(coverage_map(worlds[0].coverage, worlds[0].world)))
    else:
        raise InputError(f"{path}: the scenarios are of {len(worlds)} worlds, and a picture shows one. Write .html.")


def check_coverage_file(path: Path) -> None:
    """Refuse a file that cannot be written, or whose ending is none that coverage is written as."""
    if path.suffix.lower() not in COVERAGE_FORMATS:
        raise InputError(
            f"{path}: coverage is written as {', '.join(COVERAGE_FORMATS)}. Give --out one of these endings."
        )
    check_writable(path)
