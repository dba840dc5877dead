"""Data of the replay: runs and traces as JSON with packed numbers, and the colours of people.

A run is one blob of channels at 10 Hz, in centimetres. Each channel holds integers: the first value and then the
differences, as zigzag varints, deflated. `static/replay.js` and `static/trace.js` document and read the layout. The
replay is a view: verdicts and counts come from the exact records, never from this rounded copy. A trace keeps 5 moments
a second and every few rays; the bag of the same trace holds all of it.
"""

from __future__ import annotations

import base64
import colorsys
import json
import zlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import FileError
from rvsg.core.inputs import parse_json, read_text
from rvsg.evaluation.sampled import sampled
from rvsg.evaluation.verdict import number, outcome_in_words
from rvsg.report.renderer import unbroken
from rvsg.report.run_facts import INVOLVED_M, RunFacts, footprint_of
from rvsg.report.words import limit_in_words, quantity, untimed
from rvsg.robots.robot import Robot
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission
from rvsg.simulation.events import DoorMoved
from rvsg.simulation.run import Run
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.world import World

if TYPE_CHECKING:
    from rvsg.simulation.embedded.trace import Frame, Trace


FIRST = ("#c4570a", "#0b8270", "#a23bb8", "#8a6d00", "#c2255c", "#3f7d20", "#6a5acd", "#9c4a2f")
"""Enough for most scenarios, chosen by hand: none is near the blue of the robot."""
ROBOT_HUES = (200.0, 250.0)
"""Hues (degrees) that the robot's blue keeps for itself."""
GOLDEN = 0.618034
"""Step around the hues that are left, as a share: no two of many come close."""


def distinct_colours(count: int) -> list[str]:
    """Return `count` different colours as `#rrggbb`; fewer are the first of more."""
    colours = list(FIRST[:count])
    free = 360.0 - (ROBOT_HUES[1] - ROBOT_HUES[0])
    for place in range(count - len(FIRST)):
        hue = (ROBOT_HUES[1] + place * GOLDEN % 1.0 * free) % 360.0
        channels = colorsys.hls_to_rgb(hue / 360.0, (0.25, 0.35, 0.45)[place % 3], 0.75)
        colours.append("#" + "".join(f"{round(255 * value):02x}" for value in channels))
    return colours


Floats = NDArray[np.float64]

PERIOD_S = 0.1
LEAF_STEPS = 10
"""The leaf of a door is given at each of so many parts of its way, and closed."""
FAR_STEP = 5
"""A person who is not involved in a run is kept at every fifth sample (2 Hz)."""


@dataclass(frozen=True, kw_only=True)
class ReplayGroup:
    """Runs of one configuration. `status` is its verdict; `manners` describes each person by name; `moved` are the
    outlines of objects that its scenario moved into the world."""

    id: str
    label: str
    purpose: str
    runs: tuple[RunFacts, ...]
    status: str = ""
    moved: tuple[tuple[tuple[float, float], ...], ...] = ()
    manners: dict[str, str] = field(default_factory=dict)
    tasks: dict[str, list[str]] = field(default_factory=dict)
    """What each person is asked to do, by name."""
    notes: tuple[str, ...] | None = None
    """What the component shows beside each run. None: whether it holds a contact."""


def replay_payload(
    groups: Sequence[ReplayGroup], *, mission: Mission, requirement: Requirement, world: World
) -> dict[str, Any]:
    """Return the JSON data of the component."""
    route, robot = mission.route, mission.robot_record
    doors = [
        {
            "name": door.name,
            "opening": door.opening_s,
            "leaf": [
                [[round(v, 3) for v in corner] for corner in door.leaf(k / LEAF_STEPS)] for k in range(LEAF_STEPS + 1)
            ],
        }
        for door in world.moving_doors
    ]
    return ({"doors": doors} if doors else {}) | {
        "version": 1,
        "period": PERIOD_S,
        "matrix": [*floor_plan(world, tooltips=False).transform],
        "route": {
            "start": [route.start.x, route.start.y],
            "goal": [route.goal.x, route.goal.y],
            "through": [[pose.x, pose.y] for pose in route.through],
        },
        "waypoints": [[w.name, round(w.x, 2), round(w.y, 2)] for w in world.grid.waypoints if w.human],
        "requirement": {
            "name": requirement.name,
            "quantity": f"{quantity(requirement)} so far",
            "unit": requirement.unit,
            "worse": requirement.worse,
            "limit": requirement.threshold,
            "limitText": limit_in_words(requirement),
        },
        "groups": [_group(group, robot, requirement.unit) for group in groups],
    }


