"""People who follow recorded tracks, and leave them where the robot does something else than in the recording.

A run without tracks does not come here. The compiled loop stops after every tick of the people; here those who follow a
track are placed on it. For the compiled code they stand until they begin to walk by themselves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.scenario.scenario import FASTEST_M_S, HumanAgent, Track
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded.people.crowd import PERIOD_S, Crowd

Floats = NDArray[np.float64]

AWAY_M = 30.0
"""Absent people are this far outside of the map."""
TURNS_M_S = 0.15
"""Who is slower than this keeps the direction."""
PASSED_M = 0.1
"""A track passes a goal where it is nearest to it for the first time, up to this."""


@dataclass
class Follower:
    """A person on a track. `speed` and `walked` (the gait) are those of the simulated person."""

    track: Track
    times: Floats
    places: Floats
    passed_s: Floats
    """When the track passes each goal, s."""
    pauses_s: Floats
    speed: float
    walked: float
    away: tuple[float, float]


class RecordedPeople:
    """People of one run who follow tracks; `driven` is where the robot of the recording was."""

    def __init__(self, agents: Sequence[HumanAgent], driven: Track | None, crowd: Crowd) -> None:
        self.crowd = crowd
        self._driven = None if driven is None else _arrays(driven)
        self.left_s: dict[str, float] = {}
        """When people turned from their tracks to their tasks, by name."""
        self.absent_at: dict[str, tuple[float, float]] = {}
        self._names = [agent.name for agent in agents]
        self._followers: dict[int, Follower] = {}
        for i, agent in enumerate(agents):
            if agent.track is not None:
                away = (float(crowd.raster_x) - AWAY_M, float(crowd.raster_y) - AWAY_M - 2.0 * i)
                self.absent_at[agent.name] = away
                self._followers[i] = _follower(agent, agent.track, float(crowd.speed[i]), float(crowd.walked[i]), away)
                crowd.start_time[i], crowd.speed[i] = math.inf, FASTEST_M_S
        self.step(0.0, np.zeros(0))

    def step(self, t: float, body: Floats) -> None:
        """Place the people where they are in the middle of the next tick; `body` is the robot's, empty at first."""
        t = max(0.0, t + PERIOD_S / 2) if len(body) else 0.0
        apart = 0.0
        if self._driven is not None and len(body):
            x, y = _at(*self._driven, t)
            apart = math.hypot(float(body[base.X]) - x, float(body[base.Y]) - y)
        for i, follower in list(self._followers.items()):
            track = follower.track
            differs = track.until_m is not None and apart > track.until_m
            if (track.start_s <= t <= track.end_s and differs) or (t > track.end_s and not track.leaves):
                self._release(i, t)
            else:
                self._place(i, follower, t)

    def _place(self, i: int, follower: Follower, t: float) -> None:
        crowd, track = self.crowd, follower.track
        present = track.start_s <= t <= track.end_s
        x, y = _at(follower.times, follower.places, t) if present else follower.away
        vx = vy = 0.0
        if present:
            before = _at(follower.times, follower.places, max(track.start_s, t - PERIOD_S))
            vx, vy = (x - before[0]) / PERIOD_S, (y - before[1]) / PERIOD_S
        speed = math.hypot(vx, vy)
        follower.walked += speed * PERIOD_S
        crowd.x[i] = crowd.place_x[i] = x
        crowd.y[i] = crowd.place_y[i] = y
        crowd.vx[i], crowd.vy[i], crowd.walked[i] = vx, vy, follower.walked
        if speed > TURNS_M_S:
            crowd.yaw[i] = math.atan2(vy, vx)

    def _release(self, i: int, t: float) -> None:
        """Let a person go on with the tasks, from the goal that comes next on the track."""
        crowd, follower = self.crowd, self._followers.pop(i)
        crowd.x[i], crowd.y[i] = _at(follower.times, follower.places, t)
        ahead = np.flatnonzero(follower.passed_s > t)
        goal = int(ahead[0]) if len(ahead) else len(follower.passed_s) - 1
        crowd.goal_index[i], crowd.start_time[i], crowd.speed[i] = goal, t, follower.speed
        crowd.start_pause[i] = -1.0
        crowd.from_x[i], crowd.from_y[i] = crowd.x[i], crowd.y[i]
        crowd.ends[i, goal] = goal
        if goal > 0:
            rest = follower.passed_s[goal - 1] + follower.pauses_s[goal - 1] - t
            crowd.pause_left[i] = max(0.0, float(rest))
        self.left_s[self._names[i]] = round(t, 2)


def _arrays(track: Track) -> tuple[Floats, Floats]:
    times = np.array([track.start_s + track.period_s * k for k in range(len(track.points))])
    return times, np.array(track.points, np.float64)


def _at(times: Floats, places: Floats, t: float) -> tuple[float, float]:
    return float(np.interp(t, times, places[:, 0])), float(np.interp(t, times, places[:, 1]))


def _follower(agent: HumanAgent, track: Track, speed: float, walked: float, away: tuple[float, float]) -> Follower:
    times, places = _arrays(track)
    passed, first = [], 0
    for goal in agent.goals:
        far = np.hypot(*(places[first:] - goal).T)
        first += int((far <= far.min() + PASSED_M).argmax())
        passed.append(times[first])
    return Follower(track, times, places, np.array(passed), np.array(agent.pauses_s), speed, walked, away)
