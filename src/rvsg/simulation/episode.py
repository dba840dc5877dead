"""One episode as a single compiled loop: sensing, planning, control, motion and people on one clock of 10 ms."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.simulation import robot
from rvsg.simulation import robot_state as st
from rvsg.simulation.compiled import inner, kernel
from rvsg.simulation.costmap import LOCAL_CELLS, LOCAL_RESOLUTION_M
from rvsg.simulation.lidar import place_legs
from rvsg.simulation.localisation import ACTIVE, localise
from rvsg.simulation.navigator import begin_following, navigate, place_path
from rvsg.simulation.people import PERIOD_S, Crowd, tick
from rvsg.simulation.perception import update_global, update_local
from rvsg.simulation.robot_state import Settings, State
from rvsg.simulation.scene import Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAD_TICKS = 200
"""The costmaps run 2 s before the robot gets its goal, with everybody standing at their starts."""
LOCAL_PERIOD_S = 0.2
GLOBAL_PERIOD_S = 1.0
SCAN_TICKS = 10
"""The lidars, and with them the robot's localisation, run at 10 Hz: a costmap's scan is up to 0.1 s old."""
OUT_OF_SIGHT_M = 1e9
TRACK_TICKS = 5
"""Trajectories are recorded every 50 ms of simulated time."""


class Recording(NamedTuple):
    """What a run leaves, filled from the front; `counts` (3,) says how far: track rows, log rows, inertial samples.

    `track` (N, 7) and `log` (M, 7): t, x, y, yaw, v, omega, acceleration; `track_humans` and `log_humans`
    (..., H, 4): x, y, yaw, speed. `imu` (K,) acceleration magnitude every 10 ms. The log's times are wall seconds.
    """

    track: Floats
    track_humans: Floats
    log: Floats
    log_humans: Floats
    imu: Floats
    counts: Ints


def new_recording(time_limit_s: float, clock: float, humans: int) -> Recording:
    """Space for a run of that length (wall seconds)."""
    ticks = int(time_limit_s * clock / robot.STEP_S) + 20
    rows = int(time_limit_s / 0.5) + 4
    return Recording(
        track=np.zeros((ticks // TRACK_TICKS + 3, 7)),
        track_humans=np.zeros((ticks // TRACK_TICKS + 3, humans, 4)),
        log=np.zeros((rows, 7)),
        log_humans=np.zeros((rows, humans, 4)),
        imu=np.zeros(ticks),
        counts=np.zeros(3, np.int64),
    )


@inner
def write_robot(row: Floats, t: float, body: Floats, acceleration: float) -> None:
    """One row of a record: time, pose, velocities, acceleration."""
    row[0] = t
    row[1] = body[robot.X]
    row[2] = body[robot.Y]
    row[3] = body[robot.YAW]
    row[4] = body[robot.V]
    row[5] = body[robot.W]
    row[6] = acceleration


@inner
def write_track(record: Recording, t: float, body: Floats, acceleration: float, crowd: Crowd) -> None:
    """A row of the trajectory: everything where it is now."""
    n = record.counts[0]
    if n >= record.track.shape[0]:
        return
    write_robot(record.track[n], t, body, acceleration)
    for i in range(crowd.x.size):
        record.track_humans[n, i, 0] = crowd.x[i]
        record.track_humans[n, i, 1] = crowd.y[i]
        record.track_humans[n, i, 2] = crowd.yaw[i]
        record.track_humans[n, i, 3] = min(crowd.speed[i], math.sqrt(crowd.vx[i] ** 2 + crowd.vy[i] ** 2))
    record.counts[0] = n + 1


@inner
def write_log(record: Recording, wall_s: float, body: Floats, acceleration: float, crowd: Crowd) -> None:
    """A row as the study's client writes it: people as last published, one tick old."""
    n = record.counts[1]
    if n >= record.log.shape[0]:
        return
    write_robot(record.log[n], wall_s, body, acceleration)
    for i in range(crowd.x.size):
        record.log_humans[n, i, 0] = crowd.logged_x[i]
        record.log_humans[n, i, 1] = crowd.logged_y[i]
        record.log_humans[n, i, 2] = crowd.logged_yaw[i]
        record.log_humans[n, i, 3] = crowd.logged_speed[i]
    record.counts[1] = n + 1


@inner
def prepare(state: State, settings: Settings, phases: Floats) -> None:
    """Set the timers as they are 2 s before the start; `phases` (s) of smoother, local and global map."""
    state.body[robot.COMMAND_T] = -1e9
    half = 0.5 * (LOCAL_CELLS - 0.5)
    state.nav[st.WINDOW_COLUMN] = int(state.body[robot.X] / LOCAL_RESOLUTION_M - half)
    state.nav[st.WINDOW_ROW] = int(state.body[robot.Y] / LOCAL_RESOLUTION_M - half)
    state.nav[st.NEED_PLAN] = 1
    state.nav[st.CLEAR_GLOBAL] = 1
    begin = -LEAD_TICKS * robot.STEP_S
    state.times[st.SMOOTH_T] = begin + phases[0]
    state.times[st.LOCAL_T] = begin + phases[1]
    state.times[st.GLOBAL_T] = begin + phases[2]
    begin_following(state, settings.robot_start_s)


