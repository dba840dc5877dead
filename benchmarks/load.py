"""Measures what runs cost the campaign's own process: `python benchmarks/load.py --runs 2000 --jobs 4`.

Workers make runs with a simulator that only sleeps, so that all processor time of this process is overhead: handing
out tasks, receiving results, storing them. Prints one JSON object: processor time of this process and of the workers,
memory and store size per run, and how far the throughput is from that of the sleeping workers alone. With several
numbers, `--jobs 1 2 4 8 16 32 --sleep-s 1`, one object for each.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
import time
from collections import deque
from pathlib import Path

from rvsg.core import plugins
from rvsg.core.seeds import seed_for
from rvsg.runs.ledger import CachedLedger
from rvsg.runs.runner import Evaluator, FinishedRun, PendingRun, Runner, RunRequest
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import load_requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.store.sqlite import SqliteLedger
from rvsg.world.world import World
from rvsg.world.world_folder import load_world


class Sleeping(KinematicSimulator):
    """Sleeps, and returns the same run under another seed."""

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self.seconds = seconds
        self._kept: Run | None = None

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        """Sleep, then answer."""
        time.sleep(self.seconds)
        if self._kept is None:
            self._kept = super().run(scenario, world, seed=0)
        fields = {name: getattr(self._kept, name) for name in self._kept.__dataclass_fields__}
        return Run(**fields | {"seed": seed})


def memory_kb() -> int:
    """Resident memory of this process."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def workers_s() -> float:
    """Processor time that the workers used so far, s."""
    ids = [pid for task in Path("/proc/self/task").iterdir() for pid in (task / "children").read_text().split()]
    fields = [Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for pid in set(ids)]
    return sum(int(field[11]) + int(field[12]) for field in fields) / os.sysconf("SC_CLK_TCK")


def main() -> int:
    """Make the runs and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, help="by default 2000, or 12 per worker where there are several --jobs")
    parser.add_argument("--jobs", type=int, nargs="+", default=[4])
    parser.add_argument("--sleep-s", type=float, default=0.05)
    parser.add_argument("--simulator", help="instead of sleeping, this one")
    options = parser.parse_args()
    found = []
    for jobs in options.jobs:
        runs = options.runs or (2000 if len(options.jobs) == 1 else 12 * jobs)
        found.append(measured(jobs, runs, options.sleep_s, options.simulator))
        print(json.dumps(found[-1], indent=2 if len(options.jobs) == 1 else None), flush=True)
    return 0


def measured(jobs: int, runs: int, sleep_s: float, name: str | None) -> dict[str, object]:
    """Make runs with so many workers and return the figures."""
    world = load_world("warehouse")
    route = world.route("route_1")
    requirement = load_requirement("R1").for_time_limit(route.time_limit_s)
    mission = Mission(world=world.name, world_id=world.id, route=route)
    generator = plugins.make("generator", "random", {})
    scenario = generator.propose(Brief(mission=mission, requirement=requirement, seed=1), world).scenario
    assert scenario is not None
    simulator = plugins.make("simulator", name, {}) if name else Sleeping(sleep_s)
    measuring = Evaluator(requirement, world)
    warm = 2 * jobs
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ledger.sqlite"
        with (
            SqliteLedger(path) as ledger,
            Runner(simulator, world, measuring=measuring, jobs=jobs, ledger=CachedLedger(ledger)) as runner,
        ):
            for each in [runner.submit(RunRequest(scenario, seed_for(7, "warm", number))) for number in range(warm)]:
                keep(each, ledger)
            pending: deque[PendingRun] = deque()
            began, cpu, memory, working = time.monotonic(), time.process_time(), memory_kb(), workers_s()
            for number in range(runs):
                pending.append(runner.submit(RunRequest(scenario, seed_for(7, "load", number))))
                if len(pending) > 5 * jobs:
                    keep(pending.popleft(), ledger)
            for each in pending:
                keep(each, ledger)
            took, used, grown = time.monotonic() - began, time.process_time() - cpu, memory_kb() - memory
            worked = workers_s() - working
        size = path.stat().st_size
    figures: dict[str, object] = {
        "runs": runs,
        "jobs": jobs,
        "cores": os.cpu_count(),
        "parent_cpu_ms_per_run": round(1000 * used / runs, 3),
        "worker_cpu_ms_per_run": round(1000 * worked / runs, 1),
        "parent_memory_growth_kb_per_1000_runs": round(1000 * grown / runs, 1),
        "parent_memory_kb": memory_kb(),
        "store_bytes_per_run": round(size / (runs + warm)),
        "runs_per_s": round(runs / took, 2),
        "runs_per_hour_by_processor_time": round(3600 * (os.cpu_count() or 1) / ((used + worked) / runs)),
    }
    if not name:
        figures["share_of_ideal_throughput"] = round(runs / took * sleep_s / jobs, 3)
    return figures


def keep(pending: PendingRun, ledger: SqliteLedger) -> None:
    """Wait for a run and store it."""
    found = pending.result()
    assert isinstance(found, FinishedRun)
    ledger.keep(found.packed)


if __name__ == "__main__":
    sys.exit(main())
