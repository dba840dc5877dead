from __future__ import annotations

import html
import html.parser
import json
import re
import xml.etree.ElementTree as ET
from functools import cache
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest
from tests.campaign.parts import REQUIREMENT, MemoryLedger, WalkGenerator, a_scenario, plan, searched, warehouse
from tests.coded import coded
from tests.report.test_page_parts import call

import rvsg
from rvsg.core.errors import InputError
from rvsg.evaluation.realism import PEOPLE_REALISM, motions, rarest
from rvsg.evaluation.verdict import Status, how_sure, judge, number
from rvsg.generation.generator import Proposal
from rvsg.generation.vlm.call_log import CallLog
from rvsg.report.answer_row import Ranked
from rvsg.report.junit import junit_of
from rvsg.report.page import _curse, render_page, write_runs_page
from rvsg.report.renderer import unbroken
from rvsg.report.result import CampaignAnswer, Result
from rvsg.report.run_facts import EDGES
from rvsg.report.terminal import describe_finding
from rvsg.runs.attempt import Attempt, Plan
from rvsg.scenario.brief import Brief
from rvsg.search.strategies import RandomStrategy, StudyStrategy
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.world.world import World

NASTY = "</script><script>alert(1)</script><img src=x onerror=alert(2)> & \"quoted\" 'single' \u2028"


class NastyGenerator(WalkGenerator):
    def propose(self, brief: Brief, world: World) -> Proposal:
        proposal = super().propose(brief, world)
        scenario = proposal.scenario
        assert scenario is not None
        people = scenario.people.replace(
            humans=tuple(
                human.replace(name=f"{NASTY[:60]} {k}", tasks=(human.tasks[0].replace(name=NASTY), *human.tasks[1:]))
                for k, human in enumerate(scenario.people.humans)
            )
        )
        return proposal.replace(scenario=scenario.replace(description=NASTY, people=people))


def campaign(ledger: MemoryLedger, generator: object = None, strategy: type = StudyStrategy, **changes: object):
    the_plan = plan(**changes)
    return the_plan, searched(strategy, the_plan, ledger, generator=generator)


def result_of(the_plan: Plan, attempts: list[Attempt], ledger: MemoryLedger, **more: Any) -> Result:
    return Result(the_plan, attempts, warehouse(), cache(ledger.run), **more)


def page(the_plan: Plan, attempts: list[Attempt], ledger: MemoryLedger, **more: Any) -> str:
    return render_page(result_of(the_plan, attempts, ledger), command="rvsg run --seed 7", **more)


@cache
def default_campaign() -> tuple[Plan, list[Attempt], MemoryLedger]:
    """The campaign that most tests look at; nobody changes it."""
    ledger = MemoryLedger()
    return *campaign(ledger), ledger


def answer(the_plan: Plan, attempts: list[Attempt], ledger: MemoryLedger, **more: Any) -> CampaignAnswer:
    return result_of(the_plan, attempts, ledger, **more).answer


@cache
def default_page() -> str:
    return page(*default_campaign())


