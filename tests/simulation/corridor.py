"""A hall of 16 x 4 m, cut in two by a wall with a gap of 1.6 m at x = 8, for doors, trolleys and wheelchairs."""

from __future__ import annotations

from rvsg.core.records import Pose
from rvsg.scenario.scenario import HumanAgent, PersonKind, Trolley, outline_of
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.run import Run
from rvsg.world.grid import GridSpec
from rvsg.world.lattice import build_world
from rvsg.world.occupancy import occupancy_from_objects
from rvsg.world.schema import ObjectEntry
from rvsg.world.world import Door, Route, World

ROUTE = Route(name="along", start=Pose(x=2, y=2), goal=Pose(x=14, y=2), time_limit_s=60)
HINGE, END = (8.0, 1.2), (8.0, 2.8)


def hall(*doors: Door, gap: bool = True) -> World:
    """Return the hall, with or without the wall across it."""
    walls = [
        {
            "name": "walls",
            "kind": "wall",
            "footprint": [(0, 0), (16, 0), (16, 4), (0, 4)],
            "height": 2.5,
            "holes": [[(0.1, 0.1), (15.9, 0.1), (15.9, 3.9), (0.1, 3.9)]],
        }
    ]
    if gap:
        for name, low, high in (("low", 0.1, 1.2), ("high", 2.8, 3.9)):
            outline = [(7.95, low), (8.05, low), (8.05, high), (7.95, high)]
            walls.append({"name": name, "kind": "wall", "footprint": outline, "height": 2.5})
    objects = [ObjectEntry.model_validate(wall).solid(0.21) for wall in walls]
    return build_world(
        name="hall",
        occupancy=occupancy_from_objects(tuple(objects), resolution_m=0.05, seeds=[(2.0, 2.0)]),
        objects=objects,
        routes=[ROUTE],
        grid_spec=GridSpec(spacing_m=1.0, origin=(0.0, 0.0)),
        doors=doors,
    )


def person(
    *points: tuple[float, float], kind: PersonKind = PersonKind.ADULT, trolley: Trolley | None = None,
    speed_m_s: float = 0.8, radius_m: float = 0.4, stays: bool = True,
) -> HumanAgent:  # fmt: skip
    """Return somebody who walks through these points and stays at the last one."""
    pauses = (0.0,) * (len(points) - 1) + (36_000.0 if stays else 0.0,)
    return HumanAgent(
        name="P", start=points[0], goals=points, pauses_s=pauses, speed_m_s=speed_m_s, radius_m=radius_m,
        outline=outline_of(kind, trolley, radius_m),
    )  # fmt: skip


def run(world: World, *people: HumanAgent, seed: int = 1, time_limit_s: float = 60.0) -> Run:
    """Simulate the robot driving along the hall."""
    return simulate_agents(world, ROUTE.model_copy(update={"time_limit_s": time_limit_s}), people, seed=seed)
