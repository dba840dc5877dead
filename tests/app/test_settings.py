"""Every setting is declared once; the command line, the file, the page and the form are made from the declaration."""

import inspect
import re
import shlex
import shutil
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml

from rvsg.app.campaign import Campaign
from rvsg.app.commands import command_for, resume_command
from rvsg.app.settings import (
    MACHINE,
    OF_THE_CALL,
    CampaignConfig,
    default_of,
    effective,
    option_of,
    parse_campaign_file,
    read_campaign_file,
    settings,
    value_type,
)
from rvsg.cli.options import pairs, setting_options
from rvsg.core.setting import GROUPS
from rvsg.world.world_folder import SHIPPED

VALUES: dict[type, tuple[Any, list[str]]] = {
    bool: (True, []),
    int: (3, ["3"]),
    float: (0.1, ["0.1"]),
    str: ("some", ["some"]),
    list: (["some"], ["some"]),
    dict: ({"some": 1}, ["some=1"]),
}
OWN: dict[str, tuple[Any, list[str]]] = {
    "doors": ({"Ward": "closed"}, ["Ward=closed"]),
    "conversation": ("study", ["study"]),
    "confidence": (0.9, ["0.9"]),
}
FOUND = Path(__file__).parents[2] / "examples" / "recordings" / "warehouse-route_1-R1-study"
SURVIVING: dict[str, Any] = {
    "world": "hospital",
    "route": "route_2",
    "requirement": "R2",
    "also": ["R2"],
    "robot": "turtlebot3_waffle",
    "generator": "random",
    "strategy": "multi",
    "simulator": "kinematic",
    "model": "openai-chat:x",
    "base_url": "http://localhost:1/v1",
    "replay": str(FOUND),
    "stack": "nav2-rpp",
    "stack_options": {"desired_linear_vel": 0.3},
    "simulator_options": {"profile": "hunavsim"},
    "generator_options": {"tries": 3},
    "moved": "moved.yaml",
    "knowledge": "knowledge.json",
    "start_from": str(FOUND.parents[1] / "three_people.json"),
    "prompts": "prompts",
}
"""Values of settings that name something."""
PARTNERS: dict[str, dict[str, Any]] = {
    "doors": {"world": "ward"},
    "strategy": {"also": ["R2"]},
    "also": {"strategy": "multi"},
    "stack": {"simulator": "embedded"},
    "stack_options": {"simulator": "embedded", "stack": "nav2-rpp"},
    "simulator_options": {"simulator": "embedded"},
    **{
        key: {"generator": "vlm", "model": "openai-chat:x", "base_url": "http://localhost:1/v1"}
        for key in ("conversation", "prompts", "model", "base_url", "budget_calls", "budget_tokens")
    },
    "budget_usd": {
        "model": "openai-chat:x",
        "base_url": "http://localhost:1/v1",
        "generator_options": {"prices": "1,1,1"},
    },
}
"""What a setting needs beside it."""
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "campaign-file.md"


@pytest.fixture(params=CampaignConfig.model_fields)
def key(request: pytest.FixtureRequest) -> str:
    """The key of each setting."""
    return str(request.param)


def test_a_setting_is_declared_with_help_group_and_default(key: str) -> None:
    setting = settings()[key]
    assert setting.help.endswith(".") and setting.group in GROUPS
    assert getattr(CampaignConfig(), key) == default_of(key)


def test_an_option_and_a_key_of_a_file_give_a_setting(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    value, words = OWN.get(key, VALUES[value_type(key)])
    given: dict[str, Any] = {}
    command = setting_options(key)(lambda settings: given.update(settings))
    assert list(inspect.signature(command).parameters) == [key]
    command(**{key: True if value_type(key) is bool else words if value_type(key) in (list, dict) else value})
    assert given == {key: value}
    assert list(parse_campaign_file(yaml.safe_dump({key: value}), Path("campaign.yaml"))) == [key]
    config = CampaignConfig(**{key: value})
    said = command_for(config)
    if key not in (*MACHINE, "out", "junit", "fail_on_violation"):
        assert " ".join([option_of(key), *words]) in said


def test_the_reference_page_lists_a_setting_with_its_help(key: str) -> None:
    row = next(line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| `{key}` |"))
    assert settings()[key].help in row


def test_options_win_over_the_file_and_the_file_over_what_was_stored() -> None:
    config = effective({"seed": 1, "scenarios": 2, "humans": 3}, {"seed": 4, "scenarios": 5}, {"seed": 6})
    assert (config.seed, config.scenarios, config.humans) == (6, 5, 3)


@pytest.mark.parametrize("mark", ["#", ":"])
def test_paths_are_relative_to_the_file(tmp_path: Path, mark: str) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "rules.yaml").write_text("near: {}\n")
    file = tmp_path / "mine" / "c.yaml"
    file.write_text(f"out: runs/x\nworld: warehouse\nrequirement: 'rules.yaml{mark}near'\n")
    values = read_campaign_file(file)
    assert values["out"] == str(tmp_path / "mine" / "runs/x")
    assert values["world"] == "warehouse"
    assert values["requirement"] == str(tmp_path / "mine" / f"rules.yaml{mark}near")


def test_the_effective_configuration_is_a_campaign_file_again(tmp_path: Path) -> None:
    config = CampaignConfig(seed=9, strategy="unguided", simulator_options={"noise": {"lidar": 0}})
    (tmp_path / "c.yaml").write_text(config.to_yaml())
    assert effective(None, read_campaign_file(tmp_path / "c.yaml"), {}) == config


@pytest.mark.parametrize("example", re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL))
def test_the_documented_example_is_a_campaign(example: str) -> None:
    CampaignConfig.model_validate(yaml.safe_load(example))


