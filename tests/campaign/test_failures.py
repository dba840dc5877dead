from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.campaign.parts import REQUIREMENT, MemoryLedger, a_scenario, parts, plan, searched, warehouse
from tests.evaluation.runs import run_of as measured_run
from tests.evaluation.runs import trajectory

from rvsg.evaluation.verdict import judge
from rvsg.findings.findings import Finding, Removal, distinct_failures, severity_of, worst_confirmation
from rvsg.report.answer_row import cause_of
from rvsg.runs.attempt import Attempt, Measurement
from rvsg.runs.ledger import CachedLedger
from rvsg.runs.observation import FailureMode, encounter_of, met, mode_of, observe, usual
from rvsg.runs.runner import Evaluator, FinishedRun, Runner, RunRequest
from rvsg.search.confirmation import Confirmations
from rvsg.search.strategies import StudyStrategy
from rvsg.simulation.events import Side
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Outcome, Run


def run_of(
    human: tuple[float, float],
    velocity: tuple[float, float],
    *,
    stops: bool = False,
    reached: bool = True,
    still: slice | None = None,
) -> Run:
    """The robot drives along x; the person passes `human` at t = 5 s, nearest; `still`: samples at rest."""
    t = np.arange(0.0, 10.05, 0.1)
    x = 0.5 * t
    hx = x[50] + human[0] + velocity[0] * (t - 5.0)
    hy = human[1] + velocity[1] * (t - 5.0) + 0.3 * (np.maximum(0.0, t - 5.0) + np.maximum(0.0, 3.5 - t))
    speed = np.full_like(t, 0.5)
    if stops:
        speed[45:55] = 0.0
    if still is not None:
        speed[still] = 0.0
    path = trajectory(t, x, v=speed, humans=[(hx, hy)])
    return measured_run(path, outcome=Outcome.REACHED if reached else Outcome.TIMED_OUT, goal=(5.0, 0.0, 0.0))


NARROW = ((0.35, 0.1), (-0.35, 0.1), (-0.35, -0.1), (0.35, -0.1))


STUCK = "stops and does not arrive"


@pytest.mark.parametrize(
    ("run", "person", "robot"),
    [
        (run_of((0.0, 1.0), (0.0, 0.0)), "stands beside it", "drives on"),
        (run_of((0.0, 1.0), (-0.7, 0.0)), "comes towards it beside it", "drives on"),
        (run_of((1.2, 0.0), (0.5, 0.0), stops=True), "walks the same way ahead of it", "stops"),
        (run_of((1.0, 0.0), (0.4, 0.8)), "crosses its way ahead of it", "drives on"),
        (run_of((0.0, 0.7), (0.0, 0.0), stops=True), "stands beside it", "stops and touches the person"),
        (run_of((0.0, 0.7), (0.0, 0.0), still=slice(50, 60)), "stands beside it", "touches the person"),
        (run_of((0.0, 1.0), (0.0, 0.0), reached=False), "stands beside it", "drives on and does not arrive"),
        (replace(run_of((0.0, 0.7), (0.0, 0.0)), robot_outline=NARROW), "stands beside it", "drives on"),
        (run_of((0.0, 1.0), (0.0, 0.0), still=slice(0, 40)), "stands beside it", "drives on"),
        (run_of((0.0, 1.0), (0.0, 0.0), still=slice(0, 55)), "stands beside it", "sets off"),
        (run_of((0.0, 1.0), (0.0, 0.0), still=slice(60, None)), "stands beside it", "drives on"),
        (run_of((0.0, 1.0), (0.0, 0.0), still=slice(45, None)), "stands beside it", "arrives"),
        (run_of((0.0, 1.0), (0.0, 0.0), still=slice(45, None), reached=False), "stands beside it", STUCK),
    ],
)
def test_a_run_is_told_by_its_closest_approach(run: Run, person: str, robot: str) -> None:
    mode = mode_of(run, warehouse())
    assert mode is not None and (mode.person, mode.robot) == (person, robot)


@pytest.mark.parametrize(
    ("responsible", "said"),
    [
        ("robot", "it stops and drives into the person"),
        ("person", "it stops and is walked into"),
        ("shared", "it stops and collides with the person"),
        (None, "it stops and touches the person"),
    ],
)
def test_the_name_of_a_contact_says_who_is_responsible(responsible: Side | None, said: str) -> None:
    mode = mode_of(run_of((0.0, 0.7), (0.0, 0.0), stops=True), warehouse())
    assert mode is not None and mode.name(responsible).endswith(said)


def test_the_usual_mode_is_that_of_most_runs() -> None:
    stands, comes = (mode_of(run_of((0.0, 1.0), (speed, 0.0)), warehouse()) for speed in (0.0, -0.7))
    assert usual([comes, stands, None, stands]) == stands
    assert usual([]) is None


def finding(attempt: int, violated: bool, share: float, mode: FailureMode | None) -> Finding:
    safety = {"contacts": {"runs": 0, "of": 1}, "arrived": {"runs": 1, "of": 1}}
    why = {"about_people": "yes", "without_people": None, "cause": (), "smallest": None}
    found = {"attempt": attempt, "violated": violated, "violation_probability": share, "failure": mode}
    return Finding.model_construct(**found, **why, **safety)


