"""Export and recordings through the front door and the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.app.parts import crossing
from tests.cli.commands import Terminal

import rvsg
from rvsg.core.errors import InputError, UnknownName
from rvsg.evaluation.metrics import measure
from rvsg.scenario.builder import save_scenario
from rvsg.search.run_set import load_recordings
from rvsg.simulation.archive import rounded
from rvsg.simulation.embedded.simulator import EmbeddedSimulator
from rvsg.simulation.embedded.trace import trace
from rvsg_exchange.formats import export, foxglove_layout, import_agents


@pytest.fixture(scope="module")
def scenario() -> rvsg.Scenario:
    return crossing(pauses_s={"H15": 2.0})


@pytest.fixture
def file(terminal: Terminal, scenario: rvsg.Scenario) -> Path:
    """The scenario in `scenario.json`."""
    save_scenario(scenario, Path("scenario.json"))
    return Path("scenario.json")


@pytest.mark.usefixtures("file")
@pytest.mark.parametrize("format", ["hunav", "nav2-goals", "initial-pose", "osc", "sdf", "csv", "foxglove-layout"])
def test_every_format_writes_a_file(terminal: Terminal, format: str) -> None:
    terminal("export scenario.json --out made/out --simulator kinematic --to", format)
    assert Path("made/out").stat().st_size > 100


def test_what_hunavsim_cannot_hold_is_returned(scenario: rvsg.Scenario, tmp_path: Path) -> None:
    notes = export(scenario, tmp_path / "agents.yaml", "hunav")
    assert len(notes) == 1
    agents = yaml.safe_load((tmp_path / "agents.yaml").read_text())["hunav_loader"]["ros__parameters"]
    assert agents["agents"] == ["agent1"]


def test_runs_of_a_file_become_a_table(scenario: rvsg.Scenario, tmp_path: Path) -> None:
    rvsg.simulate(scenario, 2, simulator="kinematic").save(tmp_path / "runs.jsonl")
    export(tmp_path / "runs.jsonl", tmp_path / "runs.csv", "csv")
    seeds = {line.split(",")[1] for line in (tmp_path / "runs.csv").read_text().splitlines()[1:]}
    assert seeds == {"0", "1"}


@pytest.mark.usefixtures("file")
def test_a_recording_is_judged_like_the_run_it_was_made_of(terminal: Terminal, scenario: rvsg.Scenario) -> None:
    pytest.importorskip("rosbags", reason="the extra `bag` is not installed")
    terminal("export scenario.json --to mcap --out run.mcap --simulator kinematic")
    judged = terminal.json("evaluate run.mcap --requirement R1 --world warehouse")
    simulated = rvsg.judge(rvsg.simulate(scenario, [0], simulator="kinematic"), "R1")
    assert judged["notes"] == []
    assert judged["measurements"][0]["objective"] == pytest.approx(simulated.measurements[0].objective, abs=1e-6)
    assert judged["measurements"][0]["outcome"] == simulated.measurements[0].outcome


@pytest.mark.slow
def test_a_trace_is_the_run_and_its_bag_holds_what_the_robot_sees(scenario: rvsg.Scenario, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra `bag` is not installed")
    world = rvsg.load_world("warehouse")
    traced = trace(scenario, 3)
    run = rounded(EmbeddedSimulator().run(scenario, world, seed=3))
    assert traced.run.id == run.id
    assert np.array_equal(traced.run.trajectory.x, run.trajectory.x)
    assert np.array_equal(traced.run.trajectory.human_x, run.trajectory.human_x)
    assert len(traced.frames) == pytest.approx(10 * run.trajectory.t[-1], abs=2)
    assert len(traced.frames[30].scans) == len(traced.robot.lidars)
    assert max(frame.costmap.max() for frame in traced.frames) == 254  # it passes something lethal
    export(scenario, tmp_path / "run.mcap", "mcap", seed=3, trace=True)
    recorded, _ = load_recordings([tmp_path / "run.mcap"], world="warehouse")
    assert recorded[0].id == run.id
    assert np.array_equal(recorded[0].imu, run.imu)
    measured, again = (measure(each, world=world) for each in (rvsg.simulate(scenario, [3])[0], recorded[0]))
    assert again == {
        name: value if value is None else pytest.approx(value, rel=1e-6, abs=1e-6) for name, value in measured.items()
    }
    from rvsg_exchange.recordings import open_bag

    with open_bag(tmp_path / "run.mcap") as reader:
        topics = {connection.topic for connection in reader.connections}
        wanted = [each for each in reader.connections if each.topic in ("/imu", "/evaluation")]
        read = [(each.topic, reader.deserialize(raw, each.msgtype)) for each, _, raw in reader.messages(wanted)]
    limit = traced.robot.limits.acceleration_m_s2
    felt = np.array([message.linear_acceleration.x for topic, message in read if topic == "/imu"])
    assert 0.5 * limit < felt.max() <= 1.2 * limit
    evaluated = [message for topic, message in read if topic == "/evaluation"]
    scored = [twist for message in evaluated for twist in message.twists if twist.total >= 0]
    assert len(scored) > 1000
    for twist in scored:
        assert sum(each.raw_score * each.scale for each in twist.scores) == pytest.approx(twist.total, abs=1e-3)
    seen = {"/scan_0", "/scan_1", "/cmd_vel", "/plan", "/local_costmap/costmap", "/global_costmap/costmap"}
    tried = {"/evaluation", "/local_trajectories", "/local_plan", "/behavior_tree_log", "/rvsg/navigation"}
    assert seen | tried <= topics
    shown = json.loads(foxglove_layout())["configById"]["3D!map"]["topics"]
    assert set(shown) <= topics


@pytest.mark.parametrize(
    ("format", "options", "error"),
    [
        ("xlsx", {}, UnknownName),
        ("hunav", {"dialect": "v3"}, UnknownName),
        ("nav2-goals", {"release": "foxy"}, UnknownName),
        ("mcap", {"trace": True, "simulator": "kinematic"}, InputError),
    ],
)
def test_what_does_not_exist_is_refused(scenario, tmp_path, format, options, error) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(error):
        export(scenario, tmp_path / "out", format, **options)


@pytest.mark.parametrize(
    "command",
    [
        "export --to csv --out x.csv",
        "export nowhere.json --to csv --out x.csv",
        "evaluate nowhere.mcap",
        "evaluate scenario.json --people-topic /people",
        "evaluate broken.mcap",
        "evaluate broken.mcap scenario.json",
        "evaluate broken.mcap --route route_1",
    ],
)
@pytest.mark.usefixtures("file")
def test_bad_input_is_one_message(terminal: Terminal, command: str) -> None:
    Path("broken.mcap").write_bytes(b"\x89MCAP0\r\n1234")
    terminal(command, code=2)


AGENTS = """\
hunav_loader:
  ros__parameters:
    map: warehouse
    agents: [anna, ben]
    anna:
      id: 1
      max_vel: 1.2
      radius: 0.4
      behavior: {type: 3, configuration: 0}
      init_pose: {x: %(x0)s, y: %(y0)s, h: 0.0}
      goal_radius: 0.3
      cyclic_goals: true
      goals: [g0, g1]
      g0: {x: %(x1)s, y: %(y1)s, h: 0.0}
      g1: {x: %(x0)s, y: %(y0)s, h: 0.0}
    ben:
      id: 2
      max_vel: 1.0
      radius: 0.4
      behavior: {type: 1, configuration: 2}
      init_pose: {x: %(x2)s, y: %(y2)s, h: 0.0}
      goal_radius: 0.3
      cyclic_goals: true
      goals: [g0]
      g0: {x: %(x2)s, y: %(y2)s, h: 0.0}