def test_the_command_to_resume_names_all_that_is_not_kept_with_the_campaign() -> None:
    of_the_campaign = {"route": "route_2", "simulator_options": {"profile": "precise"}, "seed": 3}
    of_the_moment = {
        "out": "my runs/one",
        "executor": "cluster",
        "executor_options": {"address": "tcp://10.0.0.1:8786", "patience_s": 5},
        "fail_on_violation": True,
        "junit": "junit.xml",
    }
    command = resume_command(CampaignConfig(**of_the_campaign, **of_the_moment))
    assert command == (
        "rvsg run --out 'my runs/one' --executor cluster --executor-option address=tcp://10.0.0.1:8786 "
        "--executor-option patience_s=5 --fail-on-violation --junit junit.xml"
    )


def test_options_of_a_plug_in_are_told_as_they_are_read() -> None:
    options = {"noise": {"lidar": 0}, "fast": True, "limit": None, "profile": "precise"}
    words = shlex.split(command_for(CampaignConfig(simulator_options=options)))
    given = [word for option, word in pairwise(words) if option == "--simulator-option"]
    assert pairs("simulator", given) == options


def test_a_search_near_a_scenario_tells_the_settings_that_the_scenario_would_give_otherwise() -> None:
    words = command_for(CampaignConfig(start_from="scenario.json", route="route_1"))
    assert "--route route_1" in words and "--world warehouse" in words and "--robot tiago_omni" in words


@pytest.mark.parametrize(
    ("requirement", "name"),
    [("R1", "R1"), ("req/huge.yaml", "huge"), ("req/huge.yaml#f", "f"), ("req/huge.yaml:a b/c", "a_b_c")],
)
def test_the_folder_is_named_for_the_requirement_not_for_its_file(requirement: str, name: str) -> None:
    assert CampaignConfig(requirement=requirement).folder.name == f"warehouse-route_1-{name}-heuristic-hybrid-0"


@pytest.mark.parametrize("writer", [{"generator": "vlm"}, {"model": "openai-chat:x"}, {"replay": "calls"}])
def test_the_usual_strategy_is_that_of_the_study_where_a_model_writes(writer: dict[str, str]) -> None:
    assert CampaignConfig(**writer).strategy == "study"
    assert "--strategy" not in command_for(CampaignConfig(**writer))
    other = CampaignConfig(**writer, strategy="hybrid")
    assert "--strategy hybrid" in command_for(other)
    assert CampaignConfig().strategy == "hybrid"


def test_a_stack_among_the_simulators_options_lies_beside_the_file(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("")
    text = "simulator_options: {stack: mine.yaml}\n"
    found = parse_campaign_file(text, tmp_path / "campaign.yaml")
    assert found["simulator_options"] == {"stack": str(tmp_path / "mine.yaml")}


def test_every_setting_survives_a_resume(key: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if key in OF_THE_CALL:
        pytest.skip("says how one call runs")
    monkeypatch.chdir(tmp_path)
    Path("moved.yaml").write_text("objects: []")
    Path("knowledge.json").write_text("[]")
    Path("prompts").mkdir()
    shutil.copytree(SHIPPED / "warehouse", "ward")
    Path("ward/doors.yaml").write_text("doors: [{name: Ward, hinge: [0, 0], end: [0.9, 0]}]")
    Path("ward/world.yaml").write_text("doors: doors.yaml\n" + Path("ward/world.yaml").read_text())
    needed: dict[str, Any] = {"simulator": "kinematic"} | PARTNERS.get(key, {})
    value = SURVIVING.get(key, OWN.get(key, VALUES[value_type(key)])[0])
    made = Campaign.create("one", file=needed | {key: value})
    assert getattr(made.config, key) == value != default_of(key)
    assert getattr(Campaign.open("one").config, key) == value
    assert getattr(Campaign.create("one").config, key) == value
