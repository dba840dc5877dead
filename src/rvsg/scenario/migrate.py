"""Adapt a scenario to a world that has changed since it was saved."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rvsg.core.errors import InputError
from rvsg.scenario.dependence import waypoints_used
from rvsg.scenario.scenario import Mission, Scenario, Task
from rvsg.world.world import Route, World

REACH_M = 1.0


@dataclass(frozen=True, kw_only=True)
class Migrated:
    """A scenario adapted to a world, and what was changed in it."""

    scenario: Scenario
    changes: tuple[str, ...]


def migrate(scenario: Scenario, world: World, *, reach_m: float = REACH_M, route: Route | None = None) -> Migrated:
    """Adapt a scenario to a world: every waypoint becomes the one nearest to where it was.

    Args:
        reach_m: A waypoint without a successor this near (metres) is an error.
        route: The route to drive instead of the one the scenario holds.

    Raises:
        InputError: A waypoint has no successor. Names all of them.
    """
    parts = scenario.mission.parts
    successors: dict[str, str] = {}
    lost, changes = [], []
    for name in waypoints_used(scenario.people):
        before = parts.position(name) if parts is not None else None
        if before is None:  # where it was is unknown, so only its name is left
            if name in world.grid.valid:
                successors[name] = name
            else:
                lost.append(name)
            continue
        near = world.grid.nearest(*before)
        away = math.dist(before, world.grid.position(near))
        if away > reach_m:
            lost.append(f"{name} ({before[0]:g}, {before[1]:g})")
            continue
        successors[name] = near
        if near != name or away > 1e-6:
            changes.append(f"Waypoint {name} becomes {near}, {away:.2f} m from where it was.")
    if lost:
        raise InputError(
            f"{world.name} has no waypoint within {reach_m:g} m of {', '.join(lost)}. Edit the paths of the scenario, "
            "or make a new one for this world.",
            code="waypoint-too-far",
        )
    humans = tuple(
        human.model_copy(update={"tasks": tuple(_renamed(task, successors) for task in human.tasks)})
        for human in scenario.people.humans
    )
    old = scenario.mission
    mission = Mission.of(world, route or old.route, robot=old.robot, moved=old.moved, doors=old.doors)
    people = scenario.people.model_copy(update={"humans": humans})
    return Migrated(scenario=scenario.replace(mission=mission, people=people), changes=tuple(changes))


def _renamed(task: Task, successors: dict[str, str]) -> Task:
    """Return the task over the successors of its waypoints, neighbours that became the same joined."""
    path = [successors.get(name, name) for name in task.path]
    joined = tuple(name for i, name in enumerate(path) if i == 0 or name != path[i - 1])
    pauses = tuple(pause.model_copy(update={"at": successors.get(pause.at, pause.at)}) for pause in task.pauses)
    return task.model_copy(update={"path": joined if len(joined) > 1 else tuple(path), "pauses": pauses})
