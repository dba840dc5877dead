"""Speed of the embedded simulator: whole episodes on one core, set-up included.

    python benchmarks/speed.py [--json] [--episodes 10] [--humans 2 10 50] [--robot NAME|FILE] [--stack NAME]

The shipped warehouse, both lidars at full resolution, planner at 20 Hz with replanning at 1 Hz, people at 10 Hz,
trajectories at 20 Hz, default profile, warm cache. Humans walk random shortest ways over the grid. `rtf` is simulated
over wall seconds. `start_up_s` is the time from the call to the first step of a run in a warm process whose world is
new to it; `compilation_s` the first compilation into an empty cache (in a process of its own, `--compile`).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np

ROUTES = ("route_1", "route_5")


def walkers(world: Any, count: int, seed: int) -> list[Any]:
    """Return people on random shortest ways there and back, none of whom starts at the robot."""
    from rvsg.scenario.scenario import HumanAgent

    rng = np.random.default_rng(seed)
    names = sorted(world.grid.valid)
    starts = [(route.start.x, route.start.y) for route in world.routes]
    found: list[Any] = []
    while len(found) < count:
        start, end = rng.choice(names, 2, replace=False)
        way = world.grid.shortest_path(str(start), str(end))
        if way is None or len(way) < 3 or any(math.dist(world.grid.position(way[0]), at) < 1.0 for at in starts):
            continue
        names_of_way = [*way, *way[-2:0:-1]]
        goals = tuple(world.grid.position(name) for name in names_of_way)
        found.append(HumanAgent(name=f"human_{len(found)}", start=goals[0], goals=goals, pauses_s=(0.0,) * len(goals)))
    return found


def real_time_factor(world: Any, route: str, humans: int, episodes: int, robot: Any, stack: Any) -> tuple[float, float]:
    """Simulated over wall seconds, and over this process's processor seconds, of whole episodes with other seeds."""
    from rvsg.simulation.embedded.simulator import simulate_agents

    agents = walkers(world, humans, humans)
    how = {"robot": robot, "stack": stack}
    simulate_agents(world, world.route(route), agents, seed=10_000, **how)
    began, processor = time.perf_counter(), time.process_time()
    runs = (simulate_agents(world, world.route(route), agents, seed=seed, **how) for seed in range(episodes))
    simulated = sum(run.trajectory.t[-1] for run in runs)
    return simulated / (time.perf_counter() - began), simulated / (time.process_time() - processor)


def compilation_s() -> float:
    """Seconds of a first compilation, in a process with an empty cache."""
    code = "from rvsg.simulation.embedded.simulator import warm_up; print(warm_up())"
    with tempfile.TemporaryDirectory() as empty:
        environment = {**os.environ, "NUMBA_CACHE_DIR": empty}
        done = subprocess.run([sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True)
    return float(done.stdout.split()[-1])


def benchmark(humans: list[int], episodes: int, compile_first: bool, robot: Any, stack: Any) -> dict[str, Any]:
    """All figures."""
    from rvsg.simulation.embedded import simulator as embedded
    from rvsg.world.world_folder import load_world

    world = load_world("warehouse")
    warm_s = embedded.warm_up(lambda line: print(line, file=sys.stderr))
    began = time.perf_counter()
    short = world.route(ROUTES[0]).model_copy(update={"time_limit_s": 0.01})
    embedded.simulate_agents(world, short, walkers(world, 2, 2), robot=robot, seed=0)
    start_up_s = time.perf_counter() - began
    rtf: dict[str, float] = {}
    by_route: dict[str, dict[str, dict[str, float]]] = {}
    for count in humans:
        each = {route: real_time_factor(world, route, count, episodes, robot, stack) for route in ROUTES}
        by_route[str(count)] = {
            route: {"wall": round(wall, 1), "processor": round(processor, 1)}
            for route, (wall, processor) in each.items()
        }
        rtf[str(count)] = round(float(np.mean([wall for wall, _ in each.values()])), 1)
    return {
        "rtf": rtf,
        "rtf_by_route": by_route,
        "start_up_s": round(start_up_s, 3),
        "load_from_cache_s": round(warm_s, 2),
        "compilation_s": round(compilation_s(), 1) if compile_first else None,
        "memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "conditions": {
            "robot_step_s": 0.01,
            "controller_hz": 20,
            "replanning_hz": 1,
            "people_hz": 10,
            "recording_hz": 20,
            "robot": robot.name,
            "stack": stack.record.name,
            "rays": [lidar.rays for lidar in robot.lidars],
            "humans": humans,
            "episodes": episodes,
            "routes": list(ROUTES),
            "cores": 1,
            "cores_of_machine": os.cpu_count(),
            "load_average": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
            "machine": platform.machine(),
        },
    }


def main() -> int:
    """Print the figures, readable or as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--humans", type=int, nargs="+", default=[2, 10, 50])
    parser.add_argument("--compile", action="store_true", help="also time a first compilation (about a minute)")
    parser.add_argument("--robot", default="tiago_omni", help="a shipped robot or a robot file")
    parser.add_argument("--stack", default="nav2-dwb", help="the navigation stack, as for `rvsg run --stack`")
    args = parser.parse_args()
    from rvsg.robots.robot import load_robot
    from rvsg.stacks import StackChoice

    stack = StackChoice.of(args.stack)
    stack.driver.prepare(lambda _: None)
    found = benchmark(args.humans, args.episodes, args.compile, load_robot(args.robot), stack)
    if args.json:
        print(json.dumps(found, indent=2))
        return 0
    conditions = found["conditions"]
    for count, value in found["rtf"].items():
        each = ", ".join(
            f"{route} {r['wall']:.0f} ({r['processor']:.0f} per processor second)"
            for route, r in found["rtf_by_route"][count].items()
        )
        print(f"{count:>3} humans: {value:.0f} x real time ({each})")
    print(
        f"step 10 ms, controller 20 Hz, replanning 1 Hz, people 10 Hz, record 20 Hz, {conditions['robot']}, "
        f"{conditions['stack']}, {conditions['rays']} rays, "
        f"{conditions['episodes']} episodes per route, 1 core of {conditions['cores_of_machine']} "
        f"(load {conditions['load_average']})"
    )
    print(
        f"start-up {found['start_up_s']} s, kernels from the cache {found['load_from_cache_s']} s"
        + (f", first compilation {found['compilation_s']} s" if found["compilation_s"] is not None else "")
        + f", memory {found['memory_mb']} MB"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
