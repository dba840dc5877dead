"""What the page says of contacts with things."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from tests.evaluation.runs import run_of, trajectory
from tests.simulation.corridor import ROUTE, hall

from rvsg.campaign.runner import Measuring
from rvsg.report.answer import seen_beside
from rvsg.report.run_facts import run_facts
from rvsg.scenario.requirement import shipped_requirements
from rvsg.simulation.run import ObstacleContact
from rvsg.world.world import Door

OPEN = Door(name="D", hinge=(8.0, 1.2), end=(8.0, 2.8), state="open")
LEAF, FRAME = (6.4, 1.2), (7.95, 2.8)


@pytest.mark.parametrize(("places", "said"), [([LEAF], "the door D"), ([LEAF, FRAME], "an obstacle")])
def test_a_door_that_the_robot_hits_is_named_where_it_is_that_alone(
    places: list[tuple[float, float]], said: str
) -> None:
    requirement, world = shipped_requirements()["R1"], hall(OPEN)
    hits = [ObstacleContact(time_s=k, x=x, y=y, until_s=k, speed_m_s=0.5) for k, (x, y) in enumerate(places)]
    run = run_of(trajectory([0.0, 1.0, 2.0], [2.0, 3.0, 4.0]), events=tuple(hits))
    facts = run_facts(run, Measuring(requirement, world).measure(run), requirement, world)
    plan: Any = SimpleNamespace(mission=SimpleNamespace(route=ROUTE))
    badges, sentences = seen_beside([facts], plan, "run")
    assert f"hits {said} in 1 of 1" in [badge.text for badge in badges]
    assert f"The robot hits {said} in " in [sentence[0].text for sentence in sentences]
