"""Cost of a campaign beyond its simulations: `python benchmarks/overhead.py [--share 1.0]`.

A default campaign (`rvsg run`) on one core, in this process, kernels compiled. Prints one JSON object in seconds of
processor time: `simulation_s` is all that the simulator's `run` takes (building the scene of a run included), `rest_s`
all else from the first event to the last (proposing, forecasts, measuring, packing, judging, feedback, the store), and
`report_s` the page at the end. `overhead` is `rest_s` over `simulation_s`. `--share 0.2` ends after that share of the
search, for a look in between.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from rvsg import Campaign
from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.runs.runner import RunMaker
from rvsg.search.execution import RunFinished
from rvsg.search.loop import FeedbackFrom
from rvsg.simulation.embedded.simulator import EmbeddedSimulator
from rvsg.store.sqlite import SqliteLedger

SPENT: Counter[str] = Counter()


def timed(owner: Any, name: str, label: str) -> None:
    """Add the processor time of a function to a label."""
    given = getattr(owner, name)

    def wrapper(*args: Any, **kwargs: Any) -> Any:
        began = time.process_time()
        try:
            return given(*args, **kwargs)
        finally:
            SPENT[label] += time.process_time() - began

    setattr(owner, name, wrapper)


def main() -> int:
    """Run the campaign and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=1.0)
    parser.add_argument("--strategy")
    options = parser.parse_args()
    timed(EmbeddedSimulator, "run", "simulation_s")
    timed(RunMaker, "finished", "measure_and_pack_s")
    timed(SqliteLedger, "append", "store_s")
    timed(HeuristicGenerator, "propose", "propose_s")
    timed(FeedbackFrom, "__call__", "feedback_s")
    settings = {"strategy": options.strategy} if options.strategy else {}
    with tempfile.TemporaryDirectory() as folder:
        campaign = Campaign.create(Path(folder) / "c", **settings)
        campaign.prepare()
        began, runs = time.process_time(), 0
        for event in campaign.run(jobs=1):
            runs += isinstance(event, RunFinished)
            if runs >= options.share * campaign.plan.search_runs and options.share < 1.0:
                break
        total, began = time.process_time() - began, time.process_time()
        if options.share >= 1.0:
            campaign.report()
        rest = total - SPENT["simulation_s"]
        figures = {
            "runs": runs,
            **{name: round(spent, 2) for name, spent in SPENT.items()},
            "rest_s": round(rest, 2),
            "report_s": round(time.process_time() - began, 2),
            "overhead": round(rest / SPENT["simulation_s"], 3),
            "rest_ms_per_run": round(1000 * rest / runs, 1),
            "simulation_ms_per_run": round(1000 * SPENT["simulation_s"] / runs, 1),
        }
    print(json.dumps(figures, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
