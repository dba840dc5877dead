"""No module imports itself through others, also not inside of a function."""

import tomllib
from graphlib import TopologicalSorter

import grimp
from tests.architecture.size import ROOT


def test_no_module_imports_itself_through_others() -> None:
    packages = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["root_packages"]
    graph = grimp.build_graph(*packages, cache_dir=None)
    TopologicalSorter({name: graph.find_modules_directly_imported_by(name) for name in graph.modules}).prepare()
