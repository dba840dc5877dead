"""The campaign file: complete in its documentation, and the same thing as the options."""

from __future__ import annotations

import re
import shlex
from itertools import pairwise
from pathlib import Path

import pytest
import yaml

from rvsg.app.commands import command_for, resume_command
from rvsg.app.settings import CampaignConfig, effective, read_campaign_file
from rvsg.cli import VERBS
from rvsg.cli.frame import full_command
from rvsg.cli.options import pairs
from rvsg.simulation.stacks.registry import DEFAULT_STACK

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "campaign-file.md"


def test_every_key_is_documented_with_its_default_and_nothing_else_is() -> None:
    rows = re.findall(r"^\| (`[^|]+) \| ([^|]+) \|", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    documented = {key: default.strip() for keys, default in rows for key in re.findall(r"`(\w+)`", keys)}
    assert set(documented) == set(CampaignConfig.model_fields)
    config = CampaignConfig()
    for key, default in documented.items():
        value = getattr(config, key)
        if isinstance(value, bool):
            assert default == f"`{str(value).lower()}`"
        elif value not in (None, {}):
            assert default == f"`{value}`", key


def test_every_key_is_an_option_and_the_other_way_round() -> None:
    options = {parameter.name for parameter in full_command(VERBS, "run").params if not parameter.hidden}
    fields = CampaignConfig.model_fields
    keys = {key.removesuffix("s") if key.endswith("_options") or key == "doors" else key for key in fields}
    assert options - {"campaign", "json", "help"} == keys


def test_the_help_of_an_option_names_the_true_default() -> None:
    shown = {p.name: re.findall(r"\[([^\]]+)\]$", p.help or "") for p in full_command(VERBS, "run").params}
    config = CampaignConfig()
    told = {name: default[0] for name, default in shown.items() if default and name != "jobs"}
    assert {"world", "scenarios", "refinements", "repeats", "confirmations", "seed", "memory"} <= set(told)
    derived = {"budget_runs": "scenarios x configurations x repeats", "stack": DEFAULT_STACK, "generator": "heuristic"}
    wrong = {name for name, default in told.items() if str(getattr(config, name)) != derived.get(name, default)}
    assert wrong <= derived.keys()


def test_options_win_over_the_file_and_the_file_over_what_was_stored() -> None:
    config = effective({"seed": 1, "scenarios": 2, "humans": 3}, {"seed": 4, "scenarios": 5}, {"seed": 6})
    assert (config.seed, config.scenarios, config.humans) == (6, 5, 3)


def test_paths_are_relative_to_the_file(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "rules.yaml").write_text("")
    (tmp_path / "mine" / "c.yaml").write_text("out: runs/x\nworld: warehouse\nrequirement: rules.yaml#near\n")
    values = read_campaign_file(tmp_path / "mine" / "c.yaml")
    assert values["out"] == str(tmp_path / "mine" / "runs/x")
    assert values["world"] == "warehouse"
    assert values["requirement"] == str(tmp_path / "mine" / "rules.yaml") + "#near"


def test_the_effective_configuration_is_a_campaign_file_again(tmp_path: Path) -> None:
    config = CampaignConfig(seed=9, strategy="unguided", simulator_options={"noise": {"lidar": 0}})
    (tmp_path / "c.yaml").write_text(config.to_yaml())
    assert effective(None, read_campaign_file(tmp_path / "c.yaml"), {}) == config


@pytest.mark.parametrize("example", re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL))
def test_the_documented_example_is_a_campaign(example: str) -> None:
    CampaignConfig.model_validate(yaml.safe_load(example))


@pytest.mark.parametrize("mark", ["#", ":"])
def test_a_requirement_of_a_file_beside_the_campaign_file_is_found_with_either_mark(tmp_path: Path, mark: str) -> None:
    (tmp_path / "mine.yaml").write_text("near: {}\n", encoding="utf-8")
    file = tmp_path / "campaign.yaml"
    file.write_text(f"requirement: 'mine.yaml{mark}near'\n", encoding="utf-8")
    assert read_campaign_file(file)["requirement"] == str(tmp_path / f"mine.yaml{mark}near")


def test_the_command_to_resume_names_all_that_is_not_kept_with_the_campaign() -> None:
    of_the_campaign = {"route": "route_2", "simulator_options": {"profile": "precise"}, "seed": 3}
    of_the_moment = {
        "out": "my runs/one",
        "executor": "cluster",
        "executor_options": {"address": "tcp://10.0.0.1:8786", "patience_s": 5},
        "fail_on_violation": True,
        "junit": "junit.xml",
        "budget_usd": 2.5,
    }
    command = resume_command(CampaignConfig(**of_the_campaign, **of_the_moment))
    assert command == (
        "rvsg run --out 'my runs/one' --executor cluster --executor-option address=tcp://10.0.0.1:8786 "
        "--executor-option patience_s=5 --fail-on-violation --junit junit.xml --budget-usd 2.5"
    )


def test_options_of_a_plug_in_are_told_as_they_are_read() -> None:
    options = {"noise": {"lidar": 0}, "fast": True, "limit": None, "profile": "precise"}
    words = shlex.split(command_for(CampaignConfig(simulator_options=options)))
    given = [word for option, word in pairwise(words) if option == "--simulator-option"]
    assert pairs("simulator", given) == options


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
