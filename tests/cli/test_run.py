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
from tests.cli.commands import Terminal, rvsg, words_of
from tests.coded import coded

from rvsg.app.campaign import Campaign
from rvsg.app.folder import LEDGER, alone_in
from rvsg.core.errors import InputError, SimulationError
from rvsg.core.files import make_folder
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
ONE = words_of(SMALL, "--scenarios 1 --refinements 0")
LONG = words_of(SMALL, "--scenarios 8 --repeats 3 --seed 7")


@pytest.fixture(scope="module")
def _finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished") / "one"
    rvsg("run", SMALL, "--seed 7 --out", folder)
    return folder


@pytest.fixture
def finished(_finished: Path, tmp_path: Path) -> Path:
    """A copy of a finished campaign with seed 7, in the folder `one`."""
    return Path(shutil.copytree(_finished, tmp_path / "one"))


def attempts_of(folder: Path) -> list[Any]:
    """The attempts that a campaign keeps."""
    with SqliteLedger.existing(folder / LEDGER) as ledger:
        return list(ledger.attempts(ledger.campaigns()[0]))


def records(folder: Path) -> list[str]:
    """Everything a campaign keeps: its attempts and its runs, as text."""
    attempts = attempts_of(folder)
    with SqliteLedger.existing(folder / LEDGER) as ledger:
        runs = [ledger.run(m.run_id).trajectory.x.tobytes().hex() for a in attempts for m in a.measurements]
    return [attempt.to_json() for attempt in attempts] + runs


def test_a_campaign_leaves_its_files_and_prints_json_with_the_command_that_repeats_it(
    terminal: Terminal, finished: Path
) -> None:
    told = terminal.json("run", SMALL, "--seed 7 --out two --junit junit.xml")
    left = {path.name for path in Path("two").iterdir()}
    assert {"ledger.sqlite", "report.html", "best_scenario.json", "campaign.yaml"} <= left
    assert not [name for name in left if name.endswith(("-wal", "-shm"))]
    assert len(ET.parse("junit.xml").getroot()[0]) == 6
    assert told["complete"] and len(told["ranking"]) == 6
    assert told["accounting"]["search_runs"] == 12
    assert told["confirmed"][0]["verdict"]["runs"] == 4
    command = told["command"].split()
    assert command[:2] == ["rvsg", "run"] and command[-2:] == ["--seed", "7"]
    terminal(command[1:], "--out three")
    assert terminal.out == ""
    terminal("run one/campaign.yaml --out four")
    assert records(finished) == records(Path("two")) == records(Path("three")) == records(Path("four"))


