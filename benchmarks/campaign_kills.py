"""Kills whole campaigns at random moments: `python benchmarks/campaign_kills.py --kills 100`.

`rvsg run` is killed (SIGKILL, the whole process group, so the workers as well) at a moment between its start and the
end of an undisturbed one, and started again, until the campaign is complete. Prints one JSON object: how many kills
hit, and how many campaigns ended with other records than the undisturbed one (compared byte for byte).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SETTINGS = """world: warehouse
route: route_1
requirement: R1
generator: heuristic
strategy: study
scenarios: 3
refinements: 2
repeats: 3
confirmations: 6
seed: 5
"""


def started(folder: Path, simulator: str, jobs: int) -> subprocess.Popen[bytes]:
    """Start or resume the campaign in a folder, in a process group of its own."""
    begun = (folder / "ledger.sqlite").exists()
    file = folder.parent / "campaign.yaml"
    file.write_text(f"{SETTINGS}simulator: {simulator}\n")
    given = ["--out", str(folder), "--jobs", str(jobs)]
    command = [sys.executable, "-m", "rvsg", "run", *([] if begun else [str(file)]), *given]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, start_new_session=True, **quiet)  # type: ignore[call-overload,no-any-return]


def records(folder: Path) -> list[tuple[str, ...]]:
    """Every attempt and run of the store, by content."""
    with contextlib.closing(sqlite3.connect(folder / "ledger.sqlite")) as store:
        attempts = store.execute("SELECT position, id FROM attempts ORDER BY position").fetchall()
        return attempts + store.execute("SELECT id, checksum FROM runs ORDER BY id").fetchall()


def main() -> int:
    """Kill, resume, compare and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--each", type=int, default=5, help="kills of each campaign")
    parser.add_argument("--simulator", default="kinematic")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    chance = random.Random(options.seed)
    found = {"kills": 0, "campaigns": 0, "different": 0, "failed": 0}
    with tempfile.TemporaryDirectory() as folder:
        calm = Path(folder) / "calm"
        began = time.monotonic()
        assert started(calm, options.simulator, options.jobs).wait() == 0
        lasts = time.monotonic() - began
        while found["kills"] < options.kills:
            campaign = Path(folder) / f"campaign-{found['campaigns']}"
            for _ in range(options.each):
                process = started(campaign, options.simulator, options.jobs)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(chance.uniform(0.0, lasts))
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGKILL)
                    found["kills"] += 1
                process.communicate()
            last = started(campaign, options.simulator, options.jobs)
            _, said = last.communicate()
            found["campaigns"] += 1
            found["failed"] += last.returncode != 0
            found["different"] += last.returncode == 0 and records(campaign) != records(calm)
            if last.returncode:
                print(said.decode(errors="replace")[-2000:], file=sys.stderr)
            print(found, file=sys.stderr, flush=True)
    print(json.dumps({"undisturbed_s": round(lasts, 1), **found}, indent=2))
    return 1 if found["different"] or found["failed"] else 0


if __name__ == "__main__":
    sys.exit(main())
