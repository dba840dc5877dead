"""`rvsg report` in the terminal: what a campaign found, and how far one came that was cut off."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.cli.commands import printed, rvsg
from tests.cli.test_run import SMALL, records

from rvsg.app.folder import LEDGER
from rvsg.cli import main
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.world.world import World

Told = pytest.CaptureFixture[str]


def cut_off(out: Path, before_run: int, *asked: str) -> None:
    """A campaign of 6 attempts with 2 runs each and 4 to confirm, interrupted before one of its runs."""
    original, made = KinematicSimulator.run, []

    def interrupted(self: KinematicSimulator, scenario: Scenario, world: World, *, seed: int) -> Run:
        made.append(seed)
        if len(made) == before_run:
            raise KeyboardInterrupt
        return original(self, scenario, world, seed=seed)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(KinematicSimulator, "run", interrupted)
        assert main(["run", *SMALL, *asked, "--out", str(out)]) == 3


@pytest.mark.parametrize(
    ("before_run", "how_far", "ranked"),
    [
        pytest.param(1, "0 of 6", False, marks=pytest.mark.slow),
        (7, "3 of 6", True),
        pytest.param(14, "all 6 attempts", True, marks=pytest.mark.exhaustive),
    ],
)
def test_a_campaign_that_was_cut_off_says_how_far_it_came_and_how_to_go_on(
    tmp_path: Path, capsys: Told, before_run: int, how_far: str, ranked: bool
) -> None:
    cut_off(tmp_path / "one", before_run)
    capsys.readouterr()
    for store in (tmp_path / "one", tmp_path / "one" / LEDGER):
        assert main(["report", str(store)]) == 0
        told = capsys.readouterr().err
        go_on = f"rvsg run --out {tmp_path / 'one'}"
        assert how_far in told and f"Resume with: {go_on}\n" in told
        assert ("verdict" in told) is ranked
    copy = shutil.copy(tmp_path / "one" / LEDGER, tmp_path / "copy.sqlite")
    rvsg("report", copy)
    told = capsys.readouterr().err
    assert how_far in told and "Resume with" not in told
    assert printed(capsys, go_on.removeprefix("rvsg "))["complete"]


def test_the_folder_of_separate_campaigns_has_an_overview_and_links_both_ways(tmp_path: Path, capsys: Told) -> None:
    cut_off(tmp_path / "one", 7)
    cut_off(tmp_path / "two", 7, "--route", "route_2")
    capsys.readouterr()
    assert main(["report", str(tmp_path)]) == 0
    told = capsys.readouterr().err
    assert all(f"Resume with: rvsg run --out {tmp_path / name}\n" in told for name in ("one", "two"))
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    for name in ("one", "two"):
        assert f'href="{name}/report.html"' in text
        assert 'href="../report.html"' in (tmp_path / name / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_of_several_campaigns_each_that_was_cut_off_or_never_began_is_told(tmp_path: Path, capsys: Told) -> None:
    folder = tmp_path / "all"
    asked = ["--route", "route_1", "--route", "route_2", "--route", "route_3"]
    assert main(["run", *SMALL, *asked, "--out", str(folder)]) == 0
    whole = records(folder / "route_2-R1")
    for name in ("route_1-R1", "route_2-R1", "route_3-R1"):
        shutil.rmtree(folder / name)
    cut_off(folder / "route_1-R1", 1)
    cut_off(folder / "route_2-R1", 7, "--route", "route_2")
    capsys.readouterr()
    assert main(["report", str(folder)]) == 0
    told = capsys.readouterr().err
    assert "0 of 6" in told and "3 of 6" in told
    assert f"Resume with: rvsg run --out {folder}\n" in told
    assert main(["run", "--out", str(folder)]) == 0
    assert records(folder / "route_2-R1") == whole
    capsys.readouterr()
    assert main(["report", str(folder)]) == 0
    assert "Resume with" not in capsys.readouterr().err
