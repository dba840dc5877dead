import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from tests.campaign.parts import MemoryLedger
from tests.report.test_page import campaign

from rvsg.campaign.attempt import Plan
from rvsg.cli.tables import matrix_table, ranked_table, without_common_beginning
from rvsg.evaluation.verdict import Status
from rvsg.report.summary import Summary, summarise


@pytest.fixture(scope="module")
def found() -> tuple[Plan, Summary]:
    the_plan, attempts = campaign(MemoryLedger())
    return the_plan, summarise(the_plan, attempts)


def drawn(*cells: tuple[Plan, Summary], width: int) -> list[str]:
    return on_paper(matrix_table(cells), width).splitlines()


def on_paper(table: object, width: int = 80) -> str:
    paper = io.StringIO()
    Console(file=paper, width=width).print(table)
    return paper.getvalue()


@pytest.mark.parametrize("width", [78, 80, 100])
def test_several_campaigns_with_long_names_and_values_fit_a_terminal(found: tuple[Plan, Summary], width: int) -> None:
    the_plan, summary = found
    route = the_plan.mission.route.replace(name="from_the_loading_dock")
    requirement = the_plan.requirement.replace(name="keeps_its_distance", unit="m/s^3")
    long = the_plan.replace(mission=the_plan.mission.replace(route=route), requirement=requirement)
    lines = drawn((long, summary.replace(confirmed=None)), found, width=width)
    assert all(len(line) <= width for line in lines)
    assert lines[1].split() == ["campaign", "worst", "[95", "%]", "verdict", "violated"]
    assert "…" not in "".join(lines)
    assert sum("*" in line for line in lines) == 2  # the one that is not confirmed, and what that means
    assert lines[-1].startswith("* ")


def test_a_violation_of_which_fail_or_flaky_is_open_is_marked(found: tuple[Plan, Summary]) -> None:
    the_plan, summary = found
    assert summary.confirmed and summary.confirmed.verdict
    verdict = summary.confirmed.verdict.replace(status=Status.INCONCLUSIVE, violations=8, runs=8)
    shown = summary.replace(confirmed=summary.confirmed.replace(verdict=verdict))
    lines = drawn((the_plan, shown), width=80)
    assert "INCONCLUSIVE†" in "".join(lines)
    assert lines[-1].rstrip() == "† violated; FAIL or FLAKY is still open."
    assert not {"†", "*"} & set("".join(drawn(found, width=80)))  # confirmed: it needs no remark


def test_a_long_objective_takes_its_room_from_the_description_and_not_from_the_rank(
    found: tuple[Plan, Summary],
) -> None:
    the_plan, summary = found
    values = {"mean": -0.7461, "interval": (-0.7841, -0.7071), "status": Status.INCONCLUSIVE}
    values |= {"violations": 2, "runs": 2}
    ranking = tuple(
        entry.replace(verdict=entry.verdict.replace(**values), description=f"{entry.scenario} {'pick goods ' * 9}")
        for entry in summary.ranking
    )
    text = on_paper(ranked_table(the_plan, summary.replace(ranking=ranking), width=80))
    lines = text.splitlines()
    assert all(len(line) <= 80 for line in lines) and "verdict, violated runs" in text
    row = next(line for line in lines if line.split()[:1] == ["1"])
    assert "-0.746 [-0.784, -0.707] m" in row and "INCONCLUSIVE† 2/2" in row


def test_a_table_says_how_many_scenarios_it_leaves_out(found: tuple[Plan, Summary]) -> None:
    the_plan, summary = found
    ranking = tuple(summary.ranking[0].replace(rank=k + 1) for k in range(13))
    ten, all_ = (on_paper(ranked_table(the_plan, summary.replace(ranking=ranking), rows=rows)) for rows in (10, 13))
    assert "3 more scenarios in the report" in ten and "more scenario" not in all_


def test_words_that_all_begin_with_are_left_away() -> None:
    assert without_common_beginning(["the work: pick a", "the work: pack"]) == ["pick a", "pack"]
    assert without_common_beginning(["same", "same"]) == ["same", "same"]
    assert without_common_beginning(["alone"]) == ["alone"]
    assert without_common_beginning([]) == []


@given(st.lists(st.text(alphabet="ab ", min_size=1), max_size=5))
def test_what_is_left_is_the_end_of_each_text(texts: list[str]) -> None:
    left = without_common_beginning(texts)
    assert all(text.endswith(end) for text, end in zip(texts, left, strict=True))
    assert len({len(text) - len(end) for text, end in zip(texts, left, strict=True)}) <= 1
