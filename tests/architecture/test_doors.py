"""The doors hold no rules: a verb of the command line is short and calls the front door."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import rvsg

CLI = Path(rvsg.__file__).parent / "cli"
LONGEST = 30


def verbs() -> Iterator[tuple[str, ast.FunctionDef]]:
    for path in sorted(CLI.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and any("command" in ast.unparse(d) for d in node.decorator_list):
                yield f"{path.name}: {node.name}", node


def lines_of(node: ast.FunctionDef) -> int:
    first = node.body[1] if ast.get_docstring(node) is not None else node.body[0]
    return (node.end_lineno or 0) - first.lineno + 1


def test_a_verb_is_at_most_thirty_lines() -> None:
    found = {name: lines_of(node) for name, node in verbs()}
    assert len(found) > 25
    assert {name: lines for name, lines in found.items() if lines > LONGEST} == {}


def test_a_verb_refuses_nothing_itself() -> None:
    raised = {
        name: ast.unparse(each.exc)
        for name, node in verbs()
        for each in ast.walk(node)
        if isinstance(each, ast.Raise) and each.exc is not None
    }
    ends = ("typer.Exit", "Interrupted")  # the exit code, and how to resume
    assert {name: what for name, what in raised.items() if not what.startswith(ends)} == {}
