"""A campaign as an object."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from tests.coded import coded

import rvsg
from rvsg.app.campaign import campaigns_in
from rvsg.app.record import CampaignRecord
from rvsg.app.stored_campaign import check_same_route
from rvsg.core.errors import InputError
from rvsg.robots.robot import shipped_robots
from rvsg.scenario import world_lookup
from rvsg.scenario.builder import check_mission, mission_of
from rvsg.search import execution
from rvsg.store.sqlite import SqliteLedger
from rvsg.testing import WalkingGenerator
from rvsg.world.world_folder import SHIPPED, shipped_worlds

SMALL: dict[str, Any] = {"world": "warehouse", "simulator": "kinematic", "strategy": "random", "seed": 7}
SMALL |= {"scenarios": 2, "refinements": 0, "repeats": 2, "confirmations": 4}
ALWAYS = "{title: T, text: Keep away., metric: dto, worse: smaller, limit: 99.0}"


def create(folder: Path, **changes: Any) -> rvsg.Campaign:
    return rvsg.Campaign.create(folder, **SMALL | changes)


@pytest.fixture(scope="module")
def violated(tmp_path_factory: pytest.TempPathFactory) -> rvsg.Campaign:
    folder = tmp_path_factory.mktemp("campaign")
    (folder / "r.yaml").write_text(f"always: {ALWAYS}\n", encoding="utf-8")
    campaign = create(folder / "one", requirement=f"{folder / 'r.yaml'}#always")
    assert [type(event) for event in campaign.run(jobs=1)][-1] is execution.CampaignFinished
    return campaign


def test_events_tell_what_happens_in_order(tmp_path: Path) -> None:
    campaign = create(tmp_path / "one")
    seen = list(campaign.run(jobs=1))
    assert isinstance(seen[0], execution.CampaignStarted) and seen[0].attempts == 0
    kinds = [type(event).__name__ for event in seen]
    assert kinds[1:5] == ["AloneStarted", "RunFinished", "RunFinished", "RunFinished"]
    assert kinds[5:10] == ["ProposalStarted", "RunFinished", "RunFinished", "AttemptFinished", "ProposalStarted"]
    assert "ConfirmationStarted" in kinds and "ExplanationStarted" in kinds
    assert isinstance(seen[-1], execution.CampaignFinished) and seen[-1].complete
    assert campaign.finished and len(campaign.attempts()) == seen[-1].attempts


def test_a_cancelled_campaign_resumes_to_the_same_records(tmp_path: Path) -> None:
    whole = create(tmp_path / "whole")
    list(whole.run(jobs=1))
    campaign = create(tmp_path / "one")
    last = None
    for last in campaign.run(jobs=1):
        if isinstance(last, execution.AttemptFinished):
            campaign.cancel()
    assert isinstance(last, execution.CampaignFinished) and not last.complete
    again = rvsg.Campaign.open(tmp_path / "one")
    list(again.run(jobs=1))
    assert [a.to_json() for a in again.attempts()] == [a.to_json() for a in whole.attempts()]


def test_a_finding_says_how_often_and_whether_it_is_the_people(violated: rvsg.Campaign) -> None:
    first = violated.findings[0]
    assert first.violated and first.verdict.violations == 4
    assert first.without_people is not None
    assert (first.without_people.violated, first.without_people.of) == (0, 4)
    assert first.about_people == "yes" and first.difference == 1.0
    assert {removal.of for removal in first.cause} == {4} and len(first.cause) == 2
    assert first.story and first.contacts.of == 4 and first.arrived.of == 4
    with violated.result() as result:
        told = violated.data(result)
    keys = {"scenario", "verdict", "violation_probability", "interval", "contacts", "arrived", "without_people"}
    assert keys | {"cause", "story"} <= told["confirmed"][0].keys()
    assert {"campaign", "complete", "ranking", "violated", "accounting", "out", "report", "command"} <= told.keys()


def test_a_candidate_that_the_budget_did_not_reach_can_be_confirmed(violated: rvsg.Campaign) -> None:
    (left,) = violated.candidates()
    confirmed = violated.confirm(left.index, runs=3, jobs=1)
    assert confirmed.confirms == left.index and len(confirmed.measurements) == 3
    assert violated.candidates() == []
    with pytest.raises(InputError):
        violated.confirm(left.index)


def test_a_scenario_is_confirmed_once_under_whatever_number_and_a_folder_with_two_opens(tmp_path: Path) -> None:
    (tmp_path / "r.yaml").write_text(f"always: {ALWAYS}\n", encoding="utf-8")
    campaign = create(tmp_path / "one", requirement=f"{tmp_path / 'r.yaml'}#always", shrink_runs=0)
    list(campaign.run(jobs=1))
    confirmed = next(a for a in campaign.attempts() if a.purpose == "confirmation")
    assert confirmed.confirms is not None
    attempts = campaign.attempts()
    again = attempts[confirmed.confirms].replace(index=len(attempts))
    with SqliteLedger(campaign.folder / "ledger.sqlite") as ledger:
        ledger.append(again, [])
    assert again.index not in [a.index for a in campaign.candidates()]
    with pytest.raises(InputError, check=coded("confirmed")):
        campaign.confirm(again.index)
    with SqliteLedger(campaign.folder / "ledger.sqlite") as ledger:  # as an earlier version did
        ledger.append(confirmed.replace(index=again.index + 1, confirms=again.index), [])
    rows = [row.confirmation for row in campaign.answer.failures]
    assert rows.count(again.index + 1) == 1 and confirmed.index not in rows
    assert campaign.report().is_file() and len(campaign.findings) == len(rows)


def test_the_error_rates_can_be_set_and_are_stored(tmp_path: Path) -> None:
    create(tmp_path / "one", error_rate=0.2, often=0.4)
    opened = rvsg.Campaign.open(tmp_path / "one")
    assert (opened.record.judging.error_rate, opened.record.judging.often) == (0.2, 0.4)
    with pytest.raises(InputError):
        create(tmp_path / "two", rare=0.3, often=0.2)


def test_a_record_holds_its_plug_ins_by_name_and_options(tmp_path: Path) -> None:
    campaign = create(tmp_path / "one", simulator=rvsg.Spec("kinematic", {"stop_gap_m": 0.7}))
    record = rvsg.Campaign.open(tmp_path / "one").record
    assert record.simulator.name == "kinematic" and record.simulator.options["stop_gap_m"] == 0.7
    assert record.generator == rvsg.Spec("random") and record.strategy == rvsg.Spec("random")
    assert record.provenance.begun_in == str(Path.cwd()) and record == campaign.record


def test_a_campaign_goes_on_with_the_form_of_its_strategy(tmp_path: Path) -> None:
    campaign = create(tmp_path / "one", strategy="hybrid")
    recorded = campaign.record.strategy
    assert recorded.name == "hybrid" and recorded.options["spread"] is True
    wired = campaign._wired
    assert wired.strategy(None, campaign.plan, recorded).kinds is not None
    assert wired.strategy(None, campaign.plan).kinds is not None


def test_a_record_of_another_version_is_refused(tmp_path: Path) -> None:
    data = create(tmp_path / "one").record.data()
    assert CampaignRecord.read(data) is not None
    for other in (data | {"sensors": 3}, {key: data[key] for key in ("plan", "config", "simulator")}):
        with pytest.raises(InputError, check=coded("record-unreadable")):
            CampaignRecord.read(other)


def test_a_campaign_of_0_2_keeps_the_people_it_began_with(tmp_path: Path) -> None:
    campaign = rvsg.Campaign.create(tmp_path / "c", strategy="study", scenarios=1, refinements=0, repeats=1)
    data = campaign.record.data()
    assert data["simulator"]["options"].pop("human_model") == "anticipation"
    earlier = CampaignRecord.read(data)
    assert earlier is not None
    assert earlier.settings.simulator_options == {"human_model": "social-force"}
    data["simulator"]["options"]["profile"] = "published-study"
    del data["simulator"]["options"]["stack"]
    published = CampaignRecord.read(data)
    assert published is not None and published.settings.simulator_options == {} and published.settings.stack is None


@pytest.mark.parametrize(
    ("named", "stored"),
    [
        ({}, None),
        ({"stack": "nav2-dwb"}, None),
        ({"stack_options": {"sim_time": 2.0}}, {"sim_time": 2.0}),
        ({"stack": "params.yaml"}, {"padding_m": 0.02, "behaviours": {"waits_for_costmaps": True}}),
    ],
    ids=["default", "by name", "with options", "a parameter file"],
)
def test_a_campaign_of_0_2_keeps_the_stack_it_began_with(
    named: dict[str, Any], stored: dict[str, Any] | None, tmp_path: Path
) -> None:
    out = tmp_path / "c"
    study = {} if stored is None else {"stack_options": stored}
    campaign = rvsg.Campaign.create(out, stack="nav2-dwb-humble", scenarios=1, refinements=0, repeats=1, **study)
    earlier = campaign.record.data()
    earlier["config"] |= {"stack": None, "stack_options": {}, **named}
    if stored is not None:
        earlier["simulator"]["options"]["stack"] |= {"name": "nav2-dwb", "version": "1"}
    assert CampaignRecord.read(earlier) == campaign.record
    with SqliteLedger(out / "ledger.sqlite") as ledger:
        ledger.forget_empty(campaign.name)
        ledger.begin(campaign.name, earlier)
    assert rvsg.Campaign.open(out).record == campaign.record
    assert rvsg.Campaign.open(out)._wired.simulator.options == campaign.record.simulator.options


def test_every_campaign_of_a_store_is_listed_and_can_be_opened(tmp_path: Path) -> None:
    one = create(tmp_path / "one")
    with SqliteLedger(tmp_path / "one" / "ledger.sqlite") as ledger:
        other = one.record.replace(plan=one.plan.replace(name="other"))
        ledger.begin("other", other.data())
    assert [campaign.name for campaign in campaigns_in(tmp_path / "one")] == [one.name, "other"]
    assert rvsg.Campaign.open(tmp_path / "one", "other").name == "other"
    with pytest.raises(InputError, check=coded("campaign-ambiguous")):
        rvsg.Campaign.open(tmp_path / "one")


def test_a_generator_of_ones_own_needs_no_registration(tmp_path: Path) -> None:
    campaign = create(tmp_path / "one", generator=WalkingGenerator(), strategy="study")
    list(campaign.run(jobs=1))
    assert {a.proposal.generator for a in campaign.attempts()} == {"walk"}
    assert campaign.record.generator.name == "walk"


def test_a_report_of_a_world_whose_routes_changed_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(SHIPPED / "warehouse", tmp_path / "mine")
    campaign = create(tmp_path / "one", world=str(tmp_path / "mine"))
    list(campaign.run(jobs=1))
    routes = tmp_path / "mine" / "routes.yaml"
    routes.write_text(routes.read_text(encoding="utf-8").replace("time_limit_s: 25", "time_limit_s: 26"))
    monkeypatch.setattr(world_lookup, "_worlds", {})
    assert campaign.report().is_file()  # of the copy in the folder
    with pytest.raises(InputError, check=coded("world-changed")):
        rvsg.Campaign.open(tmp_path / "one").report(world=tmp_path / "mine")


def test_a_campaign_whose_world_has_changed_is_shown_with_what_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for known in ("_worlds", "_folders"):  # of this test alone
        monkeypatch.setattr(world_lookup, known, {})
    shutil.copytree(SHIPPED / "warehouse", tmp_path / "mine")
    head = tmp_path / "mine" / "world.yaml"
    head.write_text(head.read_text(encoding="utf-8").replace("name: warehouse", "name: mine"), encoding="utf-8")
    campaign = create(tmp_path / "one", world=str(tmp_path / "mine"))
    list(campaign.run(jobs=1))
    before = campaign.answer
    shutil.rmtree(tmp_path / "one" / "inputs", ignore_errors=True)
    objects = tmp_path / "mine" / "objects.yaml"
    crate = "objects:\n  - {name: crate, box: {center: [0.5, 9.0, 0.4], size: [0.6, 0.6, 0.8]}}\n"
    objects.write_text(objects.read_text(encoding="utf-8").replace("objects:\n", crate, 1), encoding="utf-8")
    monkeypatch.setattr(world_lookup, "_worlds", {})
    now = rvsg.Campaign.open(tmp_path / "one")
    shown = now.answer
    assert before.changes == "" and "The world has changed since" in shown.changes
    facts = [(row.number, row.status, row.share, row.contact) for row in before.rows]
    assert facts == [(row.number, row.status, row.share, row.contact) for row in shown.rows]
    assert "The world has changed since" in now.report().read_text(encoding="utf-8")
    with pytest.raises(InputError, check=coded("world-changed")):
        now.world  # noqa: B018 - nothing is simulated in it


@pytest.mark.slow
@pytest.mark.parametrize("world", shipped_worlds())
@pytest.mark.parametrize("robot", shipped_robots())
def test_every_robot_runs_a_campaign_with_its_report_in_every_world(tmp_path: Path, robot: str, world: str) -> None:
    place = rvsg.load_world(world)
    for route in place.routes:
        try:
            check_mission(mission_of(place, route, robot)[0], place)
        except InputError:  # the robot does not fit there
            continue
        break
    else:
        pytest.skip(f"{robot} fits on no route of {world}")
    few = {"scenarios": 1, "repeats": 1, "confirmations": 0, "simulator": "embedded", "search_anyway": True}
    campaign = create(tmp_path / "one", robot=robot, world=world, route=route.name, **few)
    list(campaign.run(jobs=1))
    assert campaign.report().exists()


@pytest.mark.parametrize("robot", shipped_robots())
def test_a_report_knows_the_route_that_was_fitted_to_its_robot(robot: str) -> None:
    world = rvsg.load_world("warehouse")
    for route in world.routes:
        try:
            mission, _ = mission_of(world, route, robot)
        except InputError:  # the robot does not fit
            continue
        check_same_route(mission, world)
        with pytest.raises(InputError, check=coded("world-changed")):
            check_same_route(mission.replace(route=mission.route.replace(time_limit_s=7.0)), world)
