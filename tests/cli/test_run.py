from __future__ import annotations

import contextlib
import json
import re
import shlex
import shutil
import signal
import sqlite3
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.cli.commands import printed, rvsg

from rvsg.app.folder import LEDGER, alone_in
from rvsg.cli import main
from rvsg.core.errors import InvalidOptions, RvsgError, SimulationError
from rvsg.core.outputs import make_folder
from rvsg.evaluation.verdict import Status
from rvsg.generation.generator import Proposal
from rvsg.generation.random_search import RandomGenerator
from rvsg.scenario.rules import Finding
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Outcome
from rvsg.store.sqlite import SqliteLedger
from rvsg.world.world_folder import SHIPPED

SMALL = [
    *("--simulator", "kinematic", "--strategy", "random", "--scenarios", "3", "--refinements", "1"),
    *("--repeats", "2", "--confirmations", "4", "--jobs", "1"),
]


@pytest.fixture(scope="module")
def _finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished") / "one"
    assert main(["run", *SMALL, "--seed", "7", "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def finished(_finished: Path, tmp_path: Path) -> Path:
    """A copy of a finished campaign with seed 7."""
    return Path(shutil.copytree(_finished, tmp_path / "one"))


def records(folder: Path) -> list[str]:
    """Everything a campaign keeps: its attempts and its runs, as text."""
    with SqliteLedger.existing(folder / LEDGER) as ledger:
        (name,) = ledger.campaigns()
        attempts = list(ledger.attempts(name))
        runs = [ledger.run(m.run_id).trajectory.x.tobytes().hex() for a in attempts for m in a.measurements]
    return [attempt.to_json() for attempt in attempts] + runs


def test_a_campaign_leaves_its_files_and_prints_json_with_the_command_that_repeats_it(
    tmp_path: Path, finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, junit = tmp_path / "two", tmp_path / "junit.xml"
    told = printed(capsys, "run", SMALL, "--seed 7 --out", out, "--junit", junit)
    left = {path.name for path in out.iterdir()}
    assert {"ledger.sqlite", "report.html", "best_scenario.json", "campaign.yaml"} <= left
    assert not [name for name in left if name.endswith(("-wal", "-shm"))]
    assert len(ET.parse(junit).getroot()[0]) == 6
    assert told["complete"] and len(told["ranking"]) == 6
    assert told["accounting"]["search_runs"] == 12
    assert told["confirmed"][0]["verdict"]["runs"] == 4
    command = told["command"].split()
    assert command[:2] == ["rvsg", "run"] and command[-2:] == ["--seed", "7"]
    rvsg(command[1:], "--out", tmp_path / "three")
    rvsg("run", finished / "campaign.yaml", "--out", tmp_path / "four")
    assert records(finished) == records(out) == records(tmp_path / "three") == records(tmp_path / "four")
    assert capsys.readouterr().out == ""


@pytest.mark.slow
def test_two_jobs_end_with_the_records_of_one(tmp_path: Path, finished: Path) -> None:
    rvsg("run", SMALL, "--seed 7 --out", tmp_path / "two", "--jobs 2")
    assert records(finished) == records(tmp_path / "two")


ONE = [*SMALL, "--scenarios", "1", "--refinements", "0"]
LONG = [*SMALL, "--scenarios", "8", "--repeats", "3", "--seed", "7"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The records of an uninterrupted campaign."""
    folder = tmp_path_factory.mktemp("whole")
    main(["run", *LONG, "--out", str(folder)])
    return records(folder)


def signalled(how: signal.Signals, after: int, *argv: str) -> subprocess.CompletedProcess[str]:
    """Run `python -m rvsg` in a process that gets a signal when its ledger has written so often.

    The moment is counted, not timed, so that it is amid the campaign on a machine of any speed.
    """
    code = (
        "import os, runpy, sys\n"
        "from rvsg.store.sqlite import SqliteLedger\n"
        "written = []\n"
        "def counted(name):\n"
        "    original = getattr(SqliteLedger, name)\n"
        "    def write(*given):\n"
        "        original(*given)\n"
        "        written.append(name)\n"
        f"        if len(written) == {after}:\n"
        f"            os.kill(os.getpid(), {int(how)})\n"
        "    setattr(SqliteLedger, name, write)\n"
        "counted('keep')\n"
        "counted('append')\n"
        f"sys.argv[1:] = {argv!r}\n"
        "runpy.run_module('rvsg', run_name='__main__', alter_sys=True)\n"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.exhaustive)])
def test_a_killed_campaign_resumes_to_identical_records(tmp_path: Path, whole: list[str], how: signal.Signals) -> None:
    folder = tmp_path / "killed"
    done = signalled(how, 9, "run", *LONG, "--out", str(folder))
    with contextlib.closing(sqlite3.connect(folder / LEDGER)) as connection:
        (kept,) = connection.execute("SELECT count(*) FROM runs").fetchone()
    assert 5 <= kept < 9
    assert done.returncode == (3 if how is signal.SIGTERM else -how)
    if how is signal.SIGTERM:
        assert f" -m rvsg run --out {folder} --jobs 1\n" in done.stderr
        assert "Traceback" not in done.stderr
    assert main(["run", "--out", str(folder)]) == 0
    assert records(folder) == whole


def test_resuming_with_other_settings_is_refused_and_names_them(finished: Path, errors: list[RvsgError]) -> None:
    before = records(finished)
    rvsg("run --out", finished, "--seed 8", code=2)
    assert isinstance(errors[-1], InvalidOptions)
    assert (errors[-1].code, errors[-1].keys) == ("other-settings", ("seed",))
    assert records(finished) == before


def change_settings(ledger_file: Path, change: Callable[[dict[str, Any]], object], kept: int) -> None:
    """Change the stored settings of a campaign, and keep its first attempts only."""
    with contextlib.closing(sqlite3.connect(ledger_file)) as connection:
        (text,) = connection.execute("SELECT settings FROM campaigns").fetchone()
        settings = json.loads(text)
        change(settings)
        connection.execute("UPDATE campaigns SET settings = ?", (json.dumps(settings),))
        connection.execute("DELETE FROM attempts WHERE position >= ?", (kept,))
        connection.commit()


def test_a_campaign_from_before_a_setting_was_added_is_resumed(finished: Path) -> None:
    before = records(finished)
    change_settings(finished / LEDGER, lambda of: (of["plan"].pop("memory"), of["config"].pop("memory")), kept=6)
    assert main(["run", "--out", str(finished)]) == 0
    assert records(finished) == before


def reworded(ledger_file: Path, **changes: object) -> None:
    """As if the requirement had been other when the campaign was begun."""
    change_settings(ledger_file, lambda of: of["plan"]["requirement"].update(changes), kept=4)


def test_a_campaign_whose_requirement_is_worded_otherwise_today_is_resumed_in_its_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, study = tmp_path / "one", [*SMALL, "--strategy", "study"]
    main(["run", *study, "--out", str(out)])
    verdicts = [json.loads(text)["verdict"] for text in records(out) if text.startswith("{")]
    reworded(out / LEDGER, text="Mind the people.", title="Keep off")
    assert main(["run", "--out", str(out)]) == 0
    assert "(title, text)" in capsys.readouterr().err
    resumed = [json.loads(text) for text in records(out) if text.startswith("{")]
    assert [attempt["verdict"] for attempt in resumed] == verdicts
    assert {a["brief"]["requirement"]["text"] for a in resumed[4:6]} == {"Mind the people."}


@pytest.mark.parametrize("change", [{"limit": 1.3}, {"metric": "min_distance"}, {"worse": "larger"}])
def test_a_campaign_whose_requirement_judges_otherwise_today_is_refused(
    finished: Path, errors: list[RvsgError], change: dict[str, object]
) -> None:
    out = finished
    reworded(out / LEDGER, **change)
    assert main(["run", "--out", str(out)]) == 2
    assert isinstance(errors[-1], InvalidOptions)
    assert (errors[-1].code, errors[-1].keys) == ("other-settings", (f"plan.requirement.{next(iter(change))}",))


def test_a_campaign_that_never_got_to_an_attempt_is_not_told_to_have_zero(
    finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change_settings(finished / LEDGER, lambda of: None, kept=0)
    capsys.readouterr()
    rvsg("run --out", finished)
    assert "0 attempts" not in capsys.readouterr().err


def test_two_processes_do_not_share_a_folder(tmp_path: Path, errors: list[RvsgError]) -> None:
    folder = tmp_path / "one"
    make_folder(folder)
    with alone_in(folder):
        rvsg("run", SMALL, "--out", folder, code=2)
    assert errors[-1].code == "out-in-use"
    assert not (folder / LEDGER).exists()


@pytest.fixture
def far(tmp_path: Path) -> list[str]:
    """Options of a small campaign whose requirement every run violates."""
    (tmp_path / "strict.yaml").write_text(
        "far: {title: Far, text: Keep 100 m., metric: dto, worse: smaller, limit: 100.0, unit: m, source: a test}\n"
    )
    return [*ONE, "--requirement", f"{tmp_path / 'strict.yaml'}#far", "--out", str(tmp_path / "one")]


def test_a_violation_is_told_by_the_exit_code_only_where_asked(tmp_path: Path, far: list[str]) -> None:
    rvsg("run", far, "--confirmations 16")
    rvsg("run", far, "--confirmations 16 --fail-on-violation", code=1)
    rvsg("report", tmp_path / "one", "--fail-on-violation", code=1)


def test_a_violation_in_few_fresh_runs_fails_the_build_though_fail_or_flaky_is_open(
    tmp_path: Path, far: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    junit = tmp_path / "junit.xml"
    rvsg("run", far, "--confirmations 8 --fail-on-violation --junit", junit, code=1)
    assert "INCONCLUSIVE (violated; FAIL or FLAKY is still open)" in " ".join(capsys.readouterr().err.split())
    assert '<failure message="INCONCLUSIVE (violated; FAIL or FLAKY is still open)' in junit.read_text()
    page = (tmp_path / "one" / "report.html").read_text()
    assert '<span class="chip bad">violated</span>' in page
    assert "violates far in 8 of 8 confirmation runs; FAIL or FLAKY is still open (INCONCLUSIVE)." in page


@pytest.fixture
def refusing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every proposal of the generator `random` is refused."""
    problem = Finding(rule="unreadable", reason="The answer is no configuration.")
    refused = Proposal(generator="random", scenario=None, problems=(problem,))
    monkeypatch.setattr(RandomGenerator, "propose", lambda self, brief, world: refused)


@pytest.mark.usefixtures("refusing")
@pytest.mark.parametrize("several", [[], ["--requirement", "R1", "--requirement", "R3"]])
def test_a_campaign_without_a_valid_scenario_is_no_success(
    tmp_path: Path, errors: list[RvsgError], several: list[str]
) -> None:
    out = ["--out", str(tmp_path / "one")]
    assert main(["run", *SMALL, "--generator", "random", *several, *out]) == 2
    assert errors[-1].code == "nothing-judged" and "The answer is no configuration." in str(errors[-1])
    assert (tmp_path / "one" / "report.html").exists()
    assert main(["report", out[1]]) == 0
    assert main(["report", out[1], "--fail-on-violation"]) == 2


def test_a_campaign_whose_stack_failed_in_every_run_is_no_success(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, errors: list[RvsgError]
) -> None:
    run, details = KinematicSimulator.run, {"stack": {"fault": "the planner is gone"}}
    failed = {"outcome": Outcome.STACK_FAILED, "details": details}
    monkeypatch.setattr(KinematicSimulator, "run", lambda *given, **seed: replace(run(*given, **seed), **failed))
    assert main(["run", *ONE, "--out", str(tmp_path / "one")]) == 2
    assert errors[-1].code == "nothing-judged" and "the planner is gone" in str(errors[-1])


@pytest.mark.slow
def test_an_undecided_campaign_says_the_command_that_adds_fresh_runs_to_those_it_made(
    tmp_path: Path, far: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    rvsg("run", far, "--confirmations 3")
    told = re.search(r"More confirmation runs can decide it: .*rvsg (run .*)\n", capsys.readouterr().err)
    assert told is not None
    again = shlex.split(told[1])
    assert again[-4:] == ["--out", str(tmp_path / "one-250"), "--confirmations", "250"]
    rvsg(again, "--jobs 1")
    seeds = []
    for name in ("one", "one-250"):
        with SqliteLedger(tmp_path / name / LEDGER) as ledger:
            attempts = ledger.attempts(ledger.campaigns()[0])
            confirmation = next(a for a in attempts if a.purpose == "confirmation")
            assert confirmation.verdict is not None
            assert confirmation.verdict.status is (Status.INCONCLUSIVE if name == "one" else Status.FAIL)
        seeds.append([measured.seed for measured in confirmation.measurements])
    assert seeds[1][:3] == seeds[0] and len(seeds[1]) == 15


def test_a_simulator_that_fails_says_that_what_there_is_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made: list[int] = []
    run = KinematicSimulator.run

    def failing(self, scenario, world, *, seed):
        made.append(seed)
        if len(made) > 5:
            raise SimulationError("the display is gone")
        return run(self, scenario, world, seed=seed)

    monkeypatch.setattr(KinematicSimulator, "run", failing)
    before = signal.getsignal(signal.SIGTERM)
    assert main(["run", *SMALL, "--out", str(tmp_path / "one")]) == 2
    told = capsys.readouterr().err
    assert "the display is gone" in told and f"Resume with: rvsg run --out {tmp_path / 'one'}" in told
    assert signal.getsignal(signal.SIGTERM) is before
    monkeypatch.setattr(KinematicSimulator, "run", run)
    assert main(["run", "--out", str(tmp_path / "one")]) == 0
    with SqliteLedger(tmp_path / "one" / LEDGER) as ledger:
        search = [a for a in ledger.attempts(ledger.campaigns()[0]) if a.purpose == "search"]
    assert [len(a.measurements) for a in search] == [2, 2, 1, 2, 2, 2]
    assert [failure.reason for a in search for failure in a.failures] == ["the display is gone"]


@pytest.mark.exhaustive
def test_a_campaign_with_files_of_its_own_goes_on_in_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(SHIPPED / "warehouse", tmp_path / "mine")
    (tmp_path / "sub" / "elsewhere").mkdir(parents=True)
    (tmp_path / "sub" / "rules.yaml").write_text(
        "near: {title: Near, text: Keep away., metric: dto, worse: smaller, limit: 1.0, unit: m}\n"
    )
    (tmp_path / "sub" / "c.yaml").write_text("world: ../mine\nrequirement: rules.yaml#near\nout: res\n")
    monkeypatch.chdir(tmp_path)
    rvsg("run sub/c.yaml", SMALL)
    whole = records(tmp_path / "sub" / "res")
    monkeypatch.chdir(tmp_path / "sub" / "elsewhere")
    out = tmp_path / "sub" / "res"
    rvsg("run --out", out)
    rvsg("run --world ../../mine --out", out)  # the same world in other words
    rvsg("report", out)
    rvsg("run ../res/campaign.yaml --jobs 1 --out again")
    rvsg("scenario prompt", out, code=2)  # the search is finished
    shutil.copytree(tmp_path / "mine", "other")
    rvsg("run --world other --out", out, code=2)
    assert records(out) == whole
