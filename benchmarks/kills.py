"""Kills worker processes at random moments: `python benchmarks/kills.py --kills 100`.

Campaigns run one after the other with two workers and the embedded simulator; in each, workers are killed at moments
between its start and its end (start-up, compilation or loading of kernels, a run, the writing of a result, shutdown).
Prints one JSON object: how many kills hit, hangs, and campaigns whose records differ from those of an undisturbed one.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import sys
import threading
import time
from collections import Counter
from pathlib import Path

from rvsg.core import plugins
from rvsg.findings.feedback import StoredFeedback
from rvsg.runs.attempt import Attempt, Plan
from rvsg.runs.ledger import CachedLedger, MemoryLedger
from rvsg.runs.runner import Evaluator, Runner
from rvsg.runs.worker_pool import Processes
from rvsg.scenario.requirement import load_requirement
from rvsg.scenario.scenario import Mission
from rvsg.search.execution import Parts
from rvsg.search.loop import run_campaign
from rvsg.search.strategies import StudyStrategy
from rvsg.world.world_folder import load_world


class Campaign(threading.Thread):
    """One small campaign with two workers."""

    def __init__(self, simulator: str, seed: int) -> None:
        super().__init__(daemon=True)
        world = load_world("warehouse")
        route = world.route("route_1")
        requirement = load_requirement("R1").for_time_limit(route.time_limit_s)
        mission = Mission(world=world.name, world_id=world.id, route=route)
        self.plan = Plan(
            name="kills", mission=mission, requirement=requirement, scenarios=2, refinements=1, repeats=4,
            confirmations=4, seed=seed,
        )  # fmt: skip
        self.world, self.ledger = world, MemoryLedger()
        measuring = Evaluator(requirement, world)
        self.executor = Processes(2)
        self.runner = Runner(
            plugins.make("simulator", simulator, {}),
            world,
            measuring=measuring,
            ledger=CachedLedger(self.ledger),
            executor=self.executor,
        )
        self.parts = Parts(
            generator=plugins.make("generator", "random", {}),
            runner=self.runner,
            judge=measuring.judge,
            ledger=self.ledger,
        )
        self.attempts: list[Attempt] = []

    def run(self) -> None:
        """Do all of the plan."""
        strategy = StudyStrategy(self.plan, StoredFeedback(CachedLedger(self.ledger), self.plan, self.world))
        with self.runner:
            attempts = run_campaign(self.plan, strategy, self.parts)
        self.attempts = attempts

    def workers(self) -> list[int]:
        """The ids of the worker processes that run now."""
        return [worker.process.pid for worker in list(self.executor.workers) if worker.process.poll() is None]


def main() -> int:
    """Kill, compare and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--each", type=int, default=2, help="kills in each campaign; a run survives two")
    parser.add_argument("--simulator", default="embedded")
    parser.add_argument("--hang-s", type=float, default=300.0, help="a campaign that takes longer hangs")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    calm = Campaign(options.simulator, 5)
    began = time.monotonic()
    calm.start()
    calm.join()
    lasts = time.monotonic() - began
    chance = random.Random(options.seed)
    found: Counter[str] = Counter()
    while found["hits"] < options.kills and not found["hangs"]:
        campaign = Campaign(options.simulator, 5)
        campaign.start()
        for _ in range(options.each):
            campaign.join(chance.uniform(0.0, 1.1 * lasts / options.each))
            try:
                os.kill(chance.choice(campaign.workers() or [0]) or 2**22, signal.SIGKILL)
                found["hits"] += 1
            except ProcessLookupError:
                found["misses"] += 1
        campaign.join(options.hang_s)
        found["hangs"] += campaign.is_alive()
        found["campaigns"] += 1
        found["different"] += campaign.attempts != calm.attempts
        print(dict(found), file=sys.stderr, flush=True)
    result = {"undisturbed_s": round(lasts, 1), "different": 0, "hangs": 0, **found, "script": Path(__file__).name}
    print(json.dumps(result, indent=2))
    return 1 if found["hangs"] or found["different"] else 0


if __name__ == "__main__":
    sys.exit(main())
