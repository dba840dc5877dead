"""Plug-ins of installed packages that claim one name."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.coded import coded

from rvsg.cli import main
from rvsg.core import plugins
from rvsg.core.errors import InputError, UnknownName
from rvsg.evaluation.metrics import METRICS


def install(folder: Path, package: str, group: str, name: str, value: str) -> None:
    """Put the metadata of an installed package into a folder."""
    info = folder / f"{package}-1.2.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text(f"[{group}]\n{name} = {value}\n")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


@pytest.mark.parametrize("value", ["acme.stack:Planner", "bolt.stack:Planner"])
@pytest.mark.parametrize("kind", sorted(plugins.KINDS))
def test_two_packages_that_register_one_name_are_both_named(site: Path, kind: str, value: str) -> None:
    install(site, "acme", plugins.KINDS[kind], "twin", "acme.stack:Planner")
    install(site, "bolt", plugins.KINDS[kind], "twin", value)
    with pytest.raises(InputError, check=coded("plug-in-name-taken")) as raised:
        plugins.find(kind, "twin")
    assert "acme 1.2" in str(raised.value) and "bolt 1.2" in str(raised.value)


def test_a_package_that_takes_the_name_of_a_shipped_stack_is_named(
    site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install(site, "acme", "rvsg.stacks", "nav2-rpp", "acme.stack:Planner")
    assert main(["stacks"]) == 2
    said = capsys.readouterr().err
    assert "acme 1.2" in said and "rvsg" in said and "Traceback" not in said


def test_a_name_that_one_package_registers_is_that_packages(site: Path) -> None:
    install(site, "acme", "rvsg.stacks", "mine", "rvsg.simulation.stacks.pure_pursuit:Social")
    assert plugins.find("stack", "mine").name == "social"
    with pytest.raises(UnknownName):
        plugins.find("stack", "min")


def test_a_metric_of_two_packages_names_both(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    value = "rvsg_study.metrics:METRICS"
    install(site, "acme", "rvsg.metrics", "extra", value)
    monkeypatch.setattr(METRICS, "_all", None)
    with pytest.raises(InputError, check=coded("plug-in-name-taken")) as raised:
        list(METRICS)
    assert "acme 1.2" in str(raised.value) and "rvsg-study 0" in str(raised.value)


def test_an_error_of_a_plug_in_is_laid_to_its_package(site: Path) -> None:
    (site / "acme_walks.py").write_text("class Walks:\n    def __init__(self):\n        {}['no such key']\n")
    install(site, "acme", "rvsg.generators", "walks", "acme_walks:Walks")
    with pytest.raises(KeyError) as raised:
        plugins.make("generator", "walks", {})
    package = plugins.at_fault(raised.value)
    assert package is not None and "acme 1.2" in package
    with pytest.raises(ValueError, match="expected") as ours:
        plugins.find("generator", "heuristic")(tries=0)
    assert plugins.at_fault(ours.value) is None