"""


def agents_file(folder: Path, shift: float = 0.1) -> Path:
    grid = rvsg.load_world("warehouse").grid
    (x0, y0), (x1, y1), (x2, y2) = (grid.position(name) for name in ("E15", "F15", "H15"))
    places = {"x0": x0 + shift, "y0": y0, "x1": x1, "y1": y1, "x2": x2, "y2": y2}
    (folder / "agents.yaml").write_text(AGENTS % places)
    return folder / "agents.yaml"


def test_agents_of_hunavsim_become_a_scenario_at_their_coordinates(terminal: Terminal, tmp_path: Path) -> None:
    agents_file(tmp_path)
    terminal("import agents agents.yaml --world warehouse --route route_1 --out scenario.json")
    scenario = rvsg.load_scenario("scenario.json")
    anna, ben = scenario.people.humans
    assert anna.start == anna.points["goal 2"]
    assert anna.behaviour.value == "surprised"
    assert ben.factors == "random_normal"
    run = rvsg.simulate(scenario, [0])[0]
    assert np.hypot(run.trajectory.human_x[:, 0] - anna.points["goal 1"][0],
                    run.trajectory.human_y[:, 0] - anna.points["goal 1"][1]).min() < 0.4  # fmt: skip
    exported = tmp_path / "again.yaml"
    export(scenario, exported, "hunav")
    again, _ = import_agents(exported, "warehouse", "route_1")
    assert again.people.humans[0].points == anna.points
    assert again.people.humans[0].start == anna.start


def test_agents_in_an_obstacle_are_refused(tmp_path: Path) -> None:
    with pytest.raises(rvsg.InvalidScenario) as raised:
        import_agents(agents_file(tmp_path, shift=-40.0), "warehouse", "route_1")
    assert raised.value.findings
