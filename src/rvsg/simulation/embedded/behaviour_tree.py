"""Nav2's default behaviour tree (navigate to pose with replanning and recovery) and its controller server."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rvsg.core.angles import wrap
from rvsg.core.kernels import inner
from rvsg.simulation.costmap import LETHAL, footprint_spans
from rvsg.simulation.embedded import base, dwb
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.localisation import MAP_YAW, to_map, to_world
from rvsg.simulation.embedded.navfn import plan
from rvsg.simulation.embedded.rollouts import SAMPLE_SIDE, SAMPLE_V, SAMPLE_W, fill_window
from rvsg.simulation.embedded.state import Scene, Settings, State
from rvsg.simulation.events import Recovery, Replan

Floats = NDArray[np.float64]


REPLANNED, RECOVERED = range(2)
# Columns: kind, first and last time (s), place of the robot (m), length and deviation of the path (m) or the action.
KIND, FROM, UNTIL, X, Y, FIRST, SECOND = range(7)
CLEARLY_M = 0.5
"""A new path that leaves the one before by more than this is an event."""
NEW_STRIDE, OLD_STRIDE = 16, 6
"""Of the poses of the paths, some 0.025 m apart, every so many are compared."""
ACTION_NAMES: tuple[Literal["clear_costmaps", "spin", "wait", "back_up"], ...] = (
    "clear_costmaps", "spin", "wait", "back_up",
)  # fmt: skip


@inner
def _note(state: State, kind: int, t: float, first: float, second: float) -> None:
    """Add a row for what begins at time t where the robot is."""
    n = state.nav[st.NOTED]
    if n >= state.journal.shape[0]:
        return
    row = state.journal[n]
    row[KIND] = kind
    row[FROM] = t
    row[UNTIL] = t
    row[X] = state.body[base.X]
    row[Y] = state.body[base.Y]
    row[FIRST] = first
    row[SECOND] = second
    state.nav[st.NOTED] = n + 1


@inner
def go_on_recovery(state: State, t: float) -> None:
    """Note that the present recovery still goes on, or ends, at time t."""
    n = state.nav[st.NOTED]
    if n > 0 and state.journal[n - 1, KIND] == RECOVERED:
        state.journal[n - 1, UNTIL] = t


@inner
def note_path(state: State, before: int, count: int, t: float) -> None:
    """Note a new path of `count` poses to the same goal that leaves the one before, of `before` poses, clearly."""
    goal = state.nav[st.GOAL]
    if before > 0 and state.nav[st.PLANNED_GOAL] == goal:
        far = deviation(state.path[2], before, state.path[0], count)
        if far > CLEARLY_M:
            _note(state, REPLANNED, t, length(state.path[0], count), far)
    state.nav[st.PLANNED_GOAL] = goal


@inner
def deviation(old: Floats, before: int, new: Floats, count: int) -> float:
    """Return the largest distance (m) of poses of a path from the nearest poses of another one."""
    found = 0.0
    for i in range(0, count, NEW_STRIDE):
        best = math.inf
        for j in range(0, before, OLD_STRIDE):
            best = min(best, (new[i, 0] - old[j, 0]) ** 2 + (new[i, 1] - old[j, 1]) ** 2)
            if best <= found:
                break
        found = max(found, best)
    return math.sqrt(found)


@inner
def length(path: Floats, count: int) -> float:
    """Return the length of a path, m."""
    found = 0.0
    for i in range(1, count):
        found += math.sqrt((path[i, 0] - path[i - 1, 0]) ** 2 + (path[i, 1] - path[i - 1, 1]) ** 2)
    return found


def navigation_events(state: State) -> tuple[Replan | Recovery, ...]:
    """Return what was noted in a run, in order of time."""
    found: list[Replan | Recovery] = []
    for row in state.journal[: int(state.nav[st.NOTED])].tolist():
        place = {"time_s": round(row[FROM], 3), "x": round(row[X], 3), "y": round(row[Y], 3)}
        if row[KIND] == REPLANNED:
            found.append(Replan(**place, length_m=round(row[FIRST], 2), deviation_m=round(row[SECOND], 2)))
        else:
            found.append(Recovery(**place, until_s=round(row[UNTIL], 3), action=ACTION_NAMES[int(row[FIRST])]))
    return tuple(found)


AGAIN = 2
"""Of NEED_PLAN: the plan has failed on the way, and the controller has an empty path until there is another one."""
REPLAN_PERIOD_S = 1.01
"""1 s after the last success, and the 10 ms tick of the behaviour tree in which planning happens."""
PASSED_GOAL_M = 0.7
ACTIONS = 4
ACTION_PERIOD_S = 0.1
ACTION_TIME_S = 10.0
ODOMETRY_DEADBAND = 0.001


@inner
def has_passed(state: State) -> bool:
    """Whether the robot is within 0.7 m of the pose it is to drive through next; then the one after it is next."""
    g = state.nav[st.GOAL]
    if g >= state.goals.shape[0] - 1:
        return False
    x, y = to_map(state.own.present, state.body[base.X], state.body[base.Y])
    if (state.goals[g, 0] - x) ** 2 + (state.goals[g, 1] - y) ** 2 > PASSED_GOAL_M**2:
        return False
    state.nav[st.GOAL] = g + 1
    return True


@inner
def plan_route(scene: Scene, state: State, t: float) -> bool:
    """Plan from the robot to the next pose; the new path goes to the controller. False: no path.

    Unlike Nav2's NavigateThroughPoses the plan ends at the next pose to drive through: a plan that turns back within
    the local window would otherwise draw the robot away from it.
    """
    nav = state.nav
    x, y = to_map(state.own.present, state.body[base.X], state.body[base.Y])
    g = nav[st.GOAL]
    before = nav[dwb.PLAN_END]
    for i in range(before):
        state.path[2, i, 0] = state.path[0, i, 0]
        state.path[2, i, 1] = state.path[0, i, 1]
    count = plan(
        state.path[0], 0, x, y, state.goals[g, 0], state.goals[g, 1], state.global_master, state.costs, scene.reach,
        state.rest, state.potential, state.waiting, state.buffers, state.cells, scene.origin_x, scene.origin_y,
        scene.resolution, state.stack.behaviours.planner_tolerance_m,
    )  # fmt: skip
    if count == 0:
        return False
    state.nav[dwb.PLAN_BEGIN] = 0
    state.nav[dwb.PLAN_END] = count
    note_path(state, before, count, t)
    place_path(state)
    dwb.reset(state.nav)
    nav[st.PLANNED] = 1
    nav[st.NEED_PLAN] = 0
    state.times[st.PLAN_T] = t
    return True


@inner
def place_path(state: State) -> None:
    """Put the plan, which was made in the map, into the world where the newest estimate puts the map."""
    for i in range(state.nav[dwb.PLAN_BEGIN], state.nav[dwb.PLAN_END]):
        state.path[1, i, 0], state.path[1, i, 1] = to_world(state.own.frame, state.path[0, i, 0], state.path[0, i, 1])


@inner
def goal_yaw(state: State) -> float:
    """The goal's yaw in the world, as the robot believes it."""
    return float(state.goals[state.goals.shape[0] - 1, 2] - state.own.frame[MAP_YAW])


