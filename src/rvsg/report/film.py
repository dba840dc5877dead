"""A run as a WebP film, or as a PNG strip of its decisive moments."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg.evaluation.detection import contacts
from rvsg.evaluation.sampled import sampled
from rvsg.evaluation.verdict import number, outcome_in_words
from rvsg.report.replay_data import people_colours
from rvsg.report.run_facts import RunFacts, footprint_of, row_at, run_facts
from rvsg.report.stills import nearest_in_words
from rvsg.report.words import limit_in_words, quantity, shown_at
from rvsg.robots.robot import Robot
from rvsg.runs.attempt import Measurement
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.events import Contact
from rvsg.simulation.run import Run
from rvsg.world.drawing.floor_plan import DrawnPlan, draw_plan
from rvsg.world.drawing.sheet import NARROWEST_PX, font
from rvsg.world.world import World

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]

FORMATS = (".webp", ".png")
FINE = 2
"""Bodies are drawn this many times larger and then scaled down, which smooths their edges."""
BAR_PX, NAME_PX, GAP_PX = 56, 13, 8
RATE_HZ = 10.0
HOLD_S = 1.0
"""How long the last frame of a film stays."""
WINDOW_M = (8.0, 5.6)
LAYERS = frozenset({"objects", "areas"})
ROBOT, GREY, INK, TOUCH = "#1559c9", "#8a94a0", "#1b2430", "#b3261e"
TOUCH_M = 0.25


@dataclass(frozen=True, kw_only=True)
class Shot:
    """What to film. `judged` says in words what the requirement measures up to a time, empty for nothing.

    `verdict`: what the requirement says of the whole run, for its end.
    """

    run: Run
    world: World
    robot: Robot | None
    moments: Sequence[float] = ()
    judged: Callable[[float], str] = lambda _: ""
    verdict: str = ""


def shot_of_run(run: Run, measured: Measurement, requirement: Requirement, world: World, scenario: Scenario) -> Shot:
    """Return a shot of a run at the moments that matter for a requirement."""
    facts = run_facts(run, measured, requirement, world, scenario)
    return Shot(
        run=run,
        world=world,
        robot=scenario.mission.robot_record,
        moments=still_times(facts),
        judged=lambda t_s: _judged(facts, requirement, t_s),
        verdict=f"{requirement.name} {'' if facts.violated else 'not '}violated"
        if requirement.threshold is not None
        else "",
    )


STILLS = 4
APART_S = 0.8
"""Moments closer together than this look alike."""


def still_times(run: RunFacts) -> list[float]:
    """Return up to four moments worth a picture, in order: the decisive one, the closest, a contact, the end."""
    t = run.run.trajectory.t
    end = float(t[-1])
    contact = [event.time_s for event in run.contacts[:1]]
    wanted = [run.decisive_s, *contact, run.closest_s, end, end / 2, end / 4]
    times: list[float] = []
    for time in wanted:
        if len(times) < STILLS and all(abs(time - other) >= APART_S for other in times):
            times.append(float(shown_at(float(time))))
    return sorted(times)


def _judged(facts: RunFacts, requirement: Requirement, t_s: float) -> str:
    """Return what the requirement measures up to a time, with its limit."""
    values = [float(v) for t, v in zip(facts.curve.t, facts.curve.value, strict=True) if t <= t_s and v == v]
    if not values:
        return ""
    limit = limit_in_words(requirement)
    beside = f" (limit: {limit})" if limit else ""
    return f"{quantity(requirement)} so far: {number(values[-1], requirement.unit)}{beside}"


def check_film(path: Path) -> None:
    """Refuse a file whose format is unknown.

    Raises:
        InputError: says which formats there are.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(
            f"{path}: a replay is written as {' or '.join(FORMATS)}. Give --out one of these endings.",
            code="film-format",
        )


