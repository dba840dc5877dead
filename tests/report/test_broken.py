"""The map of what breaks where, as a table."""

from __future__ import annotations

from rvsg.campaign.feedback import MapCell
from rvsg.report.page import broken
from rvsg.scenario.brief import Encounter


def cell(stretch: str, place: str, kind: str, mean: float) -> MapCell:
    met = Encounter(stretch=stretch, place=place, who="Human 1", kind=kind)
    return MapCell(encounter=met, attempt=1, scenario_id="s", mean=mean, violations=1, runs=2, configurations=1)


def test_a_place_and_a_kind_show_their_worst_cell_on_any_part_of_the_way() -> None:
    worst, other, third = (
        cell("first third", "Shelf 1", "crosses", 0.5),
        cell("last third", "Shelf 1", "crosses", 0.9),
        cell("last third", "Area 2", "stands", 1.0),
    )
    table = broken([worst, other, third])
    assert table.places == ("Shelf 1", "Area 2")
    assert dict(table.rows) == {"crosses": (worst, None), "stands": (None, third)}


def test_nothing_met_is_no_table() -> None:
    assert broken([]).rows == ()
