"""Damages inputs for some minutes: `python -m tests.fuzz --minutes 10 [--kind runs] [--seed 5]`.

Prints one JSON object; exit code 1 where there is a finding. The files of each stand in --keep.
"""

from __future__ import annotations

import argparse
import itertools
import json
import resource
import sys
import time
from collections import Counter
from pathlib import Path

from tests.fuzz.harness import BY_NAME, run_case


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--kind", action="append", choices=list(BY_NAME))
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings"))
    options = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_DATA, (4_000_000_000, 4_000_000_000))
    end = time.monotonic() + 60 * options.minutes
    cases: Counter[str] = Counter()
    findings: list[dict[str, object]] = []
    known: set[str] = set()
    for seed in itertools.count(options.seed):
        for name in options.kind or BY_NAME:
            if time.monotonic() > end:
                print(json.dumps({"cases": dict(cases), "next_seed": seed, "findings": findings}, indent=2))
                return 1 if findings else 0
            outcome = run_case(name, seed, keep=options.keep)
            cases[name] += 1
            last = outcome.finding.strip().splitlines()[-1:] or [""]
            place = [line for line in outcome.finding.splitlines() if line.startswith("  File")][-1:]
            key = f"{name} {place} {last[0][:40]}"
            if outcome.finding and key not in known:
                known.add(key)
                findings.append({"kind": name, "seed": seed, "finding": last[0][:300]})
                print(f"{name} {seed}: {place} {last[0][:300]}", file=sys.stderr, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
