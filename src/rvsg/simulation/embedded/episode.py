"""One episode as a single compiled loop: sensing, planning, control, motion and people on one clock of 10 ms."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import SimulationError
from rvsg.core.kernels import compile_aside, compile_for, float64, inner, int64, is_cached, kernel, type_of
from rvsg.core.references import refer
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.behaviour_tree import begin_following, choose_dwb, command, follow, navigate, place_path
from rvsg.simulation.embedded.lidar import place_legs
from rvsg.simulation.embedded.localisation import ACTIVE, localise
from rvsg.simulation.embedded.people.behaviour import tick
from rvsg.simulation.embedded.people.contact import touch_people
from rvsg.simulation.embedded.people.crowd import PERIOD_S, Crowd
from rvsg.simulation.embedded.perception import keep_returns, scale_command, update_global, update_local, watch_zones
from rvsg.simulation.embedded.robot_parameters import LIDAR_TICKS
from rvsg.simulation.embedded.state import Scene, Settings, State
from rvsg.simulation.embedded.walls import touch_walls

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAD_TICKS = 200
"""The costmaps run 2 s before the robot gets its goal, with everybody standing at their starts."""
OUT_OF_SIGHT_M = 1e9
TRACK_TICKS = 5
"""Trajectories are recorded every 50 ms of simulated time."""


class Recording(NamedTuple):
    """What a run leaves, filled from the front; `counts` (3,) says how far: track rows, log rows, inertial samples.

    `track` (N, 8) and `log` (M, 8): t, x, y, yaw, v, omega, acceleration, speed to the left; `track_humans`
    and `log_humans` (..., H, 4): x, y, yaw, speed. `imu` (K,) acceleration magnitude every 10 ms. The log's times are
    wall seconds.
    """

    track: Floats
    track_humans: Floats
    log: Floats
    log_humans: Floats
    imu: Floats
    counts: Ints


def new_recording(time_limit_s: float, clock: float, humans: int) -> Recording:
    """Space for a run of that length (wall seconds)."""
    ticks = int(time_limit_s * clock / base.STEP_S) + 20
    rows = int(time_limit_s / 0.5) + 4
    return Recording(
        track=np.zeros((ticks // TRACK_TICKS + 3, 8)),
        track_humans=np.zeros((ticks // TRACK_TICKS + 3, humans, 4)),
        log=np.zeros((rows, 8)),
        log_humans=np.zeros((rows, humans, 4)),
        imu=np.zeros(ticks),
        counts=np.zeros(3, np.int64),
    )


@inner
def write_robot(row: Floats, t: float, body: Floats, acceleration: float) -> None:
    """One row of a record: time, pose, velocities, acceleration."""
    row[0], row[1], row[2], row[3] = t, body[base.X], body[base.Y], body[base.YAW]
    row[4], row[5], row[6], row[7] = body[base.V], body[base.W], acceleration, body[base.SIDE]


@inner
def write_track(record: Recording, t: float, body: Floats, acceleration: float, crowd: Crowd) -> None:
    """A row of the trajectory: everything where it is now."""
    n = record.counts[0]
    if n >= record.track.shape[0]:
        return
    write_robot(record.track[n], t, body, acceleration)
    humans = record.track_humans[n]
    for i in range(crowd.x.size):
        humans[i, 0] = crowd.x[i]
        humans[i, 1] = crowd.y[i]
        humans[i, 2] = crowd.yaw[i]
        humans[i, 3] = min(crowd.speed[i], math.sqrt(crowd.vx[i] ** 2 + crowd.vy[i] ** 2))
    record.counts[0] = n + 1


@inner
def write_log(record: Recording, wall_s: float, body: Floats, acceleration: float, crowd: Crowd) -> None:
    """A row as the study's client writes it: people as last published, one tick old."""
    n = record.counts[1]
    if n >= record.log.shape[0]:
        return
    write_robot(record.log[n], wall_s, body, acceleration)
    humans = record.log_humans[n]
    for i in range(crowd.x.size):
        humans[i, 0] = crowd.logged_x[i]
        humans[i, 1] = crowd.logged_y[i]
        humans[i, 2] = crowd.logged_yaw[i]
        humans[i, 3] = crowd.logged_speed[i]
    record.counts[1] = n + 1