@pytest.mark.slow
def test_two_jobs_end_with_the_records_of_one(terminal: Terminal, finished: Path) -> None:
    terminal("run", SMALL, "--seed 7 --out two --jobs 2")
    assert records(finished) == records(Path("two"))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The records of an uninterrupted campaign."""
    folder = tmp_path_factory.mktemp("whole")
    rvsg("run", LONG, "--out", folder)
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
    rvsg("run --out", folder)
    assert records(folder) == whole


def test_resuming_with_other_settings_is_refused_and_names_them(terminal: Terminal, finished: Path) -> None:
    before = records(finished)
    error = terminal.refused("run --out one --seed 8")
    assert (error.code, error.keys) == ("other-settings", ("seed",))
    assert records(finished) == before


def change_settings(change: Callable[[dict[str, Any]], object], *, kept: int) -> None:
    """Change the stored settings of the campaign in `one`, and keep its first attempts only."""
    with contextlib.closing(sqlite3.connect(Path("one") / LEDGER)) as connection:
        (text,) = connection.execute("SELECT settings FROM campaigns").fetchone()
        settings = json.loads(text)
        change(settings)
        connection.execute("UPDATE campaigns SET settings = ?", (json.dumps(settings),))
        connection.execute("DELETE FROM attempts WHERE position >= ?", (kept,))
        connection.commit()


def reworded(**changes: object) -> None:
    """As if the requirement had been other when the campaign was begun."""
    change_settings(lambda of: of["plan"]["requirement"].update(changes), kept=4)


def test_a_campaign_from_before_a_setting_was_added_is_resumed(terminal: Terminal, finished: Path) -> None:
    before = records(finished)
    change_settings(lambda of: (of["plan"].pop("memory"), of["config"].pop("memory")), kept=6)
    terminal("run --out one")
    assert records(finished) == before


def test_a_campaign_whose_requirement_is_worded_otherwise_today_is_resumed_in_its_words(terminal: Terminal) -> None:
    terminal("run", SMALL, "--strategy study --out one")
    verdicts = [attempt.verdict for attempt in attempts_of(Path("one"))]
    reworded(text="Mind the people.", title="Keep off")
    assert "(title, text)" in terminal("run --out one")
    resumed = attempts_of(Path("one"))
    assert [attempt.verdict for attempt in resumed] == verdicts
    assert {attempt.brief.requirement.text for attempt in resumed[4:6]} == {"Mind the people."}


@pytest.mark.usefixtures("finished")
def test_a_campaign_is_not_resumed_with_another_version_of_a_plug_in(terminal: Terminal) -> None:
    change_settings(lambda of: of.update(plugins={"strategy": "mine 1.0 mine+0"}), kept=4)
    error = terminal.refused("run --out one")
    assert (error.code, error.keys) == ("other-settings", ("plugins",))
    with pytest.raises(InputError, check=coded("other-settings")):
        Campaign.open("one", "warehouse-route_1-R1-random-random-7").prepare()


@pytest.mark.usefixtures("finished")
@pytest.mark.parametrize("change", [{"limit": 1.3}, {"metric": "min_distance"}, {"worse": "larger"}])
def test_a_campaign_whose_requirement_judges_otherwise_today_is_refused(
    terminal: Terminal, change: dict[str, object]
) -> None:
    reworded(**change)
    error = terminal.refused("run --out one")
    assert (error.code, error.keys) == ("other-settings", (f"plan.requirement.{next(iter(change))}",))


@pytest.mark.usefixtures("finished")
def test_a_campaign_that_never_got_to_an_attempt_is_not_told_to_have_zero(terminal: Terminal) -> None:
    change_settings(lambda of: None, kept=0)
    assert "0 attempts" not in terminal("run --out one")


def test_two_processes_do_not_share_a_folder(terminal: Terminal) -> None:
    make_folder(Path("one"))
    with alone_in(Path("one")):
        assert terminal.refused("run", SMALL, "--out one").code == "out-in-use"
    assert not (Path("one") / LEDGER).exists()


@pytest.fixture
def far(terminal: Terminal) -> list[str]:
    """Options of a small campaign in `one` whose requirement every run violates."""
    Path("strict.yaml").write_text(
        "far: {title: Far, text: Keep 100 m., metric: dto, worse: smaller, limit: 100.0, unit: m, source: a test}\n"
    )
    return [*ONE, "--requirement", "strict.yaml#far", "--out", "one"]


def test_a_violation_is_told_by_the_exit_code_only_where_asked(terminal: Terminal, far: list[str]) -> None:
    terminal("run", far, "--confirmations 16")
    terminal("run", far, "--confirmations 16 --fail-on-violation", code=1)
    terminal("report one --fail-on-violation", code=1)


def test_a_violation_in_few_fresh_runs_fails_the_build_though_fail_or_flaky_is_open(
    terminal: Terminal, far: list[str]
) -> None:
    said = terminal("run", far, "--confirmations 8 --fail-on-violation --junit junit.xml", code=1)
    assert "8/8 runs violate far; how often is open" in " ".join(said.split())
    assert '<failure message="VIOLATED (FAIL or FLAKY is still open)' in Path("junit.xml").read_text()
    page = Path("one/report.html").read_text()
    assert '<span class="chip bad">VIOLATED</span>' in page
    assert "8/8 runs violate far; how often is open" in page


@pytest.fixture
def refusing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every proposal of the generator `random` is refused."""
    problem = Finding(rule="unreadable", reason="The answer is no configuration.")
    refused = Proposal(generator="random", scenario=None, problems=(problem,))
    monkeypatch.setattr(RandomGenerator, "propose", lambda self, brief, world: refused)