@inner
def begin_following(state: State, t: float) -> None:
    """A new goal for the controller: its loop, progress checker and patience start afresh."""
    state.times[st.CONTROL_T] = t
    state.times[st.PROGRESS_X] = state.body[base.X]
    state.times[st.PROGRESS_Y] = state.body[base.Y]
    state.times[st.PROGRESS_T] = t
    state.times[st.VALID_T] = t


@inner
def command(state: State, v: float, side: float, w: float, direct: bool, t: float) -> None:
    """Publish a velocity (forward, to the left, turning), through the smoother or (recoveries) past it."""
    state.body[base.COMMAND_V] = v
    state.body[base.COMMAND_SIDE] = side
    state.body[base.COMMAND_W] = w
    state.body[base.COMMAND_T] = t
    state.body[base.DIRECT] = 1.0 if direct else 0.0
    if direct:
        state.body[base.SMOOTH_V] = 0.0
        state.body[base.SMOOTH_SIDE] = 0.0
        state.body[base.SMOOTH_W] = 0.0


@inner
def has_progress(state: State, t: float) -> bool:
    """Progress checker: more than 0.5 m from the stored pose within 10 s."""
    times = state.times
    square = (state.body[base.X] - times[st.PROGRESS_X]) ** 2 + (state.body[base.Y] - times[st.PROGRESS_Y]) ** 2
    if square > state.stack.behaviours.progress_m**2:
        times[st.PROGRESS_X] = state.body[base.X]
        times[st.PROGRESS_Y] = state.body[base.Y]
        times[st.PROGRESS_T] = t
    return t - times[st.PROGRESS_T] <= state.stack.behaviours.progress_s


