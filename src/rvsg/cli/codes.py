"""Codes of errors, warnings and findings, read from the source that raises them: `rvsg --explain CODE`.

The documentation site makes a page of each from the same text, so a code cannot be without one.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from rvsg.core.errors import UnknownName

PACKAGES = ("rvsg", "rvsg_exchange", "rvsg_mcp", "rvsg_ros2", "rvsg_studio", "rvsg_study")
CODE = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
PLACE = {"of": 0, "note": 0, "say": 1, "Mistake": 1, "Fault": 1, "_stop": 1, "add": 2, "wrong": 2}
"""Functions that take a code in a place of their own, with the place; elsewhere it is the argument `code`."""


class Source(NamedTuple):
    """A place in the source that reports a code."""

    code: str
    what: str
    """The class of the error and its description; empty for a finding."""
    messages: tuple[str, ...]
    """The parts of the message, with … for each value that is put in."""
    where: str
    why: str
    """What the function that reports it does."""

    @property
    def steps(self) -> list[str]:
        """The sentences of the messages after what is wrong: what was expected, and the next step."""
        sentences = [part for text in self.messages for part in re.split(r"(?<=[.?;]) (?=[A-Z…])", text)]
        return [sentence for sentence in sentences[1:] if not sentence.startswith("Known: ")]


@cache
def sources(only: str = "") -> dict[str, tuple[Source, ...]]:
    """Return the places in installed distributions that report each code, in the order of codes; or those of one."""
    trees = {}
    for package in PACKAGES:
        spec = find_spec(package)
        for folder in map(Path, spec.submodule_search_locations or () if spec else ()):
            for path in sorted(folder.rglob("*.py")):
                text = path.read_text(encoding="utf-8")
                if f'"{only}' in text or path.name in ("errors.py", "documents.py"):  # where most classes of errors are
                    name = ".".join((package, *path.relative_to(folder).with_suffix("").parts))
                    trees[name.removesuffix(".__init__")] = ast.parse(text)
    nodes = (node for tree in trees.values() for node in ast.walk(tree))
    classes = {node.name: _summary(node) for node in nodes if isinstance(node, ast.ClassDef)}
    by_code: dict[str, list[Source]] = {}
    for module, tree in trees.items():
        for source in _sources_in(tree, module, classes):
            if only in ("", source.code):
                by_code.setdefault(source.code, []).append(source)
    return {code: tuple(by_code[code]) for code in sorted(by_code)}


def explanation(code: str) -> str:
    """Return what a code means, as Markdown: what is wrong, its messages, which check reports them, and what to do.

    Raises:
        UnknownName: No message has this code.
    """
    raised = sources(code).get(code)
    if not raised:
        raise UnknownName("code", code, sources())
    parts = [f"# `{code}`", *dict.fromkeys(source.what for source in raised if source.what)]
    for source in raised:
        parts += ["\n".join(f"> {text}  " for text in source.messages)] if source.messages else []
        parts.append(f"Reported by `{source.where}`" + (f": {source.why}" if source.why else "."))
    steps = dict.fromkeys(step for source in raised for step in source.steps)
    parts += ["## What to do", "\n".join(f"- {step}" for step in steps)] if steps else []
    return "\n\n".join(parts) + "\n"


def _sources_in(tree: ast.Module, module: str, classes: dict[str, str]) -> Iterator[Source]:
    """Yield the places of a module that report a code."""
    constants = _texts(tree.body)

    def visit(node: ast.AST, inside: tuple[str, ...], why: str, local: dict[str, list[str]]) -> Iterator[Source]:
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            inside, why = (*inside, node.name), _summary(node) or why
        where = ".".join((module, *inside))
        if isinstance(node, ast.ClassDef):
            for code in _codes(child.value for child in node.body if isinstance(child, ast.Assign) and _is_code(child)):
                yield Source(code, f"`{node.name}`: {_summary(node)}", (), where, "")
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            local = constants | _texts(ast.walk(node))
        elif isinstance(node, ast.Call):
            name = ast.unparse(node.func).rpartition(".")[2]
            place = PLACE.get(name, len(node.args))
            named = [child.value for child in node.keywords if child.arg == "code"] or node.args[place : place + 1]
            for code in _codes(named, local):
                texts = [text for child in node.args if child not in named for text in _text(child, local)]
                what = f"`{name}`: {classes[name]}" if name in classes and name != "Finding" else ""
                yield Source(code, what, tuple(texts), where, why)
        for child in ast.iter_child_nodes(node):
            yield from visit(child, inside, why, local)

    return visit(tree, (), "", constants)


def _is_code(node: ast.Assign) -> bool:
    return [ast.unparse(target) for target in node.targets] == ["code"]


def _codes(nodes: Iterable[ast.expr], local: dict[str, list[str]] | None = None) -> Iterator[str]:
    """Yield the codes among constant values."""
    for text in dict.fromkeys(text for node in nodes for text in _text(node, local or {})):
        if CODE.fullmatch(text):
            yield text


def _texts(statements: Iterable[ast.AST]) -> dict[str, list[str]]:
    """Return the texts that names are set to, by name."""
    by_name: dict[str, list[str]] = {}
    for node in statements:
        if isinstance(node, ast.Assign):
            for target in node.targets:
                pairs = [(target, node.value)]
                if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                    pairs = list(zip(target.elts, node.value.elts, strict=False))
                for name, value in pairs:
                    if isinstance(name, ast.Name):
                        by_name.setdefault(name.id, []).extend(_text(value, {}))
    return by_name


def _text(node: ast.expr, local: dict[str, list[str]]) -> list[str]:
    """Return the texts that an expression may be, with … for each value that is put in."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return [node.value]
    if isinstance(node, ast.JoinedStr):
        return ["".join(str(value.value) if isinstance(value, ast.Constant) else "…" for value in node.values)]
    if isinstance(node, ast.IfExp):
        return [*_text(node.body, local), *_text(node.orelse, local)]
    return local.get(node.id, []) if isinstance(node, ast.Name) else []


def _summary(node: ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) -> str:
    """Return the first line of a docstring."""
    return (ast.get_docstring(node) or "").partition("\n")[0]
