"""What people do in a run: the leg of their way, pauses, arrivals, and where they stand still or are stuck."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.evaluation.sampled import stretches
from rvsg.scenario.brief import Arrival
from rvsg.scenario.scenario import Human, HumanAgent, HumanConfiguration, decode, goal_names
from rvsg.simulation.events import PersonPaused, PersonReached, PersonReacted
from rvsg.simulation.run import Run
from rvsg.world.grid import Grid

OfWalk = PersonReached | PersonPaused | PersonReacted
REACHED_M = 0.6
"""Somebody who is farther than this from the place of the start has left it."""
MARGIN_M, PASSED_M = 0.1, 0.8
"""A waypoint counts as reached from the goal radius plus the first, or beyond it within the second."""
STILL_M_S, STOOD_S, STUCK_S = 0.1, 2.0, 5.0
"""Somebody who should walk and is slower than the first for longer than the second stands still.

Who does so for longer than the third, until the run ends, is stuck.
"""
AHEAD, BEHIND = math.radians(45.0), math.radians(135.0)


@dataclass(frozen=True)
class Walk:
    """The walk of one person.

    Attributes:
        goals: Names of the waypoints of the cycle, in order.
        leg: (N,) Number of goals reached so far at every sample.
        doing: What the person does at every sample; a reaction only where the simulator records it.
        reached: The times at which goals are reached, in order, the start left out.
        stuck_at: Since when and where the person stands still until the run ends; None for who walks on.
        left_s: When the person leaves the place of the start; None if never.
        stood: From when to when and where somebody who should walk stands still, and then walks on.
    """

    goals: tuple[str, ...]
    leg: NDArray[np.int64]
    doing: tuple[str, ...]
    reached: tuple[float, ...]
    stuck_at: tuple[float, str] | None
    left_s: float | None
    stood: tuple[tuple[float, float, str], ...] = ()


def walks_of(run: Run, people: HumanConfiguration, grid: Grid) -> tuple[Walk, ...]:
    """Follow everybody of a run along the waypoints of their tasks, in the order of the configuration."""
    return tuple(walk_of(run, h, human, grid) for h, human in enumerate(people.humans))


def walk_of(run: Run, h: int, human: Human, grid: Grid) -> Walk:
    """Follow person `h` of a run along the waypoints of their tasks."""
    (agent,) = decode(HumanConfiguration(humans=(human,)), grid)
    times, xs, ys = run.trajectory.t, run.trajectory.human_x[:, h], run.trajectory.human_y[:, h]
    recorded = [e for e in run.events if isinstance(e, OfWalk) and e.person == human.name]
    reached, legs = _followed(times, xs, ys, agent, recorded)
    busy = _busy(times, legs, reached, agent, recorded)
    count = len(agent.goals)
    walking = [f"walking leg {leg} of {count}" for leg in range(1, count + 1)]
    doing = [what or walking[leg % count] for what, leg in zip(busy, legs, strict=True)]
    still = np.array([what is None for what in busy], np.bool_) & (_speed(times, xs, ys) < STILL_M_S)
    stood, stuck_at = [], None
    for first, last in stretches(still):
        if times[last] - times[first] < STOOD_S or len(agent.goals) < 2:
            continue
        place = grid.nearest(float(xs[first]), float(ys[first]))
        stuck = last == len(times) - 1 and times[last] - times[first] >= STUCK_S
        doing[first : last + 1] = ["stuck" if stuck else "standing still"] * (last + 1 - first)
        if stuck:
            stuck_at = (float(times[first]), place)
        else:
            stood.append((float(times[first]), float(times[last]), place))
    away = np.flatnonzero(np.hypot(xs - agent.start[0], ys - agent.start[1]) > REACHED_M)
    began = float(times[int(away[0])]) if away.size else None
    return Walk(
        goals=goal_names(human),
        leg=np.asarray(legs, np.int64),
        doing=tuple(doing),
        reached=tuple(reached),
        stuck_at=stuck_at,
        left_s=began,
        stood=tuple(stood),
    )


def _followed(
    times: NDArray[np.float64],
    xs: NDArray[np.float64],
    ys: NDArray[np.float64],
    agent: HumanAgent,
    recorded: Sequence[OfWalk],
) -> tuple[list[float], list[int]]:
    """Return the times at which goals are reached, and at every sample how many were.

    A simulator that records what people do knows the arrivals of the first round and all pauses. What it does not
    record is read off the trajectory.
    """
    n = len(agent.goals)
    seen = {e.goal: e.time_s for e in recorded if isinstance(e, PersonReached)}
    pauses = deque(e for e in recorded if isinstance(e, PersonPaused))
    reached: list[float] = []
    legs: list[int] = []
    for t, x, y in zip(times.tolist(), xs.tolist(), ys.tolist(), strict=True):  # plain numbers make the loop faster
        while (known := seen.get(len(reached) + 1)) is not None and known <= t:
            reached.append(known)
        while pauses and pauses[0].time_s <= t:
            pause = pauses.popleft()
            while len(reached) % n != pause.goal:
                reached.append(pause.time_s)
        count = len(reached)
        if n > 1 and (not seen or count + 1 >= n):
            held = agent.pauses_s[count % n] if count else agent.start_pause_s
            free_s = (reached[-1] if reached else agent.start_delay_s) + held
            if t >= free_s and _arrives((x, y), agent, count):
                reached.append(t)
        legs.append(len(reached))
    return reached, legs


def _arrives(at: tuple[float, float], agent: HumanAgent, count: int) -> bool:
    """Return whether somebody who has reached `count` goals turns to the one after the next, as simulated people do."""
    n = len(agent.goals)
    before, goal = agent.goals[count % n], agent.goals[(count + 1) % n]
    away = math.dist(at, goal)
    if away <= agent.goal_radius_m + MARGIN_M:
        return True
    beyond = (at[0] - goal[0]) * (goal[0] - before[0]) + (at[1] - goal[1]) * (goal[1] - before[1]) > 0.0
    return beyond and away <= PASSED_M and not agent.pauses_s[(count + 1) % n]


def _busy(
    times: NDArray[np.float64],
    legs: Sequence[int],
    reached: Sequence[float],
    agent: HumanAgent,
    recorded: Sequence[OfWalk],
) -> list[str | None]:
    """Return what else than walking the person is about at every sample; None: walking, though perhaps held up."""
    n = len(agent.goals)
    reactions = [(e.time_s, e.until_s) for e in recorded if isinstance(e, PersonReacted)]
    pauses = [(e.time_s, e.until_s) for e in recorded if isinstance(e, PersonPaused)]
    known = any(isinstance(e, PersonReached | PersonPaused) for e in recorded)
    found: list[str | None] = []
    for t, leg in zip(times.tolist(), legs, strict=True):
        since = reached[leg - 1] if leg else agent.start_delay_s
        held = agent.pauses_s[leg % n] if leg else agent.start_pause_s
        if any(start <= t <= end for start, end in reactions):
            found.append("reacting to the robot")
        elif t < agent.start_delay_s:
            found.append("waiting to start")
        elif any(start <= t <= end for start, end in pauses) or (not known and held and t <= since + held + 1.5):
            found.append("pausing")
        else:
            found.append(None)
    return found


def arrivals(walk: Walk, human: Human, grid: Grid) -> tuple[Arrival, ...]:
    """Return when the person reaches each waypoint for the first time, and when unhindered walking would."""
    (agent,) = decode(HumanConfiguration(humans=(human,)), grid)
    found, clock = [], human.start_delay_s
    for n, time in enumerate(walk.reached[: len(walk.goals)]):
        before, goal = agent.goals[n % len(agent.goals)], agent.goals[(n + 1) % len(agent.goals)]
        clock += math.dist(before, goal) / human.speed_m_s
        name = walk.goals[(n + 1) % len(walk.goals)]
        found.append(Arrival(at=name, time_s=round(time, 1), unhindered_s=round(clock, 1)))
        clock += agent.pauses_s[(n + 1) % len(agent.goals)]
    return tuple(found)


def side_of(run: Run, k: int, h: int) -> str:
    """Return on which side of the robot person `h` is at sample `k`."""
    bearing = _bearing(run, k, h)
    if abs(bearing) < AHEAD:
        return "ahead"
    return "behind" if abs(bearing) > BEHIND else "left" if bearing > 0.0 else "right"


def left_of(run: Run, k: int, h: int) -> bool:
    """Return whether person `h` is on the robot's left at sample `k`, ahead and behind included."""
    return _bearing(run, k, h) > 0.0


def _bearing(run: Run, k: int, h: int) -> float:
    """Direction of person `h` off the robot's heading at sample `k`, rad; positive to the left."""
    path = run.trajectory
    towards = math.atan2(float(path.human_y[k, h] - path.y[k]), float(path.human_x[k, h] - path.x[k]))
    return math.remainder(towards - float(path.yaw[k]), 2.0 * math.pi)


def _speed(t: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Speed over half a second around every sample, m/s."""
    before = np.searchsorted(t, t - 0.25)
    after = np.minimum(len(t) - 1, np.searchsorted(t, t + 0.25))
    moved = np.hypot(x[after] - x[before], y[after] - y[before])
    return np.asarray(moved / np.maximum(t[after] - t[before], 1e-6))