@inner
def at_goal(state: State) -> bool:
    """Goal checker: within 0.25 m of the plan's end (latched until the next path) and 0.25 rad of the goal's yaw."""
    end = state.nav[dwb.PLAN_END] - 1
    dx = state.path[1, end, 0] - state.body[base.X]
    dy = state.path[1, end, 1] - state.body[base.Y]
    square = dx * dx + dy * dy
    if square <= state.stack.behaviours.goal_tolerance_m**2:
        state.nav[dwb.XY_REACHED] = 1
    if state.nav[dwb.XY_REACHED] == 0:
        return False
    yaw = goal_yaw(state)
    return abs(wrap(state.body[base.YAW] - yaw)) <= state.stack.behaviours.goal_tolerance_rad


@inner
def measured(value: float) -> float:
    """A velocity as the odometry tells it."""
    return value if abs(value) > ODOMETRY_DEADBAND else 0.0


@inner
def choose_dwb(state: State, answer: Floats) -> None:
    """DWB's answer: whether there is a valid command, its forward speed, yaw rate and speed to the left."""
    body = state.body
    v = measured(body[base.V])
    w = measured(body[base.W])
    side = measured(body[base.SIDE])
    samples = state.samples
    if not state.stack.whole_range:
        samples = samples[: fill_window(samples, v, side, w, state.times[dwb.SHARE], state.stack)]
    best = dwb.choose(
        state.nav, state.times, state.scratch, state.memo, samples, state.local[st.MASTER],
        state.nav[st.WINDOW_COLUMN], state.nav[st.WINDOW_ROW], state.path[1],
        goal_yaw(state), body[base.X], body[base.Y], body[base.YAW], v, side, w, state.stack,
    )  # fmt: skip
    answer[0] = 0.0
    if best >= 0:
        answer[0] = 1.0
        answer[1] = state.samples[best, SAMPLE_V]
        answer[2] = state.samples[best, SAMPLE_W]
        answer[3] = state.samples[best, SAMPLE_SIDE]
        dwb.remember_turn(
            state.nav, state.times, answer[1], answer[3], answer[2], body[base.X], body[base.Y], body[base.YAW],
            state.stack,
        )  # fmt: skip


@inner
def follow(state: State, t: float, answer: Floats) -> None:
    """Carry out the local planner's answer; where it has had none for too long, following the path has failed."""
    if answer[0] == 0.0:
        command(state, 0.0, 0.0, 0.0, False, t)
        if t - state.times[st.VALID_T] > state.stack.behaviours.failure_tolerance_s:
            stop_following(state, t)
            return
    else:
        state.times[st.VALID_T] = t
        command(state, answer[1], answer[3], answer[2], False, t)
    if at_goal(state):
        command(state, 0.0, 0.0, 0.0, False, t)
        state.nav[st.MODE] = st.DONE
        state.nav[st.RESULT] = st.REACHED


