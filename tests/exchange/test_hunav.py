"""HuNavSim agents files: what they say of people, what they lose, and every mistake with its line."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from tests.exchange.agents_files import BLOCK, FLAT, V2

from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError, InputError
from rvsg.scenario.scenario import FOREVER_S, Behaviour, ForceFactors, HumanAgent, Reaction
from rvsg_exchange.formats import import_agents
from rvsg_exchange.hunav_agents import agents_yaml, read_agents


def written(folder: Path, text: str) -> Path:
    path = folder / "agents.yaml"
    path.write_text(text)
    return path


def test_an_unknown_behaviour_is_regular_as_in_hunavsim(tmp_path: Path) -> None:
    (waiter, guest), _ = read_agents(written(tmp_path, FLAT))
    assert waiter.behaviour is Behaviour.SCARED
    assert guest.behaviour is Behaviour.REGULAR
    assert (guest.speed_m_s, guest.radius_m, guest.yaw, guest.goals) == (0.9, 0.35, 0.5, ((1.0, 1.0),))


def test_custom_factors_are_clamped_as_the_loader_clamps_them(tmp_path: Path) -> None:
    (agent,), notes = read_agents(written(tmp_path, BLOCK))
    assert agent.factors == ForceFactors(goal=2.0, obstacle=12.0, social=6.0)
    assert agent.reaction == Reaction(duration_s=12.0, once=False, speed_m_s=1.8, distance_m=1.2, force=18.0)
    assert agent.group == 2
    assert agent.stays and agent.goal_radius_m == 0.2
    assert notes == ()


def test_version_2_goals_come_from_the_shared_table(tmp_path: Path) -> None:
    (agent,), notes = read_agents(written(tmp_path, V2))
    assert agent.goals == ((-6.77, -1.636), (-0.588, -1.458))
    assert agent.factors == "random_normal"
    assert agent.behaviour is Behaviour.SURPRISED
    assert len(notes) == 1  # front_dist


@pytest.mark.parametrize("dialect", ["block", "v2"])
def test_agents_of_ours_come_back_equal(tmp_path: Path, dialect: str) -> None:
    agents = (
        HumanAgent(name="agent1", start=(1.0, 2.0), goals=((1.0, 2.0), (3.0, 4.0)), pauses_s=(0.0, 0.0), group=1),
        HumanAgent(
            name="agent2",
            start=(0.0, 0.0),
            goals=((0.0, 0.0), (1.0, 2.0)),
            pauses_s=(0.0, FOREVER_S),
            goal_radius_m=0.5,
            behaviour=Behaviour.CURIOUS,
            reaction=Reaction(duration_s=20.0, speed_m_s=1.0, distance_m=1.5),
            factors=ForceFactors(goal=3.0, obstacle=11.0, social=4.0),
        ),
    )
    text, notes = agents_yaml(agents, map_name="room", dialect=dialect)  # type: ignore[arg-type]
    assert notes == ()
    back, _ = read_agents(written(tmp_path, text))
    regular = agents[0].replace(reaction=back[0].reaction)  # the regular never react
    assert back == (regular, agents[1])
    assert "duration: 20.0\n" in text, "ROS asks for the type of numbers"


def test_what_a_file_cannot_hold_is_said(tmp_path: Path) -> None:
    agent = HumanAgent(name="a", start=(0, 0), goals=((0, 0), (1, 0)), pauses_s=(3.0, 0.0), start_delay_s=2.0)
    text, notes = agents_yaml((agent,), map_name="room", dialect="flat")
    assert len(notes) == 2
    assert yaml.safe_load(text)["hunav_loader"]["ros__parameters"]["agent1"]["behavior"] == 1


def test_every_mistake_is_reported_with_its_line(tmp_path: Path) -> None:
    broken = FLAT.replace("max_vel: 1.5", "max_vel: fast").replace("goals: [g0]", "goals: [g7]")
    with pytest.raises(DocumentError) as raised:
        read_agents(written(tmp_path, broken))
    assert [problem.line for problem in raised.value.problems] == [13, 26]


def test_a_value_out_of_range_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, FLAT.replace("radius: 0.4", "radius: -3.0"))
    with pytest.raises(InputError):
        import_agents(path, "warehouse", "route_1")


@pytest.mark.parametrize(
    "text", ["a: 1\n", "hunav_loader: 3\n", "hunav_loader: {ros__parameters: {agents: []}}\n", "["]
)
def test_another_file_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(FileError):
        read_agents(written(tmp_path, text))