class Reader(html.parser.HTMLParser):
    """Notes tags, what they refer to, and whether all are closed."""

    VOID = frozenset({"meta", "br", "input", "link", "img", "hr"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.refers: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.refers += [value or "" for name, value in attrs if name in ("src", "href", "onerror", "onload")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    @classmethod
    def of(cls, text: str) -> Reader:
        reader = cls()
        reader.feed(text)
        return reader


def data_of(text: str) -> dict[str, Any]:
    found = re.search(r'id="data">(.*?)</script>', text, flags=re.DOTALL)
    assert found is not None
    return json.loads(found[1])


@pytest.mark.parametrize("strategy", [StudyStrategy, RandomStrategy])
def test_the_page_is_whole_and_refers_to_nothing_outside(strategy: type) -> None:
    ledger = MemoryLedger()
    text = page(*campaign(ledger, strategy=strategy), ledger)
    reader = Reader.of(text)
    assert reader.open == []
    assert reader.refers and all(target.startswith("#") for target in reader.refers)
    assert not re.search(r"https?:(?!//www\.w3\.org/2000/svg)", text)


def test_words_of_a_model_stay_words() -> None:
    ledger = MemoryLedger()
    the_plan, attempts = campaign(ledger, NastyGenerator())
    text = page(the_plan, attempts, ledger)
    assert Reader.of(text).tags.count("script") == 2 and "img" not in Reader.of(text).tags
    assert len(_junit(result_of(the_plan, attempts, ledger))) == the_plan.scenarios
    assert data_of(text)["groups"][0]["people"][0]["name"].startswith("</script>")


@pytest.mark.parametrize("objective", [0.5, 2.0], ids=["violated", "not violated"])
def test_page_terminal_and_json_say_in_the_same_words_how_far_people_go(objective: float) -> None:
    the_plan, made, ledger = default_campaign()
    attempts = [_with_objectives(a, objective) if a.purpose == "confirmation" else a for a in made]
    (confirmed,) = (a for a in attempts if a.purpose == "confirmation")
    shares = {PEOPLE_REALISM: 60.0}, {PEOPLE_REALISM: 0.1}, {PEOPLE_REALISM: None}
    measured = [m.replace(values=each) for m, each in zip(confirmed.measurements, cycle(shares), strict=False)]
    attempts = [a.replace(measurements=tuple(measured)) if a is confirmed else a for a in attempts]
    least = measured[1]
    motion = rarest(motions(ledger.run(least.run_id)))
    (found,) = result_of(the_plan, attempts, ledger).findings
    assert motion is not None and found.realism == f"With seed {least.seed}, {motion.sentence}"
    assert f"  {found.realism}" in list(describe_finding(found, the_plan.requirement))
    text = html.unescape(page(the_plan, attempts, ledger))
    assert text.count(unbroken(found.realism)) == 1


def test_every_link_of_the_page_opens_runs_that_the_replay_holds() -> None:
    text = default_page()
    known = {run["id"] for group in data_of(text)["groups"] for run in group["runs"]}
    linked = [target for target in Reader.of(text).refers if target.startswith(("#run=", "#runs="))]
    assert len(linked) > 10
    for target in linked:
        runs = target.split("=", 1)[1].split("&")[0].split(",")
        assert runs and set(runs) <= known


@pytest.mark.parametrize(
    ("selected", "fresh", "said"),
    [
        ((0.40, 0.44), (0.42, 0.46, 0.43, 0.45), "is 0.02 m less severe. Selection bias or chance can explain"),
        ((0.10, 0.11, 0.12), (0.50, 0.51, 0.52), "more than chance explains (Welch"),
        ((0.4, 0.4, 0.4), (0.3, 0.35, 0.3, 0.4, 0.3, 0.3), "The confirmation is no less severe"),
    ],
)
def test_what_the_choice_did_is_said_as_far_as_the_numbers_carry(
    selected: tuple[float, ...], fresh: tuple[float, ...], said: str
) -> None:
    the_plan, attempts, ledger = default_campaign()
    searched, confirmed = (
        next(a for a in attempts if a.purpose == purpose).replace(verdict=judge(the_plan.requirement, values))
        for purpose, values in (("search", selected), ("confirmation", fresh))
    )
    assert said in _curse(result_of(the_plan, attempts, ledger), confirmed, searched)


def test_equal_campaigns_give_equal_pages_and_unfinished_or_empty_ones_a_page_too() -> None:
    ledger = MemoryLedger()
    assert page(*campaign(ledger), ledger) == default_page()

    the_plan, attempts, ledger = default_campaign()
    assert "not confirmed" in page(the_plan, attempts[:2], ledger)
    assert "no result" in page(the_plan, [], ledger)


def test_the_replay_holds_every_run_of_every_configuration() -> None:
    _, attempts, _ = default_campaign()
    data = data_of(default_page())
    made = [m.run_id for attempt in attempts for m in attempt.measurements]
    assert sorted(run["id"] for group in data["groups"] for run in group["runs"]) == sorted(made)
    assert data["groups"][0]["purpose"] == "confirmation"
    values = [run["objective"] for run in data["groups"][0]["runs"]]
    assert values == sorted(values)  # R1 is worse when smaller


def _junit(result: Result) -> ET.Element:
    return ET.fromstring(junit_of([result]))[0]


def _scenario_case(suite: ET.Element, entry: Ranked) -> ET.Element:
    return next(case for case in suite if case.attrib["name"].startswith(f"{entry.number} "))


def _properties(case: ET.Element) -> dict[str, str]:
    return {each.attrib["name"]: each.attrib["value"] for each in case.iter("property")}


def test_in_junit_a_violation_of_which_fail_or_flaky_is_open_is_a_failure_that_says_so() -> None:
    the_plan, attempts, ledger = default_campaign()
    unsure = {"status": Status.INCONCLUSIVE, "violations": 8, "runs": 8}
    changed = [a.replace(verdict=a.verdict.replace(**unsure)) for a in attempts if a.verdict]
    summary = result_of(the_plan, changed, ledger)
    suite = _junit(summary)
    assert summary.violated and suite.attrib["failures"] == "1"
    confirmed, *candidates = summary.ranking
    assert "VIOLATED (FAIL or FLAKY is still open)" in _scenario_case(suite, confirmed)[-1].attrib["message"]
    assert candidates and {_scenario_case(suite, each)[-1].tag for each in candidates} == {"skipped"}
    assert {_properties(_scenario_case(suite, each))["state"] for each in candidates} == {"candidate"}


@pytest.mark.parametrize("status", list(Status))
def test_in_junit_the_confirmation_decides_and_what_is_not_sure_is_skipped_with_its_reason(status: Status) -> None:
    the_plan, attempts, ledger = default_campaign()
    flaky = {"status": Status.FLAKY, "violations": 1}
    changed = [
        a.replace(verdict=a.verdict.replace(**(flaky | {"status": status} if a.purpose == "confirmation" else flaky)))
        for a in attempts
        if a.verdict
    ]
    summary = result_of(the_plan, changed, ledger)
    suite = _junit(summary)
    assert len(suite) == int(suite.attrib["tests"]) == the_plan.scenarios
    assert [len(suite.findall(f".//{tag}")) for tag in ("failure", "skipped")] == [
        int(suite.attrib[key]) for key in ("failures", "skipped")
    ]
    assert (int(suite.attrib["failures"]) > 0) == summary.violated == (status in (Status.FAIL, Status.FLAKY))
    for entry in summary.ranking:
        case = _scenario_case(suite, entry)
        assert _properties(case)["state"] == entry.state
        expected = {"FAIL": "failure", "FLAKY": "failure", "PASS": "system-out"}.get(status.value, "skipped")
        assert case[-1].tag == (expected if entry.state == "confirmed" else "skipped")
        assert how_sure(entry.verdict) in case[-1].attrib.get("message", "") + (case[-1].text or "")
    alone = result_of(the_plan, [a for a in changed if a.purpose == "search"], ledger)
    unconfirmed = _junit(alone)
    assert int(unconfirmed.attrib["failures"]) == len(unconfirmed) == the_plan.scenarios


def test_a_confirmed_scenario_shows_its_confirmation_verdict_on_the_page_in_terminal_json_and_junit() -> None:
    the_plan, attempts, ledger = default_campaign()
    worst = result_of(the_plan, attempts, ledger).ranking[0]
    touched = {"contacts": 2.0, "contact_longest": 1.0, "contact_speed": 0.5, "min_distance": -0.01, "completed": 1.0}
    search = [_with_objectives(a, 0.5) for a in attempts if a.purpose == "search"]
    (confirmation,) = (a for a in attempts if a.purpose == "confirmation")
    kept = _with_objectives(confirmation, 2.0)
    verdict = judge(REQUIREMENT, [2.0] * 15)
    measured = tuple(m.replace(values=touched) for m in kept.measurements)
    changed = [*search, kept.replace(verdict=verdict, measurements=measured)]
    summary = result_of(the_plan, changed, ledger)
    assert [entry.state for entry in summary.ranking] == ["confirmed"] + ["candidate"] * (the_plan.scenarios - 1)
    last = summary.ranking[0]
    assert (last.scenario, last.verdict.status, last.seen.contacts.runs) == (worst.scenario, Status.PASS, 5)

    told = summary.data()["ranking"][0]
    assert (told["state"], told["verdict"]["status"], told["seen"]["contacts"]["runs"]) == ("confirmed", "PASS", 5)
    rows = answer(the_plan, changed, ledger).rows
    told_of = [(row.status, row.violated, row.tone, row.share, row.contact) for row in rows]
    assert told_of[0] == ("PASS", "no", "warn", "0/15", "5/5"), "contact comes first, and is not green"
    assert {row.status for row in rows[1:]} == {"candidate"}
    case = _scenario_case(_junit(summary), last)
    assert case[-1].tag == "system-out" and _properties(case)["contacts"] == "5 of 5 runs"
    assert _properties(case)["arrived"] == "5 of 5 runs"
    text = page(the_plan, changed, ledger)
    chips = re.findall(r'<td data-label="Verdict"><span class="chip \w+">(.*?)</span>', text)
    assert chips == [row.status for row in rows]


def _with_objectives(attempt: Attempt, value: float) -> Attempt:
    made = [measured.replace(objective=value) for measured in attempt.measurements]
    return attempt.replace(measurements=tuple(made), verdict=judge(REQUIREMENT, [value] * len(made)))


@pytest.mark.parametrize(
    ("alone", "cause"), [(0.5, "not the people"), (2.0, "the people"), (None, "open")], ids=["recurs", "gone", "untold"]
)
def test_a_violation_says_whether_it_recurs_without_people(alone: float | None, cause: str) -> None:
    the_plan, attempts, ledger = default_campaign()
    changed = [_with_objectives(a, 0.5) if a.purpose == "confirmation" else a for a in attempts if a.verdict]
    changed = [a for a in changed if a.purpose in ("search", "confirmation")]
    if alone is not None:
        changed.append(_with_objectives(next(a for a in attempts if a.purpose == "baseline"), alone))
    told = answer(the_plan, changed, ledger)
    assert (told.rows[0].cause, told.figures[3].value) == (cause, cause)
    assert told.status == "FAIL" or told.rows[0].runs < 15
    if alone is not None:
        drove = answer(the_plan, changed, ledger, alone=changed[-1]).headline
        assert (f", {changed[-1].runs}/{changed[-1].runs} without people" in drove) == (alone == 0.5)
    text = page(the_plan, changed, ledger)
    assert f"<b>{cause}</b>" in text[: text.index("What happens")]


def test_the_answer_tells_of_contact_in_configurations_other_than_the_worst() -> None:
    the_plan, attempts, ledger = default_campaign()
    worst = answer(the_plan, attempts, ledger).rows[0]
    assert worst.contacts == 0 and answer(the_plan, attempts, ledger).elsewhere is None
    other = next(a for a in attempts if a.purpose == "search" and a.index != worst.attempt)
    touched = tuple(m.replace(values=m.values | {"contacts": 1.0}) for m in other.measurements[:1])
    changed = [a.replace(measurements=(*touched, *a.measurements[1:])) if a is other else a for a in attempts]
    told = answer(
        the_plan, changed, ledger, commands=lambda _: {"contact": "C", "confirm": "rvsg confirm F", "planner": "P"}
    )
    assert told.elsewhere is not None and told.elsewhere.runs == (touched[0].run_id,) and told.tone != "good"
    assert told.elsewhere.text.startswith("Contact in 1 of ") and "R1 does not judge contact" in told.elsewhere.text
    steps = [step.command for step in told.next]
    assert steps[:2] == ["C", f"rvsg confirm F {other.index}"], "its confirmation is offered"


def test_an_unconfirmed_candidate_says_the_command_that_confirms_it() -> None:
    the_plan, attempts, ledger = default_campaign()
    changed = [_with_objectives(a, 0.5) for a in attempts if a.purpose == "search"]
    text = page(the_plan, changed, ledger)
    found = re.findall(r"rvsg confirm FOLDER (\d+)", text)
    assert found == [str(row.attempt) for row in answer(the_plan, changed, ledger).rows]
    assert "rvsg confirm FOLDER" not in page(the_plan, attempts, ledger).replace("candidate", "")
    text = render_page(result_of(the_plan, attempts, ledger), command="rvsg run --note '2 m' <x>")
    assert "2 m" in text[text.index("<pre>rvsg run") :][:60] and "&lt;x&gt;" in text, "the command can be copied"


def test_a_confirmation_is_paired_with_its_scenario_whatever_its_index_says() -> None:
    the_plan, attempts, ledger = default_campaign()
    worst = result_of(the_plan, attempts, ledger).ranking[0].attempt
    other = next(a for a in attempts if a.purpose == "search" and a.proposal.scenario is not None and a.index != worst)
    changed = [
        a.replace(confirms=None, proposal=other.proposal, brief=other.brief) if a.purpose == "confirmation" else a
        for a in attempts
    ]
    text = page(the_plan, changed, ledger)
    assert other.verdict is not None
    mean = number(other.verdict.mean, "m")
    assert unbroken(f"{len(other.verdict.objectives)} runs with a mean of {mean}") in text
    confirmed = [row.number for row in answer(the_plan, changed, ledger).rows if row.state == "confirmed"]
    assert confirmed == [f"{other.brief.scenario_index + 1}.{other.brief.configuration_index + 1}"]


def test_the_conversation_of_a_model_stands_on_the_page_as_text(tmp_path: Any) -> None:
    recording = CallLog(tmp_path)
    the_plan, attempts, ledger = default_campaign()
    said = call(recording, 1, ("user", NASTY), answer="an answer")
    changed = [a.replace(proposal=a.proposal.replace(calls=(said,))) if a.purpose == "search" else a for a in attempts]
    text = page(the_plan, changed, ledger, recording=recording)
    assert "from a recording" not in text and "from a recording" in page(
        the_plan, changed, ledger, recording=recording, replayed=True
    )
    assert "an answer" in text and "&lt;script&gt;alert(1)" in text and "img" not in Reader.of(text).tags


def test_no_line_breaks_between_a_number_and_its_unit() -> None:
    assert unbroken("limit of 25 s.") == "limit of 25\u00a0s."
    assert unbroken("0.5 to 0.0 m/s; 41 %") == "0.5 to 0.0\u00a0m/s; 41\u00a0%"
    assert unbroken("route 3 should, 2 sides") == "route 3 should, 2 sides"


def test_runs_that_several_attempts_of_the_search_share_are_shown_and_counted_once() -> None:
    the_plan, attempts, ledger = default_campaign()
    known = attempts[0]
    more = known.replace(index=len(attempts), measurements=known.measurements[:1])

    def told(made: list[Attempt]) -> tuple[list[str], list[str], list[str]]:
        text = page(the_plan, made, ledger)
        groups = data_of(text)["groups"]
        counted = re.findall(r"In the search, [^.]*\.", text)
        return [g["id"] for g in groups], [r["id"] for g in groups for r in g["runs"]], counted

    assert told([*attempts, more]) == told(attempts)


@pytest.mark.parametrize("named", [True, False])
def test_runs_of_no_campaign_have_a_page_with_verdict_story_and_replay(tmp_path: Path, named: bool) -> None:
    world, scenario = warehouse(), a_scenario()
    runs = rvsg.RunSet(tuple(KinematicSimulator().run(scenario, world, seed=seed) for seed in (1, 2)))
    judged = rvsg.judge(runs, "R1", world=world)
    page = tmp_path / "page.html"
    with pytest.raises(InputError, check=coded("no-world")):
        write_runs_page(page, judged, runs)
    write_runs_page(page, judged, runs, scenario=scenario if named else None, world=world, notes=[NASTY])
    text = page.read_text(encoding="utf-8")
    reader = Reader.of(text)
    assert reader.open == [] and reader.tags.count("script") == 2 and "img" not in reader.tags
    assert {run["id"] for run in data_of(text)["groups"][0]["runs"]} == {run.id for run in runs}
    assert all(target.startswith("#") for target in reader.refers)
    assert judged.outcome.value in text and 'class="card"' in text
    assert ("tasks" in data_of(text)["groups"][0]["people"][0]) is named
    corners = data_of(text)["groups"][0]["robot"]["outline"]
    assert (len(corners) == EDGES) is not named  # a robot that nobody names is drawn as the disc that measures the gaps
