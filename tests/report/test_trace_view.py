"""The trace file: what the replay shows of what a robot saw, planned and tried."""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.campaign.parts import warehouse
from tests.evaluation.runs import run_of, trajectory

from rvsg.report.replay_data import MOST_RAYS, trace_json, trace_view
from rvsg.robots.robot import load_robot
from rvsg.scenario.scenario import ROBOT
from rvsg.simulation.embedded.trace import Evaluation, Frame, NodeChange, Patch, Trace


def a_run() -> Any:
    return run_of(trajectory(np.arange(5) / 10, np.arange(5.0)))


def made(run: Any) -> Trace:
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
        frames.append(
            Frame(
                t=k / 10,
                pose=(1.0, 2.0, 0.0),
                velocity=(0.4, 0.0),
                command=(0.5, 0.0),
                phase="spin" if k > 2 else "drive",
                recoveries=int(k > 2),
                seen_from=tuple((1.0, 2.0, 0.0) for _ in rays),
                scans=scans,
                costmap=np.full((6, 6), k, np.uint8),
                costmap_origin=(0.5, 0.25),
                plan=np.array([[1.0, 2.0], [2.0, 2.0]]) if k == 0 else None,
                global_costmap=whole if k == 0 else part if k == 2 else None,
                evaluation=tried,
            )
        )
    nodes = (NodeChange(0.1, "ComputePathToPose", "IDLE", "SUCCESS"), NodeChange(0.3, "Spin", "IDLE", "RUNNING"))
    return Trace(
        run=run, robot=robot, frames=tuple(frames), nodes=nodes, resolution=0.05, global_resolution=0.05,
        global_origin=(-1.0, -2.0),
    )  # fmt: skip


def numbers(blob: str) -> list[int]:
    """Every varint of a blob, unfolded; the differences are not summed."""
    found, value, shift = [], 0, 0
    for byte in zlib.decompress(base64.b64decode(blob)):
        value |= (byte & 127) << shift
        shift += 7
        if not byte & 128:
            found.append((value >> 1) ^ -(value & 1))
            value, shift = 0, 0
    return found


def test_a_trace_is_kept_five_times_a_second_in_centimetres() -> None:
    view = trace_view(made(a_run()), warehouse())
    assert view["frames"] == [0.0, 0.2, 0.4]
    assert view["phases"] == [[0.0, "drive"], [0.3, "spin"]]
    assert view["nodes"][1] == [0.3, "Spin", "IDLE", "RUNNING"]
    lidar = view["lidars"][0]
    read = numbers(lidar["blob"])
    assert np.cumsum(read[:3]).tolist() == [100, 100, 100]  # x of the robot, cm
    assert lidar["rays"] <= MOST_RAYS
    assert set(np.cumsum(read[9 : 9 + lidar["rays"]]).tolist()) <= {0, 150}
    assert view["plans"] == {"plans": [[0.0, 2]], "blob": view["plans"]["blob"]}
    assert np.cumsum(numbers(view["plans"]["blob"])[:2]).tolist() == [100, 200]


def test_costmaps_are_kept_as_bytes_and_changes() -> None:
    view = trace_view(made(a_run()), warehouse())
    assert view["global"]["patches"] == [[0.0, 0, 0, 3, 4], [0.2, 1, 2, 1, 2]]
    assert zlib.decompress(base64.b64decode(view["global"]["blob"])) == bytes(range(12)) + b"\xfe\xfe"
    local = zlib.decompress(base64.b64decode(view["local"]["blob"]))
    assert local == bytes(36) + bytes([2] * 36) + bytes([4] * 36)


def test_forbidden_samples_have_no_score_and_the_chosen_one_is_named() -> None:
    tried = trace_view(made(a_run()), warehouse())["tried"]
    assert tried["asked"][0] == [0.0, 2, 0, 1.0, 2.0, 0.0]
    assert tried["critics"] == ("PathDist", "GoalDist", "RotateToGoal")
    assert tried["shares"][0] == [4.0, 0.2, 0.0]
    v, w, dx, dy, score = (np.cumsum(part) for part in np.array(numbers(tried["blob"])[:10]).reshape(5, 2))
    assert (v.tolist(), w.tolist()) == ([500, 200], [0, 300])
    assert (dx.tolist(), dy.tolist(), score.tolist()) == ([80, 30], [0, 10], [42, -1])


def test_a_base_that_moves_sideways_keeps_its_speed_to_the_left() -> None:
    trace = made(a_run())
    tried = trace.frames[0].evaluation
    assert tried is not None
    aside = replace(tried, velocity=np.array([[0.5, 0.0, 0.1], [0.2, 0.3, -0.4]]))
    view = trace_view(replace(trace, frames=(replace(trace.frames[0], evaluation=aside),)), warehouse())["tried"]
    assert view["sideways"] and "sideways" not in trace_view(trace, warehouse())["tried"]
    assert np.array(numbers(view["blob"])).reshape(6, 2).cumsum(axis=1)[2].tolist() == [100, -400]


def test_a_trace_without_frames_is_valid_json() -> None:
    empty = replace(made(a_run()), frames=(), nodes=())
    assert json.loads(trace_json(empty, warehouse()))["frames"] == []


@pytest.mark.parametrize("k", [0, 1])
def test_a_patch_changes_a_copy_of_the_costmap(k: int) -> None:
    first = np.zeros((3, 3), np.uint8)
    changed = Patch(row=k, column=1, cells=np.full((2, 2), 7, np.uint8)).onto(first)
    assert changed.sum() == 28 and changed[k, 1] == 7 and not first.any()
