"""Trials of routes and hops in the embedded simulator, with nobody else about.

A result depends on the floor, the robot and the simulator alone, so it is kept in the user's cache folder and a world
that has not changed is not simulated again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from rvsg.core.errors import FileError
from rvsg.core.files import write_whole
from rvsg.core.inputs import exists, parse_json, read_text
from rvsg.core.records import content_id
from rvsg.robots.robot import DEFAULT_ROBOT, Robot, load_robot
from rvsg.scenario.scenario import ROBOT, HumanConfiguration, Mission, Scenario
from rvsg.simulation.run import Outcome
from rvsg.simulation.simulators import Simulator, make_simulator, simulator_of
from rvsg.simulation.stacks.stack_choice import StackLike
from rvsg.world.routes import Drive, Hop
from rvsg.world.space import human_space
from rvsg.world.world import Route, World

SEED = 0
LONGEST_S = 600.0
"""No trial of a route takes longer, whatever its time limit."""
PATIENCE = 2.0
"""The robot gets this many times the route's time limit, so that a trial shows how long it takes."""


STEP_M = 0.25
CLEAR_M = 1.0
POINTS = 20
"""Points along a hop at which its clearance is read."""

T = TypeVar("T")
_DRIVE = TypeAdapter(Drive)
_HOPS = TypeAdapter(tuple[Hop, ...])


def trial_of(
    robot: str | Path | Robot | None = None,
    stack: StackLike | None = None,
    *,
    progress: Callable[[str], None] = lambda _: None,
) -> SimulatedTrial:
    """Return a trial with a robot (a record, the name of a shipped one or a file) whose results are kept."""
    record = robot if robot is None or isinstance(robot, Robot) else load_robot(robot)
    return SimulatedTrial(record, stack, progress=progress, cache=cache_folder())


def cache_folder() -> Path:
    """Return the folder in which results of trials are kept."""
    return Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "rvsg" / "trials"


class SimulatedTrial:
    """Routes and hops tried in the embedded simulator.

    Args:
        robot: The robot that drives; None: the default robot.
        stack: The navigation stack that drives it; None: the default one.
        progress: Called with a line for people before each part of the work.
        cache: The folder in which results are kept; None: they are not kept.
    """

    def __init__(
        self,
        robot: Robot | None = None,
        stack: StackLike | None = None,
        *,
        progress: Callable[[str], None] = lambda _: None,
        cache: Path | None = None,
    ) -> None:
        self.robot = robot
        self.stack = stack
        self.progress = progress
        self.cache = cache

    def drive(self, world: World, route: Route) -> Drive:
        """Drive a route once, with nobody about."""
        patient = route.model_copy(update={"time_limit_s": min(PATIENCE * route.time_limit_s, LONGEST_S)})
        mission = Mission.of(world, patient, robot=self.robot or ROBOT)
        scenario = Scenario(mission=mission, people=HumanConfiguration(humans=()))
        poses = patient.model_dump(mode="json", include={"start", "through", "goal"})
        on_time = content_id("driven", self._floor(world) | poses)
        late = content_id("driven", self._floor(world) | poses | {"time_limit_s": patient.time_limit_s})
        cached = self._cached(on_time, _DRIVE)
        if cached is None or cached.time_s > patient.time_limit_s:
            cached = self._cached(late, _DRIVE)
        if cached is not None:
            return cached
        self.progress(f"Driving {route.name} {route.purpose}".rstrip() + ", with nobody about")
        with simulator_of("embedded", self.stack, on_message=self.progress) as prepared:
            run = prepared.run(scenario, world, seed=SEED)
        path = run.trajectory
        drive = Drive(
            arrived=run.outcome is Outcome.REACHED,
            outcome=run.outcome.value,
            time_s=float(path.t[-1]),
            x=float(path.x[-1]),
            y=float(path.y[-1]),
            touched_s=tuple(event.time_s for event in run.events if event.kind == "obstacle_contact"),
            way=_way(path.x, path.y),
        )
        self._store(on_time if drive.arrived else late, drive.model_dump(mode="json"))
        return drive

    def not_walked(self, world: World, hops: Sequence[Hop]) -> tuple[Hop, ...]:
        """Return the hops on which a person who walks alone, slowly or fast, does not arrive in time.

        Hops with `CLEAR_M` of free floor to either side all along are not simulated: nothing there holds a person up.
        """
        from rvsg.simulation.embedded.people.behaviour import not_walked

        hops = _beside_obstacles(world, hops)
        where = {name: world.grid.position(name) for name in sorted({name for hop in hops for name in hop})}
        key = content_id("hops", self._floor(world) | {"hops": [list(hop) for hop in hops], "where": where})
        cached = self._cached(key, _HOPS)
        if cached is None:
            make_simulator("embedded").prepare(self.progress)
            self.progress(f"Walking the {len(hops)} hops beside obstacles, with nobody else about")
            cached = tuple((way[0], way[1]) for way in not_walked(world, hops))
            self._store(key, cached)
        return cached

    @cached_property
    def _simulator(self) -> Simulator:
        """The simulator, not prepared: compiling it is not needed for results that are kept."""
        return make_simulator("embedded", self.stack)

    def _floor(self, world: World) -> dict[str, object]:
        """Return what every result depends on."""
        robot, simulator = self.robot or load_robot(DEFAULT_ROBOT), self._simulator
        return {
            "floor": world.floor_id, "robot": robot.model_dump(mode="json"),
            "simulator": simulator.name, "options": dict(simulator.options),
        }  # fmt: skip

    def _cached(self, key: str, kind: TypeAdapter[T]) -> T | None:
        """Return a result that is kept; None if there is none, or where its file is damaged."""
        if self.cache is None or not exists(self.cache / f"{key}.json"):
            return None
        path = self.cache / f"{key}.json"
        try:
            return kind.validate_python(parse_json(read_text(path), path), strict=False)
        except (FileError, ValidationError):
            return None  # it is made again, and written again

    def _store(self, key: str, result: object) -> None:
        if self.cache is None:
            return
        try:
            self.cache.mkdir(parents=True, exist_ok=True)
            write_whole(self.cache / f"{key}.json", json.dumps(result))
        except (OSError, FileError) as error:
            self.progress(f"The result is not kept for the next time: {error}")


def _way(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[tuple[float, float], ...]:
    """Return a driven way in points at least `STEP_M` apart, rounded to centimetres."""
    rows = [0]
    for k in range(1, len(x)):
        if np.hypot(x[k] - x[rows[-1]], y[k] - y[rows[-1]]) >= STEP_M:
            rows.append(k)
    return tuple((round(float(x[k]), 2), round(float(y[k]), 2)) for k in [*rows, len(x) - 1])


def _beside_obstacles(world: World, hops: Sequence[Hop]) -> list[Hop]:
    """Return the hops with an obstacle within `CLEAR_M` of the line between their waypoints."""
    if not hops:
        return []
    ends = np.array([[world.grid.position(a), world.grid.position(b)] for a, b in hops])
    share = np.linspace(0.0, 1.0, POINTS)[None, :, None]
    points = ends[:, :1] + share * (ends[:, 1:] - ends[:, :1])
    clear = human_space(world).clearances(points.reshape(-1, 2)).reshape(len(hops), POINTS).min(axis=1)
    return [hop for hop, room in zip(hops, clear, strict=True) if room < CLEAR_M]