@pytest.mark.usefixtures("refusing")
@pytest.mark.parametrize("several", ["", "--requirement R1 --requirement R3"])
def test_a_campaign_without_a_valid_scenario_is_no_success(terminal: Terminal, several: str) -> None:
    error = terminal.refused("run", SMALL, "--generator random --out one", several)
    assert error.code == "nothing-judged" and "The answer is no configuration." in str(error)
    assert Path("one/report.html").exists()
    terminal("report one")
    terminal("report one --fail-on-violation", code=2)


def test_a_campaign_whose_stack_failed_in_every_run_is_no_success(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, details = KinematicSimulator.run, {"stack": {"fault": "the planner is gone"}}
    failed = {"outcome": Outcome.STACK_FAILED, "details": details}
    monkeypatch.setattr(KinematicSimulator, "run", lambda *given, **seed: replace(run(*given, **seed), **failed))
    error = terminal.refused("run", ONE, "--out one")
    assert error.code == "never-arrives" and "the planner is gone" in str(error)


@pytest.mark.slow
def test_an_undecided_campaign_says_the_command_that_adds_fresh_runs_to_those_it_made(
    terminal: Terminal, far: list[str]
) -> None:
    said = terminal("run", far, "--confirmations 3")
    told = re.search(r"next +rvsg (run .*)\n", said)
    assert told is not None
    again = shlex.split(told[1])
    assert again[-4:] == ["--out", "one-250", "--confirmations", "250"]
    terminal(again, "--jobs 1")
    seeds = []
    for name, status in (("one", Status.INCONCLUSIVE), ("one-250", Status.FAIL)):
        confirmation = next(a for a in attempts_of(Path(name)) if a.purpose == "confirmation")
        assert confirmation.verdict.status is status
        seeds.append([measured.seed for measured in confirmation.measurements])
    assert seeds[1][:3] == seeds[0] and len(seeds[1]) == 15


def test_a_simulator_that_fails_says_that_what_there_is_is_kept(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []
    run = KinematicSimulator.run

    def failing(self, scenario, world, *, seed):
        made.append(seed)
        if len(made) > 3 + 5:  # the robot drives alone first
            raise SimulationError("the display is gone")
        return run(self, scenario, world, seed=seed)

    monkeypatch.setattr(KinematicSimulator, "run", failing)
    before = signal.getsignal(signal.SIGTERM)
    told = terminal("run", SMALL, "--out one", code=2)
    assert "the display is gone" in told and "Resume with: rvsg run --out one" in told
    assert signal.getsignal(signal.SIGTERM) is before
    monkeypatch.setattr(KinematicSimulator, "run", run)
    terminal("run --out one")
    search = [a for a in attempts_of(Path("one")) if a.purpose == "search"]
    assert [len(a.measurements) for a in search] == [2, 2, 1, 2, 2, 2]
    assert [failure.reason for a in search for failure in a.failures] == ["the display is gone"]


@pytest.mark.exhaustive
def test_a_campaign_with_files_of_its_own_goes_on_in_any_folder(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(SHIPPED / "warehouse", "mine")
    Path("sub/elsewhere").mkdir(parents=True)
    Path("sub/rules.yaml").write_text(
        "near: {title: Near, text: Keep away., metric: dto, worse: smaller, limit: 1.0, unit: m}\n"
    )
    Path("sub/c.yaml").write_text("world: ../mine\nrequirement: rules.yaml#near\nout: res\n")
    terminal("run sub/c.yaml", SMALL)
    whole = records(Path("sub/res"))
    monkeypatch.chdir("sub/elsewhere")
    terminal("run --out ../res")
    terminal("run --world ../../mine --out ../res")  # the same world in other words
    terminal("report ../res")
    terminal("run ../res/campaign.yaml --jobs 1 --out again")
    terminal("scenario prompt ../res", code=2)  # the search is finished
    shutil.copytree("../../mine", "other")
    terminal("run --world other --out ../res", code=2)
    assert records(Path("../res")) == whole
