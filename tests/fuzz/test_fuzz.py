"""A few damaged inputs of every kind; `make fuzz MINUTES=10` tries many."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.fuzz.harness import case, kind_of, received, run_case
from tests.fuzz.kinds import KINDS

QUICK = ("answer", "option", "robot", "map", "scenario")
"""Kinds of which a case takes a tenth of a second."""
FOUND = [
    *(("answer", 10), ("answer", 18), ("study", 28), ("runs", 67)),
]
"""Kinds and seeds that once were findings."""
EVERY_KIND = pytest.mark.parametrize(
    "name", [pytest.param(k.name, marks=() if k.name in QUICK else pytest.mark.exhaustive) for k in KINDS]
)


@EVERY_KIND
def test_the_whole_example_is_accepted(name: str, tmp_path: Path) -> None:
    kind_of(name).write(tmp_path)
    outcome = received(kind_of(name), tmp_path)
    assert (outcome.code, outcome.finding) == (0, ""), outcome.messages


@EVERY_KIND
def test_damaged_inputs_are_received(name: str) -> None:
    for seed in range(1000, 1006):
        outcome = run_case(name, seed)
        assert not outcome.finding, f"{name} {seed}: {outcome.finding}"


@pytest.mark.parametrize(("name", "seed"), FOUND)
def test_what_was_once_a_finding_is_none(name: str, seed: int) -> None:
    assert not run_case(name, seed).finding


def test_the_damage_follows_from_the_seed(tmp_path: Path) -> None:
    for folder in ("a", "b", "c"):
        (tmp_path / folder).mkdir()
        case(kind_of("robot"), 7 if folder != "c" else 8, tmp_path / folder)
    one, other, third = ((tmp_path / folder / "r.yaml").read_bytes() for folder in ("a", "b", "c"))
    assert one == other != third
