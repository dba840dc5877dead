"""What `rvsg tune` reaches on the suite of stacks: violated shares before and after on every check, as JSON.

python benchmarks/tuning.py nav2-dwb nav2-rpp --runs 1000 --out DIR > benchmarks/results/tuning.json
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import time
from pathlib import Path
from typing import Any

from rvsg.tune.tuner import Tuner
from rvsg.tune.tuning_page import headline, part_text

SUITE = Path(__file__).parents[1] / "examples" / "suites" / "stacks"


def measured(stack: str, given: argparse.Namespace) -> dict[str, Any]:
    """Tune a stack on a copy of the suite; return what came of it."""
    folder = given.out / stack
    suite = folder / "suite"
    if not suite.exists():
        shutil.copytree(SUITE, suite)
    cases = sorted(path.stem for path in SUITE.glob("route_*.yaml"))[:: given.every]
    begun = time.monotonic()
    found = Tuner(
        suite=suite,
        stack=stack,
        only=cases,
        out=folder / "tuning",
        narrowing=given.parameters,
        budget_runs=given.runs,
        check_runs=given.checks,
        attack_runs=given.attack,
        jobs=given.jobs,
        on_message=lambda text: print(text, file=sys.stderr),
    ).run()
    parts = {
        part.name: {
            "before": [part.before.violated, part.before.judged],
            "after": [part.after.violated, part.after.judged],
            "difference": part.difference and [part.difference.difference, *part.difference.interval],
            "contacts": [part.before.contacts, part.after.contacts],
            "more_time": part.more_time,
            "failures": part.failures,
            "text": part_text(part),
        }
        for part in found.parts
    }
    return {
        "stack": stack,
        "headline": headline(found),
        "cases": [len(found.split.tuned), len(found.split.held_out)],
        "runs_of_the_search": found.runs,
        "settings": found.settings,
        "stopped": found.stopped,
        "failed": len(found.failed),
        "changes": {each.name: [each.before, each.after] for each in found.changes},
        "parts": parts,
        "unsolved": [each.model_dump(mode="json") for each in found.unsolved],
        "wall_s": round(time.monotonic() - begun),
    }


def main() -> None:
    """Tune each stack and print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stacks", nargs="+")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--checks", type=int, default=5)
    parser.add_argument("--attack", type=int, default=90)
    parser.add_argument("--every", type=int, default=1, help="Take every n-th case.")
    parser.add_argument("--parameters", type=Path)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    budgets = {key: getattr(given, key) for key in ("runs", "checks", "attack", "every", "jobs")}
    print(json.dumps([{**measured(stack, given), "budget": budgets} for stack in given.stacks], indent=1))


if __name__ == "__main__":
    main()
