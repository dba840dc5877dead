"""What the replay component reads back is the run, to the centimetre."""

from __future__ import annotations

import base64
import itertools
import json
import math
import zlib
from dataclasses import replace
from functools import cache
from itertools import accumulate
from typing import Any

import numpy as np
import pytest
from tests.campaign.parts import REQUIREMENT, warehouse
from tests.evaluation.runs import run_of, trajectory
from tests.report.test_page import default_campaign, default_page, page

from rvsg.evaluation.metrics import METRICS
from rvsg.evaluation.sampled import Sampled
from rvsg.evaluation.verdict import objective
from rvsg.report.replay_data import (
    FAR_STEP,
    INVOLVED_M,
    MOST_RAYS,
    ReplayGroup,
    distinct_colours,
    people_colours,
    replay_payload,
    trace_json,
    trace_view,
    varints,
)
from rvsg.report.run_facts import decisive, judged_curve, prefix, run_facts
from rvsg.robots.robot import load_robot
from rvsg.runs.runner import Evaluator
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import ROBOT
from rvsg.simulation.embedded.trace import Evaluation, Frame, NodeChange, Patch, Trace
from rvsg.simulation.run import Outcome, Run


@cache
def a_run() -> Run:
    _, attempts, ledger = default_campaign()
    return ledger.run(attempts[0].measurements[0].run_id)


def binary(blob: str) -> bytes:
    return zlib.decompress(base64.b64decode(blob))


def unpacked(data: bytes) -> list[int]:
    """The integers of concatenated channels, as differences."""
    found, value, shift = [], 0, 0
    for byte in data:
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            found.append((value >> 1) ^ -(value & 1))
            value = shift = 0
    return found


def payload(run: Run) -> dict[str, object]:
    facts = run_facts(run, Evaluator(REQUIREMENT, warehouse()).measure(run), REQUIREMENT, warehouse())
    return replay_payload(
        [ReplayGroup(id="0", label="runs", purpose="search", runs=(facts,))],
        mission=default_campaign()[0].mission,
        requirement=REQUIREMENT,
        world=warehouse(),
    )


@pytest.mark.parametrize("values", [[0], [5, -5, 300, -70000, 2**40], list(range(-200, 200))])
def test_varints_are_read_back(values: list[int]) -> None:
    assert list(accumulate(unpacked(varints(np.array(values, dtype=np.int64))))) == values


