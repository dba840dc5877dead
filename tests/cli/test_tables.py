import io

import pytest
from rich.console import Console
from tests.campaign.parts import MemoryLedger
from tests.report.test_page import answer, campaign

from rvsg.cli import tables
from rvsg.cli.tables import MAP_LINES, MOST_ROWS, map_text, matrix_table, rows_table, show_answer
from rvsg.report.result import CampaignAnswer, Elsewhere
from rvsg.runs.attempt import Plan
from rvsg.world.world_folder import load_world

Answered = tuple[Plan, CampaignAnswer]


@pytest.fixture(scope="module")
def found() -> tuple[Plan, CampaignAnswer]:
    ledger = MemoryLedger()
    the_plan, attempts = campaign(ledger)
    return the_plan, answer(
        the_plan, attempts, ledger, stack="nav2-dwb", commands=lambda _: {"planner": "rvsg replay X --trace"}
    )


def on_paper(table: object, width: int = 80) -> str:
    paper = io.StringIO()
    Console(file=paper, width=width).print(table)
    return paper.getvalue()


@pytest.mark.parametrize("width", [78, 80, 100])
def test_several_campaigns_with_long_names_and_values_fit_a_terminal(found: Answered, width: int) -> None:
    the_plan, told = found
    route = the_plan.mission.route.replace(name="from_the_loading_dock")
    requirement = the_plan.requirement.replace(name="keeps_its_distance", unit="m/s^3")
    long = the_plan.replace(mission=the_plan.mission.replace(route=route), requirement=requirement)
    first = told.rows[0].replace(
        name="Oncoming ahead of the robot at Large Shelf 4, it stops: Human 1", measured="mean 15.2 s"
    )
    first = first.replace(contact="12/15", contacts=12, share="14/15", status="INCONCLUSIVE")
    told = told.replace(rows=(first,), status="INCONCLUSIVE")
    lines = on_paper(matrix_table([(long, told), (the_plan, told)]), width).splitlines()
    assert all(len(line) <= width for line in lines)
    assert lines[1].split()[:5] == ["campaign", "verdict", "violated", "measured", "contact"]
    assert all(each in "".join(lines) for each in (told.status, first.share, first.measured, first.contact))
    assert len(lines) <= 2 * 12 and "Human 1" in "".join(lines) and "…" not in "".join(lines)
    empty = told.replace(rows=(), status="no result")
    assert "no result" in on_paper(matrix_table([(the_plan, empty)]), width)


def test_contact_in_other_configurations_is_marked_in_the_table_of_campaigns(
    found: Answered,
) -> None:
    the_plan, told = found
    other = told.replace(elsewhere=Elsewhere(text="Contact", number="2.1", attempt=3, runs=("run-a",)))
    lines = on_paper(matrix_table([(the_plan, other)])).splitlines()
    assert f"{told.rows[0].contact}‡" in "".join(lines) and lines[-1].startswith("‡ contact in other")
    assert "‡" not in on_paper(matrix_table([found]))


@pytest.mark.parametrize("width", [80, 100, 160])
@pytest.mark.parametrize("headline", ["It stops.", "It stops at Area 3 and is walked into by Human 1. " * 5])
def test_the_answer_takes_at_most_23_lines_with_every_number_whole(
    found: Answered,
    headline: str,
    width: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    first = found[1].rows[0]
    long = first.replace(number="17.125", share="142/145", contact="119/145", contacts=119, status="INCONCLUSIVE")
    long = long.replace(cause="Human 1, Human 2, Human 3", caused="without Human 1: 0/10")
    elsewhere = Elsewhere(text="Contact in 26 of 354 other runs; most: 19.8, 3/15." * 2, number="", attempt=1, runs=())
    told = found[1].replace(
        headline=headline, rows=(long,) * 15, elsewhere=elsewhere, rest="18 more scenarios were not violated."
    )
    monkeypatch.setattr(tables, "console", lambda: Console(width=width))
    monkeypatch.setenv("COLUMNS", str(width))
    show_answer(told, page="runs/first/report.html", again="rvsg run --seed 0")
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) <= 23
    rows = [line for line in lines if line.startswith("17.125")]
    assert len(rows) == MOST_ROWS or len(lines) == 23
    assert all(long.share in row and long.contact in row for row in rows)
    assert all(len(line) <= width for line in rows)
    assert lines[-3:] == [
        "  open      runs/first/report.html", "  next      rvsg replay X --trace --run " + first.run,
        "  again     rvsg run --seed 0",
    ]  # fmt: skip


def test_the_causes_stand_in_a_wide_table_alone(found: Answered) -> None:
    rows = [found[1].rows[0].replace(cause="Human 7")]
    assert "Human 7" in on_paper(rows_table(rows, 120), 120)
    assert "cause" not in on_paper(rows_table(rows, 80), 80)


@pytest.mark.parametrize("name", ["warehouse", "office", "hospital"])
@pytest.mark.parametrize("width", [72, 20])
def test_the_map_fits_and_shows_walls_start_and_goal_where_they_are(name: str, width: int) -> None:
    world = load_world(name)
    route = world.routes[0]
    lines = map_text(world, route, width).splitlines()
    assert 2 < len(lines) <= MAP_LINES and max(map(len, lines)) <= width
    assert [sum(line.count(letter) for line in lines) for letter in "SG"] == [1, 1]
    (start, row), (goal, other) = ((line.index(c), k) for c in "SG" for k, line in enumerate(lines) if c in line)
    for before, after, low, high in (
        (start, goal, route.start.x, route.goal.x),
        (other, row, route.start.y, route.goal.y),
    ):
        assert before == after or (before < after) is (low < high)
    assert lines[0][0] not in " \u2800" and lines[-1][-1] not in " \u2800", "the walls around"
