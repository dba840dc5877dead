"""Simulated people beside recorded people: meetings, walking, flow, and the robot.

    python benchmarks/people.py [--meetings 250] [--out people.json] [--plot people.svg]
    python benchmarks/people.py --fit meetings [--rounds 8]
    python benchmarks/people.py --fit flow [--rounds 8]

Prints JSON: the figures of the people of the profiles `default` and `hunavsim`, and each figure beside its limit.
`results/people_recorded.json` holds the statistics of the recordings, with sources and the definition of a meeting.
Simulated meetings are chosen and sampled in the same way. `--fit` fits the numbers of `Anticipation` to the meetings
named `fit` in that file, or to the speeds at density.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rvsg
from rvsg.core.records import Pose
from rvsg.core.references import refer
from rvsg.scenario.scenario import Attention, HumanAgent, HumanConfiguration, decode
from rvsg.simulation.embedded.people.behaviour import tick
from rvsg.simulation.embedded.people.crowd import Anticipation, PeopleOptions, initial
from rvsg.simulation.embedded.profiles import body_radius_m, people_options, profile
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.events import Contact
from rvsg.world.grid import GridSpec
from rvsg.world.lattice import build_world
from rvsg.world.occupancy import occupancy_from_objects
from rvsg.world.schema import ObjectEntry
from rvsg.world.world import Route, World
from rvsg.world.world_folder import load_world

Floats = NDArray[np.float64]
RECORDED = Path(__file__).parent / "results" / "people_recorded.json"
TICK_S, SAMPLE = 0.1, 4
BEFORE_S = (3.2, 2.4, 2.0, 1.6, 1.2, 0.8)
QUARTILES = ("p25", "p50", "p75")
KINDS = ("head_on", "crossing")
GRIDS_M, SHIPPED = (0.5, 1.0, 2.0), "warehouse"
"""Where meetings are measured as users make scenarios: halls with waypoints so far apart, and a shipped world."""
DENSITIES = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5)
SHOULDER_M = 0.25
APART_M = np.array([100.0, 0.0])
"""How far the pairs that walk at the same time are apart."""
NO_ROBOT = (-1000.0, 1000.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class People:
    """The people of a profile: how they walk, and the radius of their bodies."""

    options: PeopleOptions
    radius_m: float

    @classmethod
    def of(cls, name: str) -> People:
        """Return the people of the profile of this name."""
        options = profile(name)
        return cls(people_options(options), body_radius_m(options))

    def person(self, start: Sequence[float], goal: Sequence[float], **more: Any) -> HumanAgent:
        """Return somebody who walks from one point to another and stays there."""
        ends = (float(start[0]), float(start[1])), (float(goal[0]), float(goal[1]))
        given = {"radius_m": self.radius_m, **more}
        return HumanAgent(name="person", start=ends[0], goals=ends, pauses_s=(0.0, 36_000.0), **given)

    def walk(self, agents: Sequence[HumanAgent], world: World, seed: int, seconds: float) -> tuple[Floats, Floats]:
        """Return positions and velocities (T, N, 2) of people without a robot, one row per tick."""
        agents = [agent.model_copy(update={"name": f"person {k}"}) for k, agent in enumerate(agents)]
        crowd = initial(agents, world, options=self.options, seed=seed, time_limit_s=seconds)
        crowd.vx[:], crowd.vy[:] = np.cos(crowd.yaw) * crowd.speed, np.sin(crowd.yaw) * crowd.speed
        reference = refer(crowd)
        places, speeds = [], []
        for k in range(round(seconds / TICK_S)):
            places.append(np.column_stack([crowd.x, crowd.y]))
            speeds.append(np.column_stack([crowd.vx, crowd.vy]))
            tick(reference, TICK_S * (k + 1), TICK_S, *NO_ROBOT)
        return np.array(places), np.array(speeds)


@cache
def room(width: float, height: float, *blocks: tuple[float, float, float, float], spacing_m: float = 2.0) -> World:
    """Return an empty room around the origin, with blocks (left, low, right, high)."""
    a, b = width / 2, height / 2
    outer = [(-a - 1, -b - 1), (a + 1, -b - 1), (a + 1, b + 1), (-a - 1, b + 1)]
    hole = [(-a, -b), (a, -b), (a, b), (-a, b)]
    walls: list[dict[str, Any]] = [
        {"name": "walls", "kind": "wall", "footprint": outer, "height": 2.5, "holes": [hole]}
    ]
    for k, (left, low, right, high) in enumerate(blocks):
        corners = [(left, low), (right, low), (right, high), (left, high)]
        walls.append({"name": f"block {k}", "kind": "wall", "footprint": corners, "height": 2.5})
    objects = [ObjectEntry.model_validate(wall).solid(0.21) for wall in walls]
    route = Route(name="along", start=Pose(x=1 - a, y=0), goal=Pose(x=a - 1, y=0), time_limit_s=60)
    return build_world(
        name="room",
        occupancy=occupancy_from_objects(tuple(objects), resolution_m=0.05, seeds=[(1 - a, 0.0)]),
        objects=objects,
        routes=[route],
        grid_spec=GridSpec(spacing_m=spacing_m, origin=(0.0, 0.0)),
    )


# Meetings


def pair_of_ways(kind: str, rng: np.random.Generator, before_s: float = 7.0) -> tuple[Floats, Floats, Floats]:
    """Return starts, goals (2, 2) and headings (2,) of two people who would meet after `before_s`.

    Angle and offset are drawn. Both would walk at 1.34 m/s.
    """
    turn = 180.0 + float(np.clip(rng.normal(0.0, 12.0), -45, 45)) if kind == "head_on" else float(rng.uniform(45, 135))
    turn = math.radians(turn if rng.random() < 0.5 else -turn)
    ahead = np.array([[1.0, 0.0], [math.cos(turn), math.sin(turn)]])
    across = ahead[1] - ahead[0]
    normal = np.array([-across[1], across[0]]) / np.hypot(*across)
    middle = np.array([np.zeros(2), normal * rng.uniform(-1.5, 1.5)])
    return middle - 1.34 * before_s * ahead, middle + 1.34 * before_s * ahead, np.array([0.0, turn])


def predicted(places: Floats, speeds: Floats) -> Floats:
    """Return the distance at the closest approach of two people (T, 2, 2) who keep their velocities."""
    r, w = places[:, 1] - places[:, 0], speeds[:, 1] - speeds[:, 0]
    time = np.maximum(0.0, -(r * w).sum(1) / np.maximum((w * w).sum(1), 1e-9))
    return np.asarray(np.hypot(*(r + time[:, None] * w).T))


def selected(places: Floats, kind: str) -> tuple[Floats, float] | None:
    """Return the predicted distances at `BEFORE_S` and the closest distance of a pair (T, 2, 2) sampled every 0.4 s.

    None where the pair is no meeting by the definition.
    """
    step = TICK_S * SAMPLE
    speeds = np.diff(places, axis=0, prepend=places[:1]) / step
    distance = np.hypot(*(places[:, 1] - places[:, 0]).T)
    nearest, first = int(distance.argmin()), round(BEFORE_S[0] / step)
    if nearest <= first or nearest == len(distance) - 1 or np.hypot(*speeds[nearest - first].T).min() < 0.5:
        return None
    a, b = speeds[nearest - first]
    turn = abs(math.degrees(math.atan2(a[0] * b[1] - a[1] * b[0], a @ b)))
    if not (turn > 135.0 if kind == "head_on" else 45.0 <= turn <= 135.0):
        return None
    rows = [nearest - round(before / step) for before in BEFORE_S]
    distances = predicted(places[rows], speeds[rows])
    return None if distances[0] >= 0.5 else (distances, float(distance[nearest]))


def summary(found: Sequence[tuple[Floats, float]]) -> dict[str, Any]:
    """Return the statistics of meetings that `people_recorded.json` gives of recorded ones."""
    percentiles = np.percentile([pair[1] for pair in found], (5, 25, 50, 75, 95)).round(2).tolist()
    return {
        "n": len(found),
        "median_predicted_closest_m": np.median([pair[0] for pair in found], axis=0).round(2).tolist(),
        "closest_centres_m": dict(zip(("p5", *QUARTILES, "p95"), percentiles, strict=True)),
    }


def pairs_apart(kind: str, people: People, rng: np.random.Generator, seed: int) -> Iterator[tuple[Floats, Floats]]:
    """Yield how pairs walk to one goal each, far from others and walls."""
    for k in range(40):
        agents = [people.person(a + n * APART_M, b + n * APART_M, yaw=yaw) for n in range(1, 101)
                  for a, b, yaw in zip(*pair_of_ways(kind, rng), strict=True)]  # fmt: skip
        walked = people.walk(agents, room(4.0, 4.0), 1000 * seed + k, 12.0)
        yield from ((walked[0][:, n : n + 2], walked[1][:, n : n + 2]) for n in range(0, len(agents), 2))


def pairs_in(
    world: World, kind: str, people: People, rng: np.random.Generator, seed: int
) -> Iterator[tuple[Floats, Floats]]:
    """Yield how pairs walk by `rvsg.walk` between waypoints of a world, at ends drawn as for those apart."""
    valid = [waypoint for waypoint in world.grid.waypoints if waypoint.human]
    points = np.array([(waypoint.x, waypoint.y) for waypoint in valid])
    for k in range(4000):
        middle = points[rng.integers(len(points))]
        names = [[valid[int(np.hypot(*(points - middle - end).T).argmin())].name for end in ends]
                 for ends in zip(*pair_of_ways(kind, rng)[:2], strict=True)]  # fmt: skip
        if any(a == b or world.grid.shortest_path(a, b) is None for a, b in names):
            continue
        humans = tuple(rvsg.walk(f"person {n}", *ends).human(world) for n, ends in enumerate(names))
        agents = decode(HumanConfiguration(humans=humans), world.grid, people.radius_m)
        yield people.walk(agents, world, 10_000 * seed + k, 12.0)


def meetings(kind: str, people: People, number: int, seed: int = 1, world: World | None = None) -> dict[str, Any]:
    """Simulate pairs, apart or in a world, until `number` of them are meetings; return their statistics."""
    rng = np.random.default_rng([seed, kind == "head_on"])
    found, peaks, contacts, right = [], [], 0, 0
    walked = pairs_apart(kind, people, rng, seed) if world is None else pairs_in(world, kind, people, rng, seed)
    for places, speeds in walked:
        pair = selected(places[::SAMPLE], kind)
        if pair is None:
            continue
        found.append(pair)
        distance = np.hypot(*(places[:, 1] - places[:, 0]).T)
        contacts += bool(distance.min() < 2.0 * people.radius_m + 0.005)
        row = int(distance.argmin())
        r, v = places[row, 1] - places[row, 0], speeds[row, 0]
        right += bool(v[0] * r[1] - v[1] * r[0] > 0.0)
        accelerations = np.diff(speeds[: row + 10], axis=0) / TICK_S
        peaks.append(float(np.hypot(accelerations[..., 0], accelerations[..., 1]).max()))
        if len(found) == number:
            break
    return {
        **summary(found),
        "contacts": round(contacts / len(found), 3),
        "pass_on_the_right": round(right / len(found), 2),
        "peak_acceleration_m_s2_p50_p95": np.percentile(peaks, (50, 95)).round(2).tolist(),
    }


# Flow


def points_apart(rng: np.random.Generator, number: int, low: Sequence[float], high: Sequence[float]) -> Floats:
    """Return random points (N, 2) of a rectangle, no two nearer than shoulders allow."""
    points = np.empty((0, 2))
    while len(points) < number:
        point = rng.uniform(low, high)
        if not len(points) or np.hypot(*(points - point).T).min() > 2.0 * SHOULDER_M:
            points = np.vstack([points, point])
    return points


def speed_at_density(people: People, two_ways: bool) -> dict[str, dict[str, float]]:
    """Return the mean speed by density in 2 m of a corridor 3 m wide, while a crowd 40 m long walks through it.

    The free speeds are those of the participants of the recordings.
    """
    hall = room(80.0, 3.0)
    manner, speed = people.options.anticipation, 1.55
    if manner is not None:
        speed /= manner.speed_share
        manner = manner.model_copy(update={"speed_spread": 0.18 / speed})
    people = People(people.options.model_copy(update={"anticipation": manner}), SHOULDER_M)
    rows: list[tuple[float, float]] = []
    for density in np.arange(0.25, 2.3, 0.2):
        seed = round(100 * density)
        number = round(density * 120.0)
        way = np.where(np.arange(number) % 2 == 0, 1.0, -1.0) if two_ways else np.ones(number)
        starts = points_apart(np.random.default_rng(seed), number, (-20.0, -1.2), (20.0, 1.2))
        agents = [
            people.person((x, y), (x + 100.0 * w, y), yaw=0.0 if w > 0 else math.pi, speed_m_s=speed)
            for (x, y), w in zip(starts, way, strict=True)
        ]
        places, speeds = people.walk(agents, hall, seed, 11.0)
        for k in range(40, 110, 5):
            for middle in (-1.0, 1.0, 3.0):
                inside = np.abs(places[k, :, 0] - middle) < 1.0
                if inside.any():
                    rows.append((inside.sum() / 6.0, float((way * speeds[k, :, 0])[inside].mean())))
    found = {}
    values = np.array(rows)
    for low, high in pairwise(DENSITIES):
        these = values[(values[:, 0] >= low) & (values[:, 0] < high), 1]
        if len(these):
            found[f"{low:g}-{high:g}"] = {"n": len(these), "speed_m_s": round(float(these.mean()), 2)}
    return found


def bottleneck(people: People, width_m: float = 1.0) -> float:
    """Return the flow of a waiting crowd through an opening, people per second and metre of its width."""
    hall = room(30.0, 6.0, (0.0, width_m / 2, 0.4, 3.0), (0.0, -3.0, 0.4, -width_m / 2))
    starts = points_apart(np.random.default_rng(1), 60, (-8.0, -2.6), (-0.8, 2.6))
    agents = [
        HumanAgent(name="person", start=(x, y), goals=((x, y), (-0.2, 0.0), (14.0, 0.0)), pauses_s=(0.0, 0.0, 36_000.0),
                   radius_m=SHOULDER_M)
        for x, y in starts.tolist()
    ]  # fmt: skip
    places, _ = people.walk(agents, hall, 1, 60.0)
    through = np.sort([times.min() * TICK_S for times in map(np.flatnonzero, places[:, :, 0].T > 0.4) if len(times)])
    middle = through[len(through) // 6 : len(through) - len(through) // 6]
    return 0.0 if len(middle) < 2 else round(float((len(middle) - 1) / (middle[-1] - middle[0]) / width_m), 2)


def free_speed(people: People) -> dict[str, float]:
    """Return mean and standard deviation of the speeds that 2,000 people draw."""
    agents = [people.person((0.0, 0.0), (9.0, 0.0)).model_copy(update={"name": f"person {k}"}) for k in range(40)]
    hall = room(40.0, 12.0)
    speeds = [initial(agents, hall, options=people.options, seed=seed).speed for seed in range(50)]
    return {"mean": round(float(np.mean(speeds)), 2), "standard_deviation": round(float(np.std(speeds)), 2)}


# The robot


def before_the_robot(profile_name: str, attention: Attention = Attention.ATTENTIVE, number: int = 60) -> dict[str, Any]:
    """Let people meet the robot head-on at 0.5 m/s; return when they turn off and how far they pass (centres).

    They have turned off where they are 0.15 m beside their way.
    """
    hall, people = room(40.0, 12.0), People.of(profile_name)
    onsets, passed, peaks, contacts = [], [], [], 0
    route = Route(name="along", start=Pose(x=-6.0, y=0.0), goal=Pose(x=16.0, y=0.0), time_limit_s=60)
    step = SAMPLE * TICK_S
    for seed in range(number):
        y = float(np.random.default_rng(seed).uniform(-0.3, 0.3))
        agent = people.person((16.0, y), (-18.0, y), yaw=math.pi, attention=attention)
        run = simulate_agents(hall, route, [agent], options=profile(profile_name), seed=seed)
        path = run.trajectory
        times = np.arange(0.0, path.t[-1], step)
        tracks = ((path.x, path.y), (path.human_x[:, 0], path.human_y[:, 0]))
        places = np.stack([np.column_stack([np.interp(times, path.t, axis) for axis in xy]) for xy in tracks], axis=1)
        distance = np.hypot(*(places[:, 1] - places[:, 0]).T)
        row = int(distance.argmin())
        straight = np.flatnonzero(np.abs(places[:row, 1, 1] - y) < 0.15)
        onsets.append((row - int(straight[-1])) * step)
        passed.append(float(distance[row]))
        velocity = np.diff(places[:, 1], axis=0) / step
        peaks.append(float(np.hypot(*(np.diff(velocity[2 : row + 5], axis=0) / step).T).max()))
        contacts += any(isinstance(event, Contact) for event in run.events)
    return {
        "n": number,
        "onset_s_p25_p50_p75": np.percentile(onsets, (25, 50, 75)).round(1).tolist(),
        "closest_centres_m_p25_p50_p75": np.percentile(passed, (25, 50, 75)).round(2).tolist(),
        "peak_acceleration_m_s2_p95": round(float(np.percentile(peaks, 95)), 2),
        "contacts": round(contacts / number, 2),
    }


# Figures


def figures(name: str, number: int) -> dict[str, Any]:
    """Return all figures of the people of a profile."""
    people = People.of(name)
    worlds = {f"grid {m:g} m": room(24.0, 24.0, spacing_m=m) for m in GRIDS_M} | {SHIPPED: load_world(SHIPPED)}
    attentions = list(Attention) if people.options.anticipation is not None else [Attention.ATTENTIVE]
    return {
        "free_speed_m_s": free_speed(people),
        "meetings": {kind: meetings(kind, people, number) for kind in KINDS},
        "front_door": {
            place: {kind: meetings(kind, people, number, world=world) for kind in KINDS}
            for place, world in worlds.items()
        },
        "speed_at_density": {key: speed_at_density(people, key == "two_way") for key in ("one_way", "two_way")},
        "bottleneck_per_m_s": bottleneck(people),
        "robot": {each.value: before_the_robot(name, each) for each in attentions},
    }


def comparison(found: dict[str, Any], recorded: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return each figure with what is recorded, the range it should lie in, and whether it does.

    `interval95`: the sampling error of what is recorded.
    """
    rows: dict[str, dict[str, Any]] = {}

    def add(name: str, ours: float, low: float, high: float, theirs: float | None = None, *error: list[float]) -> None:
        low, high = round(low, 2), round(high, 2)
        rows[name] = {"ours": ours, "recorded": theirs, "from": low, "to": high, "met": low <= ours <= high}
        if error:
            rows[name] |= {"interval95": error[0], "in_interval": error[0][0] <= ours <= error[0][1]}

    def compare(name: str, ours: dict[str, Any], theirs: dict[str, Any], limit: float) -> None:
        predictions = ours["median_predicted_closest_m"], theirs["median_predicted_closest_m"]
        for before, a, b, error in zip(BEFORE_S, *predictions, theirs["interval95_predicted_m"], strict=True):
            add(f"{name}: predicted {before} s before", a, b - limit, b + limit, b, error)
        for q, error in zip(QUARTILES, theirs["interval95_quartiles_m"], strict=True):
            a, b = ours["closest_centres_m"][q], theirs["closest_centres_m"][q]
            add(f"{name}: closest {q}", a, b * (1.0 - limit), b * (1.0 + limit), b, error)

    for source, limit in (("fit", 0.1), ("held_out", 0.15)):
        for kind, ours in found["meetings"].items():
            compare(f"{source} {kind}", ours, recorded["meetings"][source][kind], limit)
    for place, walked in found["front_door"].items():
        for kind, ours in walked.items():
            compare(f"{place} {kind}", ours, recorded["meetings"]["fit"][kind], 0.1 if kind == "head_on" else 0.15)
    for kind, ours in found["meetings"].items():
        add(f"{kind}: contacts", ours["contacts"], 0.0, 0.01)
        add(f"{kind}: peak acceleration p95", ours["peak_acceleration_m_s2_p50_p95"][1], 0.0, 1.7)
    for count in ("one_way", "one_way_repeated", "two_way"):
        simulated = found["speed_at_density"][count.removesuffix("_repeated")]
        for density, value in recorded["speed_at_density"][count].items():
            b = value["speed_m_s"]
            error = [value["interval95_m_s"]] if "interval95_m_s" in value else []
            add(f"{count}: speed at {density}", simulated[density]["speed_m_s"], 0.9 * b, 1.1 * b, b, *error)
    add("bottleneck", found["bottleneck_per_m_s"], 1.2, 1.9)
    add("robot: onset p50", found["robot"]["attentive"]["onset_s_p25_p50_p75"][1], 2.0, 3.5)
    return rows


