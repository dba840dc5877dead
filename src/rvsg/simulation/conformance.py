"""What every Simulator must do. Plug-in writers run `check_simulator(MySimulator(), scenario, world)` in a test."""

from __future__ import annotations

import json

import numpy as np

from rvsg.scenario.scenario import Scenario
from rvsg.simulation.archive import arrays_of, run_from_json, run_to_json
from rvsg.simulation.protocol import Simulator
from rvsg.simulation.run import Run, run_id
from rvsg.world.world import World


def check_simulator(simulator: Simulator, scenario: Scenario, world: World, *, repeatable: bool = True) -> None:
    """Raises AssertionError naming the first promise that is broken.

    The id of a run is known before it is made; a run names scenario and seed, has a sample for every time and a
    column for every human, only finite numbers, times that increase from 0 to at most the limit, and survives being
    written and read. Equal seeds give equal runs, bit for bit (unless not `repeatable`: a simulator in wall time).
    """
    name = simulator.name
    before = scenario.to_json()
    json.dumps(dict(simulator.options), allow_nan=False)
    runs = [simulator.run(scenario, world, seed=seed) for seed in (0, 1, 2**32 - 1)]
    assert scenario.to_json() == before, f"{name} changed the scenario it was given"
    for run, seed in zip(runs, (0, 1, 2**32 - 1), strict=True):
        expected = run_id(scenario.id, name, simulator.options, seed)
        assert run.id == expected, f"{name}: a run's name, options, scenario or seed are not those that were asked for"
        _check_run(name, run, scenario)
    if repeatable:
        assert same_run(simulator.run(scenario, world, seed=1), runs[1]), f"{name}: equal seeds give different runs"


def same_run(one: Run, other: Run) -> bool:
    """Whether two runs are equal, bit for bit."""
    a, b = arrays_of(one), arrays_of(other)
    return one.id == other.id and one.outcome is other.outcome and all(np.array_equal(a[key], b[key]) for key in a)


def _check_run(name: str, run: Run, scenario: Scenario) -> None:
    humans = scenario.people.humans
    assert run.human_names == tuple(human.name for human in humans), f"{name}: the humans are not those of the scenario"
    for what, path in (("trajectory", run.trajectory), ("log", run.log)):
        assert len(path) > 0, f"{name}: the {what} is empty; a run that ends at once still has a sample"
        assert path.human_x.shape == (len(path), len(humans)), f"{name}: {what}.human_x has shape {path.human_x.shape}"
        assert path.t[0] >= 0.0 and (np.diff(path.t) > 0).all(), f"{name}: the times of the {what} do not increase"
    limit = scenario.mission.route.time_limit_s
    assert run.trajectory.t[-1] <= limit + 5.0, (
        f"{name}: the run lasts {run.trajectory.t[-1]} s, its limit is {limit} s"
    )
    for key, array in arrays_of(run).items():
        assert np.isfinite(array).all(), f"{name}: {key} holds numbers that are not finite"
    assert same_run(run_from_json(run_to_json(run)), run), f"{name}: the run does not survive being written and read"
