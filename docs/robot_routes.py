"""Drive every shipped robot on every route of the warehouse and print the table for benchmarks/results/robots.md.

    python docs/robot_routes.py

Nobody is in the way; three seeds each. The route is fitted to the robot as `rvsg simulate --robot` does.
"""

from __future__ import annotations

from collections import Counter

from rvsg.core.errors import InputError
from rvsg.robots.robot import shipped_robots
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.run import Outcome
from rvsg.world.routes import fitted
from rvsg.world.world_folder import load_world

SEEDS = range(3)


def main() -> None:
    """Print the table."""
    world = load_world("warehouse")
    print("| robot | " + " | ".join(f"`{route.name}`" for route in world.routes) + " |")
    print("|---|" + "---|" * len(world.routes))
    for robot in shipped_robots().values():
        cells = []
        for route in world.routes:
            try:
                fit, _ = fitted(route, robot, world)
            except InputError as error:
                cells.append(f"refused: `{error.code}`")
                continue
            runs = [simulate_agents(world, fit, [], robot=robot, seed=seed) for seed in SEEDS]
            arrived = [float(run.trajectory.t[-1]) for run in runs if run.outcome is Outcome.REACHED]
            others = Counter(run.outcome.name.lower().replace("_", " ") for run in runs)
            del others["reached"]
            told = [f"{sum(arrived) / len(arrived):.1f} s"] if arrived else []
            told += [f"{name} in {count} of {len(runs)}" for name, count in others.items()]
            touched = sum(event.kind == "obstacle_contact" for run in runs for event in run.events)
            told += [f"{touched} contacts"] if touched else []
            cells.append(", ".join(told))
        print(f"| `{robot.name}` | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
