from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence

import pytest
from markupsafe import escape
from tests.campaign.parts import MemoryLedger, warehouse
from tests.report.test_page import NastyGenerator, Reader, campaign, default_campaign, result_of

from rvsg.evaluation.verdict import Status, judge
from rvsg.report.overview import Pin, Reported, pins_of, render_overview
from rvsg.report.page import render_page
from rvsg.report.renderer import unbroken
from rvsg.report.result import Result
from rvsg.runs.attempt import Attempt
from rvsg.world.drawing.sheet import known_window
from rvsg.world.world_folder import load_world


def reported(link: str = "route_1-R1/report.html", status: Status | None = None, **changes: object) -> Reported:
    ledger = MemoryLedger()
    the_plan, attempts = campaign(ledger, **changes) if changes else default_campaign()[:2]
    ledger = ledger if changes else default_campaign()[2]
    if status is not None:
        attempts = [
            a.replace(verdict=a.verdict.replace(status=status)) if a.purpose == "confirmation" and a.verdict else a
            for a in attempts
        ]
    return link, result_of(the_plan, attempts, ledger)


def page(*each: Reported, missing: int = 0) -> str:
    return render_overview(each, command="rvsg run --seed 7", missing=missing)


def test_the_overview_is_whole_and_leads_to_the_reports_beside_it_alone() -> None:
    text = page(reported(), reported("Gang_Süd-R 1/report.html"))
    reader = Reader.of(text)
    assert reader.open == []
    assert set(reader.refers) == {"route_1-R1/report.html", "Gang_S%C3%BCd-R%201/report.html"}
    assert "//" not in text and "script" not in reader.tags
    assert "2 campaigns in warehouse" in text and "rvsg run --seed 7" in text
    assert page(reported()) == page(reported()), "equal campaigns give equal overviews"
    link, result = reported()
    assert "stack nav2-rpp (mine.yaml)" in page((link, dataclasses.replace(result, stack="nav2-rpp (mine.yaml)")))

    assert not {"script", "img"} & set(Reader.of(page(reported(generator=NastyGenerator()))).tags)


def test_a_campaign_is_told_by_its_fresh_runs_with_the_limit_they_are_judged_by() -> None:
    link, result = reported()
    text, told = page((link, result)), result.answer
    assert unbroken(told.rows[0].measured) in text and told.rows[0].share in text
    assert "at least 1\N{NO-BREAK SPACE}m" in text and "12 + 5" in text
    assert escape(told.headline.split(".")[0]) in text.replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.parametrize(
    ("violated", "tones", "said"),
    [
        (("yes", "no"), ("bad", "good"), "Of 2 campaigns: 1 violated; 1 not violated."),
        (("no", "no"), ("good", "good"), "Of 2 campaigns: 2 not violated."),
        (("no", "no"), ("good", "warn"), "Of 2 campaigns: 1 not violated, but with contact; 1 not violated."),
        (("no", "no limit"), ("good", "quiet"), "Of 2 campaigns: 1 without a limit; 1 not violated."),
    ],
)
def test_the_headline_counts_what_fresh_runs_decided(
    violated: tuple[str, ...], tones: tuple[str, ...], said: str
) -> None:
    link, result = reported()
    results = [dataclasses.replace(result) for _ in violated]
    for copy, is_violated, tone in zip(results, violated, tones, strict=True):
        vars(copy)["answer"] = result.answer.replace(violated=is_violated, tone=tone)
    text = page(*((link, copy) for copy in results))
    assert said in text and ('class="chip good"' in text) == ("good" in tones)


def test_what_is_not_finished_or_has_not_begun_is_told() -> None:
    the_plan, attempts, ledger = default_campaign()
    parts = [(name, result_of(the_plan, made, ledger)) for name, made in (("a", attempts[:2]), ("b", []))]
    text = page(*parts, missing=3)
    assert ">nothing found<" in text and ">no result<" in text and "3 more not begun" in text
    assert "Of 2 campaigns: 2 open." in text


def test_the_matrix_has_a_cell_for_each_route_and_requirement() -> None:
    link, result = reported()
    plan, told = result.plan, result.answer
    other = plan.replace(requirement=plan.requirement.replace(name="R9"))
    elsewhere = plan.replace(mission=plan.mission.replace(route=warehouse().route("route_2")))
    found = [(link, plan), ("b.html", other), ("c.html", elsewhere)]
    text = page(*((place, dataclasses.replace(result, plan=each)) for place, each in found), missing=1)
    table = text[text.index('class="matrix"') : text.index("</table>")]
    assert table.count('class="cell') == 3 and table.count("not begun") == 1
    assert (f"contact {told.rows[0].contact}" in table) == (told.rows[0].contacts > 0)


def test_campaigns_of_one_pair_share_a_cell_and_worlds_are_named_where_they_differ() -> None:
    link, result = reported()
    plan = result.plan
    office = plan.replace(mission=plan.mission.replace(world="office"))
    text = page(
        *((place, dataclasses.replace(result, plan=each)) for place, each in ((link, plan), ("b", plan), ("c", office)))
    )
    table = text[text.index('class="matrix"') : text.index("</table>")]
    assert table.count('class="cell') == 3 and table.count('scope="row"') == 2
    assert "3 campaigns in warehouse and office" in text and "warehouse, route_1" in table
    assert ">office, route_1</a>" in text and ">office, route_1</a>" not in table, "in the list of campaigns"


def test_every_finding_has_a_pin_where_it_happens_and_a_row_that_opens_it() -> None:
    the_plan, attempts, ledger = default_campaign()
    confirmation = next(a for a in attempts if a.purpose == "confirmation")
    bad = confirmation.replace(verdict=judge(the_plan.requirement, [0.1] * 15))

    def pinned(confirmed: Attempt) -> tuple[Result, Sequence[Pin]]:
        quiet = tuple(m.replace(values=m.values | {"contacts": 0.0}) for m in confirmed.measurements)
        changed = [confirmed.replace(measurements=quiet) if a is confirmation else a for a in attempts]
        result = result_of(the_plan, changed, ledger)
        return result, pins_of("a/report.html", result)

    result, (pin,) = pinned(bad)
    x0, y0, x1, y1 = known_window(warehouse())
    assert x0 < pin.x < x1 and y0 < pin.y < y1
    assert pin.row.run in {measured.run_id for measured in bad.measurements} and f"#run={pin.row.run}&" in pin.address
    assert (pin.row.status, pin.row.share) == ("FAIL", "15/15")
    told = render_page(result, command="rvsg run")
    assert pin.row.place and told.count(f"at {pin.row.place}, it") > 1 and pin.row.name in told
    shown = [("a/report.html", result)]
    other = dataclasses.replace(pin, x=pin.x + 1.0)
    text = render_overview(shown, command="rvsg run", pins=[pin, other])
    assert text.count('class="pin"') == 2
    assert text.count(f'href="{escape(pin.address)}"') == 4, "on the map and in the table"
    elsewhere = dataclasses.replace(other, world=load_world("office"))
    both = render_overview(shown, command="rvsg run", pins=[pin, elsewhere])
    assert both.count('<figure id="map-') == 2 and both.count('class="pin"') == 2
    assert re.findall(r">(\d)</text></g></a>", both) == ["1", "2"], "numbered as in the table"
    assert pinned(confirmation.replace(verdict=judge(the_plan.requirement, [2.0] * 15)))[1] == []
