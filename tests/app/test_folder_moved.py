"""A campaign's folder that was moved to another place, where the files it was begun with are not."""

from __future__ import annotations

import shutil
from importlib import resources
from pathlib import Path

import pytest
import yaml
from tests.app.parts import RPP
from tests.cli.commands import Terminal

import rvsg
from rvsg.world.world_folder import SHIPPED

OWN = (
    "--world site --robot robot.yaml --requirement limits.yaml#far --also more/limits.yaml#Near --strategy multi "
    "--moved pallet.yaml"
)
SMALL = "--simulator kinematic --humans 1 --scenarios 2 --refinements 0 --repeats 1 --shrink-runs 0"
CONFIRMED = f"{SMALL} --confirmations 2"
FAR = "{title: Far, text: Far away., metric: min_distance, worse: smaller, limit: 100}"


@pytest.fixture(autouse=True)
def files(terminal: Terminal) -> None:
    """A world, a robot, requirements and a moved object in the folder where the campaign begins."""
    shutil.copytree(SHIPPED / "warehouse", "site")
    Path("site/notes.txt").write_text("not of the world")
    text = (resources.files("rvsg.robots") / "data" / "turtlebot3_waffle.yaml").read_text()
    Path("robot.yaml").write_text(text.replace("turtlebot3_waffle", "mine"))
    Path("more").mkdir()
    Path("limits.yaml").write_text(f"far: {FAR}\n")
    Path("more/limits.yaml").write_text(f"Near: {FAR}\n")
    Path("pallet.yaml").write_text(
        "objects:\n  - {name: pallet, box: {center: [0.0, 9.0, 0.4], size: [0.4, 0.4, 0.8]}}\n"
    )


def moved_away() -> Path:
    """Move the campaign to another folder, and everything it was begun with out of reach."""
    there = Path("elsewhere/artefact")
    there.parent.mkdir()
    shutil.move("first", there)
    for path in ("site", "more"):
        shutil.rmtree(path)
    for path in ("robot.yaml", "limits.yaml", "pallet.yaml"):
        Path(path).unlink()
    return there


def test_a_moved_folder_is_reported_confirmed_and_resumed(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal("run", OWN, SMALL, "--confirmations 0 --out first")
    before = rvsg.Campaign.open("first")
    plan, attempts = before.plan, before.attempts()
    there = moved_away().absolute()
    assert not (there / "inputs/world/site/notes.txt").exists()
    monkeypatch.chdir(there.parent)
    terminal("report artefact")
    candidate = rvsg.Campaign.open("artefact").candidates()[0].index
    terminal("confirm artefact", str(candidate))
    terminal("run --out artefact")
    after = rvsg.Campaign.open("artefact")
    assert after.plan == plan and after.attempts()[: len(attempts)] == attempts
    assert "--robot artefact/inputs/robot/robot.yaml" in after.command
    kept = yaml.safe_load((there / "campaign.yaml").read_text())
    assert (kept["robot"], kept["requirement"]) == ("inputs/robot/robot.yaml", "inputs/requirement/limits.yaml#far")
    terminal("run artefact/campaign.yaml --out again")
    assert rvsg.Campaign.open("again").plan.mission == plan.mission


def test_the_parameter_file_of_nav2_moves_with_the_folder(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("nav2_params.yaml").write_text(RPP)
    terminal("run --stack nav2_params.yaml --humans 1 --scenarios 1 --refinements 0 --repeats 1 --confirmations 0",
             "--shrink-runs 0 --search-anyway --out first")  # fmt: skip
    simulator = rvsg.Campaign.open("first").record.simulator
    Path("nav2_params.yaml").unlink()
    there = moved_away()
    monkeypatch.chdir(there.parent)
    terminal("run --out artefact")
    assert rvsg.Campaign.open("artefact").found_with.simulator.options["stack"] == simulator.options["stack"]


def test_several_campaigns_in_a_moved_folder_are_resumed(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal("run", OWN, CONFIRMED, "--route route_1 --route route_2 --out first")
    there = moved_away().absolute()
    monkeypatch.chdir(there.parent)
    terminal("run --out artefact")
    terminal("report artefact")


def test_a_file_that_has_changed_is_read_from_the_copy_unless_it_is_named(terminal: Terminal) -> None:
    terminal("run", OWN, CONFIRMED, "--out first")
    plan = rvsg.Campaign.open("first").plan
    Path("limits.yaml").write_text(f"far: {FAR}\n".replace("100", "50"))
    terminal("run --out first")
    assert rvsg.Campaign.open("first").plan == plan
    assert terminal.refused("run", OWN, CONFIRMED, "--out first").code == "other-settings"
    Path("limits.yaml").write_text(f"far: {FAR}\n")
    Path("robot.yaml").rename("same.yaml")
    terminal("run", OWN.replace("robot.yaml", "same.yaml"), CONFIRMED, "--out first")
