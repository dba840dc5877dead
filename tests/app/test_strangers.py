"""A folder of a stranger: no verb and no job runs anything of it, and no key goes to its server."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.app.parts import crossing, suite_of
from tests.generation.loopback import fails, serving

import rvsg
from rvsg.findings.ranking import candidates, search_attempts
from rvsg.scenario.builder import save_scenario
from rvsg_exchange.formats import export

KEY = "sk-of-the-user-42424242"
PROGRAM = Path(sys.executable).with_name("rvsg")
POISON = (
    *("json", "typing", "re", "types", "functools", "sitecustomize", "usercustomize", "yaml", "numpy", "numba"),
    *("dask", "distributed", "cloudpickle", "pydantic", "rvsg_studio", "rvsg_exchange", "tests"),
)
CONFIGS = ("disable_jit: 1", "[1, 2]", "{1: 2}", "text", "opt: fast", "cache_dir: /nowhere", "a: [", "\x00", "debug: 1")
pytest.importorskip("rosbags")


@pytest.fixture(scope="module")
def _folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clone")
    (folder / "strict.yaml").write_text(
        "far: {title: Far, text: Keep 100 m., metric: dto, worse: smaller, limit: 100.0, unit: m, source: a test}\n"
    )
    few = {"scenarios": 1, "refinements": 2, "repeats": 3, "confirmations": 0, "simulator": "kinematic", "jobs": 1}
    campaign = rvsg.Campaign.create(folder / "first", requirement=f"{folder / 'strict.yaml'}#far", **few)
    list(campaign.run())
    suite_of(folder / "suite")
    save_scenario(crossing(), folder / "scenario.json")
    (folder / "field" / "route_1").mkdir(parents=True)
    drive = rvsg.simulate(crossing(ends=("B12", "E12")), 1, simulator="kinematic")
    export(drive, folder / "field" / "route_1" / "drive.mcap", "mcap")
    return folder


@pytest.fixture
def folder(_folder: Path, tmp_path: Path) -> Path:
    """A folder with a campaign, a suite, a scenario, a recording, and modules that shadow those which RVSG imports."""
    folder = Path(shutil.copytree(_folder, tmp_path / "clone"))
    for name in POISON:
        code = f"open({str(tmp_path / 'ran')!r}, 'a').write(__file__ + '\\n')\n"
        (folder / f"{name}.py").write_text(code)
        (folder / name).mkdir()
        for module in ("__init__", "worker"):
            (folder / name / f"{module}.py").write_text(code)
    (folder / ".numba_config.yaml").write_text("disable_jit: 1\nopt: fast\n")
    return folder


KINEMATIC = "--simulator kinematic --jobs 2"
VERBS = {
    "run": f"run {KINEMATIC} --scenarios 2 --refinements 0 --repeats 1 --confirmations 0 --out out",
    "simulate": f"simulate scenario.json --repeats 2 {KINEMATIC} --out runs.jsonl",
    "simulate with physics": "simulate scenario.json --repeats 2 --jobs 2 --out runs.jsonl",
    "confirm": "confirm first {candidate} --jobs 2 --runs 2",
    "suite run": f"suite run suite {KINEMATIC} --runs 2",
    "suite compare": "suite compare kinematic kinematic --suite suite --runs 2 --jobs 2",
    "recording": "recording scenario field/route_1/drive.mcap --world warehouse --runs 2 --jobs 2 --out made.json",
    "watch": f"watch suite --monitor field --cycles 1 {KINEMATIC} --out watched",
    "tune": "tune suite --jobs 2 --budget-runs 8 --check-runs 2 --attack-runs 0 --out tuned",
}


def run(words: list[str], folder: Path) -> None:
    """Run a command in a folder; it must end with a result or one message."""
    ended = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=900, check=False)
    assert ended.returncode in (0, 1, 2), ended.stderr
    assert "Usage" not in ended.stderr and "Error [" not in ended.stderr.replace("[nothing-to-tune]", ""), ended.stderr
    assert not (folder.parent / "ran").exists(), (folder.parent / "ran").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("verb", VERBS)
def test_no_file_of_the_current_folder_runs(folder: Path, verb: str) -> None:
    campaign = rvsg.Campaign.open(folder / "first")
    candidate = candidates(search_attempts(campaign.attempts()), campaign.requirement)[0].index
    run([str(PROGRAM), *VERBS[verb].format(candidate=candidate).split()], folder)


@pytest.mark.slow
def test_no_file_of_the_current_folder_runs_for_python_m(folder: Path) -> None:
    for name in ("types", "functools"):  # Python itself imports these before it looks for RVSG
        (folder / f"{name}.py").unlink()
        shutil.rmtree(folder / name)
    run([sys.executable, "-m", "rvsg", *VERBS["simulate"].split()], folder)


@pytest.mark.slow
def test_numba_reads_no_file_of_the_current_folder(tmp_path: Path) -> None:
    code = "from rvsg.core.kernels import numba; print(numba.njit(lambda x: x + 1)(1), numba.config.DISABLE_JIT)"
    for content in CONFIGS:
        (tmp_path / ".numba_config.yaml").write_text(content)
        words = [sys.executable, "-W", "error::UserWarning", "-c", code]
        ended = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert ended.stdout == "2 0\n", (content, ended.stderr)


def jobs_of(folder: Path, asked: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Start jobs of the studio in a folder and return how they ended, by kind."""
    from rvsg_studio.workspace import Jobs

    jobs = Jobs(folder.parent / "jobs", folder)
    ids = {kind: jobs.start(kind, title="", command="", target=kind, **given).id for kind, given in asked.items()}
    for child in [*jobs._children.values()]:
        child.wait(600.0)
    return {kind: jobs.get(job).result for kind, job in ids.items()}


