"""The one runner: scenarios x seeds x variants x requirements."""

from __future__ import annotations

from pathlib import Path

from tests.campaign.parts import REQUIREMENT, Counted, a_scenario, warehouse

import rvsg
from rvsg.core.plugins import Spec
from rvsg.evaluation.verdict import Procedure
from rvsg.runs.attempt import Attempt, Failure
from rvsg.runs.runner import Evaluator, FinishedRun, Runner, RunRequest
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.suites.suite import result_of_attempt
from rvsg.suites.suite_folder import run_cases

NEAR = REQUIREMENT.replace(name="near", metric="min_distance", limit=100.0)


def test_a_run_is_made_once_for_all_requirements_of_a_case_and_judged_by_its_suite(tmp_path: Path) -> None:
    scenario, simulator = a_scenario(), Counted()
    suite = rvsg.Suite.create(tmp_path / "suite", judging=Procedure(error_rate=0.001))
    suite = suite.add(scenario, REQUIREMENT, name="walk").add(scenario, NEAR)
    results = list(run_cases([suite.tested("walk")], simulator, runs=3))
    assert simulator.runs == 3 and [each.requirement for each in results] == ["R1", "near"]
    assert {each.verdict.judged_by.error_rate for each in results} == {0.001}
    for each, requirement in zip(results, (REQUIREMENT, NEAR), strict=True):
        alone = [
            Evaluator(requirement, warehouse()).measure(run)
            for run in rvsg.simulate(scenario, 3, simulator="kinematic")
        ]
        flags = [None if m.objective is None else requirement.violated_by(m.objective) for m in alone]
        assert list(each.violations) == flags
        verdict = Evaluator(requirement).judge(alone)
        attempt = Attempt.by_hand(
            scenario.mission, requirement, scenario, people=1, measurements=alone, verdict=verdict
        )
        stored = result_of_attempt(attempt, requirement)
        assert (stored.violations, stored.arrived, stored.failed) == (each.violations, each.arrived, each.failed)


def test_a_run_names_its_variant_and_one_that_is_refused_is_a_failure() -> None:
    measuring, world = Evaluator([REQUIREMENT, NEAR]), warehouse()
    with Runner() as runner:
        made, refused = (
            runner.submit(RunRequest(a_scenario(), 1, world=world, simulator=spec, measuring=measuring)).result()
            for spec in (Spec("kinematic"), Spec("kinematic", {"wheels": 5}))
        )
    assert isinstance(refused, Failure) and isinstance(made, FinishedRun)
    with Runner(KinematicSimulator(), world, measuring=measuring) as runner:
        assert runner.submit(RunRequest(a_scenario(), 1)).result() == made
