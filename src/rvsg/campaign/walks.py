"""What people do in a run: the leg of their way, pauses, arrivals, and where they are stuck."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.scenario.agents import decode, goal_names
from rvsg.scenario.brief import Arrival
from rvsg.scenario.scenario import Human, HumanConfiguration
from rvsg.simulation.events import PersonReached, PersonReacted
from rvsg.simulation.run import Run
from rvsg.world.grid import Grid

REACHED_M = 0.6
"""A waypoint counts as reached this near to it; people turn to the next one a little before they stand on it."""
STILL_M_S, STUCK_S = 0.1, 2.0
"""Somebody who should walk and moves less than the first for longer than the second is stuck."""
AHEAD, BEHIND = math.radians(45.0), math.radians(135.0)


@dataclass(frozen=True)
class Walk:
    """The walk of one person.

    Attributes:
        goals: Names of the waypoints of the cycle, in order.
        leg: (N,) Number of goals reached so far at every sample.
        doing: What the person does at every sample; a reaction only where the simulator records it.
        reached: The times at which goals are reached, in order, the start left out.
        stuck_at: When and where the person is first stuck; None if never.
        left_s: When the person leaves the place of the start; None if never.
    """

    goals: tuple[str, ...]
    leg: NDArray[np.int64]
    doing: tuple[str, ...]
    reached: tuple[float, ...]
    stuck_at: tuple[float, str] | None
    left_s: float | None


def walks_of(run: Run, people: HumanConfiguration, grid: Grid) -> tuple[Walk, ...]:
    """Follow everybody of a run along the waypoints of their tasks, in the order of the configuration."""
    return tuple(walk_of(run, h, human, grid) for h, human in enumerate(people.humans))


def walk_of(run: Run, h: int, human: Human, grid: Grid) -> Walk:
    """Follow person `h` of a run along the waypoints of their tasks."""
    (agent,) = decode(HumanConfiguration(humans=(human,)), grid)
    names = goal_names(human)
    times, xs, ys = run.trajectory.t, run.trajectory.human_x[:, h], run.trajectory.human_y[:, h]
    t, x, y = times.tolist(), xs.tolist(), ys.tolist()  # plain numbers make the loops faster
    legs: list[int] = []
    reached: list[float] = []
    seen = {e.goal: e.time_s for e in run.events if isinstance(e, PersonReached) and e.person == human.name}
    for k in range(len(t)):
        # Waypoints may be passed at a distance, or lie closer together than `REACHED_M`: a simulator that records
        # arrivals knows better, for the first round.
        while (known := seen.get(len(reached) + 1)) is not None and known <= t[k]:
            reached.append(known)
        goal = agent.goals[(len(reached) + 1) % len(agent.goals)]
        near = t[k] >= agent.start_delay_s and math.dist((x[k], y[k]), goal) <= REACHED_M
        if near and len(agent.goals) > 1 and (not seen or len(reached) + 1 >= len(agent.goals)):
            reached.append(t[k])
        legs.append(len(reached))
    speed = _speed(times, xs, ys).tolist()
    doing: list[str] = []
    stuck_at: tuple[float, str] | None = None
    still_since: float | None = None
    reactions = [e for e in run.events if isinstance(e, PersonReacted) and e.person == human.name]
    for k, time in enumerate(t):
        leg = legs[k]
        since = reached[leg - 1] if leg else agent.start_delay_s
        pauses = agent.pauses_s[leg % len(agent.goals)] if leg else 0.0
        if any(reaction.time_s <= time <= reaction.until_s for reaction in reactions):
            doing.append("reacting to the robot")
            still_since = None
            continue
        if time < agent.start_delay_s:
            doing.append("waiting to start")
            continue
        if pauses and time <= since + pauses + 1.5:
            doing.append("pausing")
            still_since = None
            continue
        still_since = (time if still_since is None else still_since) if speed[k] < STILL_M_S else None
        if still_since is not None and time - still_since >= STUCK_S:
            doing.append("stuck")
            stuck_at = stuck_at or (still_since, grid.nearest(x[k], y[k]))
        else:
            doing.append(f"walking leg {leg % len(agent.goals) + 1} of {len(agent.goals)}")
    away = np.flatnonzero(np.hypot(xs - agent.start[0], ys - agent.start[1]) > REACHED_M)
    began = t[int(away[0])] if away.size else None
    return Walk(names, np.asarray(legs, np.int64), tuple(doing), tuple(reached), stuck_at, began)


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
    path = run.trajectory
    bearing = math.remainder(
        math.atan2(float(path.human_y[k, h] - path.y[k]), float(path.human_x[k, h] - path.x[k])) - float(path.yaw[k]),
        2.0 * math.pi,
    )
    if abs(bearing) < AHEAD:
        return "ahead"
    return "behind" if abs(bearing) > BEHIND else "left" if bearing > 0.0 else "right"


def _speed(t: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Speed over half a second around every sample, m/s."""
    before = np.searchsorted(t, t - 0.25)
    after = np.minimum(len(t) - 1, np.searchsorted(t, t + 0.25))
    moved = np.hypot(x[after] - x[before], y[after] - y[before])
    return np.asarray(moved / np.maximum(t[after] - t[before], 1e-6))
