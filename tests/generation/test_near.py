"""Campaigns that start from a scenario: the scenario first, then changes that stay near it."""

import math
from pathlib import Path

import pytest

import rvsg
from rvsg.core.errors import InputError
from rvsg.generation.near import NearGenerator
from rvsg.scenario.brief import Brief, Feedback
from rvsg.scenario.scenario import Scenario, Track
from rvsg.scenario.validity import check
from rvsg.world.world import World
from rvsg.world.world_folder import load_world

EXAMPLE = Path(__file__).parents[2] / "examples" / "three_people.json"
NEAR = 0.4


@pytest.fixture(scope="module")
def world() -> World:
    return load_world("warehouse")


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    found = rvsg.load_scenario(EXAMPLE)
    walker, other, third = found.people.humans
    track = Track(start_s=1.0, points=tuple((4.0 + 0.1 * k, 3.0) for k in range(40)))
    followed = other.replace(track=track)
    return found.replace(people=found.people.replace(humans=(walker, followed, third)))


def brief(scenario: Scenario, index: int = 0, configuration: int = 0, **more: object) -> Brief:
    return Brief(
        mission=scenario.mission, requirement=None, humans=len(scenario.people.humans), seed=7, scenario_index=index,
        configuration_index=configuration, **more,  # type: ignore[arg-type]
    )  # fmt: skip


def far(scenario: Scenario, other: Scenario, world: World) -> tuple[float, float, float]:
    """The largest difference of times (s), places (m) and speeds (m/s) between two scenarios."""
    found = []
    for human, changed in zip(scenario.people.humans, other.people.humans, strict=True):
        if human.track is not None and changed.track is not None:
            times, places = (human.track.end_s, changed.track.end_s), (human.track.points[-1], changed.track.points[-1])
        else:
            times = human.start_delay_s, changed.start_delay_s
            places = tuple(each.position(each.tasks[-1].path[-1], world.grid) for each in (human, changed))  # type: ignore[assignment]
        found.append((abs(times[0] - times[1]), math.dist(*places), abs(human.speed_m_s - changed.speed_m_s)))
    return tuple(max(each) for each in zip(*found, strict=True))  # type: ignore[return-value]


def test_the_scenario_comes_first_and_all_others_stay_near_it(scenario: Scenario, world: World) -> None:
    generator = NearGenerator(scenario, NEAR)
    first = generator.propose(brief(scenario), world).scenario
    assert first is not None and first.people == scenario.people
    last, seen = first, set()
    for index in range(1, 13):
        told = Feedback.model_construct(scenario=last, best=None) if index > 6 else None
        proposal = generator.propose(brief(scenario, index).model_copy(update={"feedback": told}), world)
        assert proposal.scenario is not None, proposal.problems
        assert not check(proposal.scenario.people, proposal.scenario.mission, world)
        seconds, metres, speed = far(scenario, proposal.scenario, world)
        assert seconds <= NEAR + 1e-6 and metres <= NEAR + 0.01 and speed <= NEAR / 5 + 0.011
        assert proposal.scenario.people != scenario.people and "Changed: " in proposal.scenario.description
        seen.add(proposal.scenario.id)
        last = proposal.scenario
    assert len(seen) == 12
    again = generator.propose(brief(scenario, 3), world)
    assert again == NearGenerator(scenario, NEAR).propose(brief(scenario, 3), world)


def test_more_people_are_added(scenario: Scenario, world: World) -> None:
    asked = brief(scenario, 2).replace(humans=4)
    found = NearGenerator(scenario, NEAR).propose(asked, world).scenario
    assert found is not None
    assert [human.name for human in found.people.humans] == ["Human 1", "Human 2", "Human 3", "Human 4"]


def test_a_campaign_starts_from_a_scenario(tmp_path: Path) -> None:
    scenario = rvsg.load_scenario(EXAMPLE)
    own = scenario.mission.route.replace(name="as driven")
    file = tmp_path / "found.json"
    file.write_text(scenario.replace(mission=scenario.mission.replace(route=own)).to_json(), encoding="utf-8")
    few = {"scenarios": 2, "refinements": 1, "repeats": 1, "confirmations": 0, "shrink_runs": 0, "jobs": 1}
    made = rvsg.Campaign.create(tmp_path / "out", start_from=str(file), near=NEAR, simulator="kinematic", **few)
    assert (made.plan.mission.route, made.config.humans, made.config.strategy) == (own, 3, "study")
    list(made.run())
    assert made.changes == "" and made.report(world="warehouse").is_file(), "no world has a route that was driven"
    kept = [attempt.proposal.scenario for attempt in rvsg.Campaign.open(tmp_path / "out").attempts()]
    assert len(kept) == 4 and kept[0] is not None and kept[0].people == scenario.people
    for words, settings in {"--generator": {"generator": "random"}, "--humans": {"humans": 1}}.items():
        with pytest.raises(InputError, match=words):
            rvsg.Campaign.create(tmp_path / words, start_from=str(file), **settings)


def test_other_campaigns_are_stored_as_before() -> None:
    from rvsg.app.settings import CampaignConfig

    assert not {"start_from", "near"} & CampaignConfig().model_dump().keys()