def test_confirmed_violations_are_grouped_by_how_the_robot_fails_and_more_runs_count_more() -> None:
    one = FailureMode(place="Area 1", person="stands ahead of it", robot="stops")
    two = FailureMode(place="Area 2", person="stands ahead of it", robot="stops")
    found = [finding(3, True, 1.0, one), finding(5, True, 0.9, two), finding(1, True, 0.8, one)]
    groups = distinct_failures([*found, finding(7, False, 0.0, two), finding(8, True, 0.5, None)])
    assert [(g.mode, g.attempts, g.violation_probability) for g in groups] == [(one, (3, 1), 1.0), (two, (5,), 0.9)]
    assert "Area 1" in groups[0].words
    few, many = (
        Attempt.model_construct(
            index=bad, purpose="confirmation", verdict=judge(REQUIREMENT, [0.0] * bad + [2.0] * good)
        )
        for bad, good in ((2, 0), (14, 1))
    )
    assert worst_confirmation([few, many], REQUIREMENT) is many


def confirmed(index: int, objectives: list[float], contacts: int, realism: float = 20.0) -> Attempt:
    usual = {"min_distance": 0.1, "completed": 1.0, "people_realism": realism}
    measured = tuple(
        Measurement.model_construct(values=usual | {"contacts": float(k < contacts)}, objective=objective)
        for k, objective in enumerate(objectives)
    )
    verdict = judge(REQUIREMENT, objectives)
    return Attempt.model_construct(index=index, purpose="confirmation", verdict=verdict, measurements=measured)


def test_usual_people_come_first_then_contact_then_always_sometimes_open_and_not_violated_then_share_and_mean() -> None:
    in_order = [
        confirmed(1, [0.5] * 15, 10), confirmed(2, [0.1] * 15, 3), confirmed(3, [0.5] * 3 + [2.0] * 3, 6),
        confirmed(4, [2.0] * 15, 1), confirmed(5, [0.1] * 15, 0), confirmed(6, [0.5] * 15, 0),
        confirmed(7, [0.5] * 3 + [2.0] * 3, 0), confirmed(10, [0.1] * 15, 12, realism=0.4),
        confirmed(8, [0.5, 2.0], 0), confirmed(9, [2.0] * 15, 0),
    ]  # fmt: skip
    keys = [severity_of(attempt, REQUIREMENT) for attempt in in_order]
    assert keys == sorted(keys, reverse=True) and len(set(keys)) == len(keys)
    assert worst_confirmation(in_order[::-1], REQUIREMENT) is in_order[0]


def removals(*people: tuple[str, float]) -> tuple[Removal, ...]:
    return tuple(Removal(without=name, violated=0, of=5, before=5, p=p) for name, p in people)


@pytest.mark.parametrize(
    ("cause", "said"),
    [
        (removals(("Human 1", 0.001), ("Human 2", 0.2)), ("Human 1", "without Human 1: 0/5")),
        (removals(("Human 1", 0.2), ("Human 2", 0.1)), ("open", "without Human 2 0/5 violate: not told apart")),
        (removals(*((f"Human {k}", 1.0) for k in range(20))), ("no single person", "none explains it (20 tried)")),
        (removals(*((f"Human {k}", 0.01) for k in range(5))), ("5 people", "without Human 0: 0/5")),
    ],
)
def test_a_cause_is_named_where_its_removal_is_told_apart(cause: tuple[Removal, ...], said: tuple[str, str]) -> None:
    shown = finding(1, True, 1.0, None).model_copy(update={"cause": cause, "verdict": judge(REQUIREMENT, [0.1] * 15)})
    assert cause_of(shown) == said


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("stands beside it", "stands beside the robot"),
        ("comes towards it ahead of it", "walks the opposite way to the robot, ahead of it"),
        ("crosses its way behind it", "crosses the robot's way, behind it"),
        ("something else", "something else"),
    ],
)
def test_a_kind_of_encounter_reads_without_the_robot_named_before(kind: str, said: str) -> None:
    assert met(kind) == said


def test_what_was_observed_of_a_run_when_it_was_made_is_what_the_stored_run_shows() -> None:
    ledger = MemoryLedger()
    cached = CachedLedger(ledger)
    with Runner(KinematicSimulator(), warehouse(), ledger=cached) as runner:
        made = runner.submit(RunRequest(a_scenario(), 1)).result()
    assert isinstance(made, FinishedRun) and made.observation is None
    ledger.keep(made.packed)
    stored = ledger.run(made.id)
    ledger.runs.clear()
    observed = cached.observation(made.id, warehouse())
    assert observed == observe(stored, warehouse())
    assert (observed.mode, observed.encounter) == (mode_of(stored, warehouse()), encounter_of(stored, warehouse()))
    assert cached.failure_mode(made.id, warehouse()) == mode_of(stored, warehouse())


def test_one_of_every_kind_of_failure_is_confirmed_before_the_second_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    the_plan, ledger = plan(scenarios=4, refinements=0, repeats=1, confirmations=0), MemoryLedger()
    made = parts(ledger)
    with made.runner:
        found = searched(StudyStrategy, the_plan, ledger, changes={"runner": made.runner})
        kinds = {m.run_id: "same" if a.index != 2 else "other" for a in found for m in a.measurements}
        monkeypatch.setattr(CachedLedger, "failure_mode", lambda self, run_id, world: kinds[run_id])
        always = the_plan.replace(requirement=the_plan.requirement.replace(limit=99.0))
        ordered = Confirmations(always, [], made)._one_of_each_kind(found)
    assert [a.index for a in ordered] == [0, 2, 1, 3]


def test_a_run_in_which_the_stack_failed_is_measured_and_not_judged() -> None:
    path = trajectory([0, 1], 0, humans=[(2, 0)])
    failed, made = measured_run(path, outcome=Outcome.STACK_FAILED), measured_run(path)
    measuring = Evaluator(REQUIREMENT)
    assert measuring.measure(failed).values["dto"] == measuring.measure(made).values["dto"] == 2.0
    assert measuring.measure(failed).objective is None and measuring.judged(failed).objective is None
    assert measuring.measure(made).objective == measuring.judged(made).objective == 2.0
