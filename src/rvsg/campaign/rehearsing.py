"""Makes the rehearsals of a generator on the simulator of the campaign."""

from __future__ import annotations

import numpy as np

from rvsg.campaign.feedback import rows_of
from rvsg.campaign.walks import Walk, arrivals, walks_of
from rvsg.core.errors import SimulationError
from rvsg.core.seeds import seed_for
from rvsg.evaluation.naming import WaypointNames
from rvsg.generation.generator import MET_M, Rehearsal, Rehearse, Walked
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Scenario
from rvsg.simulation.protocol import Simulator
from rvsg.simulation.run import Run
from rvsg.world.world import World

PERIOD_S = 2.0
WAY_S = 0.5
"""Seconds between the points of the robot's way."""


def rehearsing(simulator: Simulator, world: World, *, seed: int) -> Rehearse:
    """Return the function that simulates a configuration once, with a seed that no run of the campaign has.

    A rehearsal that the simulator cannot make is one in which nothing happens: the runs will tell why.
    """
    own = seed_for(seed, "rehearsal")

    def rehearse(mission: Mission, people: HumanConfiguration) -> Rehearsal:
        try:
            scenario = Scenario(mission=mission, people=people)
            run = simulator.run(scenario, mission.place(world), seed=own)
        except SimulationError:
            return Rehearsal(robot=(), arrival_s=None)
        return in_short(run, people, world)

    return rehearse


def in_short(run: Run, people: HumanConfiguration, world: World) -> Rehearsal:
    """Return a run in short."""
    path = run.trajectory
    if not len(path):
        return Rehearsal(robot=(), arrival_s=None)
    wanted = np.arange(0.0, float(path.t[-1]) + 1e-9, PERIOD_S)
    samples = np.clip(np.searchsorted(path.t, wanted - 1e-9), 0, len(path) - 1)
    at = WaypointNames(world.grid).nearest(path.x[samples], path.y[samples])
    walks = walks_of(run, people, world.grid)
    along = np.unique(np.clip(np.searchsorted(path.t, np.arange(0.0, path.t[-1] + WAY_S, WAY_S)), 0, len(path) - 1))
    return Rehearsal(
        way=tuple((round(float(path.t[k]), 1), round(float(path.x[k]), 2), round(float(path.y[k]), 2)) for k in along),
        robot=tuple((round(float(path.t[k]), 1), name) for k, name in zip(samples, at, strict=True)),
        arrival_s=round(float(path.t[-1]), 1) if run.completed else None,
        people={
            human.name: _walked(run, h, human, walk, world)
            for h, (human, walk) in enumerate(zip(people.humans, walks, strict=True))
        },
        rows=rows_of(run, walks, world.grid) if people.humans else (),
    )


def _walked(run: Run, h: int, human: Human, walk: Walk, world: World) -> Walked:
    path = run.trajectory
    away = np.hypot(path.human_x[:, h] - path.x, path.human_y[:, h] - path.y)
    nearest = int(away.argmin())
    met = np.flatnonzero(away <= MET_M)
    stuck_s, stuck_at = walk.stuck_at or (None, None)
    return Walked(
        begins_at=walk.goals[0],
        left_s=round(walk.left_s, 1) if walk.left_s is not None else None,
        arrivals=arrivals(walk, human, world.grid),
        stuck_at=stuck_at,
        stuck_s=round(stuck_s, 1) if stuck_s is not None else None,
        stood=tuple((round(start, 1), round(end, 1), at) for start, end, at in walk.stood),
        nearest_m=round(float(away[nearest]), 2),
        nearest_s=round(float(path.t[nearest]), 1),
        met_s=round(float(path.t[met[0]]), 1) if met.size else None,
    )
