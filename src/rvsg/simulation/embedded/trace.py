"""A trace: one run simulated again with everything the robot sees and plans. Runs are deterministic, so it is the run.

Recording changes nothing of the run: the trajectory of a traced run equals that of the run, bit for bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rvsg.robots.robot import Robot, load_robot
from rvsg.scenario.scenario import ROBOT, Scenario
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.episode import Episode, Outside
from rvsg.simulation.embedded.navigation.behaviour_tree import ODOMETRY_DEADBAND
from rvsg.simulation.embedded.navigation.controllers.critics import CRITICS, raw_scores, scales
from rvsg.simulation.embedded.navigation.controllers.dwb import PLAN_END, STAMP
from rvsg.simulation.embedded.navigation.controllers.samples import (
    SAMPLE_SIDE,
    SAMPLE_STEPS,
    SAMPLE_V,
    SAMPLE_W,
)
from rvsg.simulation.embedded.sensing.lidar import FAR, NO_RETURN, scan
from rvsg.simulation.embedded.sensing.localisation import MAP_YAW
from rvsg.simulation.embedded.simulator import EmbeddedSimulator
from rvsg.simulation.embedded.stack import (
    LIDAR_MAX,
    LIDAR_MIN,
    LIDAR_RAYS,
    LIDAR_VIEW,
    LIDAR_X,
    LIDAR_Y,
    LIDAR_YAW,
)
from rvsg.simulation.embedded.state import State
from rvsg.simulation.embedded.tree_log import NodeChange, TreeLog
from rvsg.simulation.run import Run
from rvsg.world.world import World

Floats = NDArray[np.float64]

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


def trace_run(
    scenario: Scenario, world: World, *, seed: int, simulator: EmbeddedSimulator | None = None, ticks: int = FRAME_TICKS
) -> Trace:
    """Simulate a scenario again with everything recorded.

    Args:
        simulator: the simulator of the run, with its options.
        ticks: a frame every so many ticks of 10 ms.

    Raises:
        InputError: the scenario cannot be simulated.
    """
    recorder = _Recorder(ticks)
    simulator = simulator or EmbeddedSimulator()
    run = simulator.run(scenario, world, seed=seed, outside=Outside(probe=recorder, probe_ticks=1))
    return recorder.trace(run, scenario.mission.robot_record or load_robot(ROBOT))


class _Recorder:
    """A probe at every tick that copies the state every so many ticks."""

    def __init__(self, ticks: int) -> None:
        self._ticks = ticks
        self._frames: list[Frame] = []
        self._tree = TreeLog()
        self._planned_at = -math.inf
        self._stamp = 0
        self._evaluation: Evaluation | None = None
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
        self._evaluate(episode.state, round(episode.t, 3))
        if round(episode.t / base.STEP_S) % self._ticks == 0:
            self._frames.append(self._frame(episode))

    def _frame(self, episode: Episode) -> Frame:
        state, stack, scene = episode.state, episode.state.stack, episode.scene
        body, nav = state.body, state.nav
        self._maps = (float(stack.resolution), float(scene.resolution), (float(scene.origin_x), float(scene.origin_y)))
        evaluation, self._evaluation = self._evaluation, None
        lidars = range(stack.lidars.shape[0])
        return Frame(
            t=episode.t,
            pose=(float(body[base.X]), float(body[base.Y]), float(body[base.YAW])),
            velocity=_velocity(state, base.V, base.W, base.SIDE),
            command=_velocity(state, base.COMMAND_V, base.COMMAND_W, base.COMMAND_SIDE),
            phase=PHASES[int(nav[st.MODE])],
            recoveries=int(nav[st.RECOVERIES]),
            seen_from=tuple((float(x), float(y), float(yaw)) for x, y, yaw in state.scanned),
            scans=tuple(_cast(episode, side) for side in lidars),
            costmap=state.local[-1].copy(),
            costmap_origin=(
                float(nav[st.WINDOW_COLUMN] * stack.resolution),
                float(nav[st.WINDOW_ROW] * stack.resolution),
            ),
            plan=self._new_plan(state),
            global_costmap=self._new_cells(state.global_master),
            evaluation=evaluation,
        )

    def _new_plan(self, state: State) -> Floats | None:
        planned_at, end = float(state.times[st.PLAN_T]), int(state.nav[PLAN_END])
        if planned_at == self._planned_at or end == 0:
            return None
        self._planned_at = planned_at
        return state.path[1, :end].copy()

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
        count = len(samples) if state.stack.dwb_whole_range else int(np.count_nonzero(samples[:, SAMPLE_STEPS]))
        measured = [u if abs(u) > ODOMETRY_DEADBAND else 0.0 for u in body[[base.V, base.W, base.SIDE]].tolist()]
        slots = np.flatnonzero((state.memo.keys == measured).all(axis=1))
        pose = (float(body[base.X]), float(body[base.Y]), float(body[base.YAW]))
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        ends = state.memo.ends[slots[0], :count]
        ahead, left = ends[:, 0], ends[:, 1]
        parts = [SAMPLE_V, SAMPLE_W, SAMPLE_SIDE]
        score = state.scratch.totals[:count].copy()
        commanded = body[[base.COMMAND_V, base.COMMAND_W, base.COMMAND_SIDE]]
        asked = (samples[:count, parts] == commanded).all(axis=1)
        chosen = np.flatnonzero(asked & np.isfinite(score))
        raw = raw_scores(
            state.nav, state.scratch.sources, samples[:count], ends, state.local[st.MASTER],
            (int(state.nav[st.WINDOW_COLUMN]), int(state.nav[st.WINDOW_ROW])), state.path[1], _goal_yaw(state), pose,
            state.stack,
        )  # fmt: skip
        if not state.stack.dwb_whole_range:
            samples[:, SAMPLE_STEPS] = 0.0  # the planner writes its samples anew each time, and fewer or more of them
        self._evaluation = Evaluation(
            t=t,
            pose=pose,
            velocity=samples[:count, parts[: 3 if state.stack.base_side > 0.0 else 2]].copy(),
            end=np.column_stack([pose[0] + cos * ahead - sin * left, pose[1] + sin * ahead + cos * left]),
            score=score,
            best=int(chosen[0]) if len(chosen) else -1,
            critics=CRITICS,
            scales=scales(state.stack),
            raw=raw,
        )


def _velocity(state: State, *parts: int) -> tuple[float, ...]:
    """Return parts of the base's state, the last one only where the base moves sideways."""
    return tuple(float(state.body[part]) for part in (parts if state.stack.base_side > 0.0 else parts[:-1]))