@inner
def recover(state: State, t: float) -> None:
    """The outer recovery: the next of clearing both maps, spinning, waiting, backing up; at most six in a run."""
    nav = state.nav
    nav[st.FOLLOW_RETRIED] = 0
    nav[st.RECOVERIES] += 1
    nav[st.FAILED_ACTIONS] = 0
    command(state, 0.0, 0.0, 0.0, False, t)
    if nav[st.RECOVERIES] > state.stack.behaviours.recoveries:
        nav[st.RECOVERIES] = state.stack.behaviours.recoveries
        nav[st.MODE] = st.DONE
        nav[st.RESULT] = st.ABORTED
        return
    begin_action(state, t)


@inner
def begin_action(state: State, t: float) -> None:
    """Begin the recovery whose turn it is."""
    nav = state.nav
    action = nav[st.NEXT_ACTION]
    if action == 1 and state.stack.drive.wheelbase_m > 0.0:
        action = 2  # no spin for a robot that cannot turn on the spot
    nav[st.NEXT_ACTION] = (action + 1) % ACTIONS
    _note(state, RECOVERED, t, float(action), 0.0)
    times = state.times
    times[st.ACTION_T] = t
    times[st.ACTION_DUE] = t
    times[st.ACTION_DONE] = 0.0
    times[st.ACTION_X] = state.body[base.X]
    times[st.ACTION_Y] = state.body[base.Y]
    times[st.ACTION_YAW] = state.body[base.YAW]
    if action == 0:
        nav[st.CLEAR_LOCAL] = 1
        nav[st.CLEAR_GLOBAL] = 1
        end_action(state, t)
    else:
        nav[st.MODE] = action  # SPIN, WAIT, BACK_UP


@inner
def end_action(state: State, t: float) -> None:
    """A recovery has succeeded: stop, plan at once, follow."""
    go_on_recovery(state, t)
    command(state, 0.0, 0.0, 0.0, False, t)
    state.nav[st.MODE] = st.DRIVE
    state.nav[st.NEED_PLAN] = 1
    begin_following(state, t)


@inner
def footprint_hits(state: State, x: float, y: float, yaw: float) -> bool:
    """Whether the footprint at a pose covers a lethal cell of the local map; leaving the map counts too."""
    master = state.local[st.MASTER]
    rows, columns = master.shape
    first, end = footprint_spans(
        state.spans, x / state.stack.resolution - state.nav[st.WINDOW_COLUMN],
        y / state.stack.resolution - state.nav[st.WINDOW_ROW], yaw, state.stack.resolution, columns, rows,
        state.stack.footprint,
    )  # fmt: skip
    if first == end:
        return True
    for column in range(first, end):
        for row in range(state.spans[column, 0], state.spans[column, 1] + 1):
            if master[row, column] == LETHAL:
                return True
    return False


@inner
def is_blocked(state: State, v: float, w: float) -> bool:
    """Whether driving on at (v, w) for up to 2 s would hit something; looked at every action period."""
    x = state.body[base.X]
    y = state.body[base.Y]
    yaw = state.body[base.YAW]
    ahead = 0.0
    while ahead <= state.stack.behaviours.look_ahead_s:
        if footprint_hits(state, x + v * ahead * math.cos(yaw), y + v * ahead * math.sin(yaw), yaw + w * ahead):
            return True
        ahead += ACTION_PERIOD_S
    return False


