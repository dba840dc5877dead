"""A trace: one run simulated again with everything the robot sees and plans. Runs are deterministic, so it is the run.

Reading the state changes nothing: the trajectory of a traced run equals that of the run, bit for bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.robots import Robot, load_robot
from rvsg.scenario.agents import decode
from rvsg.scenario.scenario import ROBOT, Scenario
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.episode import Episode, Outside
from rvsg.simulation.embedded.navigation.controllers.dwb import PLAN_END
from rvsg.simulation.embedded.options import SimulatorOptions
from rvsg.simulation.embedded.sensing.lidar import FAR, NO_RETURN, scan
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.embedded.stack import (
    LIDAR_MAX,
    LIDAR_MIN,
    LIDAR_RAYS,
    LIDAR_VIEW,
    LIDAR_X,
    LIDAR_Y,
    LIDAR_YAW,
)
from rvsg.simulation.run import Run
from rvsg.world.world import World

Floats = NDArray[np.float64]

FRAME_TICKS = 10
"""A frame every 0.1 s."""
PHASES = {st.DRIVE: "drive", st.SPIN: "spin", st.WAIT: "wait", st.BACK_UP: "back up", st.DONE: "done"}
"""What the behaviour tree does; spin, wait and back up are recoveries."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """What the robot sees, plans and does at one time. World frame, metres, radians, seconds."""

    t: float
    pose: tuple[float, float, float]
    """True x, y, yaw."""
    velocity: tuple[float, float]
    """Measured forward speed (m/s) and yaw rate (rad/s)."""
    command: tuple[float, float]
    """What the navigation stack asks of the base."""
    phase: str
    """One of `PHASES`."""
    recoveries: int
    scans: tuple[Floats, ...]
    """Ranges (m) of every lidar at its latest scan, without noise; infinite where nothing returns."""
    costmap: NDArray[np.uint8]
    """Local costmap (cells, cells), Nav2's costs; row 0 is the lowest y."""
    costmap_origin: tuple[float, float]
    """World coordinates of the corner of cell (0, 0)."""
    plan: Floats | None
    """(N, 2) where the plan is new since the last frame, else None."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """A run with its frames; `resolution` (m) is that of the local costmap."""

    run: Run
    robot: Robot
    frames: tuple[Frame, ...]
    resolution: float


def trace_run(
    scenario: Scenario, world: World, *, seed: int, options: SimulatorOptions | None = None, ticks: int = FRAME_TICKS
) -> Trace:
    """Simulate a scenario again with everything recorded.

    Args:
        options: the options the run was simulated with.
        ticks: a frame every so many ticks of 10 ms.

    Raises:
        InputError: the scenario cannot be simulated.
    """
    robot = scenario.mission.robot_record or load_robot(ROBOT)
    recorder = _Recorder()
    run = simulate_agents(
        world,
        scenario.mission.route,
        decode(scenario.people, world.grid),
        options=options,
        seed=seed,
        scenario_id=scenario.id,
        robot=scenario.mission.robot_record,
        outside=Outside(probe=recorder, probe_ticks=ticks),
    )
    return Trace(run=run, robot=robot, frames=tuple(recorder.frames), resolution=recorder.resolution)


class _Recorder:
    """A probe that copies the state."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.resolution = 0.05
        self._planned_at = -math.inf

    def __call__(self, episode: Episode) -> None:
        state, stack = episode.state, episode.state.stack
        body, nav = state.body, state.nav
        self.resolution = float(stack.resolution)
        plan = None
        planned_at = float(state.times[st.PLAN_T])
        end = int(nav[PLAN_END])
        if planned_at != self._planned_at and end > 0:
            plan = state.path[1, :end].copy()
            self._planned_at = planned_at
        self.frames.append(
            Frame(
                t=episode.t,
                pose=(float(body[base.X]), float(body[base.Y]), float(body[base.YAW])),
                velocity=(float(body[base.V]), float(body[base.W])),
                command=(float(body[base.COMMAND_V]), float(body[base.COMMAND_W])),
                phase=PHASES[int(nav[st.MODE])],
                recoveries=int(nav[st.RECOVERIES]),
                scans=tuple(_cast(episode, side) for side in range(stack.lidars.shape[0])),
                costmap=state.local[-1].copy(),
                costmap_origin=(
                    float(nav[st.WINDOW_COLUMN] * stack.resolution),
                    float(nav[st.WINDOW_ROW] * stack.resolution),
                ),
                plan=plan,
            )
        )


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
        state.stack.scan_reach,
    )
    nothing = (ranges == NO_RETURN) | (ranges >= FAR) | (ranges > mount[LIDAR_MAX]) | (ranges < mount[LIDAR_MIN])
    return np.where(nothing, np.inf, ranges)
