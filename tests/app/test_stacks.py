"""The stack under test in Python, in campaign files and on the command line."""

from __future__ import annotations

import ast
import inspect
import pickle
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

import pytest
from tests.cli.commands import Terminal

import rvsg
from rvsg import stacks
from rvsg.app.matrix import Matrix
from rvsg.app.settings import read_campaign_file
from rvsg.core.errors import InputError
from rvsg.scenario.builder import scenario_json
from rvsg.simulation.embedded.trace import trace
from rvsg.stacks import Ended, Observation, StackChoice, Task, WholeStack

EXAMPLE = str(Path(__file__).parents[2] / "examples" / "stacks" / "follow_the_plan.py") + ":FollowThePlan"
NAMED = "follow_the_plan.py:FollowThePlan"
SMALL = {"scenarios": 1, "refinements": 0, "repeats": 1, "confirmations": 0, "search_anyway": True}


def test_a_campaign_keeps_its_stack_with_version_and_options(tmp_path: Path) -> None:
    campaign = rvsg.Campaign.create(tmp_path / "a", stack=rvsg.Spec("nav2-rpp", {"desired_linear_vel": 0.4}), **SMALL)
    stack = campaign.record.simulator.options["stack"]
    assert stack["name"] == "nav2-rpp" and stack["version"] and stack["options"]["desired_linear_vel"] == 0.4
    assert "--stack nav2-rpp" in campaign.command and "--stack-option desired_linear_vel=0.4" in campaign.command
    assert rvsg.Campaign.open(tmp_path / "a").record == campaign.record
    other = rvsg.Campaign.create(tmp_path / "b", stack="stop-and-go", **SMALL)
    assert other.record.simulator != campaign.record.simulator


def test_a_file_or_a_folder_never_runs_code_that_the_user_does_not_name(tmp_path: Path) -> None:
    file = tmp_path / "campaign.yaml"
    file.write_text(f"stack: {EXAMPLE}\n")
    values = read_campaign_file(file)
    with pytest.raises(InputError):
        rvsg.Campaign.create(tmp_path / "a", file=values, **SMALL)
    made = rvsg.Campaign.create(tmp_path / "a", file=values, stack=EXAMPLE, **SMALL)
    with pytest.raises(InputError):
        rvsg.Campaign.create(tmp_path / "a")
    with pytest.raises(InputError):
        rvsg.Campaign.open(tmp_path / "a").prepare()
    assert rvsg.Campaign.open(tmp_path / "a", stack=EXAMPLE)._wired.simulator.options == made.record.simulator.options
    matrix = Matrix.of(values | {"route": ["route_1", "route_2"]}, {"out": str(tmp_path / "b"), **SMALL})
    assert matrix is not None
    with pytest.raises(InputError):
        matrix.create()


def test_the_answer_names_the_file_of_the_stack_under_test(tmp_path: Path) -> None:
    file = Path(EXAMPLE).with_name("nav2_params.yaml")
    for name, (stack, said) in enumerate({str(file): "nav2-dwb (nav2_params.yaml)", EXAMPLE: NAMED}.items()):
        campaign = rvsg.Campaign.create(tmp_path / str(name), stack=stack, **SMALL)
        assert campaign.answer.setup == ("warehouse", "route_1", "tiago_omni", said)


