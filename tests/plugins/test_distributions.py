"""The built distributions: what is in them, and that they work where there is no checkout."""

from __future__ import annotations

import os
import shutil
import site
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

import rvsg

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
PROJECTS = [ROOT, *sorted((ROOT / "packages").iterdir())]
MOST_BYTES = 3_000_000
"""Of the core's wheel."""


def test_all_distributions_have_the_version_of_the_core() -> None:
    versions = {tomllib.loads((path / "pyproject.toml").read_text())["project"]["version"] for path in PROJECTS}
    assert versions == {rvsg.__version__}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    for project in PROJECTS:
        command = [sys.executable, "-m", "hatchling", "build", "-d", str(folder)]
        subprocess.run(command, cwd=project, check=True, capture_output=True)
    return folder


@pytest.mark.slow
def test_they_hold_the_product_and_nothing_else(built: Path) -> None:
    wheels = sorted(built.glob("*.whl"))
    assert len(wheels) == len(list(built.glob("*.tar.gz"))) == len(PROJECTS)
    for wheel in wheels:
        with zipfile.ZipFile(wheel) as archive:
            names = [name for name in archive.namelist() if ".dist-info/" not in name]
        package = wheel.name.partition("-")[0]
        assert {name.partition("/")[0] for name in names} == {package}
        sources = {str(path.relative_to(ROOT)) for path in ROOT.glob(f"**/src/{package}/**/*.py")}
        assert {name for name in names if name.endswith(".py")} - {"rvsg_ros2/rvsg_client.py"} == {
            name.partition("src/")[2] for name in sources
        }
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *wheels], check=True, capture_output=True)
    (core,) = built.glob("rvsg-*.whl")
    assert core.stat().st_size < MOST_BYTES
    with tarfile.open(next(built.glob("rvsg-*.tar.gz"))) as source:
        assert {name.split("/")[1] for name in source.getnames()} <= {
            "src", "pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff", "PKG-INFO", ".gitignore",
        }  # fmt: skip


@pytest.mark.slow
def test_a_second_build_is_the_same_bit_for_bit(built: Path, tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-d", str(tmp_path)], cwd=ROOT, check=True)
    made = sorted(tmp_path.iterdir())
    assert len(made) == 2
    assert [path.read_bytes() for path in made] == [(built / path.name).read_bytes() for path in made]


@pytest.mark.slow
def test_the_wheels_work_in_a_fresh_environment_and_an_empty_folder(built: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "venv", with_pip=True)
    binaries = tmp_path / "venv" / "bin"
    packages = next((tmp_path / "venv" / "lib").glob("*/site-packages"))
    # Dependencies only: files of paths in a folder that is named so are not read, nor what is editable there.
    (packages / "dependencies.pth").write_text("\n".join(site.getsitepackages()))
    wheels = map(str, built.glob("*.whl"))
    subprocess.run([binaries / "pip", "install", "-q", "--no-deps", *wheels], check=True, capture_output=True)
    folder = tmp_path / "empty"
    folder.mkdir()
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "PYTEST"))}

    def done(*words: str | Path) -> str:
        command = [binaries / words[0], *words[1:]]
        ran = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        assert ran.returncode == 0, f"{words}: {ran.stdout}{ran.stderr}"
        return ran.stdout

    assert str(packages) in done("python", "-c", "import rvsg; print(rvsg.__file__)")
    done("rvsg", "run", "--simulator", "kinematic", "--scenarios", "1", "--confirmations", "5", "--out", "first")
    assert (folder / "first" / "report.html").is_file()
    done("rvsg", "demo", "--out", "demo")
    assert (folder / "demo" / "report.html").is_file()
    assert done("rvsg", "--explain", "out-occupied").startswith("# `out-occupied`")
    planner = shutil.copy(EXAMPLES / "stacks" / "follow_the_plan.py", folder)
    done(
        "rvsg", "simulate", EXAMPLES / "three_people.json", "--stack", f"{planner}:FollowThePlan", "--out", "own.jsonl"
    )
    shutil.copytree(ROOT / "src" / "rvsg" / "world" / "worlds" / "office", folder / "objects")
    done("rvsg", "world", "new", "mine", "--objects", "objects/objects.yaml", "--no-simulation")
    done("rvsg", "world", "check", "mine", "--no-simulation")
    done("rvsg", "studio", "--help")
    collected = done("python", "-m", "pytest", "--rvsg-suite", EXAMPLES / "suites" / "warehouse", "--collect-only")
    assert "route_1-r1-R1" in collected
