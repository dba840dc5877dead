"""The percentiles of `rvsg.evaluation.realism`: how far recorded people go, counted in OpenTraj's folder `datasets`.

    python benchmarks/people_realism.py DATASETS

Prints JSON. The recordings are ETH, HOTEL, ZARA 1 and 2 (`obsmat.txt`), and students 3, whose `obsmat.txt` is noisy,
from the splines of its annotation. Tracks are sampled every 0.4 s; members of a group do not count for distances.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rvsg.evaluation.realism import (
    PERCENTILES,
    QUANTITIES,
    SAMPLE_S,
    TURN_SAMPLES,
    WALKING_M_S,
    closing,
    following,
    turning,
)
from rvsg.scenario.scenario import BODY_RADIUS_M

Floats = NDArray[np.float64]
Tracks = dict[int, tuple[int, Floats]]
"""By person: the first sample and positions in m, (N, 2)."""
RECORDINGS = ("ETH/seq_eth", "ETH/seq_hotel", "UCY/zara01", "UCY/zara02", "UCY/students03")
FRAMES_PER_SAMPLE = {"ETH/seq_eth": 6}
SPLINE_FRAMES = 10


def observed(path: Path, frames: int) -> Tracks:
    """Read frame, person, x, z, y of each row; a track with a gap ends there."""
    rows = np.loadtxt(path)[:, [0, 1, 2, 4]]
    tracks: Tracks = {}
    for person in np.unique(rows[:, 1]):
        own = rows[rows[:, 1] == person]
        samples = np.round(own[:, 0] / frames).astype(int)
        gaps = np.flatnonzero(np.diff(samples) != 1)
        end = int(gaps[0]) + 1 if len(gaps) else len(own)
        tracks[int(person)] = (int(samples[0]), own[:end, 2:])
    return tracks


def splines(folder: Path) -> Tracks:
    """Read the control points (x, y, frame) of each person, and go through them in straight lines."""
    turn = np.loadtxt(folder / "H.txt")
    tracks: Tracks = {}
    points: list[list[float]] = []
    lines = (folder / "annotation.vsp").read_text(encoding="utf-8").splitlines()[1:]
    for line in [*lines, "0 - Num of control points"]:
        numbers = line.split(" - ")[0].split()
        if len(numbers) == 4:
            points.append([float(number) for number in numbers[:3]])
        elif "Num of control points" in line:
            if points:
                x, y, frame = np.array(points).T
                first = int(np.ceil(frame[0] / SPLINE_FRAMES))
                at = np.arange(first, int(frame[-1] // SPLINE_FRAMES) + 1) * SPLINE_FRAMES
                pixels = np.stack([np.interp(at, frame, x), np.interp(at, frame, y), np.ones(len(at))])
                metres = turn @ pixels
                tracks[len(tracks) + 1] = (first, (metres[:2] / metres[2]).T)
            points = []
        elif "Num of" in line or "number of" in line:
            break
    return tracks


def same_group(path: Path) -> dict[int, set[int]]:
    """Return with whom each person walks."""
    found: dict[int, set[int]] = defaultdict(set)
    for line in path.read_text(encoding="utf-8").splitlines():
        members = {int(float(word)) for word in line.split()}
        if len(members) > 1:
            for person in members:
                found[person] |= members
    return found


def quantities(tracks: Tracks, groups: dict[int, set[int]]) -> dict[str, list[float]]:
    """How far each person goes in each quantity, as `realism.motions` measures simulated people."""
    found: dict[str, list[float]] = {name: [] for name in QUANTITIES}
    for person, (first, path) in tracks.items():
        if len(path) < 4:
            continue
        velocity = np.diff(path, axis=0) / SAMPLE_S
        speed = np.hypot(*velocity.T)
        walking = speed > WALKING_M_S
        if walking.sum() >= 4:
            found["speed"].append(float(np.median(speed[walking])))
        found["acceleration"].append(float(np.hypot(*(np.diff(velocity, axis=0) / SAMPLE_S).T).max()))
        together = [
            (path[low - first : high - first].T, path_[low - first_ : high - first_].T)
            for other, (first_, path_) in tracks.items()
            if other != person and other not in groups.get(person, ())
            and (low := max(first, first_)) < (high := min(first + len(path), first_ + len(path_)))
        ]  # fmt: skip
        if together:
            found["distance"].append(min(float(np.hypot(*(a - b)).min()) for a, b in together))
        for quantity, shown, worst in (("closing", closing, max), ("following", following, min)):
            values = [known[0] for a, b in together if (known := shown(a, b, 2.0 * BODY_RADIUS_M)) is not None]
            found[quantity] += [worst(values)] if values else []
        found["turning"].append(float(turning(path.T)[0]) if len(path) > 2 * TURN_SAMPLES else 0.0)
        steps = np.flatnonzero(walking)
        length = best = 0
        for stands in ~walking[steps[0] :] if len(steps) else ():
            length = length + 1 if stands else 0
            best = max(best, length)
        found["standing"].append(best * SAMPLE_S)
    return found


def main() -> None:
    """Print people and percentiles of all recordings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", type=Path)
    folder = parser.parse_args().datasets
    every: dict[str, list[float]] = defaultdict(list)
    for name in RECORDINGS:
        at = folder / name
        has_splines = (at / "annotation.vsp").is_file() and name.endswith("students03")
        tracks = splines(at) if has_splines else observed(at / "obsmat.txt", FRAMES_PER_SAMPLE.get(name, 10))
        for quantity, values in quantities(tracks, same_group(at / "groups.txt")).items():
            every[quantity] += values
    shown = {
        name: {"people": len(values), "percentiles": np.percentile(values, PERCENTILES).round(3).tolist()}
        for name, values in every.items()
    }
    print(json.dumps(shown, indent=1))


if __name__ == "__main__":
    main()
