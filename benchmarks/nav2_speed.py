"""Speed at which the real Nav2 can be driven: the same scenarios at several speeds.

    python benchmarks/nav2_speed.py --launch 'ros2 launch nav2_bringup navigation_launch.py use_sim_time:=True
        params_file:={params}' [--stack nav2-dwb] [--speeds 1 4 6 8 10] [--suite FOLDER --cases NAME ...] [--runs 6]
        [--keep FILE.jsonl] [--json FILE]

Nav2 is started with the parameters of a built-in stack, scaled for the speed (`rvsg ros2 params`). Scenarios are cases
of a suite, files, or routes of the warehouse without people. A speed is kept for all its runs, also where periods are
missed. --keep keeps what is told of each run and goes on from there.

For each speed: runs that reached the goal, the speed that was reached, missed control periods, how far (m, root mean
square) the path is from that of the same seed at the first speed, simulated time, and how much of a core Nav2 and RVSG
used, getting ready included.
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
from typing import Any

import numpy as np

from nav2_agreement import Nav2, Question, asked, path, say

Row = dict[str, Any]
TOLD = ("speed", "commands", "missed_periods", "turned_back", "warnings", "fault")


def main() -> int:
    """Measure, print and write the table."""
    given = arguments()
    from rvsg_ros2.nav2_file import new_nav2_params

    file = Path(tempfile.mkdtemp(prefix="rvsg-speed-")) / f"{given.stack}.yaml"
    file.write_text(new_nav2_params(stack=given.stack, release=given.release))
    questions = asked(given)
    rows = kept(given.keep)
    done = {(row["speed_asked"], row["scenario"], row["seed"]) for row in rows}
    for speed in given.speeds:
        driven = Driven({"launch": given.launch, "params": str(file), "speed": speed})
        for question in questions:
            for seed in range(given.runs):
                if (speed, question.name, seed) not in done:
                    rows.append(driven.one(question, seed))
                    keep(given.keep, rows[-1])
        driven.close()
    names = {question.name for question in questions}
    table = summary([row for row in rows if row["scenario"] in names and row["seed"] < given.runs], given.speeds)
    print(json.dumps(table, indent=1))
    if given.json is not None:
        given.json.write_text(json.dumps({"stack": given.stack, "scenarios": sorted(names), "speeds": table}, indent=1))
    return 0


def arguments() -> argparse.Namespace:
    """Return what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--launch", required=True)
    parser.add_argument("--release", default="jazzy")
    parser.add_argument("--stack", default="nav2-dwb")
    parser.add_argument("--speeds", nargs="+", type=float, default=[1.0, 4.0, 6.0, 8.0, 10.0])
    parser.add_argument("--suite", type=Path)
    parser.add_argument("--cases", nargs="*", default=[])
    parser.add_argument("--scenarios", nargs="*", type=Path, default=[])
    parser.add_argument("--routes", nargs="*", default=[])
    parser.add_argument("--runs", type=int, default=6)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def kept(file: Path | None) -> list[Row]:
    """Return the rows of earlier runs."""
    if file is None or not file.is_file():
        return []
    return [json.loads(line) for line in file.read_text().splitlines()]


def keep(file: Path | None, row: Row) -> None:
    """Add the row of a run."""
    if file is not None:
        with file.open("a") as out:
            out.write(json.dumps(row) + "\n")


class Driven(Nav2):
    """Nav2 at one speed; it is started again where a run has lowered the speed."""

    def one(self, question: Question, seed: int) -> Row:
        """Return what there is to tell of a run."""
        self.prepare()
        nav2, own, begun = self._used(), own_time(), time.monotonic()
        run = self.run(question, seed)
        wall = time.monotonic() - begun
        told = run.details["stack"]
        row = {
            "scenario": question.name, "seed": seed, "speed_asked": self.options["speed"],
            "outcome": run.outcome.value, "reached": run.completed, "time_s": float(run.trajectory.t[-1]),
            "nav2_cores": (self._used() - nav2) / wall, "own_cores": (own_time() - own) / wall,
            **{key: told.get(key) for key in TOLD},
            "path": path(run).round(3).tolist(),
        }  # fmt: skip
        say(json.dumps({key: value for key, value in row.items() if key != "path"}))
        if "speed_of_next_runs" in told or told.get("fault"):
            self.close()
        return row

    def _used(self) -> float:
        """Return the processor time of Nav2 so far, s."""
        from rvsg_ros2.launch import marked

        session = self.stack._session
        ticks = 0
        for pid in marked(session.launched.mark) if session is not None and session.launched is not None else ():
            try:
                fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue  # it ended meanwhile
            ticks += int(fields[11]) + int(fields[12])
        return ticks / os.sysconf("SC_CLK_TCK")


def own_time() -> float:
    """Return the processor time of this process, s."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def summary(rows: list[Row], speeds: list[float]) -> list[Row]:
    """Return the figures of each speed."""
    first = {(row["scenario"], row["seed"]): row for row in rows if row["speed_asked"] == speeds[0]}
    return [of_speed([row for row in rows if row["speed_asked"] == speed], speed, first) for speed in speeds]


def of_speed(rows: list[Row], speed: float, first: dict[tuple[str, int], Row]) -> Row:
    """Return the figures of one speed."""
    told = [row for row in rows if row["commands"]]
    pairs = [(row, first[row["scenario"], row["seed"]]) for row in told if (row["scenario"], row["seed"]) in first]
    apart = [float(np.sqrt(((np.array(a["path"]) - b["path"]) ** 2).sum(axis=1).mean())) for a, b in pairs]
    missed = sum(row["missed_periods"] for row in told)
    return {
        "speed": speed, "runs": len(rows), "reached": sum(row["reached"] for row in rows),
        "failed": sum(row["fault"] is not None for row in rows),
        "speed_reached": mean([row["speed"] for row in told]),
        "missed_share": missed / max(1, missed + sum(row["commands"] for row in told)),
        "most_missed": max((row["missed_periods"] for row in told), default=0),
        "path_median_m": float(np.median(apart)) if apart else None, "path_most_m": max(apart, default=None),
        "time_difference_s": mean([a["time_s"] - b["time_s"] for a, b in pairs]),
        "turned_back": sum(row["turned_back"] for row in told),
        "nav2_cores": mean([row["nav2_cores"] for row in told]), "own_cores": mean([row["own_cores"] for row in told]),
    }  # fmt: skip


def mean(values: list[float]) -> float | None:
    """Return the mean; None of nothing."""
    return float(np.mean(values)) if values else None


if __name__ == "__main__":
    sys.exit(main())
