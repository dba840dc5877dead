"""Size of the code: `make size` prints lines, files and record types by package beside the budget.

Comment, docstring and blank lines count. `budget.toml` holds the limits and the reasons for exceptions.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from collections import Counter
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
BUDGET = tomllib.loads((Path(__file__).parent / "budget.toml").read_text())
RECORD_BASES = {"Record", "NamedTuple", "BaseModel", "TypedDict"}


class Size(NamedTuple):
    """Counts of a file or a package."""

    lines: int = 0
    code: int = 0
    files: int = 0
    records: int = 0


def sources() -> list[Path]:
    """Return every Python file of every distribution."""
    return sorted([*ROOT.glob("src/**/*.py"), *ROOT.glob("packages/*/src/**/*.py")])


def package_of(path: Path) -> str:
    """Return the package of a file as the budget names it: `world`, `simulation/stacks`, `rvsg_studio`, ..."""
    parts = path.relative_to(ROOT).parts
    if parts[0] == "packages":
        return parts[3]
    inside = parts[2:-1]
    nested = "/".join(inside[:2])
    return nested if nested in BUDGET["packages"] else inside[0] if inside else "rvsg"


def size_of(path: Path) -> Size:
    """Return the counts of one file."""
    text = path.read_text(encoding="utf-8")
    nodes = list(ast.walk(ast.parse(text)))
    prose = {
        line
        for node in nodes
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    lines = [line.strip() for line in text.splitlines()]
    code = sum(bool(line) and line[0] != "#" and number not in prose for number, line in enumerate(lines, 1))
    return Size(len(lines), code, 1, sum(isinstance(node, ast.ClassDef) and _is_record(node) for node in nodes))


def _is_record(node: ast.ClassDef) -> bool:
    """Whether a class holds data: a record, a dataclass or a named tuple."""
    bases, decorators = (
        {ast.unparse(each).split("(")[0].split("[")[0].split(".")[-1] for each in found}
        for found in (node.bases, node.decorator_list)
    )
    return bool(bases & RECORD_BASES) or "dataclass" in decorators


def total(sizes: list[Size]) -> Size:
    """Return the sum of counts."""
    return Size(*map(sum, zip(*sizes, strict=True)))


def sizes() -> dict[str, Size]:
    """Return the counts by package."""
    found: dict[str, list[Size]] = {}
    for path in sources():
        found.setdefault(package_of(path), []).append(size_of(path))
    return {name: total(each) for name, each in found.items()}


def lines_of_tests() -> int:
    """Return the lines of all tests."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in ROOT.glob("tests/**/*.py"))


def words_of_docs() -> int:
    """Return the words of all Markdown pages for users."""
    pages = [*ROOT.glob("docs/**/*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    return sum(len(page.read_text(encoding="utf-8").split()) for page in pages)


def excesses() -> list[str]:
    """Return what is over budget, one line each."""
    found, limits = sizes(), BUDGET["total"]
    whole = total(list(found.values()))
    spine = [path for pattern in BUDGET["spine"]["files"] for path in ROOT.glob(pattern)]
    checked = {
        "lines of all distributions": (whole.lines, limits["lines"]),
        "files of all distributions": (whole.files, limits["files"]),
        "record types of all distributions": (whole.records, limits["records"]),
        "words of docs": (words_of_docs(), limits["words"]),
        "lines of the spine": (sum(size_of(path).lines for path in spine), limits["spine"]),
        "lines of tests": (lines_of_tests(), limits["tests"]),
    }
    checked |= {f"lines of {name}": (size.lines, BUDGET["packages"].get(name, 0)) for name, size in found.items()}
    return [f"{what}: {count}, budget {limit}" for what, (count, limit) in checked.items() if count > limit]


def same_names() -> dict[str, int]:
    """Return file names that stand in more than one package, with how many.

    A verb of the command line and a page of the studio are named after what they open, so they do not count.
    """
    counted = Counter(
        path.name
        for path in sources()
        if not path.name.startswith(("__", "verb")) and path.parent.name not in ("cli", "pages")
    )
    return {name: count for name, count in counted.items() if count > 1}


def main() -> int:
    """Print the table, then what is over budget."""
    found = sizes()
    print(f"{'package':24}{'lines':>8}{'code':>8}{'files':>7}{'records':>9}{'budget':>9}")
    for name, size in [*sorted(found.items()), ("all", total(list(found.values())))]:
        budget = BUDGET["total"]["lines"] if name == "all" else BUDGET["packages"].get(name, 0)
        print(f"{name:24}{size.lines:8}{size.code:8}{size.files:7}{size.records:9}{budget:9}")
    print(f"tests {lines_of_tests()} lines, docs {words_of_docs()} words")
    over = excesses()
    print(*over, sep="\n")
    return bool(over)


if __name__ == "__main__":
    sys.exit(main())
