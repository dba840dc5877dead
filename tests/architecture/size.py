"""Size of the code: `make size` prints lines, files and record types by package beside the budget.

Comment, docstring and blank lines count. `budget.toml` holds the limits and the reasons for exceptions.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
BUDGET = tomllib.loads((Path(__file__).parent / "budget.toml").read_text())
RECORD_BASES = {"Record", "NamedTuple", "BaseModel", "TypedDict"}


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


@dataclass
class Size:
    """Counts of one package."""

    lines: int = 0
    code: int = 0
    files: int = 0
    records: int = 0

    def add(self, other: Size) -> None:
        """Add the counts of another."""
        self.lines += other.lines
        self.code += other.code
        self.files += other.files
        self.records += other.records


def size_of(path: Path) -> Size:
    """Return the counts of one file."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    prose = {line for span in _docstrings(tree) for line in span}
    lines = text.splitlines()
    code = sum(
        bool(line.strip()) and not line.strip().startswith("#") and number not in prose
        for number, line in enumerate(lines, 1)
    )
    return Size(len(lines), code, 1, len(_records(tree)))


def _docstrings(tree: ast.AST) -> Iterator[range]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield range(node.lineno, (node.end_lineno or node.lineno) + 1)


def _records(tree: ast.AST) -> list[str]:
    """Return the names of the classes that hold data: records, dataclasses and named tuples."""
    return [
        node.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        and (
            any(_last_name(base) in RECORD_BASES for base in node.bases)
            or any(_last_name(each) == "dataclass" for each in node.decorator_list)
        )
    ]


def _last_name(node: ast.expr) -> str:
    node = node.func if isinstance(node, ast.Call) else node
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def sizes() -> dict[str, Size]:
    """Return the counts by package."""
    found: dict[str, Size] = {}
    for path in sources():
        found.setdefault(package_of(path), Size()).add(size_of(path))
    return found


def total(found: dict[str, Size]) -> Size:
    """Return the sum over all packages."""
    whole = Size()
    for size in found.values():
        whole.add(size)
    return whole


def words_of_docs() -> int:
    """Return the words of all Markdown pages for users."""
    pages = [*ROOT.glob("docs/**/*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    return sum(len(page.read_text(encoding="utf-8").split()) for page in pages if page.exists())


def excesses() -> list[str]:
    """Return what is over budget, one line each."""
    found = sizes()
    whole = total(found)
    limits = BUDGET["total"]
    checked = {
        "lines of all distributions": (whole.lines, limits["lines"]),
        "files of all distributions": (whole.files, limits["files"]),
        "record types of all distributions": (whole.records, limits["records"]),
        "words of docs": (words_of_docs(), limits["words"]),
        "lines of the spine": (sum(size_of(ROOT / path).lines for path in spine()), limits["spine"]),
        "lines of tests": (lines_of_tests(), limits["tests"]),
    }
    checked |= {f"lines of {name}": (size.lines, BUDGET["packages"].get(name, 0)) for name, size in found.items()}
    return [f"{what}: {count}, budget {limit}" for what, (count, limit) in checked.items() if count > limit]


def spine() -> list[str]:
    """Return the files that docs/explanation/architecture.md leads through."""
    return [
        str(path.relative_to(ROOT))
        for pattern in BUDGET["spine"]["files"]
        for path in sorted(ROOT.glob(pattern))
        if path.suffix == ".py"
    ]


def lines_of_tests() -> int:
    """Return the lines of all tests."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in ROOT.glob("tests/**/*.py"))


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
    for name, size in [*sorted(found.items()), ("all", total(found))]:
        budget = BUDGET["total"]["lines"] if name == "all" else BUDGET["packages"].get(name, 0)
        print(f"{name:24}{size.lines:8}{size.code:8}{size.files:7}{size.records:9}{budget:9}")
    print(f"tests {lines_of_tests()} lines, docs {words_of_docs()} words")
    over = excesses()
    print(*over, sep="\n")
    return bool(over)


if __name__ == "__main__":
    sys.exit(main())
