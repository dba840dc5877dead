from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence

import pytest
from markupsafe import escape
from tests.campaign.parts import MemoryLedger, warehouse
from tests.report.test_page import NastyGenerator, Reader, campaign, default_campaign

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.findings import findings
from rvsg.evaluation.run_events import place_name
from rvsg.evaluation.verdict import Status, judge
from rvsg.report.overview import Pin, Reported, pins_of, render_overview
from rvsg.report.page import render_page
from rvsg.report.summary import summarise
from rvsg.world.drawing.sheet import known_window
from rvsg.world.world_folder import load_world


def reported(link: str = "route_1-R1/report.html", status: Status | None = None, **changes: object) -> Reported:
    the_plan, attempts = campaign(MemoryLedger(), **changes) if changes else default_campaign()[:2]
    summary = summarise(the_plan, attempts)
    if status and summary.confirmed and summary.confirmed.verdict:
        verdict = summary.confirmed.verdict.replace(status=status)
        summary = summary.replace(confirmed=summary.confirmed.replace(verdict=verdict))
    return link, the_plan, summary


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

    assert not {"script", "img"} & set(Reader.of(page(reported(generator=NastyGenerator()))).tags)


def test_a_campaign_is_told_by_its_fresh_runs_with_the_limit_they_are_judged_by() -> None:
    link, the_plan, summary = reported()
    assert summary.confirmed and summary.confirmed.verdict and summary.confirmed.verdict.interval
    text = page((link, the_plan, summary))
    low, high = summary.confirmed.verdict.interval
    assert f"[{low:.3g}, {high:.3g}] m" in text
    assert "≥ 1\N{NO-BREAK SPACE}m" in text and "12 + 5" in text


@pytest.mark.parametrize(
    ("statuses", "said"),
    [
        ((Status.FAIL, Status.PASS), "In 1 of 2 campaigns the worst scenario found violates its requirement."),
        ((Status.FLAKY, Status.INCONCLUSIVE), "In 1 of 2 campaigns the worst scenario found violates its"),
        ((Status.PASS, Status.PASS), "In 2 campaigns no worst scenario found violates its requirement."),
        ((Status.PASS, Status.UNJUDGED), "1 of 2 campaigns passed; no other is decided."),
    ],
)
def test_the_headline_counts_what_fresh_runs_decided(statuses: tuple[Status, ...], said: str) -> None:
    assert said in page(*(reported(status=status) for status in statuses))


def test_a_violation_of_which_fail_or_flaky_is_open_is_counted_and_coloured_as_one() -> None:
    link, the_plan, summary = reported(status=Status.INCONCLUSIVE)
    assert summary.confirmed and summary.confirmed.verdict
    verdict = summary.confirmed.verdict.replace(violations=8, runs=8)
    text = page((link, the_plan, summary.replace(confirmed=summary.confirmed.replace(verdict=verdict))))
    assert "In 1 of 1 campaign the worst scenario found violates its requirement." in text
    assert (text.count('<span class="chip bad"'), text.count('class="cell bad"')) == (2, 1)
    assert "FAIL or FLAKY is still open (INCONCLUSIVE)" in text


def test_what_is_not_finished_or_has_not_begun_is_told() -> None:
    the_plan, attempts, _ = default_campaign()
    text = page(("a", the_plan, summarise(the_plan, attempts[:2])), ("b", the_plan, summarise(the_plan, [])), missing=3)
    assert ">not confirmed<" in text and ">no result<" in text and "3 more not begun" in text
    assert "0 of 2 campaigns passed" in text


def test_the_matrix_has_a_cell_for_each_route_and_requirement() -> None:
    link, plan, summary = reported()
    other = plan.replace(requirement=plan.requirement.replace(name="R9"))
    elsewhere = plan.replace(mission=plan.mission.replace(route=warehouse().route("route_2")))
    text = page((link, plan, summary), ("b.html", other, summary), ("c.html", elsewhere, summary), missing=1)
    table = text[text.index('class="matrix"') : text.index("</table>")]
    assert table.count('class="cell') == 3 and table.count("not begun") == 1
    contacts = sum(run.values.get("contacts", 0) > 0 for run in summary.confirmed.measurements)
    assert ("contact " in table) == (contacts > 0)


def test_campaigns_of_one_pair_share_a_cell_and_worlds_are_named_where_they_differ() -> None:
    link, plan, summary = reported()
    office = plan.replace(mission=plan.mission.replace(world="office"))
    text = page((link, plan, summary), ("b.html", plan, summary), ("c.html", office, summary))
    table = text[text.index('class="matrix"') : text.index("</table>")]
    assert table.count('class="cell') == 3 and table.count('scope="row"') == 2
    assert "3 campaigns in warehouse and office" in text and "warehouse, route_1" in table
    assert ">office, route_1, R" in text and ">office, route_1, R" not in table, "in the list of campaigns"


def test_every_finding_has_a_pin_where_it_happens_and_a_row_that_opens_it() -> None:
    the_plan, attempts, ledger = default_campaign()
    confirmation = next(a for a in attempts if a.purpose == "confirmation")
    bad = confirmation.replace(verdict=judge(the_plan.requirement, [0.1] * 15))

    def pinned(confirmed: Attempt) -> tuple[list[Attempt], Sequence[Pin]]:
        changed = [confirmed if a is confirmation else a for a in attempts]
        found = findings(the_plan, changed, run_of=ledger.run, world=warehouse())
        return changed, pins_of("a/report.html", the_plan, changed, found, warehouse(), ledger.run)

    changed, (pin,) = pinned(bad)
    x0, y0, x1, y1 = known_window(warehouse())
    assert x0 < pin.x < x1 and y0 < pin.y < y1
    runs = {measured.run_id for measured in bad.measurements}
    assert pin.address.startswith("#run=") and pin.address[5:].split("&")[0] in runs
    assert (pin.row["chip"], pin.row["violated"]) == ("FAIL", "15 of 15")
    assert pin.row["where"] == place_name(warehouse(), pin.x, pin.y)
    told = render_page(the_plan, changed, world=warehouse(), run_of=ledger.run, command="rvsg run")
    near = re.findall(r"near (Area \d)", told)
    assert near and set(near) <= {area.name for area in warehouse().areas}
    shown = [("a/report.html", the_plan, summarise(the_plan, changed))]
    other = dataclasses.replace(pin, address="#run=x&t=1.0", x=pin.x + 1.0)
    text = render_overview(shown, command="rvsg run", pins=[pin, other])
    assert text.count('class="pin"') == 2
    for each in (pin, other):
        assert text.count(f'href="a/report.html{escape(each.address)}"') == 2, "on the map and in the table"
    elsewhere = dataclasses.replace(other, world=load_world("office"))
    both = render_overview(shown, command="rvsg run", pins=[pin, elsewhere])
    assert both.count('<figure id="map-') == 2 and both.count('class="pin"') == 2
    assert re.findall(r">(\d)</text></g></a>", both) == ["1", "2"], "numbered as in the table"
    assert pinned(confirmation.replace(verdict=judge(the_plan.requirement, [2.0] * 15)))[1] == []
