"""The data of the replay component (`static/replay.js`): every run at 10 Hz, in centimetres, delta-coded and deflated.

A run is one blob of channels. Each channel holds integers: the first value and then the differences, as zigzag
varints. `static/replay.js` documents and reads the same layout. The replay is a view: verdicts and counts come from
the exact records, never from this rounded copy.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.evaluation.sampled import sampled
from rvsg.evaluation.wording import outcome_in_words
from rvsg.report.colours import distinct_colours
from rvsg.report.quantity import Curve
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission
from rvsg.simulation.run import DoorMoved, Run
from rvsg.world.world import Door

Floats = NDArray[np.float64]

PERIOD_S = 0.1
LEAF_STEPS = 10
INVOLVED_M = 2.0
"""A person who never comes nearer to the robot than this, surface to surface, is drawn grey."""
FAR_STEP = 5
"""A person who is not involved in a run is kept at every fifth sample (2 Hz)."""


@dataclass(frozen=True, kw_only=True)
class ReplayRun:
    """A run to replay, with the facts the component shows beside it. `moments` are (time in s, text)."""

    run: Run
    objective: float | None
    violated: bool
    curve: Curve
    opens_s: float
    note: str = ""
    lanes: Mapping[str, Sequence[tuple[float, float]]] = field(default_factory=dict)
    moments: Sequence[tuple[float, str]] = ()


@dataclass(frozen=True, kw_only=True)
class ReplayGroup:
    """Runs of one configuration. `status` is its verdict; `manners` describes each person by name; `moved` are the
    outlines of objects that its scenario moved into the world."""

    id: str
    label: str
    purpose: str
    runs: tuple[ReplayRun, ...]
    status: str = ""
    moved: tuple[tuple[tuple[float, float], ...], ...] = ()
    manners: dict[str, str] = field(default_factory=dict)


def replay_payload(
    groups: Sequence[ReplayGroup],
    *,
    mission: Mission,
    requirement: Requirement,
    waypoints: Sequence[tuple[str, float, float]],
    matrix: str,
    quantity: str,
    footprint: Callable[[Run], Sequence[tuple[float, float]]],
    doors: Sequence[Door] = (),
) -> dict[str, Any]:
    """Return the JSON data of the component.

    Args:
        waypoints: Name, x and y (m) of the waypoints of the grid.
        matrix: From world metres to the units of the floor plan (`FloorPlan.matrix`).
        quantity: The judged quantity in words.
        footprint: Gives the outline of the robot of a run in its own frame, m.
        doors: The automatic doors of the world.
    """
    route = mission.route
    leaves = {"doors": [_door(door) for door in doors]} if doors else {}
    return leaves | {
        "version": 1,
        "period": PERIOD_S,
        "matrix": [float(v) for v in matrix[7:-1].replace(",", " ").split()],
        "route": {
            "start": [route.start.x, route.start.y],
            "goal": [route.goal.x, route.goal.y],
            "through": [[pose.x, pose.y] for pose in route.through],
        },
        "waypoints": [[name, round(x, 2), round(y, 2)] for name, x, y in waypoints],
        "requirement": {
            "name": requirement.name,
            "quantity": quantity,
            "unit": requirement.unit,
            "worse": requirement.worse,
            "limit": requirement.threshold,
        },
        "groups": [_group(group, footprint) for group in groups],
    }


def _door(door: Door) -> dict[str, Any]:
    """Return the leaf of a door, opened by 0, 0.1 ... 1 of its way."""
    shares = [[[round(x, 3), round(y, 3)] for x, y in door.leaf(k / LEAF_STEPS)] for k in range(LEAF_STEPS + 1)]
    return {"name": door.name, "opening": door.opening_s, "leaf": shares}


def _door_moves(run: Run) -> dict[str, list[list[float]]]:
    """Return when each door moves: begin (s), how far it is open then, 1 to open or 0 to close, and end (s)."""
    moves: dict[str, list[list[float]]] = {}
    for event in run.events:
        if isinstance(event, DoorMoved):
            moves.setdefault(event.door, []).append([event.time_s, event.share, float(event.opens), event.until_s])
    return moves


def people_colours(runs: Sequence[Run]) -> dict[str, str | None]:
    """Return a colour for each person of the runs by name; None for a person who is not involved in any of them."""
    names = list(dict.fromkeys(name for run in runs for name in run.human_names))
    involved = [name for name in names if name in _involved_in(runs)]
    return dict.fromkeys(names) | dict(zip(involved, distinct_colours(len(involved)), strict=True))


def _group(group: ReplayGroup, footprint: Callable[[Run], Sequence[tuple[float, float]]]) -> dict[str, Any]:
    runs = [each.run for each in group.runs]
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
            "outline": [[round(x, 3), round(y, 3)] for x, y in footprint(runs[0])] if runs else [],
            "radius": runs[0].robot_radius_m if runs else 0.0,
        },
        "people": [
            {"name": n, "radius": radii[n], "colour": colours[n], "manner": group.manners.get(n, "")}
            | ({"outline": outlines[n]} if outlines.get(n) else {})
            for n in names
        ],
        **({"moved": [[list(point) for point in outline] for outline in group.moved]} if group.moved else {}),
        "runs": [_run(each, names) for each in group.runs],
    }


def _involved_in(runs: Iterable[Run]) -> set[str]:
    """Return the names of the people who come within 2 m of the robot in at least one run."""
    found: set[str] = set()
    for run in runs:
        if run.human_names and len(run.trajectory):
            closest = sampled(run).gap.min(axis=0)
            found |= {n for n, gap in zip(run.human_names, closest, strict=True) if gap <= INVOLVED_M}
    return found


def _run(each: ReplayRun, names: Sequence[str]) -> dict[str, Any]:
    run = each.run
    coded, samples, far, near = _coded(run, names)
    data: dict[str, Any] = {
        "id": run.id,
        "seed": run.seed,
        "objective": each.objective,
        "violated": each.violated,
        "outcome": outcome_in_words(run.outcome),
        "arrived": run.completed,
        "note": each.note,
        "t0": round(float(run.trajectory.t[0]), 3) if len(run.trajectory) else 0.0,
        "samples": samples,
        "opens": round(each.opens_s, 2),
        "present": [names.index(name) for name in run.human_names],
        "far": far,
        "near": near,
        "lanes": {name: [[round(a, 2), round(b, 2)] for a, b in spans] for name, spans in each.lanes.items() if spans},
        "moments": [[round(t, 2), text] for t, text in each.moments],
        "blob": coded,
    }
    if moves := _door_moves(run):
        data["doors"] = moves
    if each.curve.is_known:
        data["judged"] = _judged(each.curve)
    return data


def _judged(curve: Curve) -> dict[str, Any]:
    """Return the curve as numbers of four significant digits; null where there is no judgement yet."""
    return {
        "t": [round(float(t), 2) for t in curve.t],
        "value": [float(f"{v:.4g}") if np.isfinite(v) else None for v in curve.value],
    }


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
    body = b"".join(varints(np.round(channel).astype(np.int64)) for channel in channels)
    return base64.b64encode(zlib.compress(body, 9)).decode(), len(rows), far, near


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
