"""Runs of the shipped warehouse against stored ones: a change of the simulator must not change them unnoticed.

`python tests/simulation/test_golden_runs.py` writes the stored figures again, after a change that is meant to.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from rvsg.scenario.agents import HumanAgent
from rvsg.simulation.embedded.options import profile
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.run import Run
from rvsg.world.io.load import load_world
from rvsg.world.world import World

STORED = Path(__file__).with_name("golden_runs.json")
CASES = [
    f"{name}/{route}/{people}/{seed}"
    for name in ("default", "published-study")
    for route, people, seed in (("route_1", 2, 0), ("route_2", 10, 1), ("route_5", 2, 2))
]


def walkers(world: World, count: int) -> list[HumanAgent]:
    """People on random shortest ways there and back."""
    rng = np.random.default_rng(count)
    names = sorted(world.grid.valid)
    people: list[HumanAgent] = []
    while len(people) < count:
        start, end = rng.choice(names, 2, replace=False)
        way = world.grid.shortest_path(str(start), str(end))
        if way is None or len(way) < 3:
            continue
        goals = tuple(world.grid.position(name) for name in [*way, *way[-2:0:-1]])
        people.append(
            HumanAgent(name=f"human_{len(people)}", start=goals[0], goals=goals, pauses_s=(0.0,) * len(goals))
        )
    return people


def figures(run: Run) -> list[float]:
    """Samples of everything a run holds: every 40th row, and sums that no row can leave unnoticed."""
    found: list[float] = [float(len(run.trajectory)), float(len(run.log)), float(run.imu.sum())]
    for path in (run.trajectory, run.log):
        for values in vars(path).values():
            if not values.size:
                continue  # a robot that does not move sideways
            found += [float(values.sum()), *(float(value) for value in values[::40].ravel()[:60])]
    return found


def simulated(case: str) -> Run:
    name, route, people, seed = case.split("/")
    world = load_world("warehouse")
    agents = walkers(world, int(people))
    if name == "default":
        start = world.route(route).start
        agents = [agent for agent in agents if math.dist(agent.start, (start.x, start.y)) > 1.0]
    return simulate_agents(world, world.route(route), agents, options=profile(name), seed=int(seed))


@pytest.mark.parametrize("case", CASES)
def test_a_run_is_as_stored(case: str) -> None:
    stored = json.loads(STORED.read_text())[case]
    run = simulated(case)
    assert run.outcome.name == stored["outcome"]
    assert np.allclose(figures(run), stored["figures"], rtol=1e-9, atol=1e-9)


if __name__ == "__main__":
    runs = {case: simulated(case) for case in CASES}
    text = json.dumps({case: {"outcome": run.outcome.name, "figures": figures(run)} for case, run in runs.items()})
    STORED.write_text(text.replace('}, "', '},\n"') + "\n")
