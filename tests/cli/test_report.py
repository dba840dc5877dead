"""`rvsg report` in the terminal: what a campaign found, and how far one came that was cut off."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.cli.commands import Terminal
from tests.cli.test_run import SMALL, records

from rvsg.app.folder import LEDGER
from rvsg.core.errors import SimulationError
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.world.world import World


def cut_off(terminal: Terminal, before_run: int, asked: str) -> None:
    """A campaign of 6 attempts with 2 runs each and 4 to confirm, interrupted before one of the runs of its search."""
    original, made = KinematicSimulator.run, []

    def interrupted(self: KinematicSimulator, scenario: Scenario, world: World, *, seed: int) -> Run:
        made.append(seed)
        if len(made) == 3 + before_run:  # the robot drives alone first
            raise KeyboardInterrupt
        return original(self, scenario, world, seed=seed)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(KinematicSimulator, "run", interrupted)
        terminal("run", SMALL, asked, code=3)


@pytest.mark.parametrize(
    ("before_run", "how_far", "ranked"),
    [
        pytest.param(1, "0 of 6", False, marks=pytest.mark.slow),
        (7, "3 of 6", True),
        pytest.param(14, "all 6 attempts", True, marks=pytest.mark.exhaustive),
    ],
)
def test_a_campaign_that_was_cut_off_says_how_far_it_came_and_how_to_go_on(
    terminal: Terminal, before_run: int, how_far: str, ranked: bool
) -> None:
    cut_off(terminal, before_run, "--out one")
    for store in ("one", f"one/{LEDGER}"):
        told = terminal("report", store)
        assert how_far in told and "Resume with: rvsg run --out one\n" in told
        assert ("  where " in told) is ranked
    shutil.copy(f"one/{LEDGER}", "copy.sqlite")
    told = terminal("report copy.sqlite")
    assert how_far in told and "Resume with" not in told
    assert terminal.json("run --out one")["complete"]


def test_a_simulator_that_fails_at_once_keeps_nothing_and_says_so(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object, **__: object) -> Run:
        raise SimulationError("no licence")

    monkeypatch.setattr(KinematicSimulator, "prepare", failing)
    told = terminal("run", SMALL, "--out one", code=SimulationError.exit_code)
    assert "0 finished attempts are kept. Resume with: rvsg run" in told and "Finished work" not in told


def test_the_folder_of_separate_campaigns_has_an_overview_and_links_both_ways(terminal: Terminal) -> None:
    cut_off(terminal, 7, "--out all/one")
    cut_off(terminal, 7, "--route route_2 --out all/two")
    told = terminal("report all")
    text = Path("all/report.html").read_text(encoding="utf-8")
    for name in ("one", "two"):
        assert f"Resume with: rvsg run --out all/{name}\n" in told
        assert f'href="{name}/report.html"' in text
        assert 'href="../report.html"' in Path(f"all/{name}/report.html").read_text(encoding="utf-8")


def test_a_rvsg_file_is_unpacked_beside_it_and_reported(terminal: Terminal) -> None:
    cut_off(terminal, 7, "--out one")
    assert "rvsg report or rvsg studio" in terminal("export one --to view --out sent.rvsg")
    assert "3 of 6" in terminal("report sent.rvsg") and Path("sent/report.html").is_file()
    terminal.refused("report sent.rvsg")


@pytest.mark.slow
def test_of_several_campaigns_each_that_was_cut_off_or_never_began_is_told(terminal: Terminal) -> None:
    terminal("run", SMALL, "--route route_1 --route route_2 --route route_3 --out all")
    whole = records(Path("all/route_2-R1"))
    for name in ("route_1-R1", "route_2-R1", "route_3-R1"):
        shutil.rmtree(Path("all") / name)
    cut_off(terminal, 1, "--out all/route_1-R1")
    cut_off(terminal, 7, "--route route_2 --out all/route_2-R1")
    told = terminal("report all")
    assert "0 of 6" in told and "3 of 6" in told
    assert "Resume with: rvsg run --out all\n" in told
    terminal("run --out all")
    assert records(Path("all/route_2-R1")) == whole
    assert "Resume with" not in terminal("report all")
