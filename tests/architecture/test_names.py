"""Names that say what they stand for, in the rooms that are named so."""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.architecture.size import ROOT, sources

VAGUE = {"found", "each", "known", "made", "given", "told", "kept"}
ROOMS = ("src/rvsg/report", "src/rvsg/cli", "packages/rvsg-studio")
PATHS = [path for path in sources() if str(path.relative_to(ROOT)).startswith(ROOMS)]


def bound_in(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield every name that a module binds to a value or calls a parameter, with its line."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name) | ast.MatchAs(name=str(name)):
                yield name, node.lineno
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield name, node.lineno


@pytest.mark.parametrize("path", PATHS, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_value_has_a_name_that_says_nothing(path: Path) -> None:
    names = bound_in(ast.parse(path.read_text()))
    assert [f"{path.name}:{line} {name}" for name, line in names if name in VAGUE] == []


def test_no_class_shares_its_name_with_another() -> None:
    classes = {path: [n.name for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ClassDef)]
               for path in sources()}  # fmt: skip
    counts = Counter(name for names in classes.values() for name in names)
    assert [name for path in PATHS for name in classes[path] if counts[name] > 1] == []
