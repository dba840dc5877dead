"""The published study's runs as the fidelity benchmark reads them: configurations and logged metrics."""

from __future__ import annotations

import csv
import math
import statistics
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

from rvsg.core.errors import InputError
from rvsg.core.records import Pose
from rvsg.scenario.scenario import HUNAVSIM_RADIUS_M, HumanAgent
from rvsg.world.grid import Grid
from rvsg_study.study_folder import read_people

METHODS = ("distance", "jerk", "reach", "no_req", "random")
COLUMNS = {
    "dto": "avg_distance_to_closest_person",
    "jerk": "avg_robot_jerk",
    "trg": "time_to_reach_goal",
    "rpc": "robot_on_person_collision",
    "por": "person_on_robot_collision",
    "chc": "cumulative_heading_changes",
    "pl": "path_length",
    "tnm": "time_not_moving",
    "min_distance": "minimum_distance_to_people",
}
"""Metric ids and the columns of the study's log.csv that hold them."""
FROZEN_M = 0.3
"""A human 2 that never came farther from its start was held by forces; such single runs are left out."""
EARLY_STARTS_REPEATED = 0.01
"""Of the repeated runs people began early in about 1 %, of the single ones in 21 % (`PUBLISHED_EARLY_START`)."""
STRAIGHT_ROWS = 5
MAX_V_M_S = 0.5
"""The study's velocity smoother let the robot drive this fast."""

Values = dict[str, float]


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """One configuration with its published runs: `runs` holds the metrics of each, `completed` whether it arrived.

    `clocks`: simulated over wall seconds of the runs of its session, all of one method and route; `repeated`: one of
    the scenarios that were run again and again.
    """

    key: str
    method: str
    route: str
    agents: tuple[HumanAgent, ...]
    runs: tuple[Values, ...]
    completed: tuple[bool, ...]
    clocks: tuple[float, ...] = ()
    repeated: bool = False


@dataclass(frozen=True)
class LeftOut:
    """A configuration that is not compared, and why."""

    key: str
    reason: str


def routes_in(folder: Path) -> list[str]:
    """The names of the routes that have a folder, in order."""
    return sorted({path.name for path in folder.glob("*/route_*") if path.is_dir()} | _repeated_routes(folder))


def _repeated_routes(folder: Path) -> set[str]:
    return {path.name for path in folder.glob("*_scenario/*/route_*") if path.is_dir()}


def repeated(folder: Path, routes: list[str], grid: Grid) -> Iterator[Configuration | LeftOut]:
    """The best and the worst scenarios, which were run again and again; row 0 selected them and is dropped."""
    for kind in ("best", "worst"):
        for method in METHODS:
            for route in routes:
                place = folder / f"{kind}_scenario" / method / route / "0"
                if (place / "log.csv").is_file():
                    key = f"{kind}/{method}/{route}"
                    clocks = clock_ratios(place, 1)
                    yield _configuration(place, 0, key, method, route, grid, clocks, rows=slice(1, None))


def singles(folder: Path, routes: list[str], grid: Grid) -> Iterator[Configuration | LeftOut]:
    """All configurations that were run once."""
    for method in METHODS:
        for route in routes:
            clocks = clock_ratios(folder / method / route)
            for place in sorted((folder / method / route).glob("*/"), key=lambda p: (len(p.name), p.name)):
                if not (place / "log.csv").is_file():
                    continue
                for k in range(len(_rows(place / "log.csv"))):
                    key = f"{method}/{route}/{place.name}/{k}"
                    yield _configuration(place, k, key, method, route, grid, clocks, rows=slice(k, k + 1))


def _configuration(
    place: Path, k: int, key: str, method: str, route: str, grid: Grid, clocks: tuple[float, ...], *, rows: slice
) -> Configuration | LeftOut:
    files = [path for path in sorted(place.glob(f"*_{k}.json")) if "_scenario_" not in path.name]
    if len(files) != 1:
        return LeftOut(key, f"expected one configuration file *_{k}.json, found {len(files)}")
    try:
        agents = study_agents(files[0], grid)
    except InputError as error:
        return LeftOut(key, str(error).split(": ", 1)[-1])
    found = _rows(place / "log.csv")[rows]
    log = place / f"log_{k}.csv"
    if rows.start == k and log.is_file() and _stood_still(log):
        return LeftOut(key, f"human 2 was never more than {FROZEN_M} m from its start: held by forces it cannot leave")
    return Configuration(
        key=key,
        method=method,
        route=route,
        agents=agents,
        runs=tuple({metric: float(row[column]) for metric, column in COLUMNS.items()} for row in found),
        completed=tuple(row["completed"] == "True" for row in found),
        clocks=clocks,
        repeated=rows.start == 1,
    )


