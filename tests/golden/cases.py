"""Golden runs and campaigns: cases, and hashes of what they record.

`python -m tests.golden.cases` simulates every case and writes `runs.json` and `campaigns.json`; do so only for a change
that is meant to alter recorded results, and say why in the commit. A hash covers every number of a run as it is stored,
its events and details and its content id, or every attempt of a campaign in order and all its runs.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from tests.recordings import FOLDERS

import rvsg
from rvsg.robots.robot import Robot, load_robot

HERE = Path(__file__).parent
NAV2_FILE = str(HERE.parents[1] / "examples" / "stacks" / "nav2_params.yaml")

ROUTES = {
    "warehouse": ("route_1", "route_2", "route_3", "route_4", "route_5"),
    "hospital": ("route_1", "route_2", "route_3"),
    "office": ("route_1", "route_2", "route_3"),
}
# robot, stack, people, profile
SETTINGS = (
    ("tiago_omni", "nav2-dwb-humble", 0, "hunavsim"),
    ("tiago_omni", "nav2-dwb-humble", 2, "hunavsim"),
    ("tiago_omni", "nav2-dwb-humble", 6, "hunavsim"),
    ("tiago_omni", "nav2-dwb-humble", 12, "hunavsim"),
    ("tiago_omni", "nav2-dwb-humble", 2, "published-study"),
    ("tiago_omni", "nav2-dwb-humble", 5, "published-study"),
    ("tiago_omni", "nav2-dwb-humble", 12, "published-study"),
    ("tiago_omni", "nav2-rpp", 3, "published-study"),
    ("tiago_omni", "nav2-rpp", 4, "hunavsim"),
    ("tiago_omni", "nav2-mppi", 3, "hunavsim"),
    ("tiago_omni", "social", 3, "hunavsim"),
    ("tiago_omni", "stop-and-go", 3, "hunavsim"),
    ("tiago_omni", NAV2_FILE, 3, "hunavsim"),
    ("turtlebot3_waffle", "nav2-dwb-humble", 3, "hunavsim"),
    ("turtlebot3_waffle", "nav2-mppi", 2, "hunavsim"),
    ("turtlebot3_waffle", "nav2-rpp", 8, "hunavsim"),
    ("industrial_amr", "nav2-dwb-humble", 3, "hunavsim"),
    ("industrial_amr", "stop-and-go", 5, "hunavsim"),
    ("tugger", "nav2-dwb-humble", 2, "hunavsim"),
    ("tugger", "social", 4, "hunavsim"),
    ("tiago_omni", "nav2-dwb-humble", 3, "default"),
    ("tiago_omni", "nav2-mppi", 6, "default"),
    ("industrial_amr", "nav2-rpp", 12, "default"),
    ("tiago_omni", "nav2-dwb", 6, "default"),
    ("turtlebot3_waffle", "nav2-dwb", 3, "default"),
)
BEHAVIOURS = ("regular", "impassive", "surprised", "scared", "curious", "threatening")

_SMALL = {"scenarios": 2, "refinements": 2, "repeats": 3, "confirmations": 20, "shrink_runs": 20, "jobs": 1}
CAMPAIGNS: dict[str, dict[str, Any]] = {
    "hybrid": {**_SMALL, "strategy": "hybrid", "seed": 1},
    "hybrid-three-people-R3": {**_SMALL, "strategy": "hybrid", "requirement": "R3", "humans": 3, "route": "route_3"},
    "study": {**_SMALL, "strategy": "study", "seed": 2, "route": "route_4"},
    "study-published-profile": {
        **_SMALL,
        "strategy": "study",
        "requirement": "R2",
        "simulator_options": {"profile": "published-study"},
    },
    "unguided": {**_SMALL, "strategy": "unguided", "world": "office"},
    "random": {**_SMALL, "strategy": "random", "robot": "turtlebot3_waffle", "world": "hospital"},
    "multi": {**_SMALL, "strategy": "multi", "also": ["R3"], "scenarios": 4},
    "kinematic": {**_SMALL, "strategy": "study", "simulator": "kinematic", "scenarios": 4, "max_in_flight": 3},
    "pure-pursuit": {**_SMALL, "stack": "nav2-rpp", "route": "route_5", "requirement": "R3", "search_anyway": True},
    "replay-R1": {"demo": "warehouse-route_1-R1"},
    "replay-R3-draws": {"demo": "warehouse-route_3-R3-draws"},
}


def run_cases() -> list[str]:
    """Return the names of all runs, e.g. `office/route_2/tugger/social/4/default`."""
    return [
        "/".join((world, route, robot, Path(stack).name, str(people), profile))
        for world, routes in ROUTES.items()
        for route in routes
        for robot, stack, people, profile in SETTINGS
    ]


def run_hash(case: str) -> str:
    """Simulate a case and return the hash of the run, or why there is none."""
    world_name, route, robot, stack, people, profile = case.split("/")
    scenario = scenario_of(world_name, route, robot, int(people), seed=people_seed(case))
    if scenario is None:
        return "refused: the robot does not fit"
    given = NAV2_FILE if stack == Path(NAV2_FILE).name else stack
    simulator = rvsg.Spec("embedded", {"profile": profile})
    [run] = rvsg.simulate(scenario, [int(people) + int(route[-1])], simulator=simulator, stack=given)
    return digest_of_run(run)


def people_seed(case: str) -> int:
    """Return the seed of a case's people: that of the time when `hunavsim` and `nav2-dwb-humble` were the defaults."""
    return len(case.replace("hunavsim", "default").replace("-humble", "")) + int(case.split("/")[1][-1])


