"""What the values of requirements are in the shipped warehouse, from which their shipped limits were chosen.

    python benchmarks/limits.py [--requirement R1 R2 R3] [--scenarios 20] [--seeds 3] > benchmarks/results/limits.json

Of each requirement: the values of a drive through the empty warehouse on every route, among people who walk at random,
and among people whom the offline heuristic places to disturb, with the share of runs beyond the limit.
"""

from __future__ import annotations

import argparse
import json
from typing import Any

import numpy as np

import rvsg

WORLD = "warehouse"


def summary(runs: rvsg.RunSet, requirement: str, route: str, world: rvsg.World) -> list[tuple[float, bool]]:
    """The values of runs, each with whether it violates the requirement; without those that have no value."""
    judged = rvsg.load_requirement(requirement, world.route(route))
    values = rvsg.judge(runs, judged, world=world).verdict.objectives
    return [(value, judged.violated_by(value)) for value in values]


def described(pairs: list[tuple[float, bool]]) -> dict[str, Any]:
    """Range, median and the share of violations."""
    if not pairs:
        return {"runs": 0}
    values = np.array([value for value, _ in pairs])
    return {
        "runs": len(values),
        **{name: round(float(np.quantile(values, q)), 3) for name, q in (("least", 0), ("median", 0.5), ("most", 1))},
        "beyond_limit": round(float(np.mean([beyond for _, beyond in pairs])), 3),
    }


def measured(requirement: str, scenarios: int, seeds: int) -> dict[str, Any]:
    """The values of one requirement without people, among random people and among people placed to disturb."""
    world = rvsg.load_world(WORLD)
    routes = [route.name for route in world.routes]
    found: dict[str, list[tuple[float, bool]]] = {"empty": [], "random": [], "heuristic": []}
    for route in routes:
        empty = rvsg.simulate(rvsg.scenario(world, route), range(seeds), world=world)
        found["empty"] += summary(empty, requirement, route, world)
    for generator in ("random", "heuristic"):
        for number in range(scenarios):
            route = routes[number % len(routes)]
            proposal = rvsg.propose(world, route, requirement, generator=generator, seed=number)
            if proposal.scenario is not None:
                runs = rvsg.simulate(proposal.scenario, range(seeds), world=world)
                found[generator] += summary(runs, requirement, route, world)
    return {name: described(pairs) for name, pairs in found.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--requirement", nargs="+", default=["R1", "R2", "R3"])
    parser.add_argument("--scenarios", type=int, default=20)
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    print(json.dumps({name: measured(name, given.scenarios, given.seeds) for name in given.requirement}, indent=1))
