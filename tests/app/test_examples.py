"""The examples and the how-to page do what they show."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
PAGE = ROOT / "docs" / "how-to" / "use-rvsg-from-python.md"


def executed(blocks: list[str]) -> dict[str, Any]:
    """Execute code blocks one after the other, as a notebook does."""
    names: dict[str, Any] = {"__name__": "example"}
    for block in blocks:
        exec(compile(block, "example", "exec"), names)
    return names


def test_the_notebook_runs() -> None:
    notebook = json.loads((EXAMPLES / "rvsg_in_a_notebook.ipynb").read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    names = executed(["".join(cell["source"]) for cell in cells])
    assert names["campaign"].finished and len(names["runs"]) == 6


def test_the_how_to_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    names = executed(blocks)
    assert len(blocks) == 2 and names["campaign"].finished
    assert (tmp_path / "runs" / "from-python" / "report.html").exists()


@pytest.mark.slow
def test_the_script_judges_twenty_runs_on_two_cores(capsys: pytest.CaptureFixture[str]) -> None:
    source = (EXAMPLES / "judge_one_scenario.py").read_text(encoding="utf-8")
    assert len(source.splitlines()) <= 25
    verdict = executed([source])["main"]("kinematic")
    assert verdict.verdict.runs == 20 and verdict.requirement.name == "R1"
    assert capsys.readouterr().out.startswith("R1 ")
