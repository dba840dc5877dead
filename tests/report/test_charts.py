"""Whatever a chart draws stands within it, and nothing is left out without a word."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.campaign.parts import REQUIREMENT, warehouse
from tests.coded import coded
from tests.evaluation.runs import run_of, trajectory
from tests.report.test_page import default_campaign

from rvsg.core.errors import InputError
from rvsg.evaluation.verdict import judge, number, objective
from rvsg.report.charts import LETTER, confirmation_chart, requirement_chart, search_chart
from rvsg.report.film import HOLD_S, RATE_HZ, Shot, check_film, strip, write_film
from rvsg.report.run_facts import footprint_of
from rvsg.robots.robot import shipped_robots
from rvsg.runs.attempt import Attempt, Plan
from rvsg.simulation.events import Contact

SPACE = "http://www.w3.org/2000/svg"
WIDE = [(-9.0, 1.0), (0.5, 40.0), (-1000.0, 1000.0)]


@pytest.fixture(scope="module")
def found() -> tuple[Plan, list[Attempt]]:
    plan, attempts, _ = default_campaign()
    return plan, [attempt for attempt in attempts if attempt.purpose in ("search", "confirmation")]


def spread(attempt: Attempt, interval: tuple[float, float]) -> Attempt:
    return attempt.replace(verdict=attempt.verdict.replace(interval=interval))


def lines(svg: str, kind: str) -> list[dict[str, float]]:
    """The ends of the lines of a class."""
    return [
        {name: float(node.attrib[name]) for name in ("x1", "x2", "y1", "y2")}
        for node in ET.fromstring(svg).iter("line")
        if kind in node.attrib["class"].split()
    ]


@pytest.mark.parametrize("interval", WIDE)
def test_whatever_a_chart_draws_stands_on_its_canvas(
    found: tuple[Plan, list[Attempt]], interval: tuple[float, float]
) -> None:
    plan, attempts = found
    old, new = attempts[0], attempts[-1]
    for both in ((spread(old, interval), new), (old, spread(new, interval))):
        bars = lines(confirmation_chart(plan, *both), "bar")
        assert len(bars) == 2
        assert all(116 <= bar["x1"] <= bar["x2"] <= 640 - 16 for bar in bars), "beside their names"
    svg = search_chart(plan, [spread(old, interval), *attempts[1:]])
    assert all(14 <= line["y2"] <= line["y1"] <= 280 - 44 for line in lines(svg, "spread"))
    far = plan.replace(requirement=REQUIREMENT.replace(limit=500.0))
    assert 116 <= lines(confirmation_chart(far, old, new), "limit")[0]["x1"] <= 640 - 16
    assert 14 <= lines(search_chart(far, attempts), "limit")[0]["y1"] <= 280 - 44


def test_the_words_of_the_limit_stand_beside_the_search_and_a_unit_is_no_markup(
    found: tuple[Plan, list[Attempt]],
) -> None:
    plan, attempts = found
    long, sly = (plan.replace(requirement=REQUIREMENT.replace(unit=unit)) for unit in ("contacts per minute", "<b>&m"))
    svg = ET.fromstring(search_chart(long, attempts))
    words = next(node for node in svg.iter("text") if node.attrib["class"] == "limit")
    assert words.text == "limit 1 contacts per minute"
    start = float(words.attrib["x"])
    assert start > max(float(dot.attrib["cx"]) + 3.5 for dot in svg.iter("circle"))
    assert start + LETTER * len(words.text) <= 960
    for drawn in (confirmation_chart(sly, attempts[0], attempts[-1]), search_chart(sly, attempts)):
        assert not list(ET.fromstring(drawn).iter("b"))


def test_two_runs_have_no_interval_that_would_flatten_the_search_chart(found: tuple[Plan, list[Attempt]]) -> None:
    plan, attempts = found
    searched = [
        attempt.replace(verdict=judge(plan.requirement, (1.0 + k, 1.5 + k)))
        for k, attempt in enumerate(each for each in attempts if each.purpose == "search")
    ]
    svg = search_chart(plan, searched)
    assert lines(svg, "spread") == []
    dots = [float(node.attrib["cy"]) for node in ET.fromstring(svg).iter() if node.attrib.get("class") == "new"]
    assert len(dots) == len(searched)
    assert max(dots) - min(dots) > 0.7 * (280 - 44 - 14), "the means take most of the height"


def test_a_search_that_returns_to_scenarios_is_numbered_by_attempts(found: tuple[Plan, list[Attempt]]) -> None:
    plan, attempts = found

    def numbers(made: list[Attempt]) -> list[str]:
        nodes = [node for node in ET.fromstring(search_chart(plan, made)).iter("text") if node.text]
        return [str(node.text) for node in nodes if node.attrib.get("text-anchor") == "middle"]

    searched = [each for each in attempts if each.purpose == "search"]
    returns = [each.replace(brief=each.brief.replace(scenario_index=k % 2)) for k, each in enumerate(searched)]
    assert numbers(searched) == ["1", "2", "scenario"]
    *counted, axis = numbers(returns)
    assert axis.startswith("attempt") and counted == [str(k) for k in range(len(searched))]


WIDTH = 480


@cache
def a_shot() -> Shot:
    _, attempts, ledger = default_campaign()
    run, robot = ledger.run(attempts[0].measurements[0].run_id), shipped_robots()["tiago_omni"]
    moments = (2.0, 5.0, 9.0)
    return Shot(run=run, world=warehouse(), robot=robot, moments=moments, judged=lambda t: f"judged at {t:.0f}")


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


def test_contact_is_marked_from_its_begin_on() -> None:
    shot = a_shot()
    path = shot.run.trajectory
    touch = Contact(
        time_s=4.0, until_s=4.5, x=float(path.x[60]), y=float(path.y[60]), person=shot.run.human_names[0],
        closing_speed_m_s=0.5, robot_part_m_s=0.5, person_part_m_s=0.0, bearing_rad=0.0, overlap_m=0.0,
    )  # fmt: skip
    recording = replace(shot.run, robot_outline=((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)))
    touching = replace(shot, run=replace(recording, events=(touch,)), moments=(2.0, 5.0))
    plain = replace(shot, run=replace(recording, events=()), moments=(2.0, 5.0))
    marked = (np.asarray(strip(touching, WIDTH)) != np.asarray(strip(plain, WIDTH))).any(axis=(0, 2))
    assert not marked[:WIDTH].any() and marked[WIDTH:].any()


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


def test_a_requirement_is_drawn_over_runs_that_hold_and_fail() -> None:
    t = np.arange(40) / 10
    runs = [run_of(trajectory(t, 0.0, humans=[(near + 0.5 * t, 0.0)])) for near in (0.5, 1.0, 2.0, 4.0, 6.0)]
    runs = [replace(run, scenario_id=f"s{k}") for k, run in enumerate(runs)]
    requirement = REQUIREMENT.replace(limit=2.6)
    values = [objective(run, requirement) for run in runs]
    picture = ET.fromstring(requirement_chart(requirement, runs))
    texts = ["".join(text.itertext()).replace("\N{NO-BREAK SPACE}", " ") for text in picture.iter(f"{{{SPACE}}}text")]
    assert [text.rsplit(": ", 1)[1] for text in texts[-3:]] == [
        f"{number(values[4], 'm')}, holds", f"{number(values[2], 'm')}, holds", f"{number(values[0], 'm')}, fails",
    ]  # fmt: skip
    assert any(text.startswith("limit 2.6") for text in texts)
    drawn = list(picture.iter(f"{{{SPACE}}}polyline"))
    ends = [line.attrib["points"].split()[-1].split(",") for line in drawn]
    heights = [float(y) for _, y in ends]
    assert len(drawn) == 3 and heights == sorted(heights)  # a smaller distance is drawn lower
    assert requirement_chart(requirement, [run_of(trajectory(t, 0.0))]) == ""
