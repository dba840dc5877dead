"""Measures what runs cost the campaign's own process: `python benchmarks/load.py --runs 2000 --jobs 4`.

Workers make runs with a simulator that only sleeps, so that all processor time of this process is overhead: handing
out tasks, receiving results, storing them. Prints one JSON object: processor time, memory and store size per run, and
how far the throughput is from that of the sleeping workers alone.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
import time
from pathlib import Path

from rvsg.campaign.measuring import FinishedRun, Measuring
from rvsg.campaign.parallel import PendingRun, Simulations
from rvsg.core import plugins
from rvsg.core.seeds import seed_for
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirements import load_requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.store.sqlite import SqliteLedger
from rvsg.world.io.load import load_world
from rvsg.world.world import World


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


def main() -> int:
    """Make the runs and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--jobs", type=int, default=4)
    parser.add_argument("--sleep-s", type=float, default=0.05)
    parser.add_argument("--simulator", help="instead of sleeping, this one")
    options = parser.parse_args()
    world = load_world("warehouse")
    route = world.route("route_1")
    requirement = load_requirement("R1").for_time_limit(route.time_limit_s)
    mission = Mission(world=world.name, world_id=world.id, route=route)
    generator = plugins.make("generator", "random", {})
    scenario = generator.propose(Brief(mission=mission, requirement=requirement, seed=1), world).scenario
    assert scenario is not None
    simulator = plugins.make("simulator", options.simulator, {}) if options.simulator else Sleeping(options.sleep_s)
    measuring = Measuring(requirement, world)
    warm = min(4 * options.jobs, options.runs // 4)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ledger.sqlite"
        with (
            SqliteLedger(path) as ledger,
            Simulations(
                simulator, world, measure=measuring.measure, jobs=options.jobs, known=ledger.find
            ) as simulations,
        ):
            pending: list[PendingRun] = []
            began, cpu, memory = time.monotonic(), time.process_time(), memory_kb()
            for number in range(options.runs + warm):
                pending.append(simulations.submit(scenario, seed_for(7, "load", number)))
                if len(pending) > 5 * options.jobs:
                    keep(pending.pop(0), ledger)
                if number == warm:
                    began, cpu, memory = time.monotonic(), time.process_time(), memory_kb()
            for each in pending:
                keep(each, ledger)
            took, used, grown = time.monotonic() - began, time.process_time() - cpu, memory_kb() - memory
        size = path.stat().st_size
    figures = {
        "runs": options.runs,
        "jobs": options.jobs,
        "cores": os.cpu_count(),
        "parent_cpu_ms_per_run": round(1000 * used / options.runs, 3),
        "parent_memory_growth_kb_per_1000_runs": round(1000 * grown / options.runs, 1),
        "parent_memory_kb": memory_kb(),
        "store_bytes_per_run": round(size / (options.runs + warm)),
        "runs_per_s": round(options.runs / took, 1),
    }
    if not options.simulator:
        figures["share_of_ideal_throughput"] = round(options.runs / took * options.sleep_s / options.jobs, 3)
    print(json.dumps(figures, indent=2))
    return 0


def keep(pending: PendingRun, ledger: SqliteLedger) -> None:
    """Wait for a run and store it."""
    found = pending.result()
    assert isinstance(found, FinishedRun)
    ledger.keep(found.packed)


if __name__ == "__main__":
    sys.exit(main())
