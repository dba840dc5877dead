"""Several routes and requirements in one command."""

from __future__ import annotations

import html
import re
import shutil
import signal
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from tests.cli.commands import Terminal, rvsg
from tests.cli.test_run import records, signalled

from rvsg.app.folder import LEDGER
from rvsg.app.matrix import folders_in
from rvsg.world.world_folder import SHIPPED

QUICK = [
    *("--simulator", "kinematic", "--strategy", "random", "--repeats", "2", "--confirmations", "4", "--seed", "7"),
]
MANY = [*QUICK, "--scenarios", "2", "--refinements", "1"]
SMALL = [*MANY, "--jobs", "1"]
ONE = [*QUICK, "--scenarios", "1", "--refinements", "0", "--jobs", "1"]
PAIRS = [("route_1", "R1"), ("route_1", "R3"), ("route_2", "R1"), ("route_2", "R3")]
ROUTES = "--route route_1 --route route_2"
ASKED = f"{ROUTES} --requirement R1 --requirement R3"


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """The records of every cell, run alone."""
    folder = tmp_path_factory.mktemp("alone")
    found = {}
    for route, requirement in PAIRS:
        out = folder / f"{route}-{requirement}"
        rvsg("run", SMALL, "--route", route, "--requirement", requirement, "--out", out)
        found[out.name] = records(out)
    return found


def kept(folder: str) -> dict[str, list[str]]:
    """The records of every campaign in a folder."""
    return {path.name: records(path) for path in folders_in(Path(folder))}


@pytest.mark.slow
def test_campaigns_side_by_side_keep_what_each_keeps_alone(terminal: Terminal, alone: dict[str, list[str]]) -> None:
    told = terminal.json("run", MANY, ASKED, "--out all --jobs 3 --junit junit.xml")
    assert [(c["route"], c["requirement"]) for c in told["campaigns"]] == PAIRS
    assert kept("all") == alone
    assert all(Path(f"all/{name}/report.html").exists() for name in alone)
    assert len(ET.parse("junit.xml").getroot()) == 4
    assert told["command"].startswith(f"rvsg run {ASKED}")
    overview = Path("all/report.html").read_text()
    assert {link.split("#")[0] for link in re.findall(r'href="([^"]+)"', overview)} == {
        f"{route}-{r}/report.html" for route, r in PAIRS
    }
    assert told["command"] in html.unescape(overview)
    Path("all/report.html").unlink()
    assert len(terminal.json("report all")["campaigns"]) == 4
    assert Path("all/report.html").read_text() == overview


@pytest.mark.slow
@pytest.mark.parametrize("how", [pytest.param(signal.SIGKILL, marks=pytest.mark.exhaustive), signal.SIGINT])
def test_cells_that_are_stopped_resume_to_identical_records(
    terminal: Terminal, alone: dict[str, list[str]], how: signal.Signals
) -> None:
    done = signalled(how, 9, "run", *MANY, *ASKED.split(), "--out", "all", "--jobs", "2")
    assert done.returncode == (3 if how is signal.SIGINT else -how)
    if how is signal.SIGINT:
        assert " -m rvsg run --out all" in done.stderr
        assert "Traceback" not in done.stderr
    terminal("run --out all")
    assert kept("all") == alone


@pytest.mark.parametrize(
    ("asked", "meant"),
    [("--route route_1 --route rout_2", "route_2"), ("--requirement R1 --requirement clearence", "clearance")],
)
def test_a_mistake_in_one_cell_is_told_before_any_begins(terminal: Terminal, asked: str, meant: str) -> None:
    assert terminal.refused("run", SMALL, asked, "--out all").nearest == meant
    assert not Path("all").exists()


@pytest.mark.exhaustive
def test_cells_keep_their_settings_stay_in_the_list_and_more_may_be_added(
    terminal: Terminal, alone: dict[str, list[str]]
) -> None:
    terminal("run", SMALL, ROUTES, "--out all")
    assert terminal.refused("run --out all --seed 8").code == "other-settings"
    assert len(terminal.json("run --out all --route route_1")["campaigns"]) == 1
    assert "2 campaigns in warehouse" in Path("all/report.html").read_text()
    assert len(terminal.json("run --out all")["campaigns"]) == 2
    terminal("run --out all --requirement R1 --requirement R3")
    assert kept("all") == alone


