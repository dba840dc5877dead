from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
from tests.campaign.parts import WalkGenerator, plan, warehouse
from tests.cli.commands import Terminal

from rvsg.scenario.brief import Brief


@pytest.mark.exhaustive
def test_a_scenario_and_its_runs_become_strips(terminal: Terminal) -> None:
    brief = Brief(mission=plan().mission, requirement=plan().requirement, seed=1)
    made = WalkGenerator().propose(brief, warehouse()).scenario
    assert made is not None
    Path("s.json").write_text(made.to_json(), encoding="utf-8")
    terminal("replay s.json --out one.png --width 800 --seed 3 --simulator kinematic")
    terminal("simulate s.json --out runs.jsonl --seed 3 --simulator kinematic")
    terminal("replay runs.jsonl --out two.png --width 800", code=2)  # in which world?
    terminal("replay runs.jsonl --out two.png --width 800 --world warehouse")
    with Image.open("one.png") as first, Image.open("two.png") as second:
        assert first.size == second.size


@pytest.mark.slow
def test_a_run_of_a_campaign_is_shown_by_its_id(terminal: Terminal) -> None:
    small = "--scenarios 1 --refinements 0 --repeats 2 --confirmations 2 --jobs 1"
    terminal("run --simulator kinematic --generator random --out c", small)
    terminal("replay c --out film.png --run run-0", code=2)
    run = terminal("replay c --out film.png").split("Replay of ")[1].split(",")[0]
    terminal("replay c --out film.png --run", run)