@pytest.mark.slow
def test_no_file_of_the_folder_runs_in_a_job_of_the_studio(folder: Path) -> None:
    pytest.importorskip("nicegui")
    from rvsg_studio.worker import KINDS

    assert set(KINDS) >= {"campaign", "runs", "tuning"}
    runs = {"scenario": "scenario.json", "seed": 0, "repeats": 2, "requirement": "R1", "out": "runs.jsonl"}
    ended = jobs_of(folder, {kind: {} for kind in KINDS} | {"runs": runs})
    assert ended["runs"]["state"] == "finished", ended["runs"]
    assert all(ended.values())
    assert not (folder.parent / "ran").exists(), (folder.parent / "ran").read_text()


@pytest.mark.slow
def test_no_door_sends_a_key_where_only_a_file_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("RVSG_API_KEY", KEY)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    folder = tmp_path / "clone"
    folder.mkdir()
    few = {"generator": "vlm", "model": "openai-chat:x", "scenarios": 1, "repeats": 1, "simulator": "kinematic"}

    def rvsg_(*words: str) -> None:
        subprocess.run([PROGRAM, *words], cwd=folder, env=dict(os.environ), capture_output=True, check=False)

    with serving(fails(401, "no")) as server:
        for number, where in enumerate(({"base_url": server.url}, {"generator_options": {"base_url": server.url}})):
            (folder / f"{number}.yaml").write_text(yaml.safe_dump(few | where))
            rvsg_("run", f"{number}.yaml", "--out", f"out{number}", "--jobs", "1")
            rvsg_("run", "--out", f"out{number}", "--jobs", "1")
        proposed = few | {"seed": 0, "world": "warehouse", "route": "route_1", "requirement": "R1"}
        access = {"model": "openai-chat:x", "base_url": server.url}
        asked = {
            "campaign": {"folder": "out0"},
            "describe": {"world": "office", "start": None, "reasons": [], "access": access},
            "names": {"world": "office", "access": access},
            "propose": {"folder": "proposals", "count": 1, "settings": proposed | access},
        }
        jobs_of(folder, asked)
        assert len(server.headers) >= 6, (len(server.headers), capfd.readouterr())
        assert KEY not in json.dumps(server.headers)
        rvsg_("run", "0.yaml", "--out", "out0", "--jobs", "1", "--allow-key-for", server.url.split("/")[2])
        assert KEY in json.dumps(server.headers.pop())
        jobs_of(folder, {"campaign": {"folder": "out0"}})
        assert KEY in json.dumps(server.headers.pop())
