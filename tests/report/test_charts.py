"""Whatever a chart draws stands within it, and nothing is left out without a word."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest
from tests.campaign.parts import REQUIREMENT, MemoryLedger
from tests.report.test_page import campaign

from rvsg.campaign.attempt import Attempt, Plan
from rvsg.evaluation.verdict import Verdict, judge
from rvsg.report.charts import LETTER, confirmation_chart, search_chart

WIDE = [(-9.0, 1.0), (0.5, 40.0), (-1000.0, 1000.0)]


@pytest.fixture(scope="module")
def found() -> tuple[Plan, list[Attempt]]:
    plan, attempts = campaign(MemoryLedger())
    return plan, [attempt for attempt in attempts if attempt.purpose in ("search", "confirmation")]


def verdict(attempt: Attempt) -> Verdict:
    assert attempt.verdict is not None
    return attempt.verdict


def spread(attempt: Attempt, interval: tuple[float, float]) -> Attempt:
    return attempt.replace(verdict=verdict(attempt).replace(interval=interval))


def lines(svg: str, kind: str) -> list[dict[str, float]]:
    """The ends of the lines of a class."""
    return [
        {name: float(node.attrib[name]) for name in ("x1", "x2", "y1", "y2")}
        for node in ET.fromstring(svg).iter("line")
        if kind in node.attrib["class"].split()
    ]


@pytest.mark.parametrize("interval", WIDE)
@pytest.mark.parametrize("which", ["old", "new"])
def test_the_bars_of_the_confirmation_stay_right_of_their_names_and_left_of_the_edge(
    found: tuple[Plan, list[Attempt]], interval: tuple[float, float], which: str
) -> None:
    plan, attempts = found
    old, new = attempts[0], attempts[-1]
    svg = (
        confirmation_chart(plan, spread(old, interval), new)
        if which == "old"
        else confirmation_chart(plan, old, spread(new, interval))
    )
    bars = lines(svg, "bar")
    assert len(bars) == 2
    assert all(116 <= bar["x1"] <= bar["x2"] <= 640 - 16 for bar in bars)


def test_a_limit_far_from_all_values_is_on_the_canvas(found: tuple[Plan, list[Attempt]]) -> None:
    plan, attempts = found
    far = plan.replace(requirement=REQUIREMENT.replace(limit=500.0))
    assert 116 <= lines(confirmation_chart(far, attempts[0], attempts[-1]), "limit")[0]["x1"] <= 640 - 16
    assert 14 <= lines(search_chart(far, attempts), "limit")[0]["y1"] <= 280 - 44


@pytest.mark.parametrize("interval", WIDE)
def test_the_intervals_of_the_search_stay_on_the_canvas(
    found: tuple[Plan, list[Attempt]], interval: tuple[float, float]
) -> None:
    plan, attempts = found
    svg = search_chart(plan, [spread(attempts[0], interval), *attempts[1:]])
    assert all(14 <= line["y2"] <= line["y1"] <= 280 - 44 for line in lines(svg, "spread"))


def test_the_words_of_the_limit_stand_beside_the_search_and_not_on_it(found: tuple[Plan, list[Attempt]]) -> None:
    plan, attempts = found
    long = plan.replace(requirement=REQUIREMENT.replace(unit="contacts per minute"))
    svg = ET.fromstring(search_chart(long, attempts))
    words = next(node for node in svg.iter("text") if node.attrib["class"] == "limit")
    assert words.text == "limit 1 contacts per minute"
    start = float(words.attrib["x"])
    assert start > max(float(dot.attrib["cx"]) + 3.5 for dot in svg.iter("circle"))
    assert start + LETTER * len(words.text) <= 960


def test_a_unit_is_text_and_never_markup(found: tuple[Plan, list[Attempt]]) -> None:
    plan, attempts = found
    sly = plan.replace(requirement=REQUIREMENT.replace(unit="<b>&m"))
    for svg in (confirmation_chart(sly, attempts[0], attempts[-1]), search_chart(sly, attempts)):
        assert not list(ET.fromstring(svg).iter("b"))


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
