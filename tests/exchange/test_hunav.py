"""HuNavSim agents files: what they say of people, what they lose, and every mistake with its line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError, InputError
from rvsg.scenario.scenario import FOREVER_S, Behaviour, ForceFactors, HumanAgent, Reaction
from rvsg_exchange.formats import import_agents
from rvsg_exchange.hunav_agents import agents_yaml, read_agents

FLAT = """\
hunav_loader:
  ros__parameters:
    map: cafe
    publish_people: true
    agents:
      - waiter
      - guest
    waiter:
      id: 1
      skin: 0
      behavior: 4
      group_id: -1
      max_vel: 1.5
      radius: 0.4
      init_pose: {x: 3.48, y: 6.93, z: 1.25, h: 0.0}
      goal_radius: 0.3
      cyclic_goals: true
      goals: [g0, g1]
      g0: {x: 3.37, y: -4.58, h: 1.25}
      g1: {x: -3.58, y: -4.79, h: 1.25}
    guest:
      id: 2
      behavior: 9
      max_vel: 0.9
      init_pose: {x: 0.0, y: 0.0, h: 0.5}
      goals: [g0]
      g0: {x: 1.0, y: 1.0}
"""


def loader(settings: dict[str, Any]) -> str:
    return yaml.safe_dump({"hunav_loader": {"ros__parameters": settings}}, sort_keys=False)


BLOCK = loader({"map": "map_of_room", "agents": ["agent1"], "agent1": {
    "id": 1, "group_id": 2, "max_vel": 1.1, "radius": 0.35, "goal_radius": 0.2, "cyclic_goals": False,
    "behavior": {
        "type": 5, "configuration": 1, "duration": 12.0, "once": False, "vel": 2.5, "dist": 1.2,
        "goal_force_factor": 1.0, "obstacle_force_factor": 12.0, "social_force_factor": 6.0, "other_force_factor": 18.0,
    },
    "init_pose": {"x": 1.0, "y": 2.0, "z": 1.25, "h": 1.57},
    "goals": ["g0", "g1"], "g0": {"x": 1.0, "y": 2.0, "h": 0.0}, "g1": {"x": 4.0, "y": 2.0, "h": 0.0},
}}) + "hunav_agent_manager: {ros__parameters: {publish_tf: true}}\n"  # fmt: skip
V2 = loader({
    "yaml_base_name": "ward", "simulator": "Isaac Sim", "map": "ward", "publish_people": True,
    "global_goals": {1: {"x": -6.77, "y": -1.636}, 2: {"x": -0.588, "y": -1.458}}, "agents": ["nurse"],
    "nurse": {
        "id": 1, "skin": 1, "group_id": -1, "max_vel": 1.2, "radius": 0.4, "goal_radius": 0.3, "cyclic_goals": True,
        "behavior": {"type": "Surprised", "configuration": 2, "once": True, "front_dist": 1.4},
        "init_pose": {"x": -6.77, "y": -1.636, "z": 0.0, "h": 0.0}, "goals": [1, 2],
    },
})  # fmt: skip


def written(folder: Path, text: str) -> Path:
    path = folder / "agents.yaml"
    path.write_text(text)
    return path


def test_each_dialect_is_read_as_its_loader_reads_it(tmp_path: Path) -> None:
    (waiter, guest), _ = read_agents(written(tmp_path, FLAT))
    assert (waiter.behaviour, guest.behaviour) == (Behaviour.SCARED, Behaviour.REGULAR)  # an unknown one is regular
    assert (guest.speed_m_s, guest.radius_m, guest.yaw, guest.goals) == (0.9, 0.35, 0.5, ((1.0, 1.0),))
    (agent,), notes = read_agents(written(tmp_path, BLOCK))
    assert agent.factors == ForceFactors(goal=2.0, obstacle=12.0, social=6.0)  # clamped
    assert agent.reaction == Reaction(duration_s=12.0, once=False, speed_m_s=1.8, distance_m=1.2, force=18.0)
    assert (agent.group, agent.stays, agent.goal_radius_m, notes) == (2, True, 0.2, ())
    (agent,), notes = read_agents(written(tmp_path, V2))
    assert agent.goals == ((-6.77, -1.636), (-0.588, -1.458))  # from the shared table
    assert (agent.factors, agent.behaviour) == ("random_normal", Behaviour.SURPRISED)
    assert len(notes) == 1  # front_dist


@pytest.mark.parametrize(
    "text", ["a: 1\n", "hunav_loader: 3\n", "hunav_loader: {ros__parameters: {agents: []}}\n", "["]
)
def test_mistakes_are_reported_with_their_lines_and_another_file_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(FileError):
        read_agents(written(tmp_path, text))
    broken = FLAT.replace("max_vel: 1.5", "max_vel: fast").replace("goals: [g0]", "goals: [g7]")
    with pytest.raises(DocumentError) as raised:
        read_agents(written(tmp_path, broken))
    assert [problem.line for problem in raised.value.problems] == [13, 26]
    with pytest.raises(InputError):
        import_agents(written(tmp_path, FLAT.replace("radius: 0.4", "radius: -3.0")), "warehouse", "route_1")


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
