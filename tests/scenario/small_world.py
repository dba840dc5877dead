"""A small hall to try rules on: 5 x 7 waypoints one metre apart, one shelf in the middle, four areas, one route.

Rows A to E lie at x = 0 to 4, columns 1 to 7 at y = 0 to 6. The shelf covers C3 to C5 and cuts B4-C4 and the like.
"""

from __future__ import annotations

import numpy as np

from rvsg.core.records import Pose
from rvsg.scenario.rules import read_ends
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Task
from rvsg.world.grid import Grid, Waypoint
from rvsg.world.world import Area, OccupancyMap, Route, World

SHELF = {"C3", "C4", "C5"}


def hall() -> World:
    rows, columns = "ABCDE", range(1, 8)
    waypoints = tuple(
        Waypoint(name=f"{r}{c}", x=float(i), y=float(c - 1), row=i, column=c - 1, human=f"{r}{c}" not in SHELF)
        for i, r in enumerate(rows)
        for c in columns
    )
    valid = [w for w in waypoints if w.human]
    hops = tuple(
        (a.name, b.name)
        for i, a in enumerate(valid)
        for b in valid[i + 1 :]
        if abs(a.row - b.row) <= 1 and abs(a.column - b.column) <= 1 and {a.name, b.name} != {"C2", "D2"}
    )
    cells = np.zeros((160, 120), np.uint8)
    cells[55:105, 46:54] = 100  # y 1.75 to 4.25, x 1.8 to 2.2
    areas = (("Dock", "A1 A2 B1"), ("Bench", "A6 A7 B7"), ("Store", "E1 E2"), ("Office", "E6 E7 D7"))
    return World(
        name="hall",
        title="A hall",
        objects=(),
        occupancy=OccupancyMap(cells=cells, resolution=0.05, origin=Pose(x=-0.5, y=-1.0)),
        lidar_height_m=0.2,
        grid=Grid(rows=tuple(rows), columns=tuple(map(str, columns)), waypoints=waypoints, hops=hops),
        areas=tuple(
            Area(name=name, outline=((0, 0), (1, 0), (1, 1)), waypoints=tuple(points.split())) for name, points in areas
        ),
        routes=(Route(name="across", start=Pose(x=1.0, y=3.0), goal=Pose(x=3.0, y=6.0), time_limit_s=20),),
        activities=("unloading a truck", "repairing a machine"),
    )


WORLD = hall()
MISSION = Mission(world="hall", world_id=WORLD.id, route=WORLD.routes[0])


def human(*tasks: str | Task, name: str = "Ada", **more: object) -> Human:
    """A person from tasks written "name: A1 A2 B3"."""
    made = tuple(task if isinstance(task, Task) else walk(task) for task in tasks)
    return Human(name=name, tasks=made, **more)


def walk(text: str) -> Task:
    name, _, path = text.partition(":")
    return Task(name=name.strip(), path=tuple(path.split()))


def people(*humans: Human) -> HumanConfiguration:
    """A configuration as it is read from a file: the names of tasks say their areas."""
    return read_ends(HumanConfiguration(humans=humans), WORLD)


GOOD = ("Dock → Store: A1 B1 C1 D1 E1", "Store → Dock: E1 D1 C1 B1 A1")
