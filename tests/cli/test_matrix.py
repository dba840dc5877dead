"""Several routes and requirements in one command."""

from __future__ import annotations

import html
import json
import re
import shutil
import signal
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from tests.cli.commands import printed, rvsg
from tests.cli.test_run import records, signalled

from rvsg.app.folder import LEDGER
from rvsg.app.matrix import folders_in
from rvsg.cli import main
from rvsg.core.errors import RvsgError, UnknownName
from rvsg.world.world_folder import SHIPPED

SMALL = [
    *("--simulator", "kinematic", "--strategy", "random", "--scenarios", "2", "--refinements", "1"),
    *("--repeats", "2", "--confirmations", "4", "--seed", "7", "--jobs", "1"),
]
ONE = [*SMALL, "--scenarios", "1", "--refinements", "0"]
PAIRS = [("route_1", "R1"), ("route_1", "R3"), ("route_2", "R1"), ("route_2", "R3")]
ASKED = ["--route", "route_1", "--route", "route_2", "--requirement", "R1", "--requirement", "R3"]


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """The records of every cell, run alone."""
    folder = tmp_path_factory.mktemp("alone")
    found = {}
    for route, requirement in PAIRS:
        out = folder / f"{route}-{requirement}"
        assert main(["run", *SMALL, "--route", route, "--requirement", requirement, "--out", str(out)]) == 0
        found[out.name] = records(out)
    return found