def test_a_stack_file_beside_the_campaign_file_is_found(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("")
    (tmp_path / "campaign.yaml").write_text("stack: mine.py:Mine\n")
    assert read_campaign_file(tmp_path / "campaign.yaml")["stack"] == str(tmp_path / "mine.py:Mine")


def test_a_simulator_without_stacks_says_so(terminal: Terminal) -> None:
    terminal("run --simulator kinematic --stack nav2-rpp --out a", code=2)
    assert "nav2-rpp" in terminal("run --stack nav2-rrp --out a", code=2)


def test_the_list_names_every_stack(terminal: Terminal) -> None:
    listed = {each["name"]: each for each in terminal.json("stacks")}
    assert {"nav2-dwb", "nav2-rpp", "stop-and-go", "social", "exec", "exec-stack"} <= set(listed)
    assert listed["nav2-rpp"]["options"]["lookahead_dist"] == 0.6
    terminal("stacks --write-clients .")
    assert Path("rvsg_client.py").stat().st_size and Path("rvsg_client.hpp").stat().st_size


def test_a_run_in_which_the_stack_failed_is_no_success(terminal: Terminal) -> None:
    Path("s.json").write_text(scenario_json(alone()))
    Path("fails.py").write_text(
        "from rvsg.stacks import LocalPlanner\n\n\nclass Fails(LocalPlanner):\n    def reset(self, task): pass\n"
        "    def command(self, seen): raise ValueError\n"
    )
    terminal("simulate s.json --stack fails.py:Fails --out runs.jsonl", code=2)
    assert Path("runs.jsonl").read_text()


class GivesUp(WholeStack):
    """Ends every run at once, and counts how often a stack of this class is closed."""

    closed: ClassVar[int] = 0

    def reset(self, task: Task) -> None:
        return

    def step(self, seen: Observation) -> Ended:
        return Ended.GAVE_UP

    def close(self) -> None:
        type(self).closed += 1


def _campaign(stack: object, folder: Path) -> None:
    campaign = rvsg.Campaign.create(folder / "campaign", stack=stack, **SMALL)
    list(campaign.run(jobs=1))


def _suite(stack: object, folder: Path) -> None:
    suite = rvsg.Suite.create(folder / "suite").add(alone(), "R1", name="alone", expected="pass")
    suite.run(stack=stack, runs=1)


def alone() -> rvsg.Scenario:
    return rvsg.scenario(rvsg.load_world("warehouse"), "route_1", [])


@pytest.mark.parametrize(
    "work",
    [
        lambda stack, folder: rvsg.simulate(alone(), 1, stack=stack),
        lambda stack, folder: trace(alone(), stack=stack),
        _campaign,
        _suite,
    ],
)
def test_who_makes_a_stack_closes_it(
    work: Callable[[object, Path], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(GivesUp, "closed", 0)
    work(GivesUp(), tmp_path / "given")
    assert GivesUp.closed == 0
    if work is not _campaign:  # whose stack is data or an instance, no class
        work(GivesUp, tmp_path / "made")
        assert GivesUp.closed == 1


def test_the_copy_of_a_stack_in_a_worker_is_closed_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(GivesUp, "closed", 0)
    choice = StackChoice.of(GivesUp())
    choice.close()
    assert GivesUp.closed == 0
    pickle.loads(pickle.dumps(choice)).close()
    assert GivesUp.closed == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        EXAMPLE,
        "beside:FollowThePlan",
        "lib/mine.py:FollowThePlan",
        str(Path(__file__).parents[2] / "examples" / "stacks" / "nav2_params.yaml"),
    ],
)
def test_a_stack_of_ones_own_drives_in_worker_processes(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = Path(EXAMPLE.rpartition(":")[0])
    shutil.copy(file, tmp_path / "beside.py")
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "what_it_imports.py").write_text("SPEED = 0.4\n")
    text = file.read_text().replace("import numpy as np\n", "import what_it_imports\nimport numpy as np\n", 1)
    (tmp_path / "lib" / "mine.py").write_text(
        text.replace("speed: float = 0.5", "speed: float = what_it_imports.SPEED")
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    campaign = rvsg.Campaign.create(tmp_path / "a", stack=name, **{**SMALL, "repeats": 4})
    list(campaign.run(jobs=2))
    attempts = campaign.attempts()
    assert [attempt.failures for attempt in attempts] == [()] * len(attempts)
    assert sum(len(attempt.measurements) for attempt in attempts) >= 4


@pytest.mark.parametrize("kind", [stacks.Observation, stacks.LocalObservation, stacks.Costmap, stacks.Scan])
def test_every_member_of_an_observation_states_what_it_is(kind: type) -> None:
    body = ast.parse(inspect.getsource(kind)).body[0].body
    fields = [at for at, node in enumerate(body) if isinstance(node, ast.AnnAssign)]
    assert len(fields) == len(kind.__annotations__) >= 3
    for at in fields:
        follows = body[at + 1] if at + 1 < len(body) else None
        assert isinstance(follows, ast.Expr) or ast.unparse(body[at].target) == "y", ast.unparse(body[at])
