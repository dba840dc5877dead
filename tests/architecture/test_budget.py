"""The size of the code stays within its budget, and its files keep to a few rules of form."""

from __future__ import annotations

import ast

from tests.architecture.size import BUDGET, ROOT, excesses, same_names, sources


def test_nothing_is_over_budget() -> None:
    assert excesses() == []


def test_no_further_file_name_stands_in_two_packages() -> None:
    assert set(same_names()) <= set(BUDGET["names"]["shared"])


def test_the_product_imports_no_mock() -> None:
    found = {
        str(path.relative_to(ROOT))
        for path in sources()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module is not None and node.module.startswith("unittest")
    }
    assert found == set()