@inner(cached=True)
def update_maps(scene: Scene, state: State, settings: Settings, t: float) -> None:
    """Update each costmap that is due or to be cleared, with the latest scans.

    A cleared layer of Nav2 is not current before its next regular update (`ObstacleLayer::reset`).
    """
    waits = state.stack.behaviours.waits_for_costmaps
    do_local = state.nav[st.CLEAR_LOCAL] != 0 and not waits
    do_global = state.nav[st.CLEAR_GLOBAL] != 0 and not waits
    if t >= state.times[st.LOCAL_T] - 1e-9:
        state.times[st.LOCAL_T] += 1.0 / state.stack.maps.local_update_hz * settings.clock
        do_local = True
    if t >= state.times[st.GLOBAL_T] - 1e-9:
        state.times[st.GLOBAL_T] += 1.0 / state.stack.maps.global_update_hz * settings.clock
        do_global = True
    if do_local:
        update_local(scene, state, settings)
    if do_global:
        update_global(scene, state, settings)


@inner
def take_scan(scene: Scene, state: State, settings: Settings, crowd: Crowd, side: int, like: int, t: float) -> None:
    """Keep what a lidar sees now: the robot's pose and people's legs; rays are cast when a costmap wants them.

    With a scan of the first lidar the robot finds out where it is; a plan it follows moves with its belief. `like`: a
    lidar whose scan was taken at the same time; -1: none was.
    """
    legs = state.legs[side]
    if like >= 0:
        for n in range(legs.shape[0]):
            legs[n, 0] = state.legs[like, n, 0]
            legs[n, 1] = state.legs[like, n, 1]
    elif settings.humans_displayed_late:
        place_legs(legs, crowd.logged_x, crowd.logged_y, crowd.logged_yaw, crowd.walked)
        for i in range(crowd.x.size):
            if t < crowd.start_time[i] + PERIOD_S:
                legs[2 * i : 2 * i + 2] = OUT_OF_SIGHT_M
    else:
        place_legs(legs, crowd.x, crowd.y, crowd.yaw, crowd.walked)
    x, y, yaw = state.body[base.X], state.body[base.Y], state.body[base.YAW]
    state.scanned[side, 0] = x
    state.scanned[side, 1] = y
    state.scanned[side, 2] = yaw
    if side == 0 and state.own.counts[ACTIVE] != 0 and localise(state.own, t, x, y, yaw, scene.edges, legs):
        place_path(state)


Answer: TypeAlias = "tuple[float, float] | tuple[float, float, float]"
"""A velocity from outside: forward speed (m/s) and yaw rate (rad/s), or forward speed, speed to the left, yaw rate."""
# Why the loop is left: the run is over, or something computed outside of the compiled loop is due.
OVER, CONTROL_DUE, STACK_DUE, PROBE_DUE, BODIES_DUE = range(5)
# Where in a tick the loop goes on.
TICK_BEGINS, ANSWERED, PROBED, WALKED = range(4)
# What the loop keeps from tick to tick, and the answer from outside: whether it is a valid command, forward speed
# (m/s), yaw rate (rad/s), speed to the left (m/s), and how the run ends (RUNNING, REACHED, ABORTED; only asked of a
# whole stack).
(TICK, NEXT_ROW, ROWS, PEOPLE_T, FORWARD_SUM, LEFT_SUM, ACCELERATION, END, STAGE, VALID, COMMAND_V, COMMAND_W,
 COMMAND_SIDE, RESULT) = range(14)  # fmt: skip
LOOP_SIZE = 14


class Asked(NamedTuple):
    """What is computed outside of the compiled loop."""

    control: bool = False
    """The local planner: it answers every control period with a velocity, or that it has none."""
    stack: bool = False
    """The whole navigation stack: it answers every `stack_ticks` with a velocity and whether it has ended."""
    stack_ticks: int = 5
    probe_ticks: int = 0
    """A recorder looks at the state every so many ticks of 10 ms; 0: never."""
    bodies: bool = False
    """Doors and trolleys: they move after every tick of the people."""


