"""What a change of the world means for a scenario, and its adaptation to the changed world."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rvsg.core.errors import InputError
from rvsg.scenario.scenario import HumanConfiguration, Mission, Scenario, Task
from rvsg.world.world import Route, World

SAME_PLACE_M = 1e-6


def waypoints_used(people: HumanConfiguration) -> tuple[str, ...]:
    """Return the names of the waypoints on people's paths, in order of first use."""
    used: Iterable[str] = (
        name for human in people.humans for task in human.tasks for name in task.path if name not in human.points
    )
    return tuple(dict.fromkeys(used))


def same_floor(mission: Mission, world: World) -> bool:
    """Return whether a mission can take place in a world: it is the one it was made in, or has the same floor.

    The waypoints that people use may differ all the same: `changes_that_matter` compares those.
    """
    if mission.world_id == world.id:
        return True
    return mission.parts is not None and mission.parts.floor == world.floor_id


def changes_that_matter(people: HumanConfiguration, mission: Mission, world: World) -> tuple[str, ...]:
    """Return the differences between the world a scenario was made in and this one that change the scenario.

    Labels, activities, other routes and waypoints that nobody uses do not matter. The robot's route is part of the
    scenario itself. Empty if the scenario means the same in both worlds.
    """
    if mission.world_id == world.id:
        return ()
    if mission.parts is None:
        return (
            f"The scenario was made for {mission.world_id} and does not hold what it depends on; {world.name} is "
            f"{world.id}.",
        )
    changes = []
    if mission.parts.floor != world.floor_id:
        changes.append(f"The map or the objects of {world.name} have changed.")
    for name in waypoints_used(people):
        before, now = mission.parts.position(name), world.grid.by_name.get(name)
        if before is None:
            continue  # it never existed: the checker reports it as unknown
        if now is None:
            changes.append(f"Waypoint {name} at ({before[0]:g}, {before[1]:g}) no longer exists.")
        elif (away := math.dist(before, (now.x, now.y))) > SAME_PLACE_M:
            changes.append(
                f"Waypoint {name} moved by {away:.1g} m." if away < 0.1 else f"Waypoint {name} moved by {away:.1f} m."
            )
    return tuple(changes)


REACH_M = 1.0


def migrate(
    scenario: Scenario, world: World, *, reach_m: float = REACH_M, route: Route | None = None
) -> tuple[Scenario, tuple[str, ...]]:
    """Return a scenario adapted to a world, and what changed: every waypoint becomes the nearest to where it was.

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
    return scenario.replace(mission=mission, people=people), tuple(changes)


def _renamed(task: Task, successors: dict[str, str]) -> Task:
    """Return the task over the successors of its waypoints, neighbours that became the same joined."""
    path = [successors.get(name, name) for name in task.path]
    joined = tuple(name for i, name in enumerate(path) if i == 0 or name != path[i - 1])
    pauses = tuple(pause.model_copy(update={"at": successors.get(pause.at, pause.at)}) for pause in task.pauses)
    return task.model_copy(update={"path": joined if len(joined) > 1 else tuple(path), "pauses": pauses})