def scenario_of(world_name: str, route: str, robot: str, people: int, seed: int) -> rvsg.Scenario | None:
    """People on shortest ways between random waypoints, of all behaviours, some late, some pausing, some in a group."""
    world = rvsg.load_world(world_name)
    chance = np.random.default_rng(seed)
    names = sorted(world.grid.valid)
    driven: str | Robot = robot
    if robot == "turtlebot3_waffle":  # recorded before its footprint was the radius of its Nav2 file
        waffle = load_robot(robot)
        driven = waffle.replace(footprint=waffle.outline, body=None)
    try:
        scenario = rvsg.scenario(world, route, robot=driven)
    except rvsg.InvalidScenario:
        return None
    known: list[tuple[list[str], dict[str, Any]]] = []
    for _ in range(1000):
        if len(known) == people:
            break
        stops = [str(name) for name in chance.choice(names, int(chance.integers(2, 4)), replace=False)]
        how = {
            "behaviour": BEHAVIOURS[len(known) % len(BEHAVIOURS)],
            "speed_m_s": round(float(chance.uniform(0.8, 1.5)), 2),
            "start_delay_s": float(chance.integers(0, 3)),
            "pauses_s": {stops[1]: 3.0} if len(known) % 3 == 1 else None,
        }
        asked = [*known, (stops, how)]
        grouped = people >= 6 and len(asked) > 1  # the first two walk together
        walks = [
            rvsg.walk(f"human {k + 1}", *stops, **how, group=1 if grouped and k < 2 else None)
            for k, (stops, how) in enumerate(asked)
        ]
        try:
            scenario = rvsg.scenario(world, route, walks, robot=driven)
        except rvsg.InvalidScenario:
            continue
        known = asked
    return scenario


def digest_of_run(run: rvsg.Run) -> str:
    """Return the hash of everything a run holds."""
    digest = hashlib.sha256()
    for part in (run.trajectory, run.log):
        for field in sorted(fields(part), key=lambda field: field.name):
            digest.update(np.ascontiguousarray(getattr(part, field.name), dtype=np.float64).tobytes())
    digest.update(np.ascontiguousarray(run.imu, dtype=np.float64).tobytes())
    rest = [
        run.id,
        run.outcome.value,
        run.clock_ratio,
        run.human_names,
        run.recoveries,
        run.goal,
        run.time_limit_s,
        run.details,
        [event.model_dump(mode="json") for event in run.events],
    ]
    digest.update(json.dumps(rest, sort_keys=True, default=str).encode())
    return digest.hexdigest()[:16]


def campaign_hash(name: str) -> str:
    """Run a campaign in a temporary folder and return the hash of all its attempts and runs."""
    settings = dict(CAMPAIGNS[name])
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "campaign"
        campaign = _replayed(settings["demo"], out) if "demo" in settings else rvsg.Campaign.create(out, **settings)
        for _ in campaign.run(jobs=1):
            pass
        return digest_of_campaign(campaign)


def _replayed(demo: str, out: Path) -> rvsg.Campaign:
    from rvsg.app.settings import read_campaign_file

    folder = FOLDERS[demo]
    file = read_campaign_file(folder / "campaign.yaml")
    return rvsg.Campaign.create(out, file=file, replay=str(folder))


def digest_of_campaign(campaign: rvsg.Campaign) -> str:
    """Return the hash of the attempts in order and of all runs."""
    digest = hashlib.sha256()
    for attempt in campaign.attempts():
        record = attempt.model_dump(mode="json")
        for call in record["proposal"].get("calls", ()):
            call.pop("duration_s", None)  # wall time
        digest.update(json.dumps(record, sort_keys=True).encode())
    digest.update("".join(sorted(digest_of_run(run) for run in campaign.runs())).encode())
    return digest.hexdigest()[:16]


def stored(kind: str) -> dict[str, str]:
    """Return the stored hashes of `runs` or `campaigns` by case."""
    return dict(json.loads((HERE / f"{kind}.json").read_text()))


def computed(hash_of: Callable[[str], str], cases: Iterable[str], jobs: int = 2) -> dict[str, str]:
    """Return the hashes of cases, worked out in several processes."""
    names = list(cases)
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        return dict(zip(names, pool.map(hash_of, names, chunksize=1), strict=True))


def main() -> None:
    """Write or (`--check`) compare all hashes."""
    for kind, hash_of, cases in (("runs", run_hash, run_cases()), ("campaigns", campaign_hash, CAMPAIGNS)):
        now = computed(hash_of, cases)
        if "--check" in sys.argv:
            then = stored(kind)
            differing = [case for case in now if now[case] != then.get(case)]
            print(f"{kind}: {len(now)} cases, {len(differing)} differ", *differing, sep="\n  ")
        else:
            (HERE / f"{kind}.json").write_text(json.dumps(now, indent=1) + "\n")


if __name__ == "__main__":
    main()