@kernel
def begin(scene: Scene, state: State, settings: Settings, crowd: Crowd, phases: Floats, loop: Floats) -> None:
    """Set everything as it is 2 s before the start. `phases` (s) of smoother, local and global costmap."""
    start_s = -LEAD_TICKS * base.STEP_S
    state.body[base.COMMAND_T] = -1e9
    half = 0.5 * (state.stack.cells - 0.5)
    state.nav[st.WINDOW_COLUMN] = int(state.body[base.X] / state.stack.resolution - half)
    state.nav[st.WINDOW_ROW] = int(state.body[base.Y] / state.stack.resolution - half)
    state.nav[st.NEED_PLAN] = 1
    state.nav[st.CLEAR_GLOBAL] = 1
    state.times[st.SMOOTH_T] = start_s + phases[0]
    state.times[st.LOCAL_T] = start_s + phases[1]
    state.times[st.GLOBAL_T] = start_s + phases[2]
    begin_following(state, settings.robot_start_s)
    for side in range(state.stack.lidars.shape[0]):
        take_scan(scene, state, settings, crowd, side, -1, start_s)
    loop[:] = 0.0
    loop[TICK] = -LEAD_TICKS
    loop[END] = settings.time_limit_s * settings.clock
    loop[PEOPLE_T] = start_s + settings.people_phase_s


@inner
def walk_people(state: State, crowd: Crowd, loop: Floats, t: float) -> bool:
    """Move the people where they are due; whether they were."""
    if t < loop[PEOPLE_T] - 1e-9:
        return False
    loop[PEOPLE_T] += PERIOD_S
    body = state.body
    tick(crowd, t, PERIOD_S, body[base.X], body[base.Y], body[base.YAW], body[base.V], body[base.SIDE])
    return True


@inner
def take_scans(scene: Scene, state: State, settings: Settings, crowd: Crowd, k: int) -> None:
    """Take the scans that are due."""
    t = k * base.STEP_S
    lidars = state.stack.lidars
    like = -1
    for side in range(lidars.shape[0]):
        if (k - settings.scan_phase_ticks) % int(lidars[side, LIDAR_TICKS]) == 0:
            take_scan(scene, state, settings, crowd, side, like, t)
            like = side
            if state.stack.zones.shape[0] > 0:
                watch_zones(scene, state, settings, side, t)
            if state.stack.monitor.shape[0] > 0:
                keep_returns(scene, state, settings, side)


@inner
def obey(state: State, loop: Floats, t: float) -> None:
    """Carry out the answer of a whole stack: its velocity goes to the base as it is."""
    if loop[VALID] != 0.0:
        command(state, loop[COMMAND_V], loop[COMMAND_SIDE], loop[COMMAND_W], True, t)
    if loop[RESULT] != st.RUNNING:
        command(state, 0.0, 0.0, 0.0, True, t)
        state.nav[st.MODE] = st.DONE
        state.nav[st.RESULT] = int(loop[RESULT])


@inner(cached=True)
def decide(scene: Scene, state: State, settings: Settings, loop: Floats, asked: Asked, k: int) -> int:
    """Let the navigation stack act; return what is due outside, or OVER where nothing is."""
    t = k * base.STEP_S
    if t < settings.robot_start_s:
        return OVER
    if asked.stack:
        state.nav[st.PLANNED] = 1
        return STACK_DUE if state.nav[st.MODE] != st.DONE and k % asked.stack_ticks == 0 else OVER
    if navigate(scene, state, settings, t):
        if asked.control:
            return CONTROL_DUE
        choose_dwb(state, loop[VALID:])
        follow(state, t, loop[VALID:])
    return OVER