def people_colours(runs: Sequence[Run]) -> dict[str, str | None]:
    """Return a colour for each person of the runs by name; None for a person who is not involved in any of them."""
    names = list(dict.fromkeys(name for run in runs for name in run.human_names))
    near: set[str] = set()
    for run in runs:
        if run.human_names and len(run.trajectory):
            closest = sampled(run).gap.min(axis=0)
            near |= {name for name, gap in zip(run.human_names, closest, strict=True) if gap <= INVOLVED_M}
    return {n: css if n in near else None for n, css in zip(names, distinct_colours(len(names)), strict=True)}


def _group(group: ReplayGroup, robot: Robot | None, unit: str) -> dict[str, Any]:
    runs = [facts.run for facts in group.runs]
    colours = people_colours(runs)
    names = list(colours)
    radii = {name: radius for run in runs for name, radius in zip(run.human_names, run.human_radius_m, strict=True)}
    outlines = {
        n: o for run in runs for n, o in zip(run.human_names, run.human_outlines, strict=bool(run.human_outlines))
    }
    return {
        "id": group.id,
        "label": group.label,
        "purpose": group.purpose,
        "status": group.status,
        "robot": {
            "outline": [[round(x, 3), round(y, 3)] for x, y in footprint_of(runs[0], robot)] if runs else [],
            "radius": runs[0].robot_radius_m if runs else 0.0,
        },
        "people": [
            {"name": n, "radius": radii[n], "colour": colours[n], "manner": group.manners.get(n, "")}
            | ({"tasks": group.tasks[n]} if n in group.tasks else {})
            | ({"outline": outlines[n]} if outlines.get(n) else {})
            for n in names
        ],
        **({"moved": [[list(point) for point in outline] for outline in group.moved]} if group.moved else {}),
        "runs": [
            _run(facts, names, unit, group.notes[k] if group.notes else None) for k, facts in enumerate(group.runs)
        ],
    }


def _run(facts: RunFacts, names: Sequence[str], unit: str, note: str | None) -> dict[str, Any]:
    run = facts.run
    coded, samples, far, near = _coded(run, names)
    data: dict[str, Any] = {
        "id": run.id,
        "seed": run.seed,
        "objective": facts.measurement.objective,
        "said": number(facts.measurement.objective, unit),
        "violated": facts.violated,
        "outcome": outcome_in_words(run.outcome),
        "arrived": run.completed,
        "note": ("contact" if facts.contacts else "") if note is None else note,
        "t0": round(float(run.trajectory.t[0]), 3) if len(run.trajectory) else 0.0,
        "samples": samples,
        "opens": round(facts.decisive_s, 2) if note is None else 0.0,
        "present": [names.index(name) for name in run.human_names],
        "far": far,
        "near": near,
        "lanes": {name: [[round(a, 2), round(b, 2)] for a, b in spans] for name, spans in facts.lanes.items() if spans},
        "moments": [[round(said.time_s, 2), unbroken(untimed(said))] for said in facts.story],
        "blob": coded,
    }
    for event in run.events:
        if isinstance(event, DoorMoved):
            move = [event.time_s, event.share, float(event.opens), event.until_s]
            data.setdefault("doors", {}).setdefault(event.door, []).append(move)
    if facts.curve.is_known:
        data["judged"] = {
            "t": [round(float(t), 2) for t in facts.curve.t],
            "value": [float(f"{v:.4g}") if np.isfinite(v) else None for v in facts.curve.value],
        }
    return data


def _coded(run: Run, names: Sequence[str]) -> tuple[str, int, list[int], list[list[int]]]:
    """Encode a run: the blob, its samples per channel, which of the run's people are kept at 2 Hz, and who is nearest.

    Who is nearest is given as [sample, person among `names`] where it changes.

    Channels: x, y (cm), yaw (0.01 rad), v (cm/s), gap to the nearest person (mm); then x, y (cm), yaw (0.05 rad) of
    every person of the run.
    """
    path = run.trajectory
    if not len(path):
        return "", 0, [], []
    wanted = np.arange(0.0, float(path.t[-1] - path.t[0]) + PERIOD_S / 2, PERIOD_S) + float(path.t[0])
    rows = np.clip(np.searchsorted(path.t, wanted - 1e-9), 0, len(path) - 1)
    gap = sampled(run).gap
    people = len(run.human_names)
    least = _least(gap.min(axis=1), rows) if people else rows
    channels = [path.x[rows] * 100, path.y[rows] * 100, np.unwrap(path.yaw)[rows] * 100, path.signed_speed[rows] * 100]
    channels.append((gap.min(axis=1)[least] if people else np.zeros(len(rows))) * 1000)
    who = [names.index(run.human_names[h]) for h in gap[least].argmin(axis=1)] if people else []
    near = [[k, person] for k, person in enumerate(who) if k == 0 or person != who[k - 1]]
    far = [h for h in range(people) if gap[:, h].min() > INVOLVED_M]
    for h in range(people):
        at = rows[:: FAR_STEP if h in far else 1]
        channels += [path.human_x[at, h] * 100, path.human_y[at, h] * 100, np.unwrap(path.human_yaw[:, h])[at] * 20]
    return _channels(channels), len(rows), far, near


