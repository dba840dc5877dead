"""Ranges instead of numbers in a scenario."""

from __future__ import annotations

from typing import Any

import pytest

import rvsg
from rvsg.core.errors import InputError, UnknownName
from rvsg.scenario.variation import family_of


@pytest.fixture
def value() -> dict[str, Any]:
    world = rvsg.load_world("warehouse")
    people = [rvsg.walk("Human 1", "E15", "H15", pauses_s={"H15": 3.0}), rvsg.walk("Human 10", "E12", "H12")]
    return rvsg.scenario(world, "route_1", people).model_dump(mode="json")


def test_a_range_in_the_file_and_one_given_besides_span_a_family(value: dict[str, Any]) -> None:
    value["people"]["humans"][0]["speed_m_s"] = "0.8 to 1.4"
    family = family_of(value, ["Human 10.start_delay_s=0 to 5"])
    assert [(each.name, each.low, each.high) for each in family.ranges] == [
        ("Human 1.speed_m_s", 0.8, 1.4),
        ("Human 10.start_delay_s", 0.0, 5.0),
    ]
    first, second = family.at((0.9, 4.5)).people.humans
    assert (first.speed_m_s, second.start_delay_s) == (0.9, 4.5)
    assert family.middle.people.humans[0].speed_m_s == pytest.approx(1.1)
    assert family.at((0.9, 4.5)).mission == family.middle.mission


def test_a_pause_may_vary(value: dict[str, Any]) -> None:
    pauses = [
        (k, len(task["pauses"])) for k, task in enumerate(value["people"]["humans"][0]["tasks"]) if task["pauses"]
    ]
    (task, _), *_ = pauses
    family = family_of(value, [f"Human 1.tasks[{task}].pauses[0].duration_s=1 to 9"])
    assert family.at((7.0,)).people.humans[0].tasks[task].pauses[0].duration_s == 7.0


@pytest.mark.parametrize(
    "vary",
    [
        "Human 1.speed_m_s",
        "Human 1.speed_m_s=fast",
        "Human 1.speed_m_s=1.4 to 0.8",
        "Human 1.speed_m_s=1 to 1",
        "Human 1.speed_m_s=-1 to 1",  # no person walks so
        "Human 3.speed_m_s=1 to 2",
        "=1 to 2",
    ],
)
def test_a_range_that_cannot_be_used_is_refused(value: dict[str, Any], vary: str) -> None:
    with pytest.raises(InputError):
        family_of(value, [vary])


def test_an_unknown_number_is_told_with_the_nearest(value: dict[str, Any]) -> None:
    with pytest.raises(UnknownName) as raised:
        family_of(value, ["Human 1.sped_m_s=1 to 2"])
    assert "speed_m_s" in raised.value.known


def test_only_people_may_vary_and_a_scenario_without_a_range_is_no_family(value: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        family_of(value)
    value["mission"]["route"]["time_limit_s"] = "20 to 30"
    with pytest.raises(InputError):
        family_of(value)


def test_a_description_that_speaks_of_a_range_is_none(value: dict[str, Any]) -> None:
    value["description"] = "1 to 2"
    assert len(family_of(value, ["Human 1.speed_m_s=1 to 2"]).ranges) == 1
