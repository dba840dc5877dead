"""Runs the published configurations in the embedded simulator, in parallel."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache, lru_cache
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from published_runs import EARLY_STARTS_REPEATED, FROZEN_M, Configuration, Values, resting_pose
from published_world import published_world
from rvsg.core.errors import InputError
from rvsg.evaluation.metrics import measure
from rvsg.simulation.embedded.profiles import profile
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.world.world import Route, World

METRICS = ("dto", "por", "trg", "rpc", "chc", "pl", "jerk", "tnm", "min_distance")

Results = dict[str, list[Values]]


@lru_cache(maxsize=2)
def world_of(folder: Path) -> World:
    """The study's world for a folder of published results, loaded once per process."""
    return published_world(map_folder(folder))


def map_folder(folder: Path) -> Path:
    """Where `maps/study_warehouse.yaml`, the map that the study's robot used, lies: beside the results if possible.

    Else the folder that RVSG_PUBLISHED_DATA names, else `shared/data` beside or above this checkout.
    """
    places = [folder.parent, folder]
    if "RVSG_PUBLISHED_DATA" in os.environ:
        places.append(Path(os.environ["RVSG_PUBLISHED_DATA"]))
    places += [parent / "shared" / "data" for parent in Path(__file__).resolve().parents]
    for place in places:
        if (place / "maps" / "study_warehouse.yaml").is_file():
            return place
    raise InputError(
        f"the study's map, maps/study_warehouse.yaml, is needed; it lies neither beside {folder} nor in "
        "$RVSG_PUBLISHED_DATA nor in shared/data above this checkout"
    )


@lru_cache(maxsize=16)
def route_of(folder: Path, name: str) -> Route:
    """The route with the robot where its logs show it at rest before the start."""
    route = world_of(folder).route(name)
    pose = resting_pose(folder, name)
    return route if pose is None else route.model_copy(update={"start": pose})


def seed_of(key: str, index: int, seed: int = 0) -> int:
    """The seed of one repeat of one configuration: a hash, so that no two configurations share their noise."""
    name = f"{key}#{index}" + (f"#{seed}" if seed else "")
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "little")


def simulate(folder: Path, configuration: Configuration, repeats: Sequence[int], seed: int = 0) -> list[Values]:
    """Metrics of fresh runs of one configuration, as the study's client would have logged them.

    `frozen` says that human 2 stayed where it began; of the published single runs such ones are left out.
    """
    world = world_of(folder)
    route = route_of(folder, configuration.route)
    found = []
    for index in repeats:
        options = profile("published-study", settling_m=(0.0, 0.0), **session_of(configuration, index, seed))
        run = simulate_agents(
            world,
            route,
            configuration.agents,
            options=options,
            seed=seed_of(configuration.key, index, seed),
            scenario_id=configuration.key,
        )
        values = measure(run, [*(f"{name}_logged" for name in METRICS), "expected_jerk"])
        known = {name.removesuffix("_logged"): math.nan if v is None else v for name, v in values.items()}
        x, y = run.log.human_x[:, 1:2], run.log.human_y[:, 1:2]
        frozen = x.size > 0 and bool((np.hypot(x - x[0], y - y[0]) <= FROZEN_M).all())
        found.append({**known, "completed": float(run.completed), "frozen": float(frozen)})
    return found


def session_of(configuration: Configuration, index: int, seed: int = 0) -> dict[str, float]:
    """Options of the machine that ran a configuration: for each repeat the clock of one of its session's runs."""
    options: dict[str, float] = {"human_early_start": EARLY_STARTS_REPEATED} if configuration.repeated else {}
    if configuration.clocks:
        drawn = configuration.clocks[seed_of(f"{configuration.key}/clock", index, seed) % len(configuration.clocks)]
        options |= {"clock_ratio": drawn, "clock_ratio_sd": 0.0, "clock_slow_share": 0.0}
    return options


@cache
def _pool(jobs: int) -> ProcessPoolExecutor:
    """Return worker processes, kept for the next call."""
    return ProcessPoolExecutor(jobs, mp_context=get_context("spawn"))


def simulate_all(
    folder: Path, configurations: Sequence[Configuration], repeats: int, jobs: int, seed: int = 0
) -> Results:
    """`simulate` for many, in parallel; the results do not depend on `jobs`."""
    if jobs <= 1:
        return {c.key: simulate(folder, c, range(repeats), seed) for c in configurations}
    executor = _pool(jobs)
    chunks = [(c, range(at, min(at + 8, repeats))) for c in configurations for at in range(0, repeats, 8)]
    futures = [executor.submit(simulate, folder, c, chunk, seed) for c, chunk in chunks]
    results: Results = {c.key: [] for c in configurations}
    for (configuration, _), future in zip(chunks, futures, strict=True):
        results[configuration.key] += future.result()
    return results