@inner
def write_rows(settings: Settings, state: State, crowd: Crowd, intervals: Floats, record: Recording, loop: Floats,
               k: int) -> bool:  # fmt: skip
    """Write the rows of trajectory and log that are due; return whether the run is over."""
    t = k * base.STEP_S
    if k % TRACK_TICKS == 0:
        mean = math.sqrt(loop[FORWARD_SUM] ** 2 + loop[LEFT_SUM] ** 2) / TRACK_TICKS
        write_track(record, t, state.body, mean, crowd)
        loop[FORWARD_SUM] = 0.0
        loop[LEFT_SUM] = 0.0
    if t >= loop[END] - 1e-9:
        write_log(record, t / settings.clock, state.body, loop[ACCELERATION], crowd)
        return True
    if t >= loop[NEXT_ROW] * settings.clock - 0.5 * base.STEP_S:
        write_log(record, loop[NEXT_ROW], state.body, loop[ACCELERATION], crowd)
        loop[NEXT_ROW] += intervals[int(loop[ROWS]) % intervals.size]
        loop[ROWS] += 1.0
    return False


@kernel
def go_on(
    scene: Scene, state: State, settings: Settings, crowd: Crowd, intervals: Floats, record: Recording, loop: Floats,
    asked: Asked,
) -> int:  # fmt: skip
    """Run until the episode is over or something is due outside; return why the loop is left.

    The answer is put into `loop` (VALID, COMMAND_V, COMMAND_W, RESULT) before the next call.
    """
    body = state.body
    while True:
        k = int(loop[TICK])
        t = k * base.STEP_S
        stage = int(loop[STAGE])
        loop[STAGE] = TICK_BEGINS
        if stage == TICK_BEGINS:
            update_maps(scene, state, settings, t)
            if walk_people(state, crowd, loop, t) and asked.bodies:
                loop[STAGE] = WALKED
                return BODIES_DUE
            stage = WALKED
        if stage == WALKED:
            take_scans(scene, state, settings, crowd, k)
            running = state.nav[st.MODE] != st.DONE
            due = decide(scene, state, settings, loop, asked, k)
            if due != OVER:
                loop[STAGE] = ANSWERED
                return due
        if stage == ANSWERED:
            running = True
            if asked.stack:
                obey(state, loop, t)
            else:
                follow(state, t, loop[VALID:])
        if stage != PROBED:
            if running and state.nav[st.MODE] == st.DONE:
                loop[END] = min(loop[END], t + settings.result_delay_s * settings.clock)
            if t >= state.times[st.SMOOTH_T] - 1e-9:
                state.times[st.SMOOTH_T] += 1.0 / state.stack.smoother.frequency_hz * settings.clock
                base.smooth(body, t, state.stack)
                if state.stack.monitor.shape[0] > 0:
                    scale_command(state)
            if k >= 0:
                if write_rows(settings, state, crowd, intervals, record, loop, k):
                    return OVER
                if asked.probe_ticks > 0 and k % asked.probe_ticks == 0:
                    loop[STAGE] = PROBED
                    return PROBE_DUE
        x, y, yaw = body[base.X], body[base.Y], body[base.YAW]
        forward, left = base.advance(body, settings.yaw_gain, state.delayed, k, state.stack)
        side = body[base.SIDE]
        change = 0.0
        if settings.solid_walls:
            change = touch_walls(state.walls, t + base.STEP_S, body, x, y, yaw)
        if not crowd.published:
            change += touch_people(crowd, t + base.STEP_S, body, x, y, yaw, state.stack.bumper_s)
        if change != 0.0 or body[base.SIDE] != side:
            forward += change / base.STEP_S
            left += (body[base.SIDE] - side) / base.STEP_S
            body[base.STOPPED_T] = max(body[base.STOPPED_T], t + state.stack.bumper_s)
        loop[ACCELERATION] = math.sqrt(forward * forward + left * left)
        loop[FORWARD_SUM] += forward
        loop[LEFT_SUM] += left
        if k >= 0 and record.counts[2] < record.imu.size:
            record.imu[record.counts[2]] = loop[ACCELERATION]
            record.counts[2] += 1
        loop[TICK] += 1.0


@dataclass(frozen=True, kw_only=True)
class Outside:
    """Parts of a run that are computed outside of the compiled loop. Each gets the episode, to read its state."""

    control: Callable[[Episode], Answer | None] | None = None
    """A local planner: a velocity, or None where it finds no valid command."""
    stack: Callable[[Episode], Answer | bool | None] | None = None
    """A whole navigation stack: a velocity, None where there is no new one, True where it has reached the goal, False
    where it gives up."""
    stack_ticks: int = 5
    probe: Callable[[Episode], None] | None = None
    """A recorder."""
    probe_ticks: int = 5


