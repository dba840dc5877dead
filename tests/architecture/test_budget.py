"""The size of the code stays within its budget, and its files keep to a few rules of form."""

from __future__ import annotations

import ast
import subprocess
import sys

import pytest
from tests.architecture.size import ROOT, excesses, same_names, sources

HEAVY = ("numba", "sqlalchemy", "pydantic_ai", "openai", "scipy", "matplotlib", "nicegui")


def test_nothing_is_over_budget() -> None:
    assert excesses() == []


def test_no_file_name_stands_in_two_packages() -> None:
    assert not same_names()


@pytest.mark.parametrize(
    ("packages", "files"),
    [
        (("unittest",), set()),
        (("pydantic_ai", "openai", "genai_prices"), {"src/rvsg/generation/vlm/client.py"}),
    ],
    ids=["mocks", "clients of models"],
)
def test_only_these_files_import(packages: tuple[str, ...], files: set[str]) -> None:
    found = set()
    for path in sources():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if any(name.split(".")[0] in packages for name in names):
                found.add(str(path.relative_to(ROOT)))
    assert found == files


@pytest.mark.parametrize(
    ("code", "unloaded"), [("import rvsg", HEAVY), ("import rvsg; rvsg.Campaign", ("numba",))], ids=["rvsg", "Campaign"]
)
def test_no_backend_is_loaded_before_it_is_needed(code: str, unloaded: tuple[str, ...]) -> None:
    code += f"; import sys; print([m for m in {unloaded!r} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"
