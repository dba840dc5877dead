"""The action and the workflow files in examples/ci do what they say: a shell runs their lines, as a service does."""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml
from tests.app.parts import crossing, suite_of

import rvsg
from rvsg import Spec
from rvsg.search.run_set import load_recordings
from rvsg.suites.suite import SuiteResult

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
ACTION = ROOT / ".github" / "actions" / "rvsg-suite" / "action.yml"
pytestmark = pytest.mark.slow


def github_steps() -> list[tuple[str, str]]:
    """Return the shell steps of the action for GitHub, each with its condition."""
    steps = yaml.safe_load(ACTION.read_text())["runs"]["steps"]
    assert {step["shell"] for step in steps if "run" in step} == {"bash"}
    return [(step["run"], step.get("if", "success()")) for step in steps if "run" in step]


def gitlab_steps() -> list[tuple[str, str]]:
    job = yaml.safe_load((EXAMPLES / "ci" / "gitlab-ci.yml").read_text())["robot"]
    before = [(line, "success()") for line in [*job["before_script"], *job["script"]]]
    return before + [(line, "always()") for line in job["after_script"]]


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A user's repository with a suite of one case that a kinematic robot masters, and one that it fails, as known."""
    suite_of(tmp_path / "suite").add(crossing("route_2", ("E15", "E12")), "R3", name="along", expected="pass")
    bin_ = tmp_path / "bin"
    bin_.mkdir()
    # The install step is run too, by a pip that only notes what it was asked for: the tests have no network.
    (bin_ / "pip").write_text('#!/bin/sh\necho "$@" >> "$PIP_LOG"\n')
    (bin_ / "git").write_text("#!/bin/sh\n")
    for sender in ("gh", "curl"):
        (bin_ / sender).write_text('#!/bin/sh\necho "$@" >> sent.log\n')
    # The kinematic simulator in one process stands in for the embedded one, which would take minutes.
    (bin_ / "rvsg").write_text(
        '#!/bin/sh\ncase "$1 $2 $4 $5" in "suite run --stack nav2_params.yaml") suite=$3; shift 5;\n'
        'set -- suite run "$suite" "$@" --simulator kinematic;; esac\n'
        f'exec "{sys.executable}" -m rvsg "$@"\n'
    )
    for tool in bin_.iterdir():
        tool.chmod(0o755)
    return tmp_path


def run_steps(folder: Path, steps: list[tuple[str, str]], branch: str) -> list[int]:
    """Run steps as the services do: each in a fresh shell that stops at the first error, later ones not after one."""
    environment = {
        **os.environ,
        "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "PIP_LOG": str(folder / "pip.log"),
        "SUITE": "suite",
        "STACK": "nav2_params.yaml",
        "RVSG": str(ROOT),
        "RUNS": "20",
        "JOBS": "1",
        "OPTIONS": "",
        "GITHUB_OUTPUT": str(folder / "output"),
        "GH_TOKEN": "token",
        "PULL_REQUEST": "7",
        "RVSG_TOKEN": "token",
        "CI_MERGE_REQUEST_IID": "7",
        "RVSG_REF": "main",
        "RVSG_REPOSITORY": "https://localhost/rvsg.git",
        "GITHUB_SHA": "abc1234",
        "CI_COMMIT_SHA": "abc1234",
        "GITHUB_STEP_SUMMARY": str(folder / "summary.md"),
        "CI_COMMIT_BRANCH": branch,
        "CI_DEFAULT_BRANCH": "main",
    }
    codes: list[int] = []
    for script, condition in steps:
        wanted = {
            "success()": not any(codes),
            "always()": True,
            "github.ref == 'refs/heads/main'": branch == "main" and not any(codes),
            "always() && github.event_name == 'pull_request' && inputs.comment == 'true'": branch != "main",
        }
        environment["CI_JOB_STATUS"] = "failed" if any(codes) else "success"
        if wanted[condition]:
            shell = ["bash", "-e", "-o", "pipefail", "-c", script]
            codes.append(subprocess.run(shell, cwd=folder, env=environment, timeout=300, check=False).returncode)
    return codes