def write_film(path: Path, shot: Shot, *, speed: float = 1.0, width_px: int = 960) -> None:
    """Write a run to a file; its ending says the format.

    Args:
        speed: Simulated seconds for each second of the film.
        width_px: Width of the film; each picture of a PNG strip is half as wide.
    """
    check_film(path)
    buffer = io.BytesIO()
    if path.suffix.lower() == ".png":
        strip(shot, max(NARROWEST_PX, width_px // 2)).save(buffer, "PNG")
    else:
        first, *rest = _frames(shot, speed, width_px)
        every_ms = round(1000 / RATE_HZ)
        first.save(buffer, "WEBP", save_all=True, append_images=rest, duration=every_ms, loop=0, quality=80, method=3)
    write_whole(path, buffer.getvalue())


def strip(shot: Shot, width_px: int) -> Image.Image:
    """Return pictures of the decisive moments side by side, each of the surroundings of the robot."""
    path = shot.run.trajectory
    across, high = WINDOW_M if shot.world.grid.up == "y" else WINDOW_M[::-1]
    pictures = []
    for t_s in shot.moments or [float(path.t[-1])]:
        row = row_at(shot.run, t_s)
        x, y = float(path.x[row]), float(path.y[row])
        window = (x - across / 2, y - high / 2, x + across / 2, y + high / 2)
        pictures.append(_Stage(shot, draw_plan(shot.world, show=LAYERS, width_px=width_px, window=window)).frame(t_s))
    width = sum(picture.width + GAP_PX for picture in pictures) - GAP_PX
    sheet = Image.new("RGB", (width, max(picture.height for picture in pictures)), "white")
    left = 0
    for picture in pictures:
        sheet.paste(picture, (left, 0))
        left += picture.width + GAP_PX
    return sheet


def _frames(shot: Shot, speed: float, width_px: int) -> Iterator[Image.Image]:
    stage = _Stage(shot, draw_plan(shot.world, show=LAYERS, width_px=width_px))
    start, end = (float(shot.run.trajectory.t[k]) for k in (0, -1))
    for k in range(int(np.ceil((end - start) / speed * RATE_HZ)) + 1):
        yield stage.frame(min(start + k / RATE_HZ * speed, end))
    last = stage.frame(end)
    for _ in range(round(HOLD_S * RATE_HZ)):
        yield last


class _Stage:
    """Draws moments of one run over one floor plan."""

    def __init__(self, shot: Shot, plan: DrawnPlan) -> None:
        self.shot, self.view = shot, plan.view
        left, top, _, _ = plan.view.plan
        ground = plan.image.crop(plan.view.plan)
        self.origin = np.array([left, top])
        self.size = ground.size
        self.ground = ground.resize((ground.width * FINE, ground.height * FINE))
        self.colours = people_colours([shot.run])
        self.scale = plan.view.scale * FINE

    def frame(self, t_s: float) -> Image.Image:
        run, row = self.shot.run, row_at(self.shot.run, t_s)
        path = run.trajectory
        image = self.ground.copy()
        draw = ImageDraw.Draw(image)
        so_far = slice(0, row + 1, max(1, row // 400))
        people = [(h, name, self.colours[name]) for h, name in enumerate(run.human_names)]
        self._trail(draw, path.x[so_far], path.y[so_far], ROBOT)
        for h, _, colour in people:
            if colour:
                self._trail(draw, path.human_x[so_far, h], path.human_y[so_far, h], colour)
        for h, _, colour in people:
            self._person(draw, row, h, colour or GREY)
        pose = (float(path.x[row]), float(path.y[row]), float(path.yaw[row]))
        outline = np.array(footprint_of(run, self.shot.robot))
        self._shape(draw, outline * 1.1, pose, "white")
        self._shape(draw, outline, pose, ROBOT)
        self._nose(draw, float(outline[:, 0].max()), pose)
        for touch in touches(run, t_s):
            x, y = (float(v) for v in self._pixels(np.array(touch.x), np.array(touch.y)))
            r = TOUCH_M * self.scale
            draw.ellipse((x - r, y - r, x + r, y + r), outline=TOUCH, width=2 * FINE)
        for h, name, colour in people:
            if colour:
                x, y = self._pixels(path.human_x[row, h], path.human_y[row, h])
                above = (float(x), float(y) - run.human_radius_m[h] * self.scale - 2 * FINE)
                letters = font(NAME_PX * FINE)
                draw.text(above, name, colour, letters, "mb", stroke_width=2 * FINE, stroke_fill="white")
        page = Image.new("RGB", (self.size[0], self.size[1] + BAR_PX), "white")
        page.paste(image.resize(self.size, Image.Resampling.LANCZOS), (0, 0))
        self._words(ImageDraw.Draw(page), row)
        return page

    def _pixels(self, x: Floats, y: Floats) -> Floats:
        return np.asarray((self.view.pixels(np.stack([x, y], axis=-1)) - self.origin) * FINE)

    def _trail(self, draw: ImageDraw.ImageDraw, x: Floats, y: Floats, colour: str) -> None:
        if len(x) > 1:
            draw.line(_points(self._pixels(x, y)), fill=colour, width=max(2, round(0.06 * self.scale)), joint="curve")

    def _shape(self, draw: ImageDraw.ImageDraw, outline: Floats, pose: Pose, colour: str) -> None:
        x, y, yaw = pose
        cos, sin = np.cos(yaw), np.sin(yaw)
        at = self._pixels(x + outline[:, 0] * cos - outline[:, 1] * sin, y + outline[:, 0] * sin + outline[:, 1] * cos)
        draw.polygon(_points(at), fill=colour)

    def _nose(self, draw: ImageDraw.ImageDraw, reach: float, pose: Pose) -> None:
        self._shape(draw, reach * np.array([[0.9, 0.0], [0.15, 0.5], [0.15, -0.5]]), pose, "white")

    def _person(self, draw: ImageDraw.ImageDraw, row: int, h: int, colour: str) -> None:
        run = self.shot.run
        path, radius = run.trajectory, run.human_radius_m[h]
        pose = (float(path.human_x[row, h]), float(path.human_y[row, h]), float(path.human_yaw[row, h]))
        if run.human_outlines and run.human_outlines[h]:
            outline = np.array(run.human_outlines[h])
            middle = outline.mean(axis=0)
            self._shape(draw, outline, pose, "white")
            self._shape(draw, middle + 0.9 * (outline - middle), pose, colour)
        px, py = (float(v) for v in self._pixels(path.human_x[row, h], path.human_y[row, h]))
        r = radius * self.scale
        draw.ellipse((px - r, py - r, px + r, py + r), fill=colour, outline="white", width=2)
        self._nose(draw, radius, pose)

    def _words(self, draw: ImageDraw.ImageDraw, row: int) -> None:
        run = self.shot.run
        t_s = float(run.trajectory.t[row])
        first = f"{t_s:.1f} s   robot {run.trajectory.signed_speed[row]:.2f} m/s"
        if run.human_names:
            first += f"   {nearest_in_words(run, t_s, '{gap} from {who}')}"
        ended = (outcome_in_words(run.outcome), self.shot.verdict) if row == len(run.trajectory) - 1 else ()
        second = "   ".join(part for part in (self.shot.judged(t_s), *ended) if part)
        width, height = self.size
        for text, top in ((first, 6), (second, 30)):
            size = 18
            while size > 10 and draw.textlength(text, font=font(size)) > width - 16:
                size -= 1
            draw.text((8, height + top), text, fill=INK, font=font(size))


def touches(run: Run, t_s: float) -> list[Contact]:
    """Return the contacts of robot and people up to a time; a film marks their places."""
    return [contact for contact in contacts(sampled(run)) if contact.time_s <= t_s]


def _points(pixels: Floats) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in pixels]
