"""Writes small result folders in the published study's layout."""

from __future__ import annotations

import csv
import json

import numpy as np
from tests.evaluation.runs import run_of

from rvsg.evaluation.metrics import measure
from rvsg.simulation.run import Outcome
from rvsg_study.study_folder import LOGGED
from rvsg_study.study_format import read_log


def configuration(*paths):
    """Each human walks one task along a path."""
    return {
        f"Worker {n} Tasks": [{"Task": f"{path[0]} → {path[-1]}", "Start": path[0], "End": path[-1], "Path": path}]
        for n, path in enumerate(paths, 1)
    }


def write_log(path, *, rows=6, offset=0.0, completed=True, workers=2):
    """A robot driving along x while the humans stand at y = 1, 2, ... (moved by `offset`)."""
    header = [
        *("timestamp", "robot_x", "robot_y", "robot_orientation_z", "robot_orientation_w", "robot_speed"),
        *("robot_angular_velocity_z", "robot_acceleration"),
    ]
    for n in range(1, workers + 1):
        header += [f"worker{n}_{part}" for part in ("x", "y", "orientation_z", "orientation_w", "speed")]
    header.append("completed")
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        for k in range(rows):
            row = [0.5 * k, 0.25 * k, 0.0, 0.0, 1.0, 0.5, 0.0, 0.1 * (k % 2)]
            for n in range(1, workers + 1):
                row += [0.3 * n, n + offset, 0.0, 1.0, 0.2]
            writer.writerow([*row, completed and k == rows - 1])


def write_logged(folder, *, goal=(1.75, -8.6, 4.5), limit=25.0):
    """`log.csv` with what the logs of the folder really give."""
    with (folder / "log.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["experiment_tag", *LOGGED, "completed"])
        for path in sorted(folder.glob("log_*.csv")):
            series, completed = read_log(path)
            outcome = Outcome.REACHED if completed else Outcome.TIMED_OUT
            values = measure(run_of(series, outcome=outcome, goal=goal, time_limit_s=limit), LOGGED.values())
            number = path.stem.removeprefix("log_")
            writer.writerow([f"0_{number}", *(repr(values[m]) for m in LOGGED.values()), completed])


def write_scenario(folder, *, description="People carry boxes.", configurations=1, requirement="distance", **log):
    """One scenario folder with its configurations, logs and `log.csv`."""
    folder.mkdir(parents=True)
    people = configuration(["G7", "G8", "G9"], ["G14", "G13"])
    listed = {"Worker 1": ["G7 → G9"], "Worker 2": ["G14 → G13"]}
    (folder / f"{requirement}_scenario_model.json").write_text(
        json.dumps({"scenario": description} | {f"scenario_{k}": listed for k in range(configurations)})
    )
    for k in range(configurations):
        (folder / f"{requirement}_model_{k}.json").write_text(json.dumps(people))
        write_log(folder / f"log_{k}.csv", offset=0.1 * k + log.get("offset", 0.0))
    write_logged(folder)
    return folder


def lines_of(path):
    """The rows of a CSV file, to edit and write back with `put`."""
    with path.open(newline="") as file:
        return list(csv.reader(file))


def put(path, lines):
    """Write rows back."""
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(lines)


def random_walk(seed, rows=30):
    """(rows, 6) wandering positions."""
    return np.cumsum(np.random.default_rng(seed).normal(size=(rows, 6)), axis=0)
