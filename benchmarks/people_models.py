"""Models of walking people, each fitted to the same recorded meetings.

    python benchmarks/people_models.py [--rounds 10] [--meetings 300] [--out people_models.json]

Two people walk on ways of `people.pair_of_ways` under a model, and `people.selected` chooses and measures the meetings,
as for recordings and for the simulator. Shared by all models: drawn speeds (1.34 m/s, standard deviation 0.26), one
individual number (log-normal), the sway of the way, a relaxation time, an acceleration of at most 1.6 m/s², bodies of
0.25 m radius that are pushed apart. The models are reduced to pairs; people.py measures the simulator itself.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from people import RECORDED, SAMPLE, SHOULDER_M, TICK_S, misfit, pair_of_ways, selected, summary

Floats = NDArray[np.float64]
SECONDS = 12.0
AHEAD_M = 3.0
MOST_M_S2 = 1.6


class Seen(NamedTuple):
    """What one person of each pair sees: all arrays (n,) or (n, 2)."""

    r: Floats  # from this person to the other
    v: Floats  # velocity
    other: Floats  # velocity of the other
    wish: Floats  # preferred velocity
    speed: Floats
    drawn: Floats  # individual factor, median 1


Acceleration = Callable[[dict[str, float], Seen], Floats]


def size(vectors: Floats) -> Floats:
    """Return lengths (n,), never zero."""
    return np.maximum(np.hypot(vectors[:, 0], vectors[:, 1]), 1e-9)


def across(vectors: Floats) -> Floats:
    """Return vectors turned to the left."""
    return np.column_stack([-vectors[:, 1], vectors[:, 0]])


def clearance(p: dict[str, float], s: Seen) -> Floats:
    """Change the velocity by what is missing to the clearance that the person likes, over the time left."""
    w = s.other - s.wish
    closing = -(s.r * w).sum(1)
    left = closing / size(w) ** 2
    normal = across(w) / size(w)[:, None]
    seen = s.other - s.v
    side = np.where((s.r[:, 1] * seen[:, 0] - s.r[:, 0] * seen[:, 1]) / size(seen) >= 0.05, 1.0, -1.0)
    missing = np.maximum(0.0, np.maximum(0.6, p["clearance"] * s.drawn) - side * (s.r * normal).sum(1))
    urgency = np.clip((p["horizon"] - left) / max(p["horizon"] - p["first"], 0.1), 0.0, 1.0) * (closing > 0.0)
    change = -normal * (side * missing * urgency / np.maximum(left, 0.5))[:, None]
    change *= np.minimum(1.0, 0.8 * s.speed / size(change))[:, None]
    return change / p["relaxation"]


def time_to_collision(p: dict[str, float], s: Seen) -> Floats:
    """Return the force of the power law of the time to collision (Karamouzas, Skinner, Guy 2014)."""
    v = s.v - s.other
    a, b = (v * v).sum(1), (s.r * v).sum(1)
    radius = np.minimum(2.0 * p["radius"] * s.drawn, 0.95 * size(s.r))
    root = b * b - a * ((s.r * s.r).sum(1) - radius**2)
    hits = (root > 1e-9) & (b > 0.0) & (a > 1e-6)
    root, a = np.sqrt(np.where(hits, root, 1.0)), np.maximum(a, 1e-6)
    t = np.maximum((b - root) / a, 0.1)
    strength = p["k"] * np.exp(-t / p["horizon"]) / (a * t * t) * (2.0 / t + 1.0 / p["horizon"]) * hits
    return -(v - (b[:, None] * v - a[:, None] * s.r) / root[:, None]) * strength[:, None]


def collision_prediction(p: dict[str, float], s: Seen) -> Floats:
    """Return the force of explicit collision prediction (Zanlungo, Ikeda, Kanda 2011)."""
    w = s.other - s.v
    left = -(s.r * w).sum(1) / size(w) ** 2
    then = s.r + w * np.maximum(left, 0.0)[:, None]
    strength = p["a"] * s.drawn * size(s.v) / np.maximum(left, 0.3) * np.exp(-size(then) / p["b"]) * (left > 0.0)
    return -then / size(then)[:, None] * strength[:, None]


def social_force(p: dict[str, float], s: Seen) -> Floats:
    """Return the social force of HuNavSim (Moussaïd 2009)."""
    towards = s.r / size(s.r)[:, None]
    d = p["lambda"] * (s.v - s.other) + towards
    along = d / size(d)[:, None]
    angle = np.arctan2(along[:, 0] * towards[:, 1] - along[:, 1] * towards[:, 0], (along * towards).sum(1))
    reach = p["gamma"] * size(d)
    slows = -np.exp(-size(s.r) / reach - (3.0 * reach * angle) ** 2)
    turns = -np.sign(angle) * np.exp(-size(s.r) / reach - (2.0 * reach * angle) ** 2)
    return p["k"] * s.drawn[:, None] * (slows[:, None] * along + turns[:, None] * across(along))


SHARED = {"spread": (0.0, 0.8), "relaxation": (0.3, 1.2), "sway": (0.0, 0.12)}
MODELS: dict[str, tuple[Acceleration, dict[str, tuple[float, float]]]] = {
    "clearance": (clearance, {"clearance": (0.6, 1.3), "horizon": (2.5, 6.0), "first": (0.6, 2.2)}),
    "time to collision": (time_to_collision, {"k": (0.2, 8.0), "horizon": (1.0, 6.0), "radius": (0.2, 0.8)}),
    "collision prediction": (collision_prediction, {"a": (0.1, 1.5), "b": (0.2, 2.0)}),
    "social force": (social_force, {"k": (1.0, 20.0), "gamma": (0.1, 1.0), "lambda": (0.5, 4.0)}),
}


class Pairs:
    """Pairs of people on their ways, and what is drawn for each."""

    def __init__(self, kind: str, number: int, seed: int) -> None:
        rng = np.random.default_rng([seed, kind == "head_on"])
        starts, goals, _ = zip(*(pair_of_ways(kind, rng) for _ in range(number)), strict=True)
        self.starts = np.array(starts)
        ways = np.array(goals) - self.starts
        self.ahead = ways / np.hypot(ways[..., 0], ways[..., 1])[..., None]
        self.speed = np.clip(rng.normal(1.34, 0.26, (number, 2)), 0.7, 2.0)
        self.normal = rng.standard_normal((number, 2))
        self.phase = rng.uniform(0.0, 2.0 * np.pi, (number, 2))

    def walk(self, model: Acceleration, p: dict[str, float]) -> tuple[Floats, Floats]:
        """Return places (T, n, 2, 2) and the peak acceleration of each pair."""
        places, velocity = self.starts.copy(), self.ahead * self.speed[..., None]
        drawn = np.exp(p["spread"] * self.normal)
        rows, peaks = [], np.zeros(len(places))
        for k in range(round(SECONDS / TICK_S)):
            rows.append(places.copy())
            along = ((places - self.starts) * self.ahead).sum(2, keepdims=True)
            aim = self.starts + self.ahead * (along + AHEAD_M) - places
            aim /= np.hypot(aim[..., 0], aim[..., 1])[..., None]
            sway = p["sway"] * np.sqrt(2.0) * np.sin(2.0 * np.pi * k * TICK_S / 2.7 + self.phase)[..., None]
            wish = self.speed[..., None] * (aim + sway * np.stack([-aim[..., 1], aim[..., 0]], axis=2))
            push = np.empty_like(places)
            for i, j in ((0, 1), (1, 0)):
                v, other = velocity[:, i], velocity[:, j]
                seen = Seen(places[:, j] - places[:, i], v, other, wish[:, i], self.speed[:, i], drawn[:, i])
                force = (wish[:, i] - v) / p["relaxation"] + model(p, seen)
                push[:, i] = force * np.minimum(1.0, MOST_M_S2 / size(force))[:, None]
            peaks = np.maximum(peaks, np.hypot(push[..., 0], push[..., 1]).max(axis=1))
            velocity = velocity + push * TICK_S
            places = places + velocity * TICK_S
            r = places[:, 1] - places[:, 0]
            apart = r / size(r)[:, None] * (np.maximum(0.0, 2.0 * SHOULDER_M - size(r)) / 2)[:, None]
            places += np.stack([-apart, apart], axis=1)
        return np.array(rows), peaks

    def statistics(self, model: Acceleration, p: dict[str, float]) -> dict[str, Any] | None:
        """Return the statistics of those pairs that are meetings; None where there are too few."""
        places, peaks = self.walk(model, p)
        nearest = np.hypot(*np.moveaxis(places[:, :, 1] - places[:, :, 0], 2, 0)).min(axis=0)
        found = [(k, pair) for k in range(len(peaks)) if (pair := selected(places[::SAMPLE, k])) is not None]
        if len(found) < 20:
            return None
        rows = [k for k, _ in found]
        touching = nearest[rows] < 2.0 * SHOULDER_M + 0.005
        return {
            **summary([pair for _, pair in found]),
            "contacts": round(float(np.mean(touching)), 3),
            "peak_acceleration_m_s2_p50_p95": np.percentile(peaks[rows], (50, 95)).round(2).tolist(),
        }


def fitted(name: str, recorded: dict[str, Any], rounds: int, number: int) -> dict[str, Any]:
    """Fit a model and return its numbers and the statistics of fresh meetings."""
    model, own = MODELS[name]
    bounds = own | SHARED
    weights = {"head_on": 1.0, "crossing": 0.3}
    pairs = {kind: Pairs(kind, number, 1) for kind in weights}

    def error(values: Sequence[float]) -> float:
        p = dict(zip(bounds, map(float, values), strict=True))
        total = 0.0
        for kind, weight in weights.items():
            ours = pairs[kind].statistics(model, p)
            if ours is None:
                return 1000.0
            total += weight * misfit(ours, recorded["fit"][kind]) + 100.0 * max(0.0, ours["contacts"] - 0.005)
        return total

    best = differential_evolution(error, list(bounds.values()), maxiter=rounds, popsize=5, polish=False, seed=1)
    p = dict(zip(bounds, best.x.round(3).tolist(), strict=True))
    fresh = {kind: Pairs(kind, 4 * number, 2).statistics(model, p) for kind in weights}
    off = {
        source: {kind: round(misfit(fresh[kind], recorded[source][kind]), 2) for kind in weights if fresh[kind]}
        for source in ("fit", "held_out")
    }
    return {"numbers": p, "misfit": off, "meetings": fresh}


def main() -> None:
    """Fit every model and print the table as JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=10, help="rounds of each fit (default: 10)")
    parser.add_argument("--meetings", type=int, default=300, help="pairs of each kind (default: 300)")
    parser.add_argument("--out", type=Path, help="write the table to this file as well")
    given = parser.parse_args()
    recorded = json.loads(RECORDED.read_text(encoding="utf-8"))["meetings"]
    text = json.dumps({name: fitted(name, recorded, given.rounds, given.meetings) for name in MODELS}, indent=1)
    text = re.sub(r"[\[{][^\[\]{}]*[\]}]", lambda match: " ".join(match[0].split()), text)
    if given.out is not None:
        given.out.write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
