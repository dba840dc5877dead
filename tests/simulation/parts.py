"""Rooms, people, crowds and stacks for tests of the simulator."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from rvsg.core.records import Pose
from rvsg.core.references import refer
from rvsg.robots.robot import load_robot
from rvsg.scenario.scenario import Behaviour, HumanAgent, PersonKind, Trolley, outline_of, reaction_of
from rvsg.simulation.costmap import inflation_kernel
from rvsg.simulation.embedded.people.behaviour import tick as tick_by_reference
from rvsg.simulation.embedded.people.crowd import Crowd, PeopleOptions, initial
from rvsg.simulation.embedded.robot_parameters import padded_footprint, stack_of
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.run import Run
from rvsg.stacks import LocalObservation, LocalPlanner, Task
from rvsg.world.grid import Grid, GridSpec
from rvsg.world.lattice import build_world
from rvsg.world.occupancy import occupancy_from_objects
from rvsg.world.schema import ObjectEntry
from rvsg.world.world import Door, OccupancyMap, OrientedBox, Route, SolidObject, World

TIAGO = load_robot("tiago_omni")
MECANUM = Path(__file__).parents[2] / "examples" / "robots" / "mecanum.yaml"
STACK = refer(stack_of(TIAGO))
FOOTPRINT = padded_footprint(TIAGO)
INFLATION = inflation_kernel(0.05, 0.55, 3.0, 0.24999999977)
RANGES = (2.5, 3.0, 0.05)
"""Obstacle range, clearing range and least range of a scan."""
BOX = np.array([-0.3585, 0.3585, -0.2485, 0.2485])


class Constant(LocalPlanner):
    """Answers the same velocity, whatever is ahead, until a time; then nothing."""

    def __init__(self, answer: Any, until_s: float = math.inf) -> None:
        self.answer, self.until_s = answer, until_s

    def reset(self, task: Task) -> None:
        self.lateral: list[float] = []

    def command(self, seen: LocalObservation) -> Any:
        self.lateral.append(seen.lateral)
        return self.answer if seen.t < self.until_s else None


def world_of(cells: np.ndarray, x: float = 0.0, y: float = 0.0, objects: tuple[SolidObject, ...] = ()) -> World:
    """Return a world of these cells of 5 cm, whose corner lies at (x, y)."""
    return World(
        name="room", title="A room", objects=objects, lidar_height_m=0.2, areas=(), routes=(),
        grid=Grid(rows=(), columns=(), waypoints=(), hops=()),
        occupancy=OccupancyMap(cells=cells, resolution=0.05, origin=Pose(x=x, y=y)),
    )  # fmt: skip


def room_cells(length_m: float, width_m: float, *blocks: tuple[float, float, float, float]) -> np.ndarray:
    """Return the cells of a closed room with boxes (x0, y0, x1, y1) from its corner."""
    cells = np.zeros((round(width_m / 0.05), round(length_m / 0.05)), np.uint8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    for x0, y0, x1, y1 in blocks:
        cells[round(y0 / 0.05) : round(y1 / 0.05), round(x0 / 0.05) : round(x1 / 0.05)] = 100
    return cells


def box(name: str, x: float, y: float, length: float, width: float) -> SolidObject:
    a, b = length / 2, width / 2
    return SolidObject(
        name=name, kind="box", origin=(x, y, 0.5), slices=(),
        box=OrientedBox(center=(x, y, 0.5), size=(length, width, 1.0)),
        footprint=((x - a, y - b), (x + a, y - b), (x + a, y + b), (x - a, y + b)),
    )  # fmt: skip


def world_with(*boxes: tuple[float, float, float, float], occupied: tuple[slice, slice] | None = None) -> World:
    """A free floor from -10 to 10 m with boxes (x, y, length, width) 1 m high."""
    cells = np.zeros((400, 400), np.uint8)
    if occupied is not None:
        cells[occupied] = 100
    return world_of(cells, -10.0, -10.0, tuple(box(f"box {i}", *each) for i, each in enumerate(boxes)))


def route(start: tuple[float, ...], goal: tuple[float, ...], limit_s: float = 25.0) -> Route:
    """Return the way from one pose (x, y, yaw) to another."""
    begin, end = (Pose(**dict(zip(("x", "y", "yaw"), pose, strict=False))) for pose in (start, goal))
    return Route(name="test", start=begin, goal=end, time_limit_s=limit_s)


def standing(x: float, y: float, radius_m: float = 0.4, **more: Any) -> HumanAgent:
    return HumanAgent(name="ann", start=(x, y), goals=((x, y),), pauses_s=(1000.0,), radius_m=radius_m, **more)


PUBLISHED = PeopleOptions(published_defects=True, leg_phase_noise=False)
CORRECT = PeopleOptions(leg_phase_noise=False)
FAR = (1000.0, 1000.0, 0.0, 0.0)


def human(*goals: tuple[float, float], start: tuple[float, float] | None = None, **more: object) -> HumanAgent:
    behaviour = Behaviour(more.pop("behaviour", Behaviour.REGULAR))
    fields = {
        "name": "human", "start": start or goals[0], "goals": goals, "pauses_s": (0.0,) * len(goals),
        "behaviour": behaviour, "reaction": reaction_of(behaviour, 1.5),
    }  # fmt: skip
    return HumanAgent.model_validate(fields | more)


def crowd_of(*agents: HumanAgent, options: PeopleOptions = CORRECT, world: World | None = None) -> Crowd:
    return initial(agents, world or world_with(), options=options, seed=7)


def tick(crowd: Crowd, *arguments: float) -> None:
    tick_by_reference(refer(crowd), *arguments, 0.0)


def walk(crowd: Crowd, ticks: int, robot: tuple[float, float, float, float] = FAR, dt: float = 0.1) -> list[float]:
    """Ticks with a robot at rest or moving straight on; returns human 0's distance from it after each."""
    x, y, yaw, v = robot
    found = []
    by_reference = refer(crowd)
    for k in range(ticks):
        tick_by_reference(by_reference, k * dt, dt, x, y, yaw, v, 0.0)
        x += v * math.cos(yaw) * dt
        y += v * math.sin(yaw) * dt
        found.append(math.hypot(crowd.x[0] - x, crowd.y[0] - y))
    return found


