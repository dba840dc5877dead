from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image
from tests.campaign.parts import MemoryLedger, warehouse
from tests.coded import coded
from tests.report.test_page import campaign

from rvsg.core.errors import InputError
from rvsg.report.film import HOLD_S, PICTURE_HZ, VIDEO_HZ, Shot, check_film, strip, write_film
from rvsg.report.run_facts import footprint_of
from rvsg.robots.robot import shipped_robots

WIDTH = 480


@cache
def a_shot() -> Shot:
    ledger = MemoryLedger()
    _, attempts = campaign(ledger, scenarios=1, refinements=0, confirmations=0)
    run = ledger.run(attempts[0].measurements[0].run_id)
    return Shot(
        run=run,
        world=warehouse(),
        robot=shipped_robots()["tiago_omni"],
        moments=(2.0, 5.0, 9.0),
        judged=lambda t: f"judged at {t:.0f}",
    )


def duration_s() -> float:
    return float(a_shot().run.trajectory.t[-1])


def test_a_robot_that_is_not_given_is_drawn_with_the_outline_of_the_run() -> None:
    outline = ((0.5, 0.2), (-0.5, 0.2), (-0.5, -0.2), (0.5, -0.2))
    run = a_shot().run
    assert footprint_of(replace(run, robot_outline=outline), None) == outline
    assert len(footprint_of(replace(run, robot_outline=()), None)) > 8  # a disc


def test_a_strip_has_a_picture_for_each_moment() -> None:
    sheet = strip(a_shot(), WIDTH)
    each = (sheet.width - 2 * 8) / 3
    assert sheet.width > 2 * WIDTH and each == int(each)
    pixels = np.asarray(sheet)
    first, second = pixels[:, : int(each)], pixels[:, int(each) + 8 : 2 * int(each) + 8]
    assert (first != second).any()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["gif", pytest.param("webp", marks=pytest.mark.exhaustive)])
def test_an_animation_shows_all_of_the_run_at_its_speed(kind: str, tmp_path: Path) -> None:
    out = tmp_path / f"run.{kind}"
    write_film(out, a_shot(), speed=10.0, width_px=WIDTH)
    with Image.open(out) as film:
        shown = 0
        for frame in range(film.n_frames):
            film.seek(frame)
            film.load()
            shown += film.info["duration"]
    assert shown / 1000 == pytest.approx(duration_s() / 10 + HOLD_S, abs=3 / PICTURE_HZ)


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", ["mp4", "webm"])
def test_a_video_lasts_as_long_as_the_run_at_its_speed(kind: str, tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="the extra `video` is not installed")
    out = tmp_path / f"run.{kind}"
    write_film(out, a_shot(), speed=10.0, width_px=WIDTH)
    _, seconds = ffmpeg.count_frames_and_secs(str(out))
    assert seconds == pytest.approx(duration_s() / 10 + HOLD_S, abs=3 / VIDEO_HZ)


def without(missing: str) -> Callable[..., ModuleType]:
    load = importlib.import_module

    def loaded(name: str, *rest: str) -> ModuleType:
        if name == missing:
            raise ImportError(name)
        return load(name, *rest)

    return loaded


def test_a_video_without_ffmpeg_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib, "import_module", without("imageio_ffmpeg"))
    with pytest.raises(InputError, check=coded("package-missing")):
        check_film(Path("run.mp4"))
    check_film(Path("run.webp"))


@pytest.mark.parametrize("name", ["run.avi", "run", "run.png.exe"])
def test_an_unknown_format_is_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(InputError, check=coded("film-format")):
        check_film(Path(name))
