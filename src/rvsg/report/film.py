"""A run as a film or as a strip of pictures, for people who do not open a page.

MP4 and WebM need ffmpeg, which the extra `video` brings; GIF, WebP and PNG need only Pillow.
"""

from __future__ import annotations

import importlib
import io
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rvsg.campaign.attempt import Measurement
from rvsg.core.errors import InputError, how_to_install
from rvsg.core.files import write_whole
from rvsg.evaluation.verdict import number, outcome_in_words
from rvsg.report.answer import quantity
from rvsg.report.page import still_times
from rvsg.report.replay_data import people_colours
from rvsg.report.run_facts import RunFacts, footprint_of, run_facts
from rvsg.report.stills import nearest_in_words
from rvsg.robots.robot import Robot
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.run import Run
from rvsg.world.drawing.floor_plan import Picture, draw_plan
from rvsg.world.drawing.sheet import NARROWEST_PX, font
from rvsg.world.world import World

Floats = NDArray[np.float64]
Pixels = NDArray[np.float64]

FINE = 2
BAR_PX = 56
NAME_PX = 13
VIDEO_HZ, PICTURE_HZ = 25.0, 10.0
HOLD_S = 1.0
"""How long the last frame of a film stays."""
WINDOW_M = (8.0, 5.6)
LAYERS = frozenset({"objects", "areas"})
ROBOT = "#1559c9"
GREY = "#8a94a0"
INK = "#1b2430"
FORMATS = (".mp4", ".webm", ".gif", ".webp", ".png")
_CODECS = {
    ".mp4": ("libx264", ["-crf", "23", "-preset", "medium", "-movflags", "+faststart"]),
    ".webm": ("libvpx-vp9", ["-crf", "34", "-b:v", "0", "-deadline", "good", "-cpu-used", "4"]),
}


@dataclass(frozen=True, kw_only=True)
class Shot:
    """What to film. `judged` says in words what the requirement measures up to a time, empty for nothing."""

    run: Run
    world: World
    robot: Robot | None
    moments: Sequence[float] = ()
    judged: Callable[[float], str] = lambda _: ""