@pytest.mark.slow
def test_campaigns_side_by_side_keep_what_each_keeps_alone(
    tmp_path: Path, alone: dict[str, list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "all"
    junit = tmp_path / "junit.xml"
    told = printed(capsys, "run", SMALL, ASKED, "--out", out, "--jobs 3 --junit", junit)
    assert [(c["route"], c["requirement"]) for c in told["campaigns"]] == PAIRS
    assert {name: records(out / name) for name in alone} == alone
    assert all((out / name / "report.html").exists() for name in alone)
    assert len(ET.parse(junit).getroot()) == 4
    assert told["command"].startswith("rvsg run --route route_1 --route route_2 --requirement R1 --requirement R3")
    overview = (out / "report.html").read_text()
    assert {link.split("#")[0] for link in re.findall(r'href="([^"]+)"', overview)} == {
        f"{route}-{r}/report.html" for route, r in PAIRS
    }
    assert told["command"] in html.unescape(overview)
    (out / "report.html").unlink()
    assert len(printed(capsys, "report", out)["campaigns"]) == 4
    assert (out / "report.html").read_text() == overview


@pytest.mark.slow
@pytest.mark.parametrize("how", [pytest.param(signal.SIGKILL, marks=pytest.mark.exhaustive), signal.SIGINT])
def test_cells_that_are_stopped_resume_to_identical_records(
    tmp_path: Path, alone: dict[str, list[str]], how: signal.Signals
) -> None:
    out = tmp_path / "all"
    done = signalled(how, 9, "run", *SMALL, *ASKED, "--out", str(out), "--jobs", "2")
    assert done.returncode == (3 if how is signal.SIGINT else -how)
    if how is signal.SIGINT:
        assert f" -m rvsg run --out {out}" in done.stderr
        assert "Traceback" not in done.stderr
    assert main(["run", "--out", str(out)]) == 0
    assert {name: records(out / name) for name in alone} == alone


@pytest.mark.parametrize(
    ("asked", "meant"),
    [("--route route_1 --route rout_2", "route_2"), ("--requirement R1 --requirement R17", "R1")],
)
def test_a_mistake_in_one_cell_is_told_before_any_begins(
    tmp_path: Path, errors: list[RvsgError], asked: str, meant: str
) -> None:
    rvsg("run", SMALL, asked, "--out", tmp_path / "all", code=2)
    assert isinstance(errors[-1], UnknownName) and errors[-1].nearest == meant
    assert not (tmp_path / "all").exists()


@pytest.mark.exhaustive
def test_cells_keep_their_settings_stay_in_the_list_and_more_may_be_added(
    tmp_path: Path, errors: list[RvsgError], alone: dict[str, list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "all"
    rvsg("run", SMALL, "--route route_1 --route route_2 --out", out)
    rvsg("run --out", out, "--seed 8", code=2)
    assert errors[-1].code == "other-settings"
    assert len(printed(capsys, "run --out", out, "--route route_1")["campaigns"]) == 1
    assert "2 campaigns in warehouse" in (out / "report.html").read_text()
    assert len(printed(capsys, "run --out", out)["campaigns"]) == 2
    rvsg("run --out", out, "--requirement R1 --requirement R3")
    assert records(out / "route_2-R3") == alone["route_2-R3"]


@pytest.mark.exhaustive
def test_a_violation_in_any_cell_is_told_by_the_exit_code_where_asked(tmp_path: Path) -> None:
    file = tmp_path / "r.yaml"
    words = "text: Keep away.\n  metric: dto\n  worse: smaller\n  unit: m\n"
    file.write_text(f"never:\n  title: N\n  {words}  limit: 99.0\nalways:\n  title: A\n  {words}  limit: 0.0\n")
    asked = ["--requirement", f"{file}#never", "--requirement", f"{file}#always", "--confirmations", "15"]
    assert main(["run", *SMALL, *asked, "--out", str(tmp_path / "all"), "--fail-on-violation"]) == 1
    assert main(["report", str(tmp_path / "all")]) == 0
    assert main(["report", str(tmp_path / "all"), "--fail-on-violation"]) == 1


def test_cells_do_not_go_into_the_folder_of_one_campaign(tmp_path: Path, errors: list[RvsgError]) -> None:
    out = str(tmp_path / "one")
    main(["run", *ONE, "--out", out])
    assert main(["run", *ONE, *ASKED, "--out", out]) == 2
    assert errors[-1].code == "out-single"


def test_the_tenth_route_comes_after_the_second(tmp_path: Path) -> None:
    for name in ("route_10-R1", "route_2-R1", "route_2-R10", "route_2-R9", "hall-R1", "none"):
        (tmp_path / name).mkdir()
        (tmp_path / name / (LEDGER if name != "none" else "notes")).touch()
    kept = [path.name for path in folders_in(tmp_path)]
    assert kept == ["hall-R1", "route_2-R1", "route_2-R9", "route_2-R10", "route_10-R1"]


@pytest.mark.parametrize("content", ["5", '{"route": 5}', '{"rout": ["route_1"]}'])
def test_a_list_of_cells_that_is_damaged_is_told(tmp_path: Path, errors: list[RvsgError], content: str) -> None:
    (tmp_path / "matrix.json").write_text(content)
    assert main(["run", "--out", str(tmp_path)]) == 2
    assert errors[-1].code == "matrix-file"


def test_a_report_of_campaigns_that_have_not_begun_says_how_to_begin(tmp_path: Path, errors: list[RvsgError]) -> None:
    (tmp_path / "matrix.json").write_text('{"route": ["route_1", "route_2"]}')
    rvsg("report", tmp_path, code=2)
    assert errors[-1].code == "not-begun"


def test_the_command_that_repeats_cells_has_the_whole_budget(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    budget = ["--budget-calls", "9"]
    main(["run", *ONE, "--route", "route_1", "--route", "route_2", *budget, "--out", str(tmp_path / "all"), "--json"])
    assert " ".join(budget) in json.loads(capsys.readouterr().out)["command"]


def test_two_cells_that_would_share_a_folder_are_refused(tmp_path: Path, errors: list[RvsgError]) -> None:
    file = tmp_path / "r.yaml"
    words = "{title: N, text: Keep away., metric: dto, worse: smaller, unit: m, limit: 1.0}"
    file.write_text(f'"N 1": {words}\nN_1: {words}\n')
    asked = ["--requirement", f"{file}#N 1", "--requirement", f"{file}#N_1"]
    assert main(["run", *SMALL, *asked, "--out", str(tmp_path / "all")]) == 2
    assert errors[-1].code == "matrix-folder-shared"


@pytest.mark.slow
def test_a_pair_that_is_added_is_one_pair(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "all"
    rvsg("run", SMALL, "--route route_1 --route route_2 --out", out)
    rvsg("run --out", out, "--route route_1 --requirement R3")
    told = printed(capsys, "run --out", out)
    assert len(told["campaigns"]) == 3
    names = {f"{route}-{requirement}" for route, requirement in PAIRS} - {"route_2-R3"}
    assert {path.name for path in folders_in(out)} == names
    first, second = told["command"].split(" && ")
    assert first.startswith("rvsg run --route route_1 --requirement R1 --requirement R3 --strategy")
    assert second.startswith("rvsg run --route route_2 --requirement R1 --strategy")
    assert main(["run", "--out", str(out), "--requirement", "R2"]) == 0
    assert {path.name for path in folders_in(out)} == names | {"route_1-R2", "route_2-R2"}


@pytest.mark.exhaustive
def test_cells_of_a_file_with_a_world_of_their_own_go_on_in_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(SHIPPED / "warehouse", tmp_path / "mine")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "c.yaml").write_text("world: mine\nroute: [route_1, route_2]\nrequirement: [R1]\nout: all\n")
    monkeypatch.chdir(tmp_path)
    rvsg("run c.yaml", SMALL)
    shutil.rmtree(tmp_path / "all" / "route_2-R1")
    monkeypatch.chdir(tmp_path / "elsewhere")
    rvsg("run --out ../all")
    rvsg("report ../all")
    again = {path.name: records(path) for path in folders_in(tmp_path / "all")}
    assert list(again) == ["route_1-R1", "route_2-R1"]
    monkeypatch.chdir(tmp_path)
    rvsg("run c.yaml", SMALL, "--out new")
    assert {path.name: records(path) for path in folders_in(tmp_path / "new")} == again
