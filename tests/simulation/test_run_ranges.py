"""Numbers of a run from a file or a foreign simulator: what is out of range is refused in one message."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import pytest
from tests.campaign.parts import WalkGenerator, plan, warehouse

from rvsg.core.errors import InputError
from rvsg.scenario.brief import Brief
from rvsg.simulation.archive import LARGEST, PackedRun, run_from_value, run_to_json
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run


@cache
def a_run() -> Run:
    brief = Brief(mission=plan().mission, requirement=plan().requirement, seed=3)
    scenario = WalkGenerator().propose(brief, warehouse()).scenario
    assert scenario is not None
    return KinematicSimulator().run(scenario, warehouse(), seed=1)


@pytest.mark.parametrize("value", [1e308, -1e308, 2 * LARGEST])
@pytest.mark.parametrize("name", json.loads(run_to_json(a_run()))["arrays"])
def test_an_array_with_a_number_out_of_range_is_refused(name: str, value: float) -> None:
    given = json.loads(run_to_json(a_run()))
    array = given["arrays"][name] or [0.0]
    place = array[-1] if isinstance(array[-1], list) else array
    place[-1] = value
    with pytest.raises(InputError, match=name):
        run_from_value(given | {"arrays": given["arrays"] | {name: array}})


OUT_OF_RANGE = [
    *(("seed", -1), ("recoveries", -1), ("clock_ratio", 1e308), ("clock_ratio", 0.0), ("robot_radius_m", 1e308)),
    *(("human_radius_m", (-1.0, 0.3)), ("goal", (1e308, 0.0, 0.0)), ("time_limit_s", 1e308), ("time_limit_s", -1.0)),
    *(("robot_latency_s", -1.0), ("robot_deceleration_m_s2", 0.0), ("robot_outline", ((1e308, 0.0),))),
]


@pytest.mark.parametrize(("field", "value"), OUT_OF_RANGE)
def test_a_field_out_of_range_is_refused_from_a_file_and_from_a_simulator(field: str, value: object) -> None:
    given = json.loads(run_to_json(a_run()))
    with pytest.raises(InputError, match=field):
        run_from_value(given | {field: value})
    with pytest.raises(InputError, match=field):
        PackedRun.of(replace(a_run(), **{field: value}))  # type: ignore[arg-type]
