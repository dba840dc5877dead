"""Time that all metrics of one run take, as JSON. `python benchmarks/metrics.py`."""

from __future__ import annotations

import json
import time

import numpy as np

from rvsg.evaluation.metrics import METRICS, measure
from rvsg.simulation.run import Outcome, Run, Trajectory
from rvsg.world.world_folder import load_world


def a_run(humans: int = 2, seconds: float = 25.0) -> Run:
    """A made-up run of usual size: 20 Hz, some humans walking about the robot."""
    rng = np.random.default_rng(1)
    t = np.arange(0.0, seconds, 0.05)
    walk = np.cumsum(rng.normal(0.0, 0.05, (2, len(t), humans)), axis=1)
    yaw = np.cumsum(rng.normal(0.0, 0.02, len(t)))
    trajectory = Trajectory(
        t=t,
        x=0.5 * t - 4.0,
        y=np.zeros(len(t)),
        yaw=yaw,
        v=np.full(len(t), 0.5),
        omega=np.gradient(yaw, t),
        acceleration=np.abs(rng.normal(0.0, 0.3, len(t))),
        human_x=walk[0],
        human_y=walk[1] + 1.0,
        human_yaw=np.cumsum(rng.normal(0.0, 0.1, walk[0].shape), axis=0),
        human_speed=np.full(walk[0].shape, 1.0),
    )
    return Run(
        scenario_id="scenario-benchmark",
        simulator="made up",
        options={},
        seed=0,
        outcome=Outcome.REACHED,
        trajectory=trajectory,
        log=trajectory,
        imu=np.abs(rng.normal(0.0, 0.3, int(seconds * 100))),
        human_names=tuple(f"Human {i + 1}" for i in range(humans)),
        human_radius_m=(0.4,) * humans,
        goal=(8.5, 0.0, 0.0),
        time_limit_s=30.0,
    )


def main() -> None:
    """Measure and print the milliseconds per run, the best of several rounds."""
    world = load_world("warehouse")
    found = {}
    for humans in (2, 10):
        run = a_run(humans)
        measure(run, world=world)
        rounds = []
        for _ in range(15):
            begun = time.perf_counter()
            measure(run, world=world)
            rounds.append((time.perf_counter() - begun) * 1000)
        found[f"{humans}_humans"] = {"best_ms": round(min(rounds), 3), "median_ms": round(float(np.median(rounds)), 3)}
    samples = len(run.trajectory)
    print(json.dumps({"metrics": len(METRICS), "samples": samples, "all_metrics_of_one_run": found}, indent=2))


if __name__ == "__main__":
    main()
