"""The names that plug-ins, scripts and other rooms rely on. Take one away only with a line in the CHANGELOG."""

import importlib

import pytest

PUBLIC = {
    "rvsg": [
        *("Campaign", "InvalidScenario", "Judgement", "Requirement", "Run", "RunSet", "RvsgError", "Scenario", "Spec"),
        *("World", "__version__", "check", "evaluate", "judge", "load_requirement", "load_runs", "load_scenario"),
        *("load_world", "propose", "scenario", "shrink", "simulate", "walk"),
    ],
    "rvsg.core.errors": [
        *("RvsgError", "InputError", "FileError", "UnknownName", "InvalidScenario", "SimulationError"),
        *("GenerationError", "ModelUnavailable", "BudgetSpent", "ReplayDiverged", "StoreError", "NewerStore"),
        "Interrupted",
    ],
    "rvsg.world.world": ["World", "Area", "Route", "SolidObject", "OccupancyMap", "OrientedBox", "Description"],
    "rvsg.world.grid": ["Grid", "Waypoint"],
    "rvsg.world.world_folder": ["load_world", "shipped_worlds"],
    "rvsg.world.drawing": ["labelled_map", "grid_picture", "png_bytes"],
    "rvsg.core.records": ["Record", "Pose", "canonical_json", "content_id"],
    "rvsg.scenario.scenario": [
        *("Mission", "HumanConfiguration", "Human", "Task", "Pause", "Behaviour", "Scenario", "HumanAgent", "decode"),
    ],
    "rvsg.scenario.requirement": ["Requirement", "load_requirement", "shipped_requirements"],
    "rvsg.scenario.brief": ["Brief", "Feedback", "Remembered", "Moment", "HumanInfluence", "Sample"],
    "rvsg.scenario.validity": ["check"],
    "rvsg.scenario.repair": ["repair"],
    "rvsg.scenario.rules": ["Finding", "Repair"],
    "rvsg.generation.generator": ["Generator", "Proposal", "Call"],
    "rvsg.simulation.run": ["Run", "Trajectory", "Outcome", "run_id"],
    "rvsg.simulation.simulators": ["Simulator"],
    "rvsg.simulation.archive": ["run_to_json", "run_from_json", "PackedRun", "unpack"],
    "rvsg.testing": ["check_simulator"],
    "rvsg.evaluation.metrics": ["METRICS", "measure", "metric"],
    "rvsg.evaluation.verdict": ["Verdict", "Status", "judge", "objective"],
    "rvsg.runs.attempt": ["Attempt", "Measurement", "Failure", "Plan"],
    "rvsg.runs.ledger": ["Ledger"],
    "rvsg.search.loop": ["run_campaign", "stream_campaign"],
    "rvsg.findings.feedback": ["feedback_of"],
    "rvsg.search.strategies": [
        *("Strategy", "StudyStrategy", "UnguidedStrategy", "RandomStrategy"),
        *("check_strategy", "check_ledger"),
    ],
    "rvsg.store.sqlite": ["SqliteLedger"],
    "rvsg.report.page": ["render_page"],
    "rvsg.cli": ["main", "VERBS"],
}


@pytest.mark.parametrize("module", sorted(PUBLIC))
def test_a_public_name_stays(module: str) -> None:
    found = importlib.import_module(module)
    assert [name for name in PUBLIC[module] if not hasattr(found, name)] == []