def check_film(path: Path) -> None:
    """Refuse a file whose format is unknown or cannot be made on this machine.

    Raises:
        InputError: says which formats there are, or what to install.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(
            f"{path}: a replay is written as {', '.join(FORMATS)}. Give --out one of these endings.", code="film-format"
        )
    if path.suffix.lower() in _CODECS:
        _ffmpeg(path)


def write_film(path: Path, shot: Shot, *, speed: float = 1.0, width_px: int = 960) -> None:
    """Write a run to a file; its ending says the format.

    Args:
        speed: Simulated seconds for each second of the film.
        width_px: Width of the film; each picture of a PNG strip is half as wide.
    """
    check_film(path)
    kind = path.suffix.lower()
    if kind == ".png":
        write_whole(path, _encoded(strip(shot, max(NARROWEST_PX, width_px // 2)), "PNG"))
    elif kind in _CODECS:
        _write_video(path, shot, speed, width_px)
    else:
        _write_animation(path, shot, speed, width_px)


def strip(shot: Shot, width_px: int) -> Image.Image:
    """Return pictures of the decisive moments side by side, each of the surroundings of the robot."""
    path = shot.run.trajectory
    pictures = []
    for t_s in shot.moments or [float(path.t[-1])]:
        row = _row(shot.run, t_s)
        x, y = float(path.x[row]), float(path.y[row])
        across, high = WINDOW_M if shot.world.grid.up == "y" else WINDOW_M[::-1]
        window = (x - across / 2, y - high / 2, x + across / 2, y + high / 2)
        stage = _Stage(
            shot, draw_plan(shot.world, show=frozenset({"objects", "areas"}), width_px=width_px, window=window)
        )
        pictures.append(stage.frame(t_s))
    height = max(picture.height for picture in pictures)
    sheet = Image.new("RGB", (sum(p.width for p in pictures) + 8 * (len(pictures) - 1), height), "white")
    left = 0
    for picture in pictures:
        sheet.paste(picture, (left, 0))
        left += picture.width + 8
    return sheet


def frames(shot: Shot, *, rate_hz: float, speed: float, width_px: int) -> Iterator[Image.Image]:
    """Yield the frames of a film of the whole floor plan."""
    stage = _Stage(shot, draw_plan(shot.world, show=LAYERS, width_px=width_px))
    t = shot.run.trajectory.t
    count = int(np.ceil((float(t[-1]) - float(t[0])) / speed * rate_hz)) + 1
    last = None
    for k in range(count):
        last = stage.frame(min(float(t[0]) + k / rate_hz * speed, float(t[-1])))
        yield last
    for _ in range(round(HOLD_S * rate_hz)):
        assert last is not None
        yield last


class _Stage:
    """Draws moments of one run over one floor plan."""

    def __init__(self, shot: Shot, plan: Picture) -> None:
        self.shot, self.view = shot, plan.view
        left, top, right, bottom = plan.view.plan
        ground = plan.image.crop((left, top, right, bottom))
        self.origin = np.array([left, top])
        self.width, self.height = (ground.width // 2 * 2, ground.height // 2 * 2)  # video needs even sizes
        self.ground = ground.crop((0, 0, self.width, self.height)).resize((self.width * FINE, self.height * FINE))
        self.colours = people_colours([shot.run])

    def frame(self, t_s: float) -> Image.Image:
        run, row = self.shot.run, _row(self.shot.run, t_s)
        path = run.trajectory
        image = self.ground.copy()
        draw = ImageDraw.Draw(image)
        step = max(1, row // 400)
        self._trail(draw, path.x[: row + 1 : step], path.y[: row + 1 : step], ROBOT)
        for h, name in enumerate(run.human_names):
            if colour := self.colours[name]:
                self._trail(draw, path.human_x[: row + 1 : step, h], path.human_y[: row + 1 : step, h], colour)
        for h, name in enumerate(run.human_names):
            self._person(draw, row, h, self.colours[name] or GREY)
        self._robot(draw, row)
        for h, name in enumerate(run.human_names):
            if colour := self.colours[name]:
                self._name(draw, row, h, colour)
        small = image.resize((self.width, self.height), Image.Resampling.LANCZOS)
        page = Image.new("RGB", (self.width, self.height + BAR_PX), "white")
        page.paste(small, (0, 0))
        self._words(ImageDraw.Draw(page), row)
        return page

    def _pixels(self, x: Floats, y: Floats) -> Pixels:
        """Convert world metres to pixels of the fine picture."""
        return np.asarray((self.view.pixels(np.stack([x, y], axis=-1)) - self.origin) * FINE)

    def _trail(self, draw: ImageDraw.ImageDraw, x: Floats, y: Floats, colour: str) -> None:
        if len(x) > 1:
            draw.line(_points(self._pixels(x, y)), fill=colour, width=max(2, round(0.06 * self._scale)), joint="curve")

    @property
    def _scale(self) -> float:
        return self.view.scale * FINE

    def _shape(self, draw: ImageDraw.ImageDraw, outline: Floats, pose: tuple[float, float, float], colour: str) -> None:
        x, y, yaw = pose
        cos, sin = np.cos(yaw), np.sin(yaw)
        at = self._pixels(x + outline[:, 0] * cos - outline[:, 1] * sin, y + outline[:, 0] * sin + outline[:, 1] * cos)
        draw.polygon(_points(at), fill=colour)

    def _nose(self, draw: ImageDraw.ImageDraw, reach: float, pose: tuple[float, float, float]) -> None:
        nose = np.array([[0.9 * reach, 0.0], [0.15 * reach, 0.5 * reach], [0.15 * reach, -0.5 * reach]])
        self._shape(draw, nose, pose, "white")

    def _person(self, draw: ImageDraw.ImageDraw, row: int, h: int, colour: str) -> None:
        path, radius = self.shot.run.trajectory, self.shot.run.human_radius_m[h]
        x, y, yaw = (float(v[row, h]) for v in (path.human_x, path.human_y, path.human_yaw))
        ((px, py),) = _points(self._pixels(np.array([x]), np.array([y])))
        r = radius * self._scale
        if self.shot.run.human_outlines and self.shot.run.human_outlines[h]:
            outline = np.array(self.shot.run.human_outlines[h])
            self._shape(draw, outline, (x, y, yaw), "white")
            middle = outline.mean(axis=0)
            self._shape(draw, middle + 0.9 * (outline - middle), (x, y, yaw), colour)
        draw.ellipse((px - r, py - r, px + r, py + r), fill=colour, outline="white", width=2)
        self._nose(draw, radius, (x, y, yaw))

    def _name(self, draw: ImageDraw.ImageDraw, row: int, h: int, colour: str) -> None:
        run = self.shot.run
        at = self._pixels(run.trajectory.human_x[row : row + 1, h], run.trajectory.human_y[row : row + 1, h])[0]
        above = (float(at[0]), float(at[1]) - run.human_radius_m[h] * self._scale - 2 * FINE)
        how = {"font": font(NAME_PX * FINE), "anchor": "mb", "stroke_width": 2 * FINE, "stroke_fill": "white"}
        draw.text(above, run.human_names[h], fill=colour, **how)  # type: ignore[arg-type]

    def _robot(self, draw: ImageDraw.ImageDraw, row: int) -> None:
        path = self.shot.run.trajectory
        pose = (float(path.x[row]), float(path.y[row]), float(path.yaw[row]))
        outline = np.array(footprint_of(self.shot.run, self.shot.robot))
        self._shape(draw, outline * 1.1, pose, "white")
        self._shape(draw, outline, pose, ROBOT)
        self._nose(draw, float(outline[:, 0].max()), pose)

    def _words(self, draw: ImageDraw.ImageDraw, row: int) -> None:
        run = self.shot.run
        t_s = float(run.trajectory.t[row])
        first = f"{t_s:.1f} s   robot {run.trajectory.signed_speed[row]:.2f} m/s"
        if run.human_names:
            first += f"   {nearest_in_words(run, t_s, '{gap} from {who}')}"
        last = row == len(run.trajectory) - 1
        second = "   ".join(
            part for part in (self.shot.judged(t_s), outcome_in_words(run.outcome) if last else "") if part
        )
        for text, top in ((first, 6), (second, 30)):
            size = 18
            while size > 10 and draw.textlength(text, font=font(size)) > self.width - 16:
                size -= 1
            draw.text((8, self.height + top), text, fill=INK, font=font(size))


def _row(run: Run, t_s: float) -> int:
    return min(int(np.searchsorted(run.trajectory.t, t_s - 1e-9)), len(run.trajectory) - 1)


def _points(pixels: Pixels) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in pixels]


def _encoded(image: Image.Image, kind: str, **how: object) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, kind, **how)
    return buffer.getvalue()


def _write_animation(path: Path, shot: Shot, speed: float, width_px: int) -> None:
    first, *rest = frames(shot, rate_hz=PICTURE_HZ, speed=speed, width_px=width_px)
    how: dict[str, object] = {"save_all": True, "append_images": rest, "duration": round(1000 / PICTURE_HZ), "loop": 0}
    if path.suffix.lower() == ".webp":
        how |= {"quality": 80, "method": 3}
    write_whole(path, _encoded(first, path.suffix[1:].upper(), **how))


def _write_video(path: Path, shot: Shot, speed: float, width_px: int) -> None:
    ffmpeg = _ffmpeg(path)
    codec, options = _CODECS[path.suffix.lower()]
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / f"film{path.suffix.lower()}"
        writer = None
        for image in frames(shot, rate_hz=VIDEO_HZ, speed=speed, width_px=width_px):
            if writer is None:
                how = {"fps": VIDEO_HZ, "codec": codec, "output_params": options, "macro_block_size": 2}
                writer = ffmpeg.write_frames(str(draft), image.size, ffmpeg_log_level="error", **how)
                writer.send(None)
            writer.send(image.tobytes())
        assert writer is not None
        writer.close()
        write_whole(path, draft.read_bytes())


def _ffmpeg(path: Path) -> Any:
    try:
        return importlib.import_module("imageio_ffmpeg")
    except ImportError:
        raise InputError(
            f"{path}: {path.suffix} needs ffmpeg: {how_to_install('video')}. Without it, write .webp, .gif or .png.",
            code="package-missing",
        ) from None


def shot_of_run(run: Run, measured: Measurement, requirement: Requirement, world: World, scenario: Scenario) -> Shot:
    """Return a shot of a run at the moments that matter for a requirement."""
    facts = run_facts(run, measured, requirement, world, scenario)
    return Shot(
        run=run,
        world=world,
        robot=scenario.mission.robot_record,
        moments=still_times(facts),
        judged=lambda t_s: _judged(facts, requirement, t_s),
    )


def _judged(facts: RunFacts, requirement: Requirement, t_s: float) -> str:
    """Return what the requirement measures up to a time, with its limit."""
    known = [float(v) for t, v in zip(facts.curve.t, facts.curve.value, strict=True) if t <= t_s and v == v]
    if not known:
        return ""
    limit = requirement.threshold
    beside = f" (limit {number(limit, requirement.unit)})" if limit is not None else ""
    return f"{quantity(requirement)} so far: {number(known[-1], requirement.unit)}{beside}"
