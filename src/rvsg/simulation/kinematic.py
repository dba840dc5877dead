"""A simulator of moving points, without physics, sensors or navigation. A run takes milliseconds.

Use it to try a campaign's settings, a plug-in or a script; its verdicts say nothing about a robot. The robot follows
the shortest path over the grid to the goal at constant speed and stops while a person is close in front of it. People
walk their cyclic paths at their own speed and react to nobody. The seed varies each person's speed and start slightly.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.core.seeds import stream
from rvsg.robots.robot import Robot
from rvsg.scenario.scenario import HumanAgent, Scenario, decode
from rvsg.simulation.run import Outcome, Run, Trajectory
from rvsg.simulation.simulators import Simulator
from rvsg.world.world import World

Floats = NDArray[np.float64]

PERIOD_S = 0.05
RADIUS_M = 0.35
"""Radius of the default robot."""
VERSION = 2


class KinematicSimulator(Simulator):
    """Runs scenarios without physics.

    The robot drives at `robot_speed_m_s` and stops for a person nearer than `stop_gap_m` within 60° of its heading. A
    robot other than the default one drives at its own speed. Every robot is a disc of its social radius.
    """

    name = "kinematic"
    any_robot = True

    def __init__(self, *, robot_speed_m_s: float = 0.5, stop_gap_m: float = 0.4) -> None:
        for name, value, least in (("robot_speed_m_s", robot_speed_m_s, 0.01), ("stop_gap_m", stop_gap_m, 0.0)):
            if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= 100.0:
                raise ValueError(f"{name} must be a number from {least:g} to 100, got {value!r}")
        self.robot_speed_m_s = robot_speed_m_s
        self.stop_gap_m = stop_gap_m

    @property
    def options(self) -> dict[str, object]:
        """The effective options."""
        return {"version": VERSION, "robot_speed_m_s": self.robot_speed_m_s, "stop_gap_m": self.stop_gap_m}

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        """Simulate one episode."""
        route = scenario.mission.route
        agents = decode(scenario.people, world.grid)
        if tracked := [agent.name for agent in agents if agent.track is not None]:
            named = ", ".join(tracked)
            raise InputError(f"The simulator {self.name} knows no recorded tracks ({named}); use embedded.")
        time = np.arange(0.0, route.time_limit_s + PERIOD_S / 2, PERIOD_S)
        walks = [_walk(agent, time, stream(seed, f"human {agent.name}")) for agent in agents]
        human_x, human_y, human_yaw, human_speed = (
            np.stack([walk[part] for walk in walks], axis=1) if walks else np.empty((len(time), 0)) for part in range(4)
        )
        radii = np.array([agent.radius_m for agent in agents])
        path = _robot_path(scenario, world)
        outcome = Outcome.NO_PATH if path is None else Outcome.TIMED_OUT
        if path is None:
            path, time = np.array([[route.start.x, route.start.y]]), time[:1]
        other = scenario.mission.robot if isinstance(scenario.mission.robot, Robot) else None
        speed = self.robot_speed_m_s if other is None else other.driving_speed_m_s
        radius = RADIUS_M if other is None else other.radius_m
        x, y, yaw, v, arrived = self._drive(path, route.start.yaw, time, human_x, human_y, radii + radius, speed)
        n = len(x)
        trajectory = Trajectory(
            t=time[:n],
            x=x,
            y=y,
            yaw=yaw,
            v=v,
            omega=_rate(np.unwrap(yaw), time[:n]),
            acceleration=np.abs(_rate(v, time[:n])),
            human_x=human_x[:n],
            human_y=human_y[:n],
            human_yaw=human_yaw[:n],
            human_speed=human_speed[:n],
        )
        return Run(
            scenario_id=scenario.id,
            simulator=self.name,
            options=self.options,
            seed=seed,
            outcome=Outcome.REACHED if arrived else outcome,
            robot_radius_m=radius,
            trajectory=trajectory,
            log=_every(trajectory, 10),
            human_names=tuple(agent.name for agent in agents),
            human_radius_m=tuple(agent.radius_m for agent in agents),
            human_groups=tuple(agent.group for agent in agents),
            human_outlines=tuple(agent.outline for agent in agents) if any(agent.outline for agent in agents) else (),
            goal=(route.goal.x, route.goal.y, route.goal.yaw),
            time_limit_s=route.time_limit_s,
        )

    def _drive(
        self, path: Floats, yaw: float, time: Floats, human_x: Floats, human_y: Floats, reach: Floats, full_speed: float
    ) -> tuple[Floats, Floats, Floats, Floats, bool]:
        """Follow `path` (K, 2); return x, y, yaw, v up to arrival or the end of `time`, and whether it arrived.

        `reach` (H,): distance of the robot and each person at which they touch, metres.
        """
        driven = self._undisturbed(path, full_speed, len(time))
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
        x, y = np.interp(driven, along, path[:, 0]), np.interp(driven, along, path[:, 1])
        ahead = np.minimum(driven + 0.2, along[-1])
        dx, dy = np.interp(ahead, along, path[:, 0]) - x, np.interp(ahead, along, path[:, 1]) - y
        headings = np.where((dx != 0.0) | (dy != 0.0), np.arctan2(dy, dx), np.nan)
        latest = np.maximum.accumulate(np.where(np.isnan(headings), -1, np.arange(len(headings))))
        headings = np.where(latest < 0, yaw, headings[latest])
        there = len(path) > 1 and bool(driven[-1] >= along[-1])

        def blocked(samples: slice, places: slice | int) -> NDArray[np.bool_]:
            off_x, off_y = human_x[samples].T - x[places], human_y[samples].T - y[places]
            gap = np.hypot(off_x, off_y) - reach[:, None]
            facing = np.cos(np.arctan2(off_y, off_x) - headings[places]) > 0.5
            return np.asarray(((gap < self.stop_gap_m) & facing).any(axis=0))

        at = np.empty(len(time), dtype=np.intp)
        stands = np.zeros(len(time), dtype=bool)
        k = place = 0
        while k < len(time):
            # As far as the way is free, then as long as somebody is in it.
            free = min(len(time) - k, len(driven) - place)
            in_the_way = blocked(slice(k, k + free), slice(place, place + free))
            if there and place + free == len(driven):
                in_the_way[-1] = False  # who is at the goal need not drive on
            stop = _first(in_the_way, free)
            at[k : k + stop] = np.arange(place, place + stop)
            k, place = k + stop, place + stop
            if place == len(driven):
                break
            wait = _first(~blocked(slice(k, None), place), len(time) - k)
            at[k : k + wait], stands[k : k + wait] = place, True
            k += wait
        arrived = there and place == len(driven)
        rows = at[:k]
        v = np.where(stands[:k], 0.0, full_speed)
        if arrived:
            v[-1] = 0.0
        return x[rows], y[rows], headings[rows], v, arrived

    def _undisturbed(self, path: Floats, full_speed: float, most: int) -> Floats:
        """Return how far the robot is along its path at every step of a drive without people, metres."""
        length = float(np.cumsum(np.hypot(*np.diff(path, axis=0).T))[-1]) if len(path) > 1 else 0.0
        driven = np.minimum(np.add.accumulate(np.append(0.0, np.full(most - 1, full_speed * PERIOD_S))), length)
        return driven[: int(np.argmax(driven >= length)) + 1] if len(path) > 1 and driven[-1] >= length else driven


def _first(values: NDArray[np.bool_], otherwise: int) -> int:
    """Return the index of the first true value, `otherwise` without one."""
    return int(values.argmax()) if values.any() else otherwise


def _robot_path(scenario: Scenario, world: World) -> Floats | None:
    route, grid = scenario.mission.route, world.grid
    stops = [route.start, *route.through, route.goal]
    points: list[tuple[float, float]] = [(route.start.x, route.start.y)]
    for a, b in pairwise(stops):
        names = grid.shortest_path(grid.nearest(a.x, a.y), grid.nearest(b.x, b.y))
        if names is None:
            return None
        points += [grid.position(name) for name in names[1:-1]]
        points.append((b.x, b.y))
    return np.array(points)


def _walk(agent: HumanAgent, time: Floats, chance: np.random.Generator) -> tuple[Floats, Floats, Floats, Floats]:
    """Return x, y, yaw and speed of a person at every time: the goals in a cycle, with pauses, after the delay."""
    speed = agent.speed_m_s * float(chance.uniform(0.9, 1.1))
    begin = agent.start_delay_s + float(chance.uniform(0.0, 0.5))
    moves = len({*agent.goals}) > 1
    # A round ends where it starts.
    goals, pauses = [*agent.goals, agent.goals[0]] if moves else [agent.goals[0]], [*agent.pauses_s, agent.pauses_s[0]]
    times, places = [begin], [goals[0]]
    if agent.start_pause_s:
        times.append(begin + agent.start_pause_s)
        places.append(goals[0])
    while times[-1] < time[-1] and moves:
        for goal, pause in zip(goals[1:], pauses[1:], strict=True):
            step = float(np.hypot(goal[0] - places[-1][0], goal[1] - places[-1][1])) / speed
            times.append(times[-1] + step)
            places.append(goal)
            if pause:
                times.append(times[-1] + pause)
                places.append(goal)
    at = np.array(places)
    x, y = np.interp(time, times, at[:, 0]), np.interp(time, times, at[:, 1])
    vx, vy = _rate(x, time), _rate(y, time)
    return x, y, np.arctan2(vy, vx), np.hypot(vx, vy)


def _rate(values: Floats, time: Floats) -> Floats:
    """Return the change of values per second since the sample before; 0 at the first."""
    step = np.diff(time, prepend=time[:1])
    return np.divide(np.diff(values, prepend=values[:1]), step, out=np.zeros_like(values), where=step > 0)


def _every(path: Trajectory, step: int) -> Trajectory:
    """Return every `step`-th sample and the last."""
    rows = np.unique(np.append(np.arange(0, len(path), step), len(path) - 1))
    return path.at(rows)