def study_agents(path: Path, grid: Grid) -> tuple[HumanAgent, ...]:
    """The people of a configuration file as the study gave them to HuNavSim.

    Its decoder dropped unknown waypoints and kept the doubled ones between two tasks, where a person stands still for a
    tick. Human 2 draws its force factors at every launch. InputError where nothing is left of a person.
    """
    read = read_people(path, grid.valid)
    if read.people is None:
        raise InputError("; ".join(message for _, message in read.odd))
    found = []
    for human in read.people.humans:
        goals = tuple(grid.position(name) for task in human.tasks for name in task.path if name in grid.valid)
        if not goals:
            raise InputError(
                f"{human.name} has no waypoint that the grid knows; the study ran a stale file instead",
                code="no-waypoint",
            )
        pauses = (0.0,) * len(goals)
        found.append(
            HumanAgent(
                name=human.name, start=goals[0], goals=goals, pauses_s=pauses, factors=human.factors,
                radius_m=HUNAVSIM_RADIUS_M,
            )
        )  # fmt: skip
    return tuple(found)


@lru_cache(maxsize=64)
def clock_ratios(folder: Path, first: int = 0) -> tuple[float, ...]:
    """Simulated over wall seconds of every run logged in a folder, from log number `first` on; read off the robot's
    speed where it drives straight, since its top speed is 0.5 m per simulated second.

    The published runs are not alike: most single runs came from a machine with ratios of 0.963 and 0.985, the repeated
    ones and one method's first route from one with 0.976 and 0.990.
    """
    logs = sorted(folder.rglob("log_*.csv"), key=lambda p: (str(p.parent), int(p.stem.removeprefix("log_"))))
    ratios = [_clock_ratio(log) for log in logs if int(log.stem.removeprefix("log_")) >= first]
    return tuple(ratio for ratio in ratios if ratio is not None)


def _clock_ratio(log: Path) -> float | None:
    """The median over the intervals between two rows at full speed and hardly turning; None where these are few."""
    with log.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    found = []
    for a, b in pairwise(rows):
        if all(
            float(row["robot_speed"]) > 0.4985 and abs(float(row["robot_angular_velocity_z"])) < 0.2 for row in (a, b)
        ):
            way = math.dist((float(a["robot_x"]), float(a["robot_y"])), (float(b["robot_x"]), float(b["robot_y"])))
            found.append(way / (float(b["timestamp"]) - float(a["timestamp"])) / MAX_V_M_S)
    return statistics.median(found) if len(found) >= STRAIGHT_ROWS else None


def resting_pose(folder: Path, route: str) -> Pose | None:
    """Where the robot stood before it moved, from the first rows of the route's logs; None where none shows it at rest.

    Gazebo lets the spawned robot settle by a fraction of a micrometre (on route 1 by 0.9 mm), always the same way. It
    matters where a human starts on the very same point: the forces push it away from the robot's centre.
    """
    for log in sorted(folder.glob(f"*/{route}/*/log_*.csv")):
        with log.open(encoding="utf-8", newline="") as file:
            row = next(csv.DictReader(file), None)
        if row is not None and float(row["robot_speed"]) < 0.01:
            yaw = 2.0 * math.atan2(float(row["robot_orientation_z"]), float(row["robot_orientation_w"]))
            return Pose(x=float(row["robot_x"]), y=float(row["robot_y"]), yaw=yaw)
    return None


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return [row for row in csv.DictReader(file) if row.get("completed") in ("True", "False")]


def _stood_still(log: Path) -> bool:
    with log.open(encoding="utf-8", newline="") as file:
        points = [(float(row["worker2_x"]), float(row["worker2_y"])) for row in csv.DictReader(file)]
    return bool(points) and max(math.dist(points[0], point) for point in points) <= FROZEN_M
