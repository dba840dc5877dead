"""Shrinking of one scenario, and of every distinct failure at the end of a campaign."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from tests.campaign.parts import (
    REQUIREMENT,
    Counted,
    Distance,
    MemoryLedger,
    Noted,
    measure,
    plan,
    searched,
    warehouse,
)
from tests.coded import coded

from rvsg.cli import main
from rvsg.cli.scenario import _show
from rvsg.core.errors import InputError
from rvsg.evaluation.verdict import DEFAULT
from rvsg.findings.findings import Smallest, distinct_failures, findings
from rvsg.runs.attempt import Attempt, Measurement, Plan
from rvsg.runs.runner import Evaluator, Runner, RunRequest
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Behaviour, Human, HumanConfiguration, Mission, Pause, Scenario, Task
from rvsg.scenario.validity import check
from rvsg.search.execution import account
from rvsg.search.smallest_scenario import Shrinker, simpler, size
from rvsg.search.strategies import RandomStrategy
from rvsg.simulation.run import Run

WORLD = warehouse()
ROUTE = WORLD.route("route_1")
MISSION = Mission(world="warehouse", world_id=WORLD.id, route=ROUTE)
LIMIT = REQUIREMENT.replace(limit=2.5)


def walk(a: str, b: str) -> Task:
    path = WORLD.grid.shortest_path(a, b)
    assert path is not None
    return Task(name=f"{a} → {b}", path=path)


def to_and_fro(name: str, a: str, b: str, **more: object) -> Human:
    return Human(name=name, tasks=(walk(a, b), walk(b, a)), **more)  # type: ignore[arg-type]


def crowd() -> Scenario:
    """One person walks where the robot drives; two are far away."""
    near = to_and_fro("near", "F13", "E20", speed_m_s=0.6, start_delay_s=1.0, behaviour=Behaviour.IMPASSIVE)
    first = near.tasks[0].replace(pauses=(Pause(at="F14", duration_s=1.0),))
    near = near.replace(tasks=(first, near.tasks[1]))
    return Scenario(
        mission=MISSION,
        people=HumanConfiguration(humans=(to_and_fro("far", "E2", "E5"), near, to_and_fro("away", "M2", "M6"))),
        description="three at work",
    )


def shrinking(simulator: Counted | None = None, **more: object) -> Shrinker:
    return Shrinker(
        requirement=more.pop("requirement", LIMIT),  # type: ignore[arg-type]
        runner=Runner(simulator or Counted(), WORLD, measuring=Distance(measure)),  # type: ignore[arg-type]
        judge=Evaluator(LIMIT).judge,
        repeats=3,
        confirmations=4,
        **more,  # type: ignore[arg-type]
    )


def test_people_and_details_that_do_not_matter_are_taken_away_and_the_result_is_valid() -> None:
    simulator = Counted()
    found = shrinking(simulator)(crowd())
    assert [human.name for human in found.smallest.people.humans] == ["near"]
    (near,) = found.smallest.people.humans
    assert near.start_delay_s == 0.0 and near.behaviour is Behaviour.REGULAR
    assert not any(task.pauses for task in near.tasks)
    assert found.after.violations == found.after.runs == 4
    assert (found.runs, found.original) == (simulator.runs, crowd())
    assert [step.what for step in found.steps if step.kept][:2] == ["without far", "without away"]
    assert "without near" in [step.what for step in found.steps if not step.kept]
    assert check(found.smallest.people, MISSION, WORLD) == () and found.smallest.mission == MISSION
    assert "near" in found.smallest.description and "1 of 3" in found.smallest.description
    assert not {"far", "away", "three"} & set(re.findall(r"\w+", found.smallest.description)), "nobody else is named"
    assert shrinking()(crowd()) == found, "equal seeds give equal results"
    assert shrinking()(found.smallest).smallest == found.smallest, "nothing more is found"


def test_trials_are_judged_and_neither_packed_nor_measured_otherwise() -> None:
    judged: list[int] = []

    def judge_only(run: Run, place: object = None) -> Measurement:
        judged.append(run.seed)
        return measure(run).replace(values={})

    runner = Runner(Counted(), WORLD, measuring=Distance(measure, judge_only))  # type: ignore[arg-type]
    trial, stored = runner.submit(RunRequest(crowd(), 1, trial=True)), runner.submit(RunRequest(crowd(), 1))
    assert trial.measurement() == measure(stored.result().unpack()).replace(values={})  # type: ignore[union-attr]
    assert judged == [1] and stored.measurement().values.keys() == {"dto"}  # type: ignore[union-attr]
    assert runner.submit(RunRequest(crowd(), 1, trial=True)).measurement() is trial.measurement()


def test_trials_that_are_made_in_any_case_begin_at_once_and_no_others() -> None:
    runner = Noted(Counted(), WORLD, measuring=Distance(measure))  # type: ignore[arg-type]
    shrinks = shrinking()
    shrinks.runner = runner
    _, steps = shrinks.smallest(crowd())
    assert {run for run, _ in runner.made} == runner.begun
    assert [begun for _, begun in runner.made[:3]] == [3, 3, 3]  # nothing depends on the runs of the original
    assert any(step.runs < shrinks.repeats for step in steps)


def test_stops_that_are_reached_late_are_left_out_and_the_loop_stays_closed() -> None:
    tasks = (walk("F13", "E20"), walk("E20", "M20"), walk("M20", "M2"), walk("M2", "F13"))
    person = Human(name="near", tasks=tasks, speed_m_s=0.6)
    long_round = crowd().replace(people=HumanConfiguration(humans=(person,)))
    found = shrinking()(long_round)
    (smallest,) = found.smallest.people.humans
    assert [task.name for task in smallest.tasks] == ["F13 → E20", "E20 → F13"]
    assert smallest.tasks[0].path == tasks[0].path


def test_every_simpler_configuration_is_smaller_before_it_is_repaired() -> None:
    people = crowd().people
    candidates = list(simpler(people, WORLD.grid))
    assert all(size(candidate) < size(people) for _, candidate in candidates)
    assert len({what for what, _ in candidates}) == len(candidates) == 6


def test_without_a_violation_or_a_limit_there_is_nothing_to_shrink() -> None:
    with pytest.raises(InputError, check=coded("no-violation")):
        shrinking(requirement=LIMIT.replace(limit=0.1))(crowd())
    with pytest.raises(InputError, check=coded("no-limit")):
        shrinking(requirement=LIMIT.replace(limit=None))(crowd())


def test_the_command_writes_the_smallest_scenario(tmp_path: Path) -> None:
    scenario_file, requirement = tmp_path / "scenario.json", tmp_path / "mine.yaml"
    scenario_file.write_text(crowd().to_json(), encoding="utf-8")
    requirement.write_text(
        "near:\n  title: Near\n  text: Keep away.\n  metric: dto\n  worse: smaller\n  limit: 2.5\n  unit: m\n"
    )
    out = tmp_path / "smallest.json"
    options = ["--simulator", "kinematic", "--repeats", "2", "--confirmations", "3", "--out", str(out)]
    assert main(["scenario", "shrink", str(scenario_file), "--requirement", f"{requirement}#near", *options]) == 0
    written = json.loads(out.read_text(encoding="utf-8"))
    assert [human["name"] for human in written["people"]["humans"]] == ["near"]


EASY = REQUIREMENT.replace(limit=20.0)
"""A limit that every run with people violates."""


def the_plan(requirement: Requirement = EASY) -> Plan:
    return plan(scenarios=3, refinements=0, repeats=1, confirmations=30, requirement=requirement)


def campaign(ledger: MemoryLedger, requirement: Requirement = EASY, **changes: object) -> list[Attempt]:
    return searched(RandomStrategy, the_plan(requirement), ledger, changes={"shrink_runs": 300, **changes})


@pytest.fixture(scope="module")
def ended() -> tuple[MemoryLedger, list[Attempt]]:
    ledger = MemoryLedger()
    return ledger, campaign(ledger)


def shrunk(attempts: list[Attempt]) -> list[Attempt]:
    return [a for a in attempts if a.purpose == "shrinking"]


def test_every_distinct_failure_is_shrunk_and_keeps_its_causes(ended: tuple[MemoryLedger, list[Attempt]]) -> None:
    ledger, attempts = ended
    found = distinct_failures(findings(the_plan(), attempts, run_of=ledger.run, world=warehouse()))
    assert found
    for failure in found:
        smallest = failure.smallest
        assert smallest is not None and smallest.taken_away
        assert smallest.violated == smallest.of > 0
        assert failure.cause and failure.without_people is not None
    for attempt in shrunk(attempts):
        confirmation = next(a for a in attempts if a.index == attempt.confirms)
        assert size(attempt.proposal.scenario.people) < size(confirmation.proposal.scenario.people)
        assert {m.seed for m in attempt.measurements} <= {m.seed for m in confirmation.measurements}


def test_all_of_it_stays_within_the_budget(ended: tuple[MemoryLedger, list[Attempt]]) -> None:
    assert 0 < account(ended[1]).shrinking_runs <= 300
    few = campaign(MemoryLedger(), shrink_runs=40)
    assert account(few).shrinking_runs <= 40


def test_nothing_is_shrunk_without_a_budget_or_a_violation() -> None:
    assert not shrunk(campaign(MemoryLedger(), shrink_runs=0))
    assert not shrunk(campaign(MemoryLedger(), REQUIREMENT.replace(limit=0.001)))


def test_an_interrupted_end_resumes_to_the_same_records(ended: tuple[MemoryLedger, list[Attempt]]) -> None:
    attempts = ended[1]
    assert shrunk(attempts)
    ledger = MemoryLedger()
    before = len(attempts) - len(shrunk(attempts))
    campaign(ledger, cancelled=lambda: len(ledger.kept) >= before)
    assert not shrunk(ledger.kept)
    assert campaign(ledger) == attempts


@pytest.mark.parametrize(("violated", "before", "holds"), [(0, 2, False), (1, 1, False), (4, 10, False), (8, 10, True)])
def test_what_no_longer_fails_is_not_told_as_the_failure_shrunk(violated: int, before: int, holds: bool) -> None:
    runs: dict[str, Any] = {"violated": violated, "of": 10, "before": before, "judged_by": DEFAULT}
    smallest = Smallest(attempt=7, scenario_id="x", taken_away=("Human 1",), **runs)
    assert smallest.holds is holds


@pytest.mark.parametrize(("after", "said"), [(0, True), (4, False)])
def test_a_smallest_scenario_that_hardly_violates_is_not_offered_in_silence(
    after: int, said: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    made = shrinking()(crowd())
    rarer = made.replace(before=made.before.replace(violations=5), after=made.after.replace(violations=after))
    capsys.readouterr()
    _show(rarer)
    assert ("use the original" in capsys.readouterr().err) is said