def _least(values: Floats, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return where the smallest value since the row before is, so that thinning hides no contact."""
    starts = np.minimum(np.concatenate([[0], rows[:-1] + 1]), rows)
    return np.array([a + int(values[a : b + 1].argmin()) for a, b in zip(starts, rows, strict=True)], np.intp)


def varints(values: NDArray[np.int64]) -> bytes:
    """Return the first value and the differences of the rest as zigzag varints (7 bits a byte, low bits first)."""
    steps = np.diff(values, prepend=np.int64(0))
    numbers = ((steps << 1) ^ (steps >> 63)).astype(np.uint64)
    most = max(1, -(-int(numbers.max(initial=0)).bit_length() // 7))
    rest = numbers[:, None] >> (np.uint64(7) * np.arange(most, dtype=np.uint64))
    more = np.column_stack([rest[:, 1:] > 0, np.zeros(len(numbers), np.bool_)])
    used = np.column_stack([np.ones(len(numbers), np.bool_), rest[:, 1:] > 0])
    return ((rest & np.uint64(0x7F)) | (more.astype(np.uint64) << np.uint64(7))).astype(np.uint8)[used].tobytes()


FORMAT = "rvsg-trace"
VERSION = 1
EVERY = 2
"""Of the frames of a trace, 10 a second, every n-th is kept."""
MOST_RAYS = 181
"""Rays of a lidar that are kept at most."""
MOST_SAMPLES = 150
"""Samples of the local planner that are kept at most: evenly, and always the chosen one."""
PLAN_STEP = 6
"""Of the poses of a plan, 0.025 m apart, every n-th is kept."""


def trace_view(trace: Trace, world: World) -> dict[str, Any]:
    """Return the data of the file."""
    frames = trace.frames[::EVERY]
    return {
        "format": FORMAT,
        "version": VERSION,
        "run": trace.run.id,
        "scenario": trace.run.scenario_id,
        "seed": trace.run.seed,
        "frames": [round(frame.t, 2) for frame in frames],
        "lidars": [_lidar(trace, frames, k) for k in range(len(trace.robot.lidars))],
        "local": _local(trace, frames),
        "global": _global(trace, world),
        "plans": _plans(trace),
        "tried": _tried(frames),
        "phases": _changes((frame.t, frame.phase) for frame in trace.frames),
        "nodes": [[change.t, change.node, change.before, change.after] for change in trace.nodes],
    }


def trace_json(trace: Trace, world: World) -> str:
    """Return the text of the file."""
    return json.dumps(trace_view(trace, world), ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"


def _lidar(trace: Trace, frames: Sequence[Frame], number: int) -> dict[str, Any]:
    """Channels: x, y (cm) and yaw (0.01 rad) of the robot at the scan of each frame; then its ranges (cm, 0: none)."""
    lidar = trace.robot.lidars[number]
    step = -(-lidar.rays // MOST_RAYS)
    rays = np.arange(0, lidar.rays, step)
    poses = np.array([frame.seen_from[number] for frame in frames]).reshape(-1, 3)
    ranges = np.array([frame.scans[number][rays] for frame in frames]).reshape(len(frames), len(rays))
    channels = [poses[:, 0] * 100, poses[:, 1] * 100, np.unwrap(poses[:, 2]) * 100]
    channels += list(np.where(np.isfinite(ranges), np.maximum(1.0, ranges * 100), 0.0))
    return {
        "x": lidar.x,
        "y": lidar.y,
        "first": round(lidar.yaw - lidar.field_of_view_rad / 2, 5),
        "step": round(step * lidar.field_of_view_rad / (lidar.rays - 1), 6),
        "rays": len(rays),
        "blob": _channels(channels),
    }


def _local(trace: Trace, frames: Sequence[Frame]) -> dict[str, Any]:
    """`origins`: channels of the corner's x and y in cells; `blob`: the bytes of each frame, row by row."""
    cells = np.array([frame.costmap for frame in frames], np.uint8)
    corners = np.array([frame.costmap_origin for frame in frames]).reshape(-1, 2) / trace.resolution
    return {
        "rows": cells.shape[1] if cells.ndim == 3 else 0,
        "columns": cells.shape[2] if cells.ndim == 3 else 0,
        "resolution": trace.resolution,
        "origins": _channels([corners[:, 0], corners[:, 1]]),
        "blob": _packed(cells.tobytes()),
    }


def _global(trace: Trace, world: World) -> dict[str, Any]:
    """`patches`: time, row, column, rows and columns of each change, the first is the whole; `blob`: their bytes."""
    new = [(frame.t, frame.global_costmap) for frame in trace.frames if frame.global_costmap is not None]
    x, y = trace.global_origin
    return {
        "x": round(x + world.map_offset[0], 4),
        "y": round(y + world.map_offset[1], 4),
        "resolution": trace.global_resolution,
        "patches": [[round(t, 2), p.row, p.column, *p.cells.shape] for t, p in new],
        "blob": _packed(b"".join(p.cells.tobytes() for _, p in new)),
    }


def _plans(trace: Trace) -> dict[str, Any]:
    """`plans`: time and number of points of each plan; `blob`: for each the channels x and y (cm)."""
    plans = [(frame.t, frame.plan) for frame in trace.frames if frame.plan is not None]
    new = [(t, np.vstack([plan[:-1:PLAN_STEP], plan[-1:]])) for t, plan in plans]
    channels = [points[:, axis] * 100 for _, points in new for axis in (0, 1)]
    return {"plans": [[round(t, 2), len(points)] for t, points in new], "blob": _channels(channels)}


def _tried(frames: Sequence[Frame]) -> dict[str, Any]:
    """`asked`: time, number of samples, the chosen one (-1: none) and x, y, yaw of the robot at each answer.

    `blob`: for each answer the channels forward speed (mm/s), yaw rate (mrad/s), with `sideways` the speed to the left
    (mm/s), x and y of the end from the robot (cm), and score (tenths; -1: forbidden). `shares`: for each answer what
    each of `critics` adds to the total of the chosen sample; empty where none is chosen.
    """
    asked, channels, shares = [], [], []
    critics: tuple[str, ...] = ()
    answers = [frame.evaluation for frame in frames if frame.evaluation is not None]
    for tried in answers:
        shown = np.arange(0, len(tried.score), max(1, -(-len(tried.score) // MOST_SAMPLES)))
        shown = np.union1d(shown, [tried.best]) if tried.best >= 0 else shown
        best = int(np.flatnonzero(shown == tried.best)[0]) if tried.best >= 0 else -1
        x, y, yaw = tried.pose
        asked.append([round(tried.t, 2), len(shown), best, round(x, 2), round(y, 2), round(yaw, 3)])
        critics = tried.critics
        shares.append((tried.raw[tried.best] * tried.scales).round(2).tolist() if critics and tried.best >= 0 else [])
        score = tried.score[shown]
        channels += [
            *(tried.velocity[shown] * 1000).T,
            (tried.end[shown, 0] - x) * 100,
            (tried.end[shown, 1] - y) * 100,
            np.where(np.isfinite(score), score * 10, -1.0),
        ]
    sideways = any(tried.velocity.shape[1] == 3 for tried in answers)
    return {
        "asked": asked,
        "critics": critics,
        "shares": shares,
        **({"sideways": True} if sideways else {}),
        "blob": _channels(channels),
    }


def _changes(values: Iterable[tuple[float, str]]) -> list[list[Any]]:
    """Keep the first of equal values that follow each other."""
    changes: list[list[Any]] = []
    for t, value in values:
        if not changes or changes[-1][1] != value:
            changes.append([round(t, 2), value])
    return changes


def _channels(channels: Iterable[NDArray[np.float64]]) -> str:
    return _packed(b"".join(varints(np.round(channel).astype(np.int64)) for channel in channels))


def _packed(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data, 9)).decode()


TRACES = "traces"
"""The folder beside a report in which the report finds traces."""
SUFFIX = ".trace.json"
MOST_IN_A_PAGE = 1_500_000
"""Bytes of traces that a page holds; it opens further ones from their files."""


def trace_file_beside(folder: Path, run: str) -> Path:
    """Return the file in which the report of a folder finds the trace of a run."""
    return folder / TRACES / f"{run}{SUFFIX}"


def traces_beside(page: Path, runs: Collection[str]) -> list[Mapping[str, Any]]:
    """Return the traces beside a page that are of its runs, in the order of their names, as far as the page holds them.

    Raises:
        FileError: a file is no trace.
    """
    traces: list[Mapping[str, Any]] = []
    left = MOST_IN_A_PAGE
    for path in sorted((page.parent / TRACES).glob(f"*{SUFFIX}")):
        if path.name.removesuffix(SUFFIX) not in runs or path.stat().st_size > left:
            continue
        value = parse_json(read_text(path), path)
        if not isinstance(value, dict) or value.get("format") != FORMAT or value.get("run") not in runs:
            raise FileError(
                path, "this is not the trace its name says. Remove it, or write it again: rvsg replay --trace."
            )
        left -= path.stat().st_size
        traces.append(value)
    return traces