# Fit

BOUNDS = {
    "meetings": {"clearance_m": 0.1, "clearance_spread": 0.15, "crossing": 0.25, "earlier": 1.0, "horizon_s": 0.15,
                 "first_s": 0.25, "relaxation_s": 0.25},
    "flow": {"headway_m": 0.9, "headway_s": 0.4, "headway_ahead_s": 0.9},
}  # fmt: skip
"""What is fitted, and how far the fit may go from the present number, as a share of it."""


def misfit(ours: dict[str, Any], theirs: dict[str, Any]) -> float:
    """Return the mean square of how far meetings are from recorded ones, in units of the goals (0.1 m, 10 %)."""
    off = np.subtract(ours["median_predicted_closest_m"], theirs["median_predicted_closest_m"]) / 0.1
    quartiles = [10.0 * (ours["closest_centres_m"][q] / theirs["closest_centres_m"][q] - 1.0) for q in QUARTILES]
    return float(np.mean(np.square(off)) + np.mean(np.square(quartiles)))


def misfit_of_meetings(people: People, recorded: dict[str, Any], number: int, seed: int) -> float:
    """Return the misfit of both kinds of meetings, and of contacts and accelerations."""
    total = 0.0
    for kind in ("head_on", "crossing"):
        ours = meetings(kind, people, number, seed)
        total += misfit(ours, recorded["meetings"]["fit"][kind])
        total += 100.0 * max(0.0, ours["contacts"] - 0.005)
        total += 10.0 * max(0.0, ours["peak_acceleration_m_s2_p50_p95"][1] - 1.6)
    return total