WORDS = "text: Keep away., metric: dto, worse: smaller, unit: m"


@pytest.mark.exhaustive
def test_a_violation_in_any_cell_is_told_by_the_exit_code_where_asked(terminal: Terminal) -> None:
    Path("r.yaml").write_text(f"never: {{title: N, {WORDS}, limit: 99.0}}\nalways: {{title: A, {WORDS}, limit: 0.0}}\n")
    asked = "--requirement r.yaml#never --requirement r.yaml#always --confirmations 15 --out all"
    terminal("run", SMALL, asked, "--fail-on-violation", code=1)
    terminal("report all")
    terminal("report all --fail-on-violation", code=1)


def test_two_cells_that_would_share_a_folder_are_refused(terminal: Terminal) -> None:
    Path("r.yaml").write_text(f'"N 1": {{title: N, {WORDS}, limit: 1.0}}\nN_1: {{title: N, {WORDS}, limit: 1.0}}\n')
    asked = ["--requirement", "r.yaml#N 1", "--requirement", "r.yaml#N_1"]
    assert terminal.refused("run", SMALL, asked, "--out all").code == "matrix-folder-shared"


def test_cells_do_not_go_into_the_folder_of_one_campaign(terminal: Terminal) -> None:
    terminal("run", ONE, "--out one")
    assert terminal.refused("run", ONE, ASKED, "--out one").code == "out-single"


def test_the_tenth_route_comes_after_the_second(tmp_path: Path) -> None:
    for name in ("route_10-R1", "route_2-R1", "route_2-R10", "route_2-R9", "hall-R1", "none"):
        (tmp_path / name).mkdir()
        (tmp_path / name / (LEDGER if name != "none" else "notes")).touch()
    found = [path.name for path in folders_in(tmp_path)]
    assert found == ["hall-R1", "route_2-R1", "route_2-R9", "route_2-R10", "route_10-R1"]


@pytest.mark.parametrize(
    ("content", "command", "code"),
    [
        *((content, "run --out .", "matrix-file") for content in ("5", '{"route": 5}', '{"rout": ["route_1"]}')),
        ('{"route": ["route_1", "route_2"]}', "report .", "not-begun"),
    ],
)
def test_a_list_of_cells_that_is_damaged_or_has_not_begun_is_told(
    terminal: Terminal, content: str, command: str, code: str
) -> None:
    Path("matrix.json").write_text(content)
    assert terminal.refused(command).code == code


def test_the_command_that_repeats_cells_has_the_whole_budget(terminal: Terminal) -> None:
    assert "--budget-calls 9" in terminal.json("run", ONE, ROUTES, "--budget-calls 9 --out all")["command"]


@pytest.mark.slow
def test_a_pair_that_is_added_is_one_pair(terminal: Terminal) -> None:
    terminal("run", SMALL, ROUTES, "--out all")
    terminal("run --out all --route route_1 --requirement R3")
    told = terminal.json("run --out all")
    assert len(told["campaigns"]) == 3
    names = {f"{route}-{requirement}" for route, requirement in PAIRS} - {"route_2-R3"}
    assert {path.name for path in folders_in(Path("all"))} == names
    first, second = told["command"].split(" && ")
    assert first.startswith("rvsg run --route route_1 --requirement R1 --requirement R3 --")
    assert second.startswith("rvsg run --route route_2 --requirement R1 --")
    terminal("run --out all --requirement R2")
    assert {path.name for path in folders_in(Path("all"))} == names | {"route_1-R2", "route_2-R2"}


@pytest.mark.exhaustive
def test_cells_of_a_file_with_a_world_of_their_own_go_on_in_any_folder(
    terminal: Terminal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(SHIPPED / "warehouse", "mine")
    Path("elsewhere").mkdir()
    Path("c.yaml").write_text("world: mine\nroute: [route_1, route_2]\nrequirement: [R1]\nout: all\n")
    terminal("run c.yaml", SMALL)
    shutil.rmtree("all/route_2-R1")
    monkeypatch.chdir("elsewhere")
    terminal("run --out ../all")
    terminal("report ../all")
    again = kept("../all")
    assert list(again) == ["route_1-R1", "route_2-R1"]
    monkeypatch.chdir(tmp_path)
    terminal("run c.yaml", SMALL, "--out new")
    assert kept("new") == again