def _compile(scene: Scene, state: State, settings: Settings, crowd: Crowd, *rest: Any) -> None:
    """Compile the loop for these arguments, in two processes at once; `rest` are the other arguments of `go_on`."""
    scenes, states, numbers, people = (type_of(value) for value in (scene, state, settings, crowd))
    intervals, record, loop, asked = (type_of(value) for value in rest)
    pose = (float64, loop, float64, float64, float64)
    elsewhere = compile_aside(
        [
            (decide, (scenes, states, numbers, loop, asked, int64)),
            (update_maps, (scenes, states, numbers, float64)),
            (touch_walls, (states.fields["walls"], *pose)),
            (touch_people, (people, *pose, float64)),
        ]
    )
    compile_for(walk_people, (states, people, loop, float64))
    compile_for(take_scans, (scenes, states, numbers, people, int64))
    if elsewhere is not None:
        elsewhere.wait()
    compile_for(go_on, (scenes, states, numbers, people, intervals, record, loop, asked))


class Episode:
    """One run, from 2 s before the start until it is over.

    It changes the arrays of `state`, `crowd` and `record` in place. `intervals`: wall seconds between the log's rows.
    The state must be as `new_state` makes it, with the robot's pose set. `bodies` moves doors and trolleys after every
    tick of the people.
    """

    def __init__(
        self, scene: Scene, state: State, settings: Settings, crowd: Crowd, phases: Floats, intervals: Floats,
        record: Recording, outside: Outside | None = None, bodies: Callable[[float, Floats], None] | None = None,
    ) -> None:  # fmt: skip
        self.scene, self.state, self.settings, self.crowd, self.record = scene, state, settings, crowd, record
        self.outside = outside or Outside()
        self._bodies = bodies
        self._intervals = intervals
        self._loop = np.zeros(LOOP_SIZE)
        self._asked = Asked(
            control=self.outside.control is not None,
            stack=self.outside.stack is not None,
            stack_ticks=self.outside.stack_ticks,
            probe_ticks=self.outside.probe_ticks if self.outside.probe is not None else 0,
            bodies=bodies is not None,
        )
        parts = {name: refer(getattr(state, name)) for name in ("stack", "walls", "own")}
        self._references = refer(scene), refer(state, **parts), refer(crowd)
        scene_, state_, crowd_ = self._references
        if not is_cached(go_on):
            _compile(scene_, state_, settings, crowd_, intervals, record, self._loop, self._asked)
        begin(scene_, state_, settings, crowd_, phases, self._loop)

    @property
    def t(self) -> float:
        """Simulated time since the start, s."""
        return float(self._loop[TICK]) * base.STEP_S

    def run(self) -> None:
        """Run until the goal is reached, navigation gives up or the time limit passes; see `state.nav`."""
        scene, state, crowd = self._references
        while True:
            due = go_on(scene, state, self.settings, crowd, self._intervals, self.record, self._loop, self._asked)
            if due == OVER:
                return
            if due == BODIES_DUE and self._bodies is not None:
                self._bodies(self.t, self.state.body)
            elif due == PROBE_DUE and self.outside.probe is not None:
                self.outside.probe(self)
            elif due == CONTROL_DUE and self.outside.control is not None:
                self._answer(self.outside.control(self))
            elif due == STACK_DUE and self.outside.stack is not None:
                answer = self.outside.stack(self)
                if isinstance(answer, bool):
                    self._loop[RESULT] = st.REACHED if answer else st.ABORTED
                else:
                    self._answer(answer)

    def _answer(self, velocity: Answer | None) -> None:
        self._loop[VALID] = 0.0 if velocity is None else 1.0
        if velocity is not None:
            if not all(map(math.isfinite, velocity)):
                raise SimulationError(f"a controller outside of the simulator answered {velocity} at {self.t:.2f} s")
            v, side, w = velocity if len(velocity) == 3 else (velocity[0], 0.0, velocity[1])
            self._loop[COMMAND_V], self._loop[COMMAND_SIDE], self._loop[COMMAND_W] = v, side, w