def test_a_run_is_kept_at_10_hz_to_the_centimetre() -> None:
    run = a_run()
    data = payload(run)["groups"][0]["runs"][0]
    steps = unpacked(binary(data["blob"]))
    n = data["samples"]
    assert n == round(float(run.trajectory.t[-1]) / 0.1) + 1
    x = np.array(list(accumulate(steps[:n]))) / 100
    rows = np.clip(np.searchsorted(run.trajectory.t, np.arange(n) * 0.1 - 1e-9), 0, len(run.trajectory) - 1)
    assert np.abs(x - run.trajectory.x[rows]).max() <= 0.005 + 1e-9
    far = [-(-n // FAR_STEP) if h in data["far"] else n for h in range(len(run.human_names))]
    assert len(steps) == 5 * n + 3 * sum(far)


def test_the_judged_quantity_ends_at_the_objective() -> None:
    run, world = a_run(), warehouse()
    formula = Requirement(name="F", title="", text="", formula="always (distance_to_person > 0.5)")
    for requirement in (REQUIREMENT, formula, REQUIREMENT.replace(metric="trg", worse="larger", limit=30.0, unit="s")):
        curve = judged_curve(run, requirement, world)
        assert curve.value[-1] == objective(run, requirement, world=world)


def test_a_mean_is_decided_where_the_run_adds_most_to_it_and_a_minimum_where_it_passes_its_limit() -> None:
    run, world = a_run(), warehouse()
    curve = judged_curve(run, REQUIREMENT, world)
    decided = decisive(run, REQUIREMENT, curve)
    away = Sampled(run, run.trajectory).closest_gap
    assert away[np.searchsorted(run.trajectory.t, decided - 0.5)] < np.quantile(away, 0.25)

    gap = Sampled(run, run.trajectory).closest_gap
    limit = float(np.quantile(gap, 0.2))
    least = REQUIREMENT.replace(metric="min_distance", limit=limit)
    decided = decisive(run, least, judged_curve(run, least, world))
    first = float(run.trajectory.t[int((gap < limit).argmax())])
    assert abs(decided - first) <= float(run.trajectory.t[-1]) / 70


def test_only_people_who_come_near_have_a_colour() -> None:
    run = a_run()
    closest = Sampled(run, run.trajectory).gap.min(axis=0)
    colours = people_colours([run])
    for name, gap in zip(run.human_names, closest, strict=True):
        assert (colours[name] is None) == (gap > INVOLVED_M)


@pytest.mark.parametrize("count", [1, 8, 9, 30, 60])
def test_no_two_people_share_a_colour(count: int) -> None:
    colours = distinct_colours(count)
    assert len(set(colours)) == count
    channels = [tuple(int(c[k : k + 2], 16) for k in (1, 3, 5)) for c in colours]
    nearest = min((math.dist(one, two) for one, two in itertools.combinations(channels, 2)), default=99.0)
    assert nearest > (12 if count <= 30 else 5)


def test_a_page_of_300_runs_stays_below_3_mb() -> None:
    the_plan, attempts, ledger = default_campaign()
    runs = sum(len(attempt.measurements) for attempt in attempts)
    empty, whole = len(page(the_plan, [], ledger).encode()), len(default_page().encode())
    assert runs > 20 and empty + 300 * (whole - empty) / runs < 3_000_000


@pytest.mark.parametrize("name", [each.id for each in METRICS.values() if each.so_far is not None])
@pytest.mark.parametrize("people", [0, 2])
def test_what_a_metric_gives_at_once_for_every_moment_is_what_it_measures_of_each_beginning(
    name: str, people: int
) -> None:
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.uniform(0.04, 0.06, 60))
    walks = [tuple(rng.normal(size=(4, 60))) for _ in range(people)]
    v = np.where(rng.random(60) < 0.3, 0.0, rng.random(60))
    series = trajectory(t, np.cumsum(v), rng.normal(size=60), yaw=rng.normal(size=60), v=v, humans=walks)
    run = run_of(series, outcome=Outcome.REACHED)
    known = METRICS[name]
    assert known.so_far is not None
    at_once = known.so_far(Sampled(run, series))
    for end in range(2, 61):
        one = known.measure(prefix(run, end))
        assert at_once[end - 1] == pytest.approx(np.nan if one is None else one, abs=1e-9, nan_ok=True)


def traced(run: Any) -> Trace:
    """A trace of five frames at a place, with numbers that are easy to find again."""
    robot = load_robot(ROBOT)
    rays = [lidar.rays for lidar in robot.lidars]
    frames = []
    for k in range(5):
        tried = Evaluation(
            t=k / 10, pose=(1.0, 2.0, 0.0), velocity=np.array([[0.5, 0.0], [0.2, 0.3]]),
            end=np.array([[1.8, 2.0], [1.3, 2.1]]), score=np.array([4.2, np.inf]), best=0,
            critics=("PathDist", "GoalDist", "RotateToGoal"), scales=(0.5, 0.1, 32.0),
            raw=np.array([[8.0, 2.0, 0.0], [0.0, 0.0, 0.0]]),
        )  # fmt: skip
        scans = tuple(np.where(np.arange(n) % 2 == 0, 1.5 + k, np.inf) for n in rays)
        whole = Patch(row=0, column=0, cells=np.arange(12, dtype=np.uint8).reshape(3, 4))
        part = Patch(row=1, column=2, cells=np.full((1, 2), 254, np.uint8))
        frame = Frame(
            t=k / 10, pose=(1.0, 2.0, 0.0), velocity=(0.4, 0.0), command=(0.5, 0.0),
            phase="spin" if k > 2 else "drive", recoveries=int(k > 2), seen_from=((1.0, 2.0, 0.0),) * len(rays),
            scans=scans, costmap=np.full((6, 6), k, np.uint8), costmap_origin=(0.5, 0.25),
            plan=np.array([[1.0, 2.0], [2.0, 2.0]]) if k == 0 else None,
            global_costmap=whole if k == 0 else part if k == 2 else None, evaluation=tried,
        )  # fmt: skip
        frames.append(frame)
    nodes = (NodeChange(0.1, "ComputePathToPose", "IDLE", "SUCCESS"), NodeChange(0.3, "Spin", "IDLE", "RUNNING"))
    return Trace(
        run=run, robot=robot, frames=tuple(frames), nodes=nodes, resolution=0.05, global_resolution=0.05,
        global_origin=(-1.0, -2.0),
    )  # fmt: skip


@cache
def a_trace() -> Trace:
    return traced(run_of(trajectory(np.arange(5) / 10, np.arange(5.0))))


def test_a_trace_is_kept_five_times_a_second_in_centimetres() -> None:
    view = trace_view(a_trace(), warehouse())
    assert view["frames"] == [0.0, 0.2, 0.4]
    assert view["phases"] == [[0.0, "drive"], [0.3, "spin"]]
    assert view["nodes"][1] == [0.3, "Spin", "IDLE", "RUNNING"]
    lidar = view["lidars"][0]
    read = unpacked(binary(lidar["blob"]))
    assert np.cumsum(read[:3]).tolist() == [100, 100, 100]  # x of the robot, cm
    assert lidar["rays"] <= MOST_RAYS
    assert set(np.cumsum(read[9 : 9 + lidar["rays"]]).tolist()) <= {0, 150}
    assert view["plans"] == {"plans": [[0.0, 2]], "blob": view["plans"]["blob"]}
    assert np.cumsum(unpacked(binary(view["plans"]["blob"]))[:2]).tolist() == [100, 200]


def test_costmaps_are_kept_as_bytes_and_changes() -> None:
    view = trace_view(a_trace(), warehouse())
    assert view["global"]["patches"] == [[0.0, 0, 0, 3, 4], [0.2, 1, 2, 1, 2]]
    assert binary(view["global"]["blob"]) == bytes(range(12)) + b"\xfe\xfe"
    assert binary(view["local"]["blob"]) == bytes(36) + bytes([2] * 36) + bytes([4] * 36)


def test_forbidden_samples_have_no_score_and_the_chosen_one_is_named() -> None:
    tried = trace_view(a_trace(), warehouse())["tried"]
    assert tried["asked"][0] == [0.0, 2, 0, 1.0, 2.0, 0.0]
    assert tried["critics"] == ("PathDist", "GoalDist", "RotateToGoal")
    assert tried["shares"][0] == [4.0, 0.2, 0.0]
    v, w, dx, dy, score = (np.cumsum(part) for part in np.array(unpacked(binary(tried["blob"]))[:10]).reshape(5, 2))
    assert (v.tolist(), w.tolist()) == ([500, 200], [0, 300])
    assert (dx.tolist(), dy.tolist(), score.tolist()) == ([80, 30], [0, 10], [42, -1])


def test_a_base_that_moves_sideways_keeps_its_speed_to_the_left() -> None:
    trace = a_trace()
    tried = trace.frames[0].evaluation
    assert tried is not None
    aside = replace(tried, velocity=np.array([[0.5, 0.0, 0.1], [0.2, 0.3, -0.4]]))
    view = trace_view(replace(trace, frames=(replace(trace.frames[0], evaluation=aside),)), warehouse())["tried"]
    assert view["sideways"] and "sideways" not in trace_view(trace, warehouse())["tried"]
    assert np.array(unpacked(binary(view["blob"]))).reshape(6, 2).cumsum(axis=1)[2].tolist() == [100, -400]


def test_a_trace_without_frames_is_valid_json() -> None:
    empty = replace(a_trace(), frames=(), nodes=())
    assert json.loads(trace_json(empty, warehouse()))["frames"] == []


@pytest.mark.parametrize("k", [0, 1])
def test_a_patch_changes_a_copy_of_the_costmap(k: int) -> None:
    first = np.zeros((3, 3), np.uint8)
    changed = Patch(row=k, column=1, cells=np.full((2, 2), 7, np.uint8)).onto(first)
    assert changed.sum() == 28 and changed[k, 1] == 7 and not first.any()
