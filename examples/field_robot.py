"""A robot in the field, for trying `rvsg watch` without one: it drives its routes and leaves a recording of each drive.

    python examples/field_robot.py field --minutes 60 --params nav2_params.yaml

Every drive is simulated among people who walk at random, and written as `field/ROUTE/drive-NNN.mcap`. Half way, the
robot gets a software update: `--params` is written anew with the costmap inflation of `--update`. Point the watch
at both:

    rvsg watch suite --monitor field --stack nav2_params.yaml --out runs/watch --for 1h
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import yaml

import rvsg
from rvsg import Spec
from rvsg_exchange.formats import export

NAV2 = {
    "controller_server": {
        "ros__parameters": {"controller_plugins": ["FollowPath"], "FollowPath": {"plugin": "dwb_core::DWBLocalPlanner"}}
    }
}


def parameters(inflation_radius: float, cost_scaling_factor: float) -> str:
    """Return a short parameter file of Nav2 with this inflation in both costmaps."""
    inflation = {
        "plugin": "nav2_costmap_2d::InflationLayer",
        "inflation_radius": inflation_radius,
        "cost_scaling_factor": cost_scaling_factor,
    }
    layers = {"static": "StaticLayer", "obstacle": "ObstacleLayer"}
    maps = {
        name: {
            name: {
                "ros__parameters": {
                    "plugins": [*layers, "inflation"],
                    **{layer: {"plugin": f"nav2_costmap_2d::{kind}"} for layer, kind in layers.items()},
                    "inflation": inflation,
                }
            }
        }
        for name in ("local_costmap", "global_costmap")
    }
    return yaml.safe_dump({**NAV2, **maps}, sort_keys=False)


def drive(route: str, number: int, stack: Spec, folder: Path) -> None:
    """Drive a route once among people who walk at random, and write the recording."""
    proposal = rvsg.propose("warehouse", route, generator="random", seed=number)
    assert proposal.scenario is not None
    runs = rvsg.simulate(proposal.scenario, 1, stack=stack)
    target = folder / route / f"drive-{number:03}.mcap"
    target.parent.mkdir(parents=True, exist_ok=True)
    export(runs, target, "mcap")


def main() -> None:
    """Drive until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--every-s", type=float, default=90.0, help="pause between two drives")
    parser.add_argument("--params", type=Path, default=Path("nav2_params.yaml"))
    parser.add_argument("--update", type=float, nargs=2, default=(1.5, 1.5), metavar=("RADIUS", "FACTOR"))
    parser.add_argument("--route", action="append", help="repeat it for several")
    asked = parser.parse_args()
    routes = asked.route or ["route_1", "route_2"]
    asked.params.write_text(parameters(0.55, 3.0), encoding="utf-8")
    begin, updated, number = time.monotonic(), False, 0
    while (passed := (time.monotonic() - begin) / 60.0) < asked.minutes:
        if passed >= asked.minutes / 2 and not updated:
            asked.params.write_text(parameters(*asked.update), encoding="utf-8")
            updated = True
        drive(routes[number % len(routes)], number, Spec(str(asked.params)), asked.folder)
        number += 1
        time.sleep(asked.every_s)


if __name__ == "__main__":
    main()
