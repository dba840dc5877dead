"""Several stacks on the same scenarios and seeds: shares, paired differences, ranking, page."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.cli.commands import Terminal

import rvsg
from rvsg.app.comparison import compare_stacks, write_comparison
from rvsg.core.errors import InputError, NothingJudged
from rvsg.evaluation.verdict import judge
from rvsg.report.comparison_page import comparison_page, ranking_rows
from rvsg.scenario.requirement import Requirement
from rvsg.suites.suite import CaseResult, SuiteResult, compare, state_of

LIMIT = Requirement(name="X", title="x", text="x", metric="min_distance", worse="smaller", limit=0.5)


def score(label: str, flags: dict[str, list[bool | None]]) -> SuiteResult:
    cases = []
    for case, row in flags.items():
        known = [flag for flag in row if flag is not None]
        verdict = judge(LIMIT, [0.0 if flag else 1.0 for flag in known])
        cases.append(
            CaseResult(
                case=case,
                title=case,
                requirement="X",
                expected="pass",
                state=state_of("pass", verdict),
                verdict=verdict,
                seeds=tuple(range(len(row))),
                violations=tuple(row),
            )
        )
    return SuiteResult(suite="here", version=label, simulator="embedded", cases=tuple(cases))


def test_the_ranking_and_the_paired_differences() -> None:
    worse = score("worse", {"a": [True] * 10, "b": [True] * 10})
    better = score("better", {"a": [False] * 10, "b": [True] * 10})
    partly = score("partly", {"a": [None] * 10, "b": [True] * 10})
    found = compare([worse, better, partly], ranked=True)
    assert [each.version for each in found.variants] == ["better", "partly", "worse"]
    never, late = (each.replace(cases=(each.cases[0].replace(arrived=n),)) for each, n in ((better, 0), (worse, 3)))
    assert [each.version for each in compare([never, late], ranked=True).variants] == ["worse", "better"]
    assert (better.violated, better.judged, better.share) == (10, 20, 0.5)
    assert better.interval[0] < 0.5 < better.interval[1] and partly.judged == 10
    pairs = {(pair.first, pair.second): pair.difference for pair in found.pairs}
    clear = pairs["better", "worse"]
    assert clear is not None and clear.difference == -0.5 and clear.is_clear and clear.paired and clear.runs == (20, 20)
    equal = pairs["better", "partly"]
    assert equal is not None and equal.difference == 0.0 and equal.runs == (10, 10)
    page = comparison_page(found)
    assert all(f">{name}</th>" in page for name in ("better", "partly", "worse")) and "<script" not in page


def test_a_stack_without_a_judged_run_has_no_rank_and_is_named() -> None:
    crashed, driven = score("crashed", {"a": [None] * 12}), score("driven", {"a": [True] * 12})
    found = compare([crashed, driven], ranked=True)
    assert [each.version for each in found.variants] == ["driven", "crashed"]
    assert [row[0] for row in ranking_rows(found)] == ["1", "not judged"]
    with pytest.raises(NothingJudged, match="crashed"):
        crashed.check_judged()


def test_what_cannot_be_compared_is_one_error(terminal: Terminal, tmp_path: Path) -> None:
    two = ["nav2-rpp", "nav2-dwb"]
    for folder, stacks in ((tmp_path, []), (tmp_path, [two[0]] * 2), (tmp_path, two), (tmp_path / "missing", two)):
        with pytest.raises(InputError):
            compare_stacks(folder, stacks)
    terminal("stacks --stack nav2-dwb", code=2)
    terminal("stacks .", code=2)


@pytest.mark.slow
def test_a_suite_against_two_stacks(terminal: Terminal) -> None:
    scenario = rvsg.scenario(rvsg.load_world("warehouse"), "route_1", people=[])
    rvsg.Suite.create("suite").add(scenario, "R3", name="alone", expected="pass")
    told = terminal.json("stacks suite --stack nav2-rpp --stack nav2-dwb --runs 2 --out out")
    assert {each["version"] for each in told["variants"]} == {"nav2-rpp", "nav2-dwb"}
    assert all(len(each["cases"][0]["seeds"]) == 2 for each in told["variants"])
    again = compare_stacks("suite", ["nav2-rpp", "nav2-dwb"], runs=2)
    assert again.model_dump(mode="json") == told
    page = write_comparison(again, "suite", "again")[0]
    assert page.read_text() == Path("out/index.html").read_text()
    assert "nav2-rpp" in page.read_text() and "<script" not in page.read_text()
