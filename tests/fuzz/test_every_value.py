"""Every value of an input, one after the other, replaced by one that is out of range or of another kind."""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.fuzz.harness import kind_of, received

VALUES = (1e308, -1e308, 1e12, -1e12, -1, 0, 1e6, 1e-308, 10**19, float("nan"), None, [], {}, "a" * 5000, True)
QUICK = ("requirement",)
KINDS = (*QUICK, "campaign", "map", "scenario", "robot", "runs", "objects", "world")
Key = tuple[str | int, ...]


def places(value: Any, at: Key = ()) -> Iterator[Key]:
    """Yield the path to every value; of a long list the first, the middle and the last."""
    if at:
        yield at
    if isinstance(value, dict):
        for name, each in value.items():
            yield from places(each, (*at, name))
    elif isinstance(value, list):
        for index in sorted({0, len(value) // 2, len(value) - 1} if value else ()):
            yield from places(value[index], (*at, index))


def replaced(document: Any, at: Key, value: object) -> Any:
    """Return a copy of the document with another value at this place."""
    whole = copy.deepcopy(document)
    around = whole
    for key in at[:-1]:
        around = around[key]
    around[at[-1]] = value
    return whole


@pytest.mark.parametrize("name", [pytest.param(n, marks=() if n in QUICK else pytest.mark.exhaustive) for n in KINDS])
def test_a_value_out_of_range_is_received(name: str, tmp_path: Path) -> None:
    kind = kind_of(name)
    findings = []
    for file in kind.write(tmp_path / "whole"):
        if file.suffix not in (".yaml", ".json", ".jsonl"):
            continue
        document = yaml.safe_load(file.read_text()) if file.suffix == ".yaml" else json.loads(file.read_text())
        for at in places(document):
            for value in VALUES:
                folder = tmp_path / "damaged"
                shutil.copytree(tmp_path / "whole", folder)
                text = yaml.safe_dump if file.suffix == ".yaml" else json.dumps
                (folder / file.name).write_text(text(replaced(document, at, value)) + "\n")
                outcome = received(kind, folder)
                if outcome.finding:
                    findings.append(f"{at} {str(value)[:20]}: {outcome.finding.strip().splitlines()[-1]}")
                shutil.rmtree(folder)
    assert not findings, findings[:10]
