"""A trace: one run simulated again with everything the robot sees and plans. Runs are deterministic, so it is the run.

Recording changes nothing of the run: the trajectory of a traced run equals that of the run, bit for bit. The compiled
planner scores no more samples than it must; what each critic of DWB says of every sample is worked out again here, in
NumPy, from the state it leaves behind.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.core.plugins import Spec, ignore
from rvsg.core.references import refer
from rvsg.robots.robot import Robot, load_robot
from rvsg.scenario.builder import check_valid
from rvsg.scenario.scenario import ROBOT, Scenario
from rvsg.scenario.world_lookup import world_of
from rvsg.simulation.archive import PackedRun, rounded
from rvsg.simulation.costmap import INSCRIBED
from rvsg.simulation.embedded import base, dwb
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.behaviour_tree import ODOMETRY_DEADBAND
from rvsg.simulation.embedded.dwb import PLAN_END, SHARE, STAMP
from rvsg.simulation.embedded.episode import Episode, Outside
from rvsg.simulation.embedded.lidar import first_ray, full_scan
from rvsg.simulation.embedded.localisation import MAP_YAW
from rvsg.simulation.embedded.robot_parameters import (
    LIDAR_MAX,
    LIDAR_MIN,
    LIDAR_RAYS,
    LIDAR_VIEW,
    Stack,
)
from rvsg.simulation.embedded.rollouts import SAMPLE_SIDE, SAMPLE_STEPS, SAMPLE_V, SAMPLE_W, is_free
from rvsg.simulation.embedded.simulator import EmbeddedSimulator
from rvsg.simulation.embedded.state import State
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import make_simulator
from rvsg.simulation.stacks.stack_choice import STUDY_STACK, StackLike
from rvsg.world.world import World

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


IDLE, RUNNING, SUCCESS, FAILURE = "IDLE", "RUNNING", "SUCCESS", "FAILURE"
NAVIGATE, PLAN, FOLLOW = "NavigateThroughPoses", "ComputePathToPose", "FollowPath"
CLEAR_GLOBAL, CLEAR_LOCAL = "ClearGlobalCostmap-Context", "ClearLocalCostmap-Context"
ACTIONS = ("ClearingActions", "Spin", "Wait", "BackUp")
"""The recoveries in their order; the first ends at once."""
WATCHED = (st.MODE, st.RESULT, st.RECOVERIES, st.NEXT_ACTION, st.FAILED_ACTIONS, st.FOLLOW_RETRIED, st.PLAN_RETRIED)
OF_MODE = {st.SPIN: "Spin", st.WAIT: "Wait", st.BACK_UP: "BackUp"}


class NodeChange(NamedTuple):
    """A node of the behaviour tree changes its status at a time (s)."""

    t: float
    node: str
    before: str
    after: str


class TreeLog:
    """Watches the navigator's state, tick by tick, and keeps the changes of the tree's nodes."""

    def __init__(self) -> None:
        self.changes: list[NodeChange] = []
        self._status: dict[str, str] = {}
        self._known = (st.DRIVE, *(0 for _ in WATCHED[1:]))
        self._planned_at = -math.inf

    def watch(self, state: State, t: float) -> None:
        """Compare the state with that of the tick before."""
        nav = state.nav
        now = tuple(int(nav[k]) for k in WATCHED)
        planned_at = float(state.times[st.PLAN_T])
        planned = planned_at != self._planned_at and bool(nav[st.PLANNED])
        if planned or now != self._known:
            self._compare(
                dict(zip(WATCHED, self._known, strict=True)), dict(zip(WATCHED, now, strict=True)), planned, t
            )
        self._known = now
        if planned:
            self._planned_at = planned_at

    def _compare(self, old: dict[int, int], new: dict[int, int], planned: bool, t: float) -> None:
        if self._status.get(NAVIGATE) is None:
            self._set(NAVIGATE, RUNNING, t)
        recovering = new[st.RECOVERIES] > old[st.RECOVERIES] or new[st.FAILED_ACTIONS] > old[st.FAILED_ACTIONS]
        self._end_of_action(old, new, t)
        if planned:
            self._set(PLAN, SUCCESS, t)
        if new[st.PLAN_RETRIED] > old[st.PLAN_RETRIED] or (old[st.PLAN_RETRIED] and recovering):
            self._set(PLAN, FAILURE, t)
        if new[st.PLAN_RETRIED] > old[st.PLAN_RETRIED]:
            self._set(CLEAR_GLOBAL, SUCCESS, t)
        if new[st.FOLLOW_RETRIED] > old[st.FOLLOW_RETRIED]:
            self._set(FOLLOW, FAILURE, t)
            self._set(CLEAR_LOCAL, SUCCESS, t)
        elif new[st.RECOVERIES] > old[st.RECOVERIES]:
            self._set(FOLLOW, FAILURE, t)
        if new[st.NEXT_ACTION] != old[st.NEXT_ACTION]:
            begun = OF_MODE.get(new[st.MODE], ACTIONS[0])
            self._set(begun, RUNNING if new[st.MODE] in OF_MODE else SUCCESS, t)
        if new[st.MODE] == st.DRIVE and (planned or new[st.FOLLOW_RETRIED] > old[st.FOLLOW_RETRIED]):
            self._set(FOLLOW, RUNNING, t)

    def _end_of_action(self, old: dict[int, int], new: dict[int, int], t: float) -> None:
        """The recovery under way, or the whole task, ends."""
        if old[st.MODE] in OF_MODE and new[st.MODE] != old[st.MODE]:
            failed = new[st.FAILED_ACTIONS] > old[st.FAILED_ACTIONS]
            self._set(OF_MODE[old[st.MODE]], FAILURE if failed else SUCCESS, t)
        if new[st.MODE] == st.DONE and old[st.MODE] != st.DONE:
            end = SUCCESS if new[st.RESULT] == st.REACHED else FAILURE
            self._set(FOLLOW, end, t)
            self._set(NAVIGATE, end, t)

    def _set(self, node: str, status: str, t: float) -> None:
        """Note a status; a node that ends again begins again first."""
        before = self._status.get(node, IDLE)
        if status != before or status != RUNNING:
            self.changes.append(NodeChange(t, node, RUNNING if before == status else before, status))
        self._status[node] = status


CRITICS = ("RotateToGoal", "BaseObstacle", "GoalAlign", "PathAlign", "PathDist", "GoalDist")
"""The critics that score; Oscillation only forbids."""
BANS = [dwb.BAN_LEFT, dwb.BAN_RIGHT, dwb.BAN_ASIDE_LEFT, dwb.BAN_ASIDE_RIGHT]


def scales(p: Stack) -> tuple[float, ...]:
    """Return the factor of each of `CRITICS`, as DWB publishes it."""
    own, per_cell = p.dwb, 0.5 * p.resolution
    distances = (own.goal_align_scale, own.path_align_scale, own.path_distance_scale, own.goal_distance_scale)
    return (own.rotate_to_goal_scale, own.obstacle_scale, *(scale * per_cell for scale in distances))


def raw_scores(
    state: State, samples: Floats, ends: Floats, measured: Floats, bans: Ints, pose: tuple[float, float, float]
) -> tuple[Floats, Floats]:
    """Return the raw scores of every sample by every critic, (S, `CRITICS`), and its total, (S,), after `dwb.choose`.

    The scales times the raw scores add up to the total, which is infinite where a critic forbids the sample.

    Args:
        ends: where the samples end, in the frame of the robot (`Rollouts.ends`).
        measured: forward speed, yaw rate and speed to the left that the odometry told.
        bans: turns to the left and right, steps to the left and right that the Oscillation critic forbids.
        pose: x, y, yaw of the robot in the local frame.
    """
    nav, master, path, p = state.nav, state.local[st.MASTER], state.path[1], state.stack
    window = (int(nav[st.WINDOW_COLUMN]), int(nav[st.WINDOW_ROW]))
    x, y, yaw = pose
    on_plan = state.scratch.sources[:, : nav[dwb.SOURCES]].astype(np.int64)
    goal, align = on_plan[:, -1], _align_cell(nav, path, x, y, window, master.shape, p)
    cos, sin = math.cos(yaw) / p.resolution, math.sin(yaw) / p.resolution
    column, row = x / p.resolution - window[0], y / p.resolution - window[1]
    (end, is_on), (ahead, is_ahead_on) = (
        _cells(column, row, cos, sin, ends[:, k], ends[:, k + 1], master.shape) for k in (0, 3)
    )
    goal_x, goal_y = path[nav[dwb.PLAN_END] - 1]
    far = math.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2) > p.dwb.forward_point_m
    v, w, side = samples[:, SAMPLE_V], samples[:, SAMPLE_W], samples[:, SAMPLE_SIDE]
    error = yaw + ends[:, 2] - float(state.goals[-1, 2] - state.own.frame[MAP_YAW])  # as the robot believes it
    off = np.abs(error - 2.0 * math.pi * np.floor((error + math.pi) / (2.0 * math.pi)))
    rotate, forbidden = np.zeros(len(ends)), np.zeros(len(ends), bool)
    if nav[dwb.IN_WINDOW] and nav[dwb.ROTATING]:
        rotate, forbidden = off, (v > 0.0) | (side != 0.0)
    elif nav[dwb.IN_WINDOW]:
        rotate = p.dwb.slowing_factor * v * v + p.dwb.slowing_factor * side * side + off
        forbidden = v * v + side * side >= measured[0] * measured[0] + measured[2] * measured[2]
    for ban, way in zip(bans, (w, -w, side, -side), strict=True):
        forbidden |= bool(ban) & (way > 0.0)
    raw = [
        rotate,
        master[end[1], end[0]].astype(np.float64),
        np.abs(ahead - align[:, None]).sum(axis=0),
        _from_plan(on_plan, ahead) if far else np.zeros(len(ends)),
        _from_plan(on_plan, end),
        np.abs(end - goal[:, None]).sum(axis=0),
    ]
    total = sum(scale * scores for scale, scores in zip(scales(p), raw, strict=True))
    forbidden |= ~(is_on & is_ahead_on) | (raw[1] >= INSCRIBED)
    return np.column_stack(raw), np.where(forbidden, np.inf, total)


def _align_cell(
    nav: Ints, path: Floats, x: float, y: float, window: tuple[int, int], shape: tuple[int, ...], p: Stack
) -> Ints:
    """Return the cell that GoalAlign measures from: ahead of the last pose of the plan within reach."""
    begin, last = int(nav[dwb.PLAN_BEGIN]), int(nav[dwb.PLAN_END])
    far = ((path[begin:last] - (x, y)) ** 2).sum(axis=1) > (0.5 * p.maps.local_size_m) ** 2
    end = begin + int(far.argmax()) if far.any() else last
    points = path[begin:end].copy()
    bearing = math.atan2(path[last - 1, 1] - y, path[last - 1, 0] - x)
    points[-1] += p.dwb.forward_point_m * math.cos(bearing), p.dwb.forward_point_m * math.sin(bearing)
    cells = np.floor(points / p.resolution - window).astype(np.int64)
    inside = np.all((cells >= 0) & (cells < shape[::-1]), axis=1).reshape(-1)
    first = int(inside.argmax())
    leaves = ~inside[first:]
    return np.asarray(cells[first + int(leaves.argmax()) - 1] if leaves.any() else cells[-1])


def _cells(
    column: float, row: float, cos: float, sin: float, dx: Floats, dy: Floats, shape: tuple[int, ...]
) -> tuple[Ints, NDArray[np.bool_]]:
    """Return columns and rows of places in the frame of the robot, kept on the map, and which of them are on it."""
    columns, rows = column + cos * dx - sin * dy, row + sin * dx + cos * dy
    is_on = (columns >= 0.0) & (columns < shape[1]) & (rows >= 0.0) & (rows < shape[0])
    kept = np.array([np.clip(columns, 0, shape[1] - 1), np.clip(rows, 0, shape[0] - 1)])
    return kept.astype(np.int64), is_on


def _from_plan(on_plan: Ints, cells: Ints) -> Floats:
    """Return |Δcolumn| + |Δrow| from cells to the plan cell nearest by Euclid, the earlier one of equals."""
    away = cells[:, :, None] - on_plan[:, None, :]
    nearest = (away**2).sum(axis=0).argmin(axis=1)
    return np.asarray(np.abs(away).sum(axis=0)[np.arange(cells.shape[1]), nearest], dtype=np.float64)


FRAME_TICKS = 10
"""A frame every 0.1 s."""
PHASES = {st.DRIVE: "drive", st.SPIN: "spin", st.WAIT: "wait", st.BACK_UP: "back up", st.DONE: "done"}
"""What the behaviour tree does; spin, wait and back up are recoveries."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """What the local planner tried when it was asked last. S sampled velocities."""

    t: float
    """When it was asked, s."""
    pose: tuple[float, float, float]
    """Where the robot was: x, y, yaw."""
    velocity: Floats
    """(S, 2) forward speed (m/s) and yaw rate (rad/s) of each sample; (S, 3) with the speed to the left (m/s) for a
    base that moves sideways."""
    end: Floats
    """(S, 2) x and y where the sampled trajectory ends, world frame."""
    score: Floats
    """(S,) total of all critics, lower is better; infinite where a critic forbids the sample, and where its
    trajectory was found to meet an obstacle."""
    best: int
    """Index of the chosen sample; -1 where none was allowed."""
    critics: tuple[str, ...] = ()
    """The critics whose raw scores, times their scales, add up to the total."""
    scales: tuple[float, ...] = ()
    raw: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """(S, critics) what each critic says of each sample; without meaning where the total is infinite."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Patch:
    """The part of a costmap that is new: its cells, and the row and column of the first of them."""

    row: int
    column: int
    cells: NDArray[np.uint8]

    def onto(self, costmap: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return a costmap with these cells; the first patch of a trace is the whole costmap."""
        rows, columns = self.cells.shape
        if self.row + rows > costmap.shape[0] or self.column + columns > costmap.shape[1]:
            return self.cells.copy()
        changed = costmap.copy()
        changed[self.row : self.row + rows, self.column : self.column + columns] = self.cells
        return changed


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """What the robot sees, plans and does at one time. World frame, metres, radians, seconds."""

    t: float
    pose: tuple[float, float, float]
    """True x, y, yaw."""
    velocity: tuple[float, ...]
    """Measured forward speed (m/s) and yaw rate (rad/s); of a base that moves sideways also the speed to the left."""
    command: tuple[float, ...]
    """What the navigation stack asks of the base, likewise."""
    phase: str
    """One of `PHASES`."""
    recoveries: int
    seen_from: tuple[tuple[float, float, float], ...]
    """The robot's pose at the latest scan of every lidar."""
    scans: tuple[Floats, ...]
    """Ranges (m) of every lidar at its latest scan, without noise; infinite where nothing returns."""
    costmap: NDArray[np.uint8]
    """Local costmap (cells, cells), Nav2's costs; row 0 is the lowest y."""
    costmap_origin: tuple[float, float]
    """World coordinates of the corner of cell (0, 0)."""
    plan: Floats | None
    """(N, 2) where the plan is new since the last frame, else None."""
    global_costmap: Patch | None
    """What of the global costmap changed since the last frame; all of it in the first."""
    evaluation: Evaluation | None
    """The local planner's latest answer, where it is new since the last frame."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """A run with its frames, and every change of a node of the behaviour tree."""

    run: Run
    robot: Robot
    frames: tuple[Frame, ...]
    nodes: tuple[NodeChange, ...]
    resolution: float
    """Of the local costmap, m."""
    global_resolution: float
    """Of the global costmap, m."""
    global_origin: tuple[float, float]
    """Corner of the global costmap's cell (0, 0), map frame."""


def trace_run(scenario: Scenario, world: World, *, seed: int, simulator: EmbeddedSimulator | None = None) -> Trace:
    """Simulate a scenario again with everything recorded.

    Args:
        simulator: the simulator of the run, with its options.

    Raises:
        InputError: the scenario cannot be simulated.
    """
    recorder = _Recorder()
    simulator = simulator or EmbeddedSimulator()
    run = simulator.run(scenario, world, seed=seed, outside=Outside(probe=recorder, probe_ticks=1))
    return recorder.trace(run, scenario.mission.robot_record or load_robot(ROBOT))


class _Recorder:
    """A probe at every tick that copies the state every `FRAME_TICKS`."""

    def __init__(self) -> None:
        self._frames: list[Frame] = []
        self._tree = TreeLog()
        self._planned_at = -math.inf
        self._stamp = 0
        self._evaluation: Evaluation | None = None
        self._bans = np.zeros(len(BANS), np.int64)
        self._global = np.zeros((0, 0), np.uint8)
        self._maps = (0.05, 0.05, (0.0, 0.0))

    def trace(self, run: Run, robot: Robot) -> Trace:
        """Return what was recorded."""
        local, of_map, origin = self._maps
        return Trace(
            run=run, robot=robot, frames=tuple(self._frames), nodes=tuple(self._tree.changes), resolution=local,
            global_resolution=of_map, global_origin=origin,
        )  # fmt: skip

    def __call__(self, episode: Episode) -> None:
        self._tree.watch(episode.state, round(episode.t, 3))
        self._evaluate(episode.state, episode.t)
        self._bans = episode.state.nav[BANS]
        if round(episode.t / base.STEP_S) % FRAME_TICKS == 0:
            self._frames.append(self._frame(episode))

    def _frame(self, episode: Episode) -> Frame:
        state, stack, scene = episode.state, episode.state.stack, episode.scene
        body, nav, side = state.body, state.nav, stack.resolution
        self._maps = (float(side), float(scene.resolution), (float(scene.origin_x), float(scene.origin_y)))
        evaluation, self._evaluation = self._evaluation, None
        plan, planned_at, end = None, float(state.times[st.PLAN_T]), int(nav[PLAN_END])
        if planned_at != self._planned_at and end != 0:
            self._planned_at, plan = planned_at, state.path[1, :end].copy()
        return Frame(
            t=episode.t,
            pose=(float(body[base.X]), float(body[base.Y]), float(body[base.YAW])),
            velocity=_velocity(state, base.V, base.W, base.SIDE),
            command=_velocity(state, base.COMMAND_V, base.COMMAND_W, base.COMMAND_SIDE),
            phase=PHASES[int(nav[st.MODE])],
            recoveries=int(nav[st.RECOVERIES]),
            seen_from=tuple((float(x), float(y), float(yaw)) for x, y, yaw in state.scanned),
            scans=tuple(_cast(episode, lidar) for lidar in range(stack.lidars.shape[0])),
            costmap=state.local[-1].copy(),
            costmap_origin=(float(nav[st.WINDOW_COLUMN] * side), float(nav[st.WINDOW_ROW] * side)),
            plan=plan,
            global_costmap=self._new_cells(state.global_master),
            evaluation=evaluation,
        )

    def _new_cells(self, master: NDArray[np.uint8]) -> Patch | None:
        if master.shape != self._global.shape:
            self._global = master.copy()
            return Patch(row=0, column=0, cells=master.copy())
        rows, columns = np.nonzero(master != self._global)
        if not len(rows):
            return None
        top, left = int(rows.min()), int(columns.min())
        changed = master[top : rows.max() + 1, left : columns.max() + 1].copy()
        self._global[top : rows.max() + 1, left : columns.max() + 1] = changed
        return Patch(row=top, column=left, cells=changed)

    def _evaluate(self, state: State, t: float) -> None:
        """Copy what the local planner has just scored; it counts its answers in STAMP."""
        stamp = int(state.nav[STAMP])
        if stamp == self._stamp:
            return
        self._stamp = stamp
        body, samples = state.body, state.samples
        count = len(samples) if state.stack.whole_range else int(np.count_nonzero(samples[:, SAMPLE_STEPS]))
        measured = body[[base.V, base.W, base.SIDE]]
        measured[np.abs(measured) <= ODOMETRY_DEADBAND] = 0.0
        slots = np.flatnonzero((state.memo.keys == [*measured, state.times[SHARE]]).all(axis=1))
        pose = (float(body[base.X]), float(body[base.Y]), float(body[base.YAW]))
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        ends = state.memo.ends[slots[0], :count]
        ahead, left = ends[:, 0], ends[:, 1]
        parts = [SAMPLE_V, SAMPLE_W, SAMPLE_SIDE]
        # What the Oscillation critic forbade before the command of this tick; a new plan lets it forget.
        bans = np.zeros_like(self._bans) if state.times[st.PLAN_T] == t else self._bans
        raw, score = raw_scores(state, samples[:count], ends, measured, bans, pose)
        best = _first_free(state, samples, score, measured, pose)
        commanded = body[[base.COMMAND_V, base.COMMAND_W, base.COMMAND_SIDE]]
        if not state.stack.whole_range:
            samples[:, SAMPLE_STEPS] = 0.0  # the planner writes its samples anew each time, and fewer or more of them
        self._evaluation = Evaluation(
            t=round(t, 3),
            pose=pose,
            velocity=samples[:count, parts[: 3 if state.stack.limits.lateral_m_s > 0.0 else 2]].copy(),
            end=np.column_stack([pose[0] + cos * ahead - sin * left, pose[1] + sin * ahead + cos * left]),
            score=score,
            best=best if (samples[best, parts] == commanded).all() else -1,
            critics=CRITICS,
            scales=scales(state.stack),
            raw=raw,
        )


def _first_free(
    state: State, samples: Floats, score: Floats, measured: Floats, pose: tuple[float, float, float]
) -> int:
    """Return the first sample of least total whose rollout is free, -1 without; others before it become infinite."""
    resolution, master, stack = state.stack.resolution, state.local[st.MASTER], refer(state.stack)
    column, row = (pose[k] / resolution - state.nav[at] for k, at in enumerate((st.WINDOW_COLUMN, st.WINDOW_ROW)))
    v0, w0, side0 = measured
    if master[int(row), int(column)] >= INSCRIBED:
        return -1
    while math.isfinite(score[best := int(score.argmin())]):
        v, w, steps, dt, side = samples[best]
        if is_free(master, column, row, pose[2], v0, side0, w0, v, side, w, int(steps), dt, stack):
            return best
        score[best] = math.inf
    return -1


def _velocity(state: State, *parts: int) -> tuple[float, ...]:
    """Return parts of the base's state, the last one only where the base moves sideways."""
    return tuple(float(state.body[part]) for part in (parts if state.stack.limits.lateral_m_s > 0.0 else parts[:-1]))


def _cast(episode: Episode, side: int) -> Floats:
    """Cast the latest scan of a lidar again, into an array of its own and without noise."""
    state = episode.state
    mount = state.stack.lidars[side]
    ranges = np.zeros(int(mount[LIDAR_RAYS]))
    full_scan(
        ranges, state.directions[side], mount[LIDAR_VIEW] / (len(ranges) - 1), *first_ray(mount, state.scanned[side]),
        episode.scene.edges, state.legs[side],
    )  # fmt: skip
    return np.where((ranges > mount[LIDAR_MAX]) | (ranges < mount[LIDAR_MIN]), np.inf, ranges)


OF_RECORD = ("version", "default_robot")
"""Options of a stored run that the simulator adds by itself."""


def trace(
    scenario: Scenario,
    seed: int = 0,
    *,
    simulator: str | Spec = "embedded",
    stack: StackLike | None = None,
    world: World | str | Path | None = None,
    on_message: Callable[[str], None] = ignore,
) -> Trace:
    """Simulate a scenario with everything recorded: scans, costmaps, plans, trajectories tried, behaviour tree.

    A stack that is given as an instance stays open.

    Raises:
        InputError: the simulator records no traces, or the scenario cannot be simulated.
    """
    place = world_of(scenario.mission, world)
    check_valid(scenario, place)
    made = make_simulator(simulator, stack)
    if not isinstance(made, EmbeddedSimulator):
        raise InputError(f'The simulator "{made.name}" records no traces; "embedded" does.')
    with closing(made):
        made.prepare(on_message)
        found = trace_run(scenario, place, seed=seed, simulator=made)
    return replace(found, run=rounded(found.run))  # as runs are before they are measured: its bag measures the same


def trace_again(run: Run, scenario: Scenario, world: World, *, on_message: Callable[[str], None] = ignore) -> Trace:
    """Simulate a stored run again with everything recorded, and check that it is the same run.

    Raises:
        InputError: the run is of another scenario or simulator, or this version simulates it otherwise.
    """
    if run.scenario_id != scenario.id:
        raise InputError(f"The run {run.id} is of another scenario ({run.scenario_id}, not {scenario.id}).")
    if run.simulator != "embedded":
        raise InputError(f'The run {run.id} is of the simulator "{run.simulator}", which records no traces.')
    told = run.details.get("stack")
    if isinstance(told, Mapping) and not told.get("repeatable", True):
        raise InputError(
            f"The run {run.id} is of a real system, which gives another run every time. It cannot be traced. "
            "`--stack` with the scenario records a new one.",
            code="run-not-repeatable",
        )
    options = {"stack": STUDY_STACK} | {name: value for name, value in run.options.items() if name not in OF_RECORD}
    made = EmbeddedSimulator(**options)  # type: ignore[arg-type]  # checked by it
    with closing(made):
        made.prepare(on_message)
        found = trace_run(scenario, world, seed=run.seed, simulator=made)
    again = rounded(found.run)
    if again.id != run.id or PackedRun.of(again).data != PackedRun.of(rounded(run)).data:
        made_by = run.options.get("version")
        raise InputError(
            f"The run {run.id} cannot be repeated: it was simulated by rules of version {made_by}, and these are of "
            f"version {made.options['version']}. Run the campaign again, or trace it with the RVSG that made it."
        )
    return replace(found, run=again)
