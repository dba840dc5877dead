"""Memory over many runs: `python benchmarks/soak.py --runs 20000 --jobs 2`.

One campaign, made by the front door as a user makes it, with the kinematic simulator: searching, judging, feedback,
storing, all of it. Prints one JSON object: resident memory of the campaign's own process and of each worker at the
start, in the middle and at the end, processor time of this process per run, and the size of the store. The
start is after a tenth of the runs, when everything is loaded.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

from rvsg import Campaign
from rvsg.search.execution import RunFinished


def resident_kb(pid: int | str = "self") -> int:
    """Resident memory of a process; 0 where it is gone."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("VmRSS:")), 0)


def children() -> list[int]:
    """The ids of the processes that this one started and that run now."""
    listed = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    for task in Path("/proc/self/task").iterdir():
        listed += (task / "children").read_text().split()
    return sorted({int(pid) for pid in listed})


def memory() -> dict[str, object]:
    """Resident memory of this process and of its workers."""
    return {"parent_kb": resident_kb(), "workers_kb": [resident_kb(pid) for pid in children()]}


def main() -> int:
    """Run the campaign, look at the memory on the way, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20_000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--generator", default="random")
    parser.add_argument("--strategy", default="study")
    parser.add_argument("--simulator", default="kinematic")
    options = parser.parse_args()
    wanted = {0.1: "start", 0.5: "middle", 1.0: "end"}
    looks: dict[str, dict[str, object]] = {}
    repeats = 10
    with tempfile.TemporaryDirectory() as folder:
        campaign = Campaign.create(
            Path(folder) / "soak",
            generator=options.generator,
            strategy=options.strategy,
            simulator=options.simulator,
            scenarios=options.runs // (2 * repeats),
            refinements=1,
            repeats=repeats,
            confirmations=0,
        )
        began, cpu, done = time.monotonic(), time.process_time(), 0
        for event in campaign.run(jobs=options.jobs):
            done += isinstance(event, RunFinished)
            for share, name in wanted.items():
                if name not in looks and done >= share * options.runs:
                    looks[name] = memory() | {"runs": done}
                    print(json.dumps({name: looks[name]}), file=sys.stderr, flush=True)
        looks.setdefault("end", memory() | {"runs": done})
        figures = {
            "runs": done,
            "jobs": options.jobs,
            "memory": looks,
            "parent_cpu_ms_per_run": round(1000 * (time.process_time() - cpu) / done, 2),
            "seconds": round(time.monotonic() - began),
            "store_bytes_per_run": round((Path(folder) / "soak" / "ledger.sqlite").stat().st_size / done),
        }
    print(json.dumps(figures, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
