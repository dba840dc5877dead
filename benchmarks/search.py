"""Compares ways of searching at an equal number of simulated runs: `python benchmarks/search.py --help`.

Every method gets the same plan (scenarios x configurations x repeats) and the same campaign seeds. What it found is
confirmed by fresh runs that took no part in the search: the confirmed mean is compared, not the selected one.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

from rvsg.api.wiring import Measuring
from rvsg.campaign.attempt import Attempt
from rvsg.campaign.confirmation import confirm
from rvsg.campaign.events import Attempted
from rvsg.campaign.loop import feedback_from, run_campaign
from rvsg.campaign.parallel import Simulations
from rvsg.campaign.parts import Parts
from rvsg.campaign.plan import Plan
from rvsg.campaign.ranking import best_attempt
from rvsg.core import plugins
from rvsg.scenario.requirements import load_requirement
from rvsg.scenario.scenario import Mission
from rvsg.store.memory import MemoryLedger
from rvsg.world.io.load import load_world
from rvsg.world.world import World


def plan_of(args: argparse.Namespace, world: World, seed: int) -> Plan:
    """What is asked of every method; a limit that is a share of the route's time limit is that of this route."""
    route = world.route(args.route)
    return Plan(
        name="benchmark",
        mission=Mission(world=args.world, world_id=world.id, route=route),
        requirement=load_requirement(args.requirement).for_time_limit(route.time_limit_s),
        humans=args.humans,
        scenarios=args.scenarios,
        refinements=args.refinements,
        repeats=args.repeats,
        max_in_flight=args.max_in_flight,
        confirmations=0,
        seed=seed,
    )


def campaign(generator: str, strategy: str, args: argparse.Namespace, seed: int, jobs: int) -> list[Attempt]:
    """All attempts of one campaign."""
    world = load_world(args.world)
    plan = plan_of(args, world, seed)
    ledger = MemoryLedger()
    measuring = Measuring(plan.requirement)
    simulator = plugins.make("simulator", "embedded", {})
    with Simulations(simulator, world, measure=measuring.measure, jobs=jobs, known=ledger.find) as simulations:
        parts = Parts(
            generator=plugins.make("generator", generator, {}),
            simulations=simulations,
            judge=measuring.judge,
            ledger=ledger,
        )
        chosen = plugins.find("strategy", strategy)(plan, feedback_from(ledger, plan, world), world)
        attempts = run_campaign(plan, chosen, parts)
        # All of the fresh runs, also where fewer would decide the verdict: what is compared here is their mean.
        unjudged = plan.replace(requirement=plan.requirement.replace(limit=None), confirmations=args.confirmations)
        best = best_attempt(attempts, plan.requirement)
        if best is None or not args.confirmations:
            return attempts
        events = confirm(unjudged, best, attempts, parts, budget=args.confirmations)
        return attempts + [event.attempt for event in events if isinstance(event, Attempted)]


def summary(attempts: list[Attempt], worse: str) -> dict[str, object]:
    """What one campaign found: best of the search, its confirmation, and the mean by configuration index."""
    sign = 1.0 if worse == "smaller" else -1.0
    search = [a for a in attempts if a.purpose == "search" and a.mean is not None]
    best = min(search, key=lambda a: sign * (a.mean or 0.0))
    confirmed = next((a for a in attempts if a.purpose == "confirmation"), None)
    steps: dict[int, list[float]] = defaultdict(list)
    for a in search:
        assert a.mean is not None
        steps[a.brief.configuration_index].append(a.mean)
    best_so_far: dict[int, list[float]] = defaultdict(list)
    for scenario in {a.brief.scenario_index for a in search}:
        values = [a.mean for a in search if a.brief.scenario_index == scenario and a.mean is not None]
        for k in range(len(values)):
            best_so_far[k].append(sign * min(sign * v for v in values[: k + 1]))
    return {
        "best": best.mean,
        "confirmed": confirmed.mean if confirmed else None,
        "mean": float(np.mean([a.mean for a in search if a.mean is not None])),
        "by_step": [float(np.mean(v)) for _, v in sorted(steps.items())],
        "best_by_step": [float(np.mean(v)) for _, v in sorted(best_so_far.items())],
        "violation": confirmed.verdict.violation_probability if confirmed and confirmed.verdict else None,
    }


def options() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("methods", nargs="*", default=["random:random", "heuristic:unguided", "heuristic:study"])
    parser.add_argument("--world", default="warehouse")
    parser.add_argument("--route", default="route_1")
    parser.add_argument("--requirement", default="R1")
    parser.add_argument("--humans", type=int, default=2)
    parser.add_argument("--scenarios", type=int, default=10)
    parser.add_argument("--refinements", type=int, default=4)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--max-in-flight", type=int, default=1)
    parser.add_argument("--confirmations", type=int, default=20)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path)
    return parser


def main() -> None:
    """Run the methods named on the command line, e.g. `random:random heuristic:study heuristic:climb`."""
    args = options().parse_args()
    worse = load_requirement(args.requirement).worse
    rows = []
    for method in args.methods:
        generator, _, strategy = method.partition(":")
        for seed in range(args.first_seed, args.first_seed + args.seeds):
            began = time.perf_counter()
            row = summary(campaign(generator, strategy or "study", args, seed, args.jobs), worse)
            rows.append({"method": method, "seed": seed, **row})
            numbers = {k: np.round(v, 3).tolist() if v is not None else None for k, v in row.items()}
            print(method, seed, numbers, f"{time.perf_counter() - began:.0f} s", flush=True)
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
