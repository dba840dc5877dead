"""What a scenario depends on in its world, and what a change of the world means for it."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rvsg.scenario.scenario import HumanConfiguration, Mission
from rvsg.world.world import World

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
            f"The scenario was saved for {mission.world_id} by a version of RVSG that did not record what it depends "
            f"on, and {world.name} is {world.id}.",
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