@pytest.mark.exhaustive
@pytest.mark.parametrize("steps", [github_steps, gitlab_steps])
def test_results_are_kept_and_compared_and_a_broken_case_fails_the_build_with_a_picture(  # type: ignore[no-untyped-def]
    steps, repository: Path
) -> None:
    assert set(run_steps(repository, steps(), "main")) == {0}
    assert f"install -c {ROOT}/constraints.txt " in (repository / "pip.log").read_text()
    result = SuiteResult.from_json((repository / "main.json").read_text())
    assert result.version == "abc1234" and [len(case.seeds) for case in result.cases] == [20, 20]
    suite = ET.parse(repository / "suite.xml").getroot()[0]
    assert (suite.get("tests"), suite.get("failures")) == ("2", "0")
    assert set(run_steps(repository, steps(), "feature")) == {0}
    assert (repository / "comment.md").read_text().count("**unchanged**") == 2
    case = yaml.safe_load((repository / "suite" / "aisle.yaml").read_text())
    case["scenario"]["mission"]["route"]["time_limit_s"] = 2.0  # the new version does not arrive in time
    (repository / "suite" / "aisle.yaml").write_text(yaml.safe_dump(case))
    assert 1 in run_steps(repository, steps(), "feature")
    suite = ET.parse(repository / "suite.xml").getroot()[0]
    assert suite.get("failures") == "1"
    broken = next(each for each in suite if each.get("name") == "aisle")
    assert "[[ATTACHMENT|pictures/aisle-R3.png]]" in (broken.findtext("system-out") or "")
    assert (repository / "pictures" / "aisle-R3.png").stat().st_size > 1000
    assert json.loads((repository / "suite.json").read_text())["cases"][0]["state"] == "broken"
    assert "broken" in (repository / "comment.md").read_text() and (repository / "report.html").is_file()
    assert "comment.md" in (repository / "sent.log").read_text()


def test_the_example_suite_holds_twelve_failures_of_five_routes_that_still_fail() -> None:
    """Few repeats: two violations in two runs are enough for a known failure (see rvsg.evaluation.verdict)."""
    suite = rvsg.Suite.open(EXAMPLES / "suites" / "warehouse")
    assert len(suite.cases) == 12
    assert {case.scenario.mission.route.name for case in suite.cases} == {f"route_{k}" for k in range(1, 6)}
    failures = [e for case in suite.cases for e in case.expectations if e.expected == "violation"]
    assert len(failures) == 12 and len({e.requirement for e in failures}) == 4
    result = suite.run(runs=3)
    known = [case for case in result.cases if case.expected == "violation"]
    assert {case.state.value for case in known} <= {"known failure", "unclear"}
    assert sum(case.state.value == "known failure" for case in known) >= 8
    assert not any(case.state.fails for case in result.cases)


def test_a_robot_in_the_field_leaves_recordings_and_new_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rosbags")
    script = runpy.run_path(str(EXAMPLES / "field_robot.py"))
    before, after = script["parameters"](0.55, 3.0), script["parameters"](1.5, 1.5)
    params = tmp_path / "nav2_params.yaml"
    params.write_text(before)
    clock = iter([0.0, 0.0, 61.0, 121.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    monkeypatch.setitem(script["main"].__globals__, "drive", lambda *asked: drives.append(asked))
    drives: list[tuple[str, int, Spec, Path]] = []
    monkeypatch.setattr(sys, "argv", ["field_robot.py", str(tmp_path), "--minutes", "2", "--params", str(params)])
    script["main"]()
    assert [(route, number) for route, number, *_ in drives] == [("route_1", 0), ("route_2", 1)]
    assert params.read_text() == after != before
    monkeypatch.undo()
    script["drive"]("route_1", 0, Spec(str(params)), tmp_path)
    recorded = [tmp_path / "route_1" / "drive-000.mcap"]
    assert len(load_recordings(recorded, world="warehouse", route="route_1")[0]) == 1