def misfit_of_flow(people: People, recorded: dict[str, Any]) -> float:
    """Return the mean square of how far speeds at density are from recorded ones, in units of the goal (10 %).

    A flow through the bottleneck near or below the least one that is recorded counts, too.
    """
    total = 100.0 * max(0.0, 1.25 - bottleneck(people)) ** 2
    for count in ("one_way", "two_way"):
        ours, theirs = speed_at_density(people, count == "two_way"), recorded["speed_at_density"][count]
        total += float(np.mean([(10.0 * (ours[k]["speed_m_s"] / theirs[k]["speed_m_s"] - 1.0)) ** 2 for k in theirs]))
    return total


def fit(what: str, recorded: dict[str, Any], rounds: int, number: int) -> dict[str, Any]:
    """Fit numbers of `Anticipation` to recorded people by differential evolution, from the present ones on."""
    from scipy.optimize import differential_evolution

    bounds = BOUNDS[what]

    def error(values: Sequence[float], number: int = number, seed: int = 1) -> float:
        manner = Anticipation(**dict(zip(bounds, map(float, values), strict=True)))
        people = People(PeopleOptions(anticipation=manner), SHOULDER_M)
        flows = what == "flow"
        return misfit_of_flow(people, recorded) if flows else misfit_of_meetings(people, recorded, number, seed)

    present = [getattr(Anticipation(), name) for name in bounds]
    best = differential_evolution(
        error, [(p * (1.0 - share), p * (1.0 + share)) for p, share in zip(present, bounds.values(), strict=True)],
        x0=present, maxiter=rounds, popsize=3, polish=False, seed=1,
        callback=lambda x, convergence: print(x.round(3).tolist(), file=sys.stderr, flush=True),
    )  # fmt: skip
    fresh = {
        name: round(error(values, 3 * number, 2), 2) for name, values in (("present", present), ("fitted", best.x))
    }
    return {"fitted": dict(zip(bounds, best.x.round(3).tolist(), strict=True)), "misfit": round(float(best.fun), 2),
            "misfit_of_fresh_people": fresh}  # fmt: skip


def main() -> None:
    """Print the figures, or fit."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--meetings", type=int, default=250, help="meetings of each kind (default: 250)")
    parser.add_argument("--out", type=Path, help="write the figures to this file as well")
    parser.add_argument("--plot", type=Path, help="draw the figures as SVG in this file")
    parser.add_argument("--fit", choices=BOUNDS, help="fit these numbers of Anticipation instead")
    parser.add_argument("--rounds", type=int, default=8, help="rounds of the fit (default: 8)")
    given = parser.parse_args()
    recorded = json.loads(RECORDED.read_text(encoding="utf-8"))
    if given.fit is not None:
        print(json.dumps(fit(given.fit, recorded, given.rounds, given.meetings), indent=1))
        return
    found = {name: figures(name, given.meetings) for name in ("default", "hunavsim")}
    compared = {name: comparison(each, recorded) for name, each in found.items()}
    text = json.dumps(found | {"comparison": compared}, indent=1)
    text = re.sub(r"[\[{][^\[\]{}]*[\]}]", lambda match: " ".join(match[0].split()), text)
    if given.out is not None:
        given.out.write_text(text + "\n", encoding="utf-8")
    if given.plot is not None:
        from people_plot import plot

        given.plot.write_text(plot(found, recorded), encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
