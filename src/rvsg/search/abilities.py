"""Abilities of a robot with its stack, measured in an empty hall: gaps, distances from people, contact, recovery."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from rvsg.core.files import write_whole
from rvsg.core.inputs import parse_json, read_text
from rvsg.core.records import Pose, content_id
from rvsg.core.seeds import seed_for
from rvsg.evaluation.detection import contacts
from rvsg.evaluation.sampled import sampled
from rvsg.generation.generator import Abilities
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Scenario, Task
from rvsg.simulation.events import Outcome, Recovery
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import Simulator
from rvsg.world.lattice import build_world
from rvsg.world.world import OccupancyMap, Point, Route, World

CELL_M, LENGTH_M, MIDDLE_M = 0.05, 10.0, 3.0
"""Cell and length of the hall, and half of its width."""
GOAL = (LENGTH_M - 1.5, MIDDLE_M)
LIMIT_S = 40.0
TRIED_M = 1.2
"""Gaps wider than the robot by up to this are tried."""
MEETINGS, BLOCKED = 5, 3
"""Runs with a person in the open hall, and with one on the goal or in a doorway."""
DOORWAY_M = 0.7
"""Such a doorway is wider than the robot by this, which leaves no room for both."""


def abilities_of(mission: Mission, simulator: Simulator, path: Path | None = None) -> Abilities | None:
    """Return what a mission's robot can do in a simulator; None for a robot that only another simulator knows.

    Args:
        path: The file that keeps what was measured, in the folder of a campaign that has begun.
    """
    if mission.robot_record is None:
        return None
    of: Mapping[str, object] = {"robot": mission.robot_record.id, "options": dict(simulator.options)}
    setting = content_id("abilities", {**of, "simulator": simulator.name})
    if path is not None and path.is_file():
        try:
            stored = Abilities.model_validate(parse_json(read_text(path), path))
        except ValidationError:
            stored = None  # of another version; it is measured again
        if stored is not None and stored.setting == setting:
            return stored
    abilities = _measured(mission, mission.robot_record.width_m, simulator, setting)
    if path is not None and path.parent.is_dir():
        write_whole(path, abilities.to_json())
    return abilities


def _measured(mission: Mission, width_m: float, simulator: Simulator, setting: str) -> Abilities:
    """Measure what the robot can do, in some twenty runs."""

    def drive(gap_m: float | None, k: int, *people: Human) -> Run:
        hall = _hall(gap_m)
        scenario = Scenario(
            mission=Mission.of(hall, hall.route("hall"), robot=mission.robot), people=HumanConfiguration(humans=people)
        )
        return simulator.run(scenario, hall, seed=seed_for(0, "abilities", k))

    gaps = [CELL_M * k for k in range(math.ceil(width_m / CELL_M), math.ceil((width_m + TRIED_M) / CELL_M) + 1)]
    low, high = -1, len(gaps)  # the widest gap that it did not drive through, the narrowest that it did
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if drive(gaps[middle], 0).completed else (middle, high)
    walker, stander = _person((8.0, MIDDLE_M), (2.0, MIDDLE_M)), _stander((5.0, MIDDLE_M))
    walking = [drive(None, k, walker) for k in range(MEETINGS)]
    standing = [drive(None, k, stander) for k in range(MEETINGS)]
    at_goal = [drive(None, k, _stander(GOAL)) for k in range(BLOCKED)]
    in_doorway = [drive(width_m + DOORWAY_M, k, stander) for k in range(BLOCKED)]
    given_up = [float(run.trajectory.t[-1]) for run in in_doorway if run.outcome is Outcome.ABORTED]
    recoveries = (event for run in (*at_goal, *in_doorway) for event in run.events if isinstance(event, Recovery))
    return Abilities(
        setting=setting,
        gap_m=round(gaps[high], 2) if high < len(gaps) else None,
        blocked_m=round(gaps[low], 2) if low >= 0 else None,
        walker_m=_nearest_m(walking),
        stander_m=_nearest_m(standing),
        touching=sum(map(_touches, (*walking, *standing))),
        met=len(walking) + len(standing),
        blocked=BLOCKED,
        arriving=sum(run.completed for run in at_goal),
        pushing=sum(map(_touches, at_goal)),
        doorway_m=round(width_m + DOORWAY_M, 2),
        passing=sum(run.completed for run in in_doorway),
        gives_up_s=round(statistics.median(given_up), 1) if given_up else None,
        recoveries=tuple(dict.fromkeys(event.action for event in recoveries)),
    )


def _hall(gap_m: float | None) -> World:
    """Return the hall, with a wall across its middle where a gap is given, and the route along it."""
    cells = np.full((round(2 * MIDDLE_M / CELL_M), round(LENGTH_M / CELL_M)), 100, np.uint8)
    cells[1:-1, 1:-1] = 0
    if gap_m is not None:
        middle, half = cells.shape[0] / 2, gap_m / CELL_M / 2
        wall = cells[:, cells.shape[1] // 2 - 2 : cells.shape[1] // 2 + 2]
        wall[: round(middle - half)] = 100
        wall[round(middle - half) + round(2 * half) :] = 100
    route = Route(name="hall", start=Pose(x=1.5, y=MIDDLE_M), goal=Pose(x=GOAL[0], y=GOAL[1]), time_limit_s=LIMIT_S)
    return build_world(
        name="hall", occupancy=OccupancyMap(cells=cells, resolution=CELL_M, origin=Pose(x=0.0, y=0.0)), routes=(route,)
    )


def _person(at: Point, to: Point, start_delay_s: float = 0.0) -> Human:
    """Return somebody who walks to and fro between two points."""
    tasks = (Task(name="there", path=("at", "to")), Task(name="back", path=("to", "at")))
    return Human(name="person", tasks=tasks, points={"at": at, "to": to}, start_delay_s=start_delay_s)


def _stander(at: Point) -> Human:
    return _person(at, (at[0] - 1.0, at[1]), start_delay_s=LIMIT_S)


def _nearest_m(runs: list[Run]) -> float | None:
    """Return the usual smallest distance between the centres of robot and person."""
    paths = [run.trajectory for run in runs if len(run.trajectory)]
    nearest = [float(np.hypot(p.human_x[:, 0] - p.x, p.human_y[:, 0] - p.y).min()) for p in paths]
    return round(statistics.median(nearest), 2) if nearest else None


def _touches(run: Run) -> bool:
    """Whether the robot moves into a person."""
    return any(contact.moved_by in ("robot", "both") for contact in contacts(sampled(run)))