def _goal_yaw(state: State) -> float:
    """Return the goal's yaw as the robot believes it."""
    return float(state.goals[-1, 2] - state.own.frame[MAP_YAW])


def _cast(episode: Episode, side: int) -> Floats:
    """Cast the latest scan of a lidar again, into an array of its own and without noise."""
    state, scene = episode.state, episode.scene
    mount, (x, y, yaw) = state.stack.lidars[side], state.scanned[side]
    rays = int(mount[LIDAR_RAYS])
    ranges = np.zeros(rays)
    scan(
        ranges,
        state.directions[side],
        x + mount[LIDAR_X] * math.cos(yaw) - mount[LIDAR_Y] * math.sin(yaw),
        y + mount[LIDAR_X] * math.sin(yaw) + mount[LIDAR_Y] * math.cos(yaw),
        yaw + mount[LIDAR_YAW] - 0.5 * mount[LIDAR_VIEW],
        scene.edges,
        np.arange(len(scene.edges), dtype=np.int32),
        state.legs[side],
        episode.settings.closed,
        mount[LIDAR_VIEW],
        float(mount[LIDAR_MAX]),
    )
    nothing = (ranges == NO_RETURN) | (ranges >= FAR) | (ranges > mount[LIDAR_MAX]) | (ranges < mount[LIDAR_MIN])
    return np.where(nothing, np.inf, ranges)