@inner
def act(state: State, settings: Settings, t: float) -> None:
    """Go on with the recovery under way (10 Hz); one that is blocked or takes over 10 s passes to the next."""
    nav = state.nav
    times = state.times
    body = state.body
    if t < times[st.ACTION_DUE] - 1e-9:
        return
    times[st.ACTION_DUE] += ACTION_PERIOD_S * settings.clock
    go_on_recovery(state, t)
    elapsed = t - times[st.ACTION_T]
    if nav[st.MODE] == st.WAIT:
        if elapsed >= state.stack.behaviours.wait_s * settings.clock:
            end_action(state, t)
        return
    v = 0.0
    w = 0.0
    if nav[st.MODE] == st.SPIN:
        times[st.ACTION_DONE] += abs(wrap(body[base.YAW] - times[st.ACTION_YAW]))
        times[st.ACTION_YAW] = body[base.YAW]
        left = state.stack.behaviours.spin_rad - times[st.ACTION_DONE]
        if left < 1e-6:
            end_action(state, t)
            return
        stopping = math.sqrt(2.0 * state.stack.behaviours.spin_acceleration_rad_s2 * left)
        w = min(state.stack.behaviours.spin_max_rad_s, max(state.stack.behaviours.spin_min_rad_s, stopping))
    else:
        done = math.sqrt((body[base.X] - times[st.ACTION_X]) ** 2 + (body[base.Y] - times[st.ACTION_Y]) ** 2)
        if done >= state.stack.behaviours.back_up_m:
            end_action(state, t)
            return
        v = -state.stack.behaviours.back_up_m_s
    if elapsed > ACTION_TIME_S or is_blocked(state, v, w):
        command(state, 0.0, 0.0, 0.0, False, t)
        nav[st.FAILED_ACTIONS] += 1
        if nav[st.FAILED_ACTIONS] >= ACTIONS:
            nav[st.MODE] = st.DONE
            nav[st.RESULT] = st.ABORTED
        else:
            begin_action(state, t)
        return
    command(state, v, 0.0, w, not state.stack.behaviours.smoothed, t)


@inner
def stop_following(state: State, t: float) -> None:
    """Following the path has failed: once again with a cleared local map, then the recovery."""
    nav = state.nav
    if nav[st.FOLLOW_RETRIED] == 0:
        nav[st.FOLLOW_RETRIED] = 1
        command(state, 0.0, 0.0, 0.0, False, t)
        nav[st.CLEAR_LOCAL] = 1
        begin_following(state, t)
    else:
        recover(state, t)


@inner
def navigate(scene: Scene, state: State, settings: Settings, t: float) -> bool:
    """Do what the behaviour tree does at time t, every 10 ms; return whether the local planner is to act.

    A map that is to be cleared is cleared before the next call; who needs it waits for that, as in Nav2. Where the
    controller refuses an empty path before that, the second attempt to plan is cancelled: navigation has failed.
    """
    nav = state.nav
    if nav[st.MODE] == st.DONE:
        return False
    if nav[st.MODE] != st.DRIVE:
        act(state, settings, t)
        return False
    if has_passed(state):
        nav[st.NEED_PLAN] = max(1, nav[st.NEED_PLAN])
    if nav[st.NEED_PLAN] != 0 or t - state.times[st.PLAN_T] >= REPLAN_PERIOD_S * settings.clock - 1e-9:
        if nav[st.CLEAR_GLOBAL] != 0:
            if nav[st.NEED_PLAN] == AGAIN:
                if t >= state.times[st.CONTROL_T] - 1e-9:
                    command(state, 0.0, 0.0, 0.0, False, t)
                    nav[st.MODE] = st.DONE
                    nav[st.RESULT] = st.ABORTED
            elif state.stack.behaviours.waits_for_costmaps:
                begin_following(state, t)  # the controller gets its goal with the plan
            return False
        if plan_route(scene, state, t):
            nav[st.PLAN_RETRIED] = 0
        elif nav[st.NEED_PLAN] == 0 and state.stack.behaviours.gives_up_without_plan:
            nav[st.NEED_PLAN] = AGAIN
            nav[st.PLAN_RETRIED] = 1
            nav[st.CLEAR_GLOBAL] = 1
            return False
        elif nav[st.PLAN_RETRIED] == 0 and not (state.stack.behaviours.waits_for_costmaps and nav[st.NEED_PLAN] == 0):
            # On the way Nav2 empties the plan, and the controller refuses an empty one twice before the global map is
            # current again: the recovery begins.
            nav[st.PLAN_RETRIED] = 1
            nav[st.CLEAR_GLOBAL] = 1
            return False
        else:
            nav[st.PLAN_RETRIED] = 0
            recover(state, t)
            return False
    if t < state.times[st.CONTROL_T] - 1e-9 or nav[st.CLEAR_LOCAL] != 0:
        return False
    state.times[st.CONTROL_T] += 1.0 / state.stack.behaviours.controller_hz * settings.clock
    if has_progress(state, t):
        return True
    stop_following(state, t)
    return False