@inner
def update_maps(scene: Scene, state: State, settings: Settings, t: float) -> None:
    """Update each costmap that is due or to be cleared, with the latest scans."""
    do_local = state.nav[st.CLEAR_LOCAL] != 0
    do_global = state.nav[st.CLEAR_GLOBAL] != 0
    if t >= state.times[st.LOCAL_T] - 1e-9:
        state.times[st.LOCAL_T] += LOCAL_PERIOD_S * settings.clock
        do_local = True
    if t >= state.times[st.GLOBAL_T] - 1e-9:
        state.times[st.GLOBAL_T] += GLOBAL_PERIOD_S * settings.clock
        do_global = True
    if do_local:
        update_local(scene, state, settings)
    if do_global:
        update_global(scene, state, settings)


@inner
def take_scan(scene: Scene, state: State, settings: Settings, crowd: Crowd, t: float) -> None:
    """Keep what the lidars see now: the robot's pose and people's legs; rays are cast when a costmap wants them.

    With the scan the robot finds out where it is; a plan it follows moves with its belief.
    """
    if settings.humans_displayed_late:
        place_legs(state.legs, crowd.logged_x, crowd.logged_y, crowd.logged_yaw, crowd.walked)
        for i in range(crowd.x.size):
            if t < crowd.start_time[i] + PERIOD_S:
                state.legs[2 * i : 2 * i + 2] = OUT_OF_SIGHT_M
    else:
        place_legs(state.legs, crowd.x, crowd.y, crowd.yaw, crowd.walked)
    x, y, yaw = state.body[robot.X], state.body[robot.Y], state.body[robot.YAW]
    state.scanned[0] = x
    state.scanned[1] = y
    state.scanned[2] = yaw
    if state.own.counts[ACTIVE] != 0 and localise(state.own, t, x, y, yaw, scene.edges, state.legs):
        place_path(state)


@kernel
def run_episode(
    scene: Scene,
    state: State,
    settings: Settings,
    crowd: Crowd,
    phases: Floats,
    intervals: Floats,
    record: Recording,
) -> None:
    """Run until the goal is reached, navigation gives up or the time limit passes; the result is in `state.nav`.

    `intervals`: wall seconds between the log's rows. The state must be as `new_state` makes it, with the robot's pose
    set; it is changed in place.
    """
    prepare(state, settings, phases)
    take_scan(scene, state, settings, crowd, -LEAD_TICKS * robot.STEP_S)
    times = state.times
    body = state.body
    end = settings.time_limit_s * settings.clock
    next_row = 0.0
    rows = 0
    people_t = -LEAD_TICKS * robot.STEP_S + settings.people_phase_s
    forward_sum = 0.0
    left_sum = 0.0
    acceleration = 0.0
    running = True
    k = -LEAD_TICKS
    while True:
        t = k * robot.STEP_S
        update_maps(scene, state, settings, t)
        if t >= people_t - 1e-9:
            people_t += PERIOD_S
            tick(crowd, t, PERIOD_S, body[robot.X], body[robot.Y], body[robot.YAW], body[robot.V])
        if (k - settings.scan_phase_ticks) % SCAN_TICKS == 0:
            take_scan(scene, state, settings, crowd, t)
        if t >= settings.robot_start_s:
            navigate(scene, state, settings, t)
            if running and state.nav[st.MODE] == st.DONE:
                running = False
                end = min(end, t + settings.result_delay_s * settings.clock)
        if t >= times[st.SMOOTH_T] - 1e-9:
            times[st.SMOOTH_T] += robot.SMOOTHER_PERIOD_S * settings.clock
            robot.smooth(body, t)
        if k >= 0:
            if k % TRACK_TICKS == 0:
                mean = math.sqrt(forward_sum**2 + left_sum**2) / TRACK_TICKS
                write_track(record, t, body, mean, crowd)
                forward_sum = 0.0
                left_sum = 0.0
            if t >= end - 1e-9:
                write_log(record, t / settings.clock, body, acceleration, crowd)
                return
            if t >= next_row * settings.clock - 0.5 * robot.STEP_S:
                write_log(record, next_row, body, acceleration, crowd)
                next_row += intervals[rows % intervals.size]
                rows += 1
        forward, left = robot.advance(body, settings.yaw_gain)
        acceleration = math.sqrt(forward * forward + left * left)
        forward_sum += forward
        left_sum += left
        if k >= 0 and record.counts[2] < record.imu.size:
            record.imu[record.counts[2]] = acceleration
            record.counts[2] += 1
        k += 1
