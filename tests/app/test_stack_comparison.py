"""Several stacks on the same scenarios and seeds: shares, paired differences, ranking, page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import rvsg
from rvsg.app.comparison import compare_stacks, write_comparison
from rvsg.campaign.suite import ScoredRun, StackScore, score_stacks
from rvsg.cli import main
from rvsg.core.errors import InputError


def score(label: str, flags: dict[str, list[bool | None]], failed: int = 0) -> StackScore:
    runs = tuple(
        ScoredRun(case=case, seed=seed, violated=flag, outcome="REACHED", contact=False)
        for case, row in flags.items()
        for seed, flag in enumerate(row)
    )
    return StackScore(label=label, name=label, version="1", runs=runs, failed=failed)


def test_the_ranking_and_the_paired_differences() -> None:
    worse = score("worse", {"a": [True] * 10, "b": [True] * 10})
    better = score("better", {"a": [False] * 10, "b": [True] * 10})
    partly = score("partly", {"a": [None] * 10, "b": [True] * 10})
    found = score_stacks("here", ["a", "b"], 10, [worse, better, partly])
    assert [each.label for each in found.scores] == ["better", "partly", "worse"]
    assert (better.violated, better.judged, better.share) == (10, 20, 0.5)
    assert better.interval[0] < 0.5 < better.interval[1] and partly.judged == 10
    pairs = {(pair.first, pair.second): pair.difference for pair in found.pairs}
    clear = pairs["better", "worse"]
    assert clear is not None and clear.difference == -0.5 and clear.is_clear and clear.paired and clear.runs == (20, 20)
    equal = pairs["better", "partly"]
    assert equal is not None and equal.difference == 0.0 and equal.runs == (10, 10)


def test_what_cannot_be_compared_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        compare_stacks(tmp_path, [])
    with pytest.raises(InputError):
        compare_stacks(tmp_path, ["nav2-rpp", "nav2-rpp"])
    with pytest.raises(InputError):
        compare_stacks(tmp_path, ["nav2-rpp", "nav2-dwb"])
    with pytest.raises(InputError):
        compare_stacks(tmp_path / "missing", ["nav2-rpp", "nav2-dwb"])
    assert main(["stacks", "--stack", "nav2-dwb"]) == 2
    assert main(["stacks", str(tmp_path)]) == 2


@pytest.mark.slow
def test_a_suite_against_two_stacks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = rvsg.load_world("warehouse")
    scenario = rvsg.scenario(place, "route_1", people=[])
    rvsg.Suite.create(tmp_path / "suite").add(scenario, "R1", name="alone", expected="pass")
    assert main([
        "stacks", str(tmp_path / "suite"), "--stack", "nav2-rpp", "--stack", "nav2-dwb", "--runs", "2",
        "--out", str(tmp_path / "out"), "--json",
    ]) == 0  # fmt: skip
    told = json.loads(capsys.readouterr().out)
    assert {each["label"] for each in told["scores"]} == {"nav2-rpp", "nav2-dwb"}
    assert all(len(each["runs"]) == 2 for each in told["scores"])
    again = compare_stacks(tmp_path / "suite", ["nav2-rpp", "nav2-dwb"], runs=2)
    assert again.model_dump(mode="json") == told
    page = write_comparison(again, tmp_path / "suite", tmp_path / "again")[0]
    assert page.read_text() == (tmp_path / "out" / "index.html").read_text()
    assert "nav2-rpp" in page.read_text() and "<script" not in page.read_text()
