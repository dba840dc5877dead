"""Measure recordings: own runs rebuilt from noisy bags, people found in scans, memory of a large bag, time to a case.

    python benchmarks/recording.py [--runs 60] [--scans 8] [--large-mb 2000] > benchmarks/results/recording.json

Runs are exported to MCAP with noise of 5 cm and 50 ms and without 10 % of the samples, read back, and rebuilt. The
smallest gap and the time of the rebuilt scenario (median of three seeds, and the seed that comes nearest) are compared
with those of the original run. `itself`: the original scenario, run again with these seeds.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import rvsg
from rvsg.app.reconstruction import rebuild
from rvsg.core.errors import RvsgError
from rvsg.evaluation.sampled import sampled
from rvsg.recording.fidelity import compare, recorded_as
from rvsg.recording.intent import People, recorded_scenario
from rvsg.recording.tracks import load_recording
from rvsg.simulation.run import Run
from rvsg.world.world import World
from rvsg_exchange.bag import Messages, rosbags_types, write_bag

NOISE_M, NOISE_S, DROPPED = 0.05, 0.05, 0.1
SEEDS = (11, 12, 13)
"""Of the rebuilt scenarios, and of the original ones run again: how far chance alone lets a run repeat itself."""


def noisy(run: Run, seed: int) -> Run:
    """Return a run as a noisy tracker records it."""
    rng = np.random.default_rng(seed)
    path = run.trajectory.at(
        np.sort(rng.permutation(len(run.trajectory))[: round((1 - DROPPED) * len(run.trajectory))])
    )
    order = np.argsort(t := path.t + rng.normal(0.0, NOISE_S, len(path)))
    changed = {"t": np.maximum.accumulate(t[order] + 1e-6 * np.arange(len(path)))}
    for name in ("x", "y", "human_x", "human_y"):
        values = getattr(path, name)[order]
        changed[name] = values + rng.normal(0.0, NOISE_M, values.shape)
    trajectory = dataclasses.replace(path, **changed)
    return dataclasses.replace(run, trajectory=trajectory, log=trajectory, imu=np.empty(0), events=())


def own_runs(count: int, world: World, folder: Path) -> dict[str, Any]:
    """Rebuild noisy recordings of own runs in each form of people."""
    rows: list[dict[str, Any]] = []
    routes = [route.name for route in world.routes]
    for k in range(count):
        proposal = rvsg.propose(world, routes[k % len(routes)], "R1", humans=1 + k % 4, seed=k)
        if proposal.scenario is None:
            continue
        (original,) = rvsg.simulate(proposal.scenario, [k], world=world)
        path = folder / f"{k}.mcap"
        write_bag(noisy(original, k), world, path)
        gap = float(sampled(original, world).gap.min())
        row: dict[str, Any] = {
            "run": k,
            "route": routes[k % len(routes)],
            "gap_m": gap,
            "outcome": original.outcome.name,
        }
        row["time_s"] = float(original.trajectory.t[-1])
        others = rvsg.simulate(proposal.scenario, SEEDS, world=world)
        row["itself"] = ends(others, world)
        for people in People:
            try:
                route = world.route(routes[k % len(routes)])
                made = recorded_scenario(load_recording(path, world=world), world, people=people, route=route)
                again = rvsg.simulate(made.scenario, SEEDS, world=world)
            except RvsgError as error:
                row[people.value] = {"error": str(error)}
                continue
            found = [compare(made.recording, run, world) for run in again]
            row[people.value] = {
                **ends(again, world), "repeats": sum(each.repeats for each in found),
                "recorded_gap_m": float(sampled(recorded_as(made.recording, again[0]), world).gap.min()),
            }  # fmt: skip
        print(json.dumps(row), file=sys.stderr, flush=True)
        rows.append(row)
    summary = {}
    for people in ("itself", *(each.value for each in People)):
        known = [row for row in rows if "error" not in row[people]]
        summary[people] = {
            "repeated": sum(alike(row, *np.median(row[people]["ends"], axis=0)) for row in known),
            "in_one_seed_at_least": sum(any(alike(row, *end) for end in row[people]["ends"]) for row in known),
            "of": len(rows),
        }
    return {"summary": summary, "rows": rows}


def ends(runs: Sequence[Run], world: World) -> dict[str, Any]:
    """Return the smallest gap (m) and the time (s) of each run."""
    gaps = [float(sampled(run, world).gap.min()) for run in runs]
    return {"ends": [[round(gap, 3), float(run.trajectory.t[-1])] for gap, run in zip(gaps, runs, strict=True)]}


def alike(row: dict[str, Any], gap_m: float, time_s: float) -> bool:
    """Whether both are those of the original run, within 0.1 m and 5 %."""
    return bool(abs(gap_m - row["gap_m"]) <= 0.1 and abs(time_s - row["time_s"]) <= 0.05 * row["time_s"])


def scans(count: int, world: World, folder: Path) -> dict[str, Any]:
    """Find people in the simulated scans of runs; count person-moments within 4 m of the robot and in sight."""
    from rvsg.simulation.embedded.trace import trace_run

    found = seen = 0
    errors: list[float] = []
    extra = 0
    for k in range(count):
        scenario = rvsg.propose(world, world.routes[k % len(world.routes)].name, "R1", humans=3, seed=100 + k).scenario
        assert scenario is not None
        trace = trace_run(scenario, world, seed=k)
        path = folder / f"scan{k}.mcap"
        write_bag(trace.run, world, path, trace=trace)
        topics = [stream.name for stream in load_recording(path, world=world).streams if "LaserScan" in stream.kind]
        recording = load_recording(path, world=world, people_topic=topics[0])
        run = trace.run.trajectory
        matched: set[int] = set()
        for h in range(run.human_x.shape[1]):
            away = np.hypot(run.human_x[:, h] - run.x, run.human_y[:, h] - run.y)
            moving = run.human_speed[:, h] > 0.2
            rows = np.flatnonzero((away < 4.0) & moving & _in_sight(world, run, h))[::10]
            for row in rows:
                at = np.array([[run.t[row]]])[0]
                best = np.inf
                for n, person in enumerate(recording.people):
                    place = person.at(at)[0]
                    apart = float(np.hypot(place[0] - run.human_x[row, h], place[1] - run.human_y[row, h]))
                    if apart < best:
                        best, who = apart, n
                seen += 1
                if best <= 0.3:
                    found += 1
                    errors.append(best)
                    matched.add(who)
        extra += len(recording.people) - len(matched)
    return {
        "moments_within_4_m": seen, "found_within_0.3_m": found, "share": found / max(1, seen),
        "median_error_m": float(np.median(errors)) if errors else None, "tracks_of_nobody_near": extra,
    }  # fmt: skip


def _in_sight(world: World, run: Any, h: int) -> np.ndarray:
    from rvsg.world.space import robot_space

    starts = np.column_stack([run.x, run.y])
    ends = np.column_stack([run.human_x[:, h], run.human_y[:, h]])
    return robot_space(world).segments_free(starts, ends)


def memory(megabytes: int, world: World, folder: Path) -> dict[str, Any]:
    """Read a bag with so many megabytes of pictures in a process of its own; return its peak of memory."""
    scenario = rvsg.propose(world, "route_1", "R1", humans=3, seed=1).scenario
    assert scenario is not None
    (run,) = rvsg.simulate(scenario, [1], world=world)
    small, large = folder / "small.mcap", folder / "large"
    write_bag(run, world, small)
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    from rvsg_exchange.recordings import open_bag

    types = rosbags_types()
    made = Messages(types)
    writer = Writer(large, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer, open_bag(small) as reader:
        topics = {c.topic: writer.add_connection(c.topic, c.msgtype, typestore=types) for c in reader.connections}
        stamp, _ = made.time(0.0)
        picture = made.make(
            "sensor_msgs/Image", header=made.header(stamp, "camera"), height=1000, width=1000, encoding="mono8",
            step=1000, data=np.random.default_rng(1).integers(0, 255, 1_000_000, np.uint8),
        )  # fmt: skip
        raw = types.serialize_cdr(picture, picture.__msgtype__)
        camera = writer.add_connection("/camera", picture.__msgtype__, typestore=types)
        messages = list(reader.messages())
        for k, (connection, at, data) in enumerate(messages):
            writer.write(topics[connection.topic], at, data)
            for _ in range(megabytes * (k + 1) // len(messages) - megabytes * k // len(messages)):
                writer.write(camera, at, raw)
    size = sum(path.stat().st_size for path in large.glob("*"))
    code = (
        "import re,sys,time;from pathlib import Path;from rvsg.recording.tracks import load_recording;t=time.time();"
        "f=load_recording(sys.argv[1]);s=Path('/proc/self/status').read_text();"
        "print(len(f.people),int(re.search(r'VmHWM:\\s+(\\d+)',s)[1])/1024,time.time()-t)"
    )
    answer = subprocess.run([sys.executable, "-c", code, str(large)], capture_output=True, text=True, check=True)
    people, peak, seconds = answer.stdout.split()
    return {"bag_mb": size / 1e6, "people": int(people), "peak_mb": float(peak), "seconds": float(seconds)}


def first_case(world: World, folder: Path) -> dict[str, Any]:
    """Measure the time from a bag of a drive among five people to a scenario that is compared and confirmed."""
    scenario = rvsg.propose(world, "route_1", "R1", humans=5, seed=2).scenario
    assert scenario is not None
    (run,) = rvsg.simulate(scenario, [1], world=world)
    write_bag(run, world, folder / "five.mcap")
    begin = time.monotonic()
    found = rebuild(folder / "five.mcap", world, "R1", runs=20, route="route_1", jobs=2)
    return {"drive_s": float(run.trajectory.t[-1]), "seconds": time.monotonic() - begin, "verdict": found.verdict}


def main() -> None:
    """Measure, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--scans", type=int, default=8)
    parser.add_argument("--large-mb", type=int, default=2000)
    given = parser.parse_args()
    world = rvsg.load_world("warehouse")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        found: dict[str, Any] = {"version": rvsg.__version__, "first_case": first_case(world, folder)}
        if given.scans:
            found["scans"] = scans(given.scans, world, folder)
        if given.large_mb:
            found["memory"] = memory(given.large_mb, world, folder)
        found["own_runs"] = own_runs(given.runs, world, folder)
    print(re.sub(r"[\[{][^\[\]{}]*[\]}]", lambda match: " ".join(match[0].split()), json.dumps(found, indent=1)))


if __name__ == "__main__":
    main()
