"""How closely the built-in stacks follow a real Nav2 on the same scenarios.

    python benchmarks/nav2_agreement.py [--scenarios FILE.json ...] [--runs 10] [--stacks nav2-dwb nav2-rpp]
        [--stack-option NAME=VALUE ...] [--json FILE]

It needs a Nav2 that `rvsg ros2 check` finds usable, or `--stack-option launch=...`; without one it says so and ends
with code 3. Without `--scenarios` it drives the five routes of the warehouse without people.

For every scenario and stack: path RMS (m) between mean paths by travelled share, duration, recoveries, share that did
not reach the goal, and the same between two halves of Nav2's own runs. Over all scenarios: rank correlation of the
mean duration and of the mean smallest distance to people, and a Kolmogorov-Smirnov test of the durations.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

SAMPLES = 100
NO_NAV2 = 3


def main() -> int:
    """Measure, print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenarios", nargs="*", type=Path, default=[])
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--stacks", nargs="*", default=["nav2-dwb", "nav2-rpp"])
    parser.add_argument("--stack-option", action="append", default=[])
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()

    import rvsg
    from rvsg.api.errors import RvsgError
    from rvsg.cli.options import pairs

    options = pairs("stack", given.stack_option)
    if reason := missing(options):
        print(f"not measured: {reason}", file=sys.stderr)
        return NO_NAV2
    scenarios = [rvsg.load_scenario(path) for path in given.scenarios] or empty_routes()
    real = rvsg.Spec("ros2", options)
    table = []
    try:
        for scenario in scenarios:
            runs = {"ros2": rvsg.simulate(scenario, given.runs, stack=real, on_message=print)}
            runs |= {name: rvsg.simulate(scenario, given.runs, stack=name) for name in given.stacks}
            table.append(compared(scenario, runs))
            print(json.dumps(table[-1]))
    except RvsgError as error:
        print(f"stopped: {error}", file=sys.stderr)
    found = {"scenarios": table, "over_all": over_all(table, given.stacks)}
    print(json.dumps(found["over_all"], indent=1))
    if given.json is not None:
        given.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0


def missing(options: dict[str, Any]) -> str:
    """Return why no real Nav2 can be measured here; empty where it can."""
    from rvsg.api.errors import RvsgError
    from rvsg.api.ros2 import check_ros2

    if "launch" in options:
        return ""
    try:
        found = check_ros2(options)
    except RvsgError as error:
        return str(error)
    lacking = [each.name for each in found.findings if each.status.name == "MISSING"]
    return "" if found.is_usable else f"no usable Nav2 in DDS domain {found.domain}: {', '.join(lacking)}"


def empty_routes() -> list[Any]:
    """Return the five routes of the warehouse without people."""
    import rvsg

    world = rvsg.load_world("warehouse")
    return [rvsg.scenario(world, route.name, []) for route in world.routes]


def compared(scenario: Any, runs: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of one scenario."""
    real = list(runs["ros2"])
    rows: dict[str, Any] = {"scenario": scenario.id, "route": scenario.mission.route.name}
    rows["ros2"] = figures(real) | {"path_rms_m": path_rms(real[::2], real[1::2])}
    for name, made in runs.items():
        if name != "ros2":
            rows[name] = figures(list(made)) | {"path_rms_m": path_rms(real, list(made))}
    return rows


def figures(runs: list[Any]) -> dict[str, Any]:
    """Return durations, recoveries, failures and smallest distances of runs of one stack."""
    return {
        "durations_s": [float(run.trajectory.t[-1]) for run in runs],
        "recoveries": float(np.mean([run.recoveries for run in runs])),
        "not_reached": float(np.mean([not run.completed for run in runs])),
        "nearest_m": [nearest(run) for run in runs],
    }


def nearest(run: Any) -> float | None:
    """Return the smallest distance between robot and people; None without people."""
    path = run.trajectory
    if not path.human_x.shape[1]:
        return None
    return float(np.hypot(path.human_x - path.x[:, None], path.human_y - path.y[:, None]).min())


def mean_path(runs: list[Any]) -> np.ndarray:
    """Return the mean path at equal shares of the travelled length, (SAMPLES, 2)."""
    paths = []
    for run in runs:
        x, y = run.trajectory.x, run.trajectory.y
        along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        share = np.linspace(0.0, along[-1], SAMPLES)
        paths.append(np.column_stack([np.interp(share, along, x), np.interp(share, along, y)]))
    return np.mean(paths, axis=0)


def path_rms(one: list[Any], other: list[Any]) -> float | None:
    """Return the root mean square distance of two mean paths; None where one has no run."""
    if not one or not other:
        return None
    return float(np.sqrt(((mean_path(one) - mean_path(other)) ** 2).sum(axis=1).mean()))


def over_all(table: list[dict[str, Any]], names: list[str]) -> dict[str, Any]:
    """Return rank correlations and Kolmogorov-Smirnov tests over scenarios."""
    found: dict[str, Any] = {}
    for name in names:
        pairs = [(row["ros2"], row[name]) for row in table if name in row]
        tests = [stats.ks_2samp(a["durations_s"], b["durations_s"]).pvalue for a, b in pairs]
        found[name] = {
            "scenarios": len(pairs),
            "rank_correlation_duration": correlation([(a["durations_s"], b["durations_s"]) for a, b in pairs]),
            "rank_correlation_nearest": correlation(
                [(a["nearest_m"], b["nearest_m"]) for a, b in pairs if None not in a["nearest_m"]]
            ),
            "ks_below_0.05": int(sum(value < 0.05 for value in tests)),
        }
    return found


def correlation(pairs: list[tuple[list[float], list[float]]]) -> float | None:
    """Return Spearman's correlation of means; None for fewer than three pairs."""
    if len(pairs) < 3:
        return None
    return float(stats.spearmanr([np.mean(a) for a, _ in pairs], [np.mean(b) for _, b in pairs]).statistic)


if __name__ == "__main__":
    sys.exit(main())