ALONG = Route(name="along", start=Pose(x=2, y=2), goal=Pose(x=14, y=2), time_limit_s=60)
HINGE, END = (8.0, 1.2), (8.0, 2.8)


def hall(*doors: Door, gap: bool = True) -> World:
    """Return a hall of 16 x 4 m, with or without a wall across it at x = 8 that has a gap of 1.6 m."""
    inner = [[(0.1, 0.1), (15.9, 0.1), (15.9, 3.9), (0.1, 3.9)]]
    walls: list[dict[str, Any]] = [
        {"name": "walls", "footprint": [(0, 0), (16, 0), (16, 4), (0, 4)], "holes": inner},
    ]
    for name, low, high in (("low", 0.1, 1.2), ("high", 2.8, 3.9)) if gap else ():
        walls.append({"name": name, "footprint": [(7.95, low), (8.05, low), (8.05, high), (7.95, high)]})
    objects = [ObjectEntry.model_validate({"kind": "wall", "height": 2.5, **wall}).solid(0.21) for wall in walls]
    return build_world(
        name="hall", objects=objects, routes=[ALONG], doors=doors,
        occupancy=occupancy_from_objects(tuple(objects), resolution_m=0.05, seeds=[(2.0, 2.0)]),
        grid_spec=GridSpec(spacing_m=1.0, origin=(0.0, 0.0)),
    )  # fmt: skip


def person(
    *points: tuple[float, float], kind: PersonKind = PersonKind.ADULT, trolley: Trolley | None = None,
    speed_m_s: float = 0.8, radius_m: float = 0.4,
) -> HumanAgent:  # fmt: skip
    """Return somebody who walks through these points and stays at the last one."""
    return HumanAgent(
        name="P", start=points[0], goals=points, pauses_s=(*(0.0,) * (len(points) - 1), 36_000.0),
        speed_m_s=speed_m_s, radius_m=radius_m, outline=outline_of(kind, trolley, radius_m),
    )  # fmt: skip


def run_along(world: World, *people: HumanAgent, time_limit_s: float = 60.0) -> Run:
    """Simulate the robot driving along the hall."""
    return simulate_agents(world, ALONG.model_copy(update={"time_limit_s": time_limit_s}), people, seed=1)
