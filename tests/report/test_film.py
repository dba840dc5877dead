from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.campaign.parts import MemoryLedger, warehouse
from tests.coded import coded
from tests.report.test_page import campaign

from rvsg.core.errors import InputError
from rvsg.report.film import HOLD_S, RATE_HZ, Shot, check_film, strip, write_film
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
def test_a_film_shows_all_of_the_run_at_its_speed(tmp_path: Path) -> None:
    out = tmp_path / "run.webp"
    write_film(out, a_shot(), speed=10.0, width_px=WIDTH)
    with Image.open(out) as film:
        shown = 0
        for frame in range(film.n_frames):
            film.seek(frame)
            film.load()
            shown += film.info["duration"]
    lasts = float(a_shot().run.trajectory.t[-1])
    assert shown / 1000 == pytest.approx(lasts / 10 + HOLD_S, abs=3 / RATE_HZ)


@pytest.mark.parametrize("name", ["run.avi", "run.mp4", "run", "run.png.exe"])
def test_an_unknown_format_is_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(InputError, check=coded("film-format")):
        check_film(Path(name))
