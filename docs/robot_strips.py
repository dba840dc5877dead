"""Draw a strip of pictures per robot for benchmarks/results/robots.md, each from a simulated run.

    python docs/robot_strips.py [--out docs/images]

A door 5 cm too narrow, a door 10 cm wide enough, a corridor with a person who blocks it, a trap, a crowd of 50.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from rvsg.core.records import Pose
from rvsg.robots.robot import Robot, load_robot, shipped_robots
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.run import Run
from rvsg.world.grid import Grid
from rvsg.world.routes import fitted
from rvsg.world.world import OccupancyMap, Route, World

CELL_M = 0.05
WIDE_M, HIGH_M = 12.0, 6.0
SCALE = 22.0
GAP = 24.0
OUTLINES = 14


def room(*blocks: tuple[float, float, float, float]) -> World:
    """Return a closed room with boxes (x0, y0, x1, y1), metres."""
    cells = np.zeros((round(HIGH_M / CELL_M), round(WIDE_M / CELL_M)), np.uint8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    for x0, y0, x1, y1 in blocks:
        cells[round(y0 / CELL_M) : round(y1 / CELL_M), round(x0 / CELL_M) : round(x1 / CELL_M)] = 100
    return World(
        name="room", title="A room", objects=(), lidar_height_m=0.2, areas=(), routes=(),
        occupancy=OccupancyMap(cells=cells, resolution=CELL_M, origin=Pose(x=0.0, y=0.0)),
        grid=Grid(rows=(), columns=(), waypoints=(), hops=()),
    )  # fmt: skip


def door(width_m: float) -> World:
    """Return a room divided by a wall with a door of about this width; cells of 5 cm."""
    low = round((0.5 * HIGH_M - 0.5 * width_m) / CELL_M) * CELL_M
    high = low + round(width_m / CELL_M) * CELL_M
    return room((6.0, 0.0, 6.2, low), (6.0, high, 6.2, HIGH_M))


def standing(x: float, y: float) -> HumanAgent:
    """Return a person who stands at a place."""
    return HumanAgent(name="person", start=(x, y), goals=((x, y),), pauses_s=(1e6,))


def crowd(count: int, seed: int = 0) -> list[HumanAgent]:
    """Return people who walk to and fro across the room."""
    rng = np.random.default_rng(seed)
    people: list[HumanAgent] = []
    for x in np.linspace(2.6, 11.2, count // 2):
        for y in (0.8, HIGH_M - 0.8):
            a, b = (float(x + rng.uniform(-0.1, 0.1)), float(y)), (float(x), HIGH_M - float(y))
            people.append(
                HumanAgent(
                    name=f"person {len(people)}",
                    start=a,
                    goals=(a, b),
                    pauses_s=(0.0, 0.0),
                    speed_m_s=float(rng.uniform(0.6, 1.4)),
                    radius_m=0.2,
                )
            )
    return people


def scenes(robot: Robot) -> list[tuple[str, World, list[HumanAgent]]]:
    """Return title, world and people of each picture."""
    width = robot.width_m + 2 * robot.padding_m
    narrow = round((robot.width_m - 0.05) / CELL_M) * CELL_M
    wide = math.ceil((width + 0.1) / CELL_M) * CELL_M
    corridor = room((4.0, 0.0, 9.0, 2.3), (4.0, 3.7, 9.0, HIGH_M))
    trap = room((6.5, 1.2, 6.7, 4.8), (4.6, 1.2, 6.5, 1.4), (4.6, 4.6, 6.5, 4.8))
    return [
        (f"door of {narrow:.2f} m", door(narrow), []),
        (f"door of {wide:.2f} m", door(wide), []),
        ("person blocks the corridor", corridor, [standing(6.5, 3.0)]),
        ("trap", trap, []),
        ("crowd of 50", room(), crowd(50)),
    ]


def run_of(robot: Robot, world: World, people: list[HumanAgent]) -> Run:
    """Simulate the robot on the way across a room."""
    route = Route(name="across", start=Pose(x=1.6, y=3.0), goal=Pose(x=10.2, y=3.0), time_limit_s=60.0)
    return simulate_agents(world, fitted(route, robot, world)[0], people, robot=robot, seed=0)


def boxes(world: World) -> list[tuple[float, float, float, float]]:
    """Return the occupied cells as boxes (m): runs of columns over all rows that have the same ones."""
    found = []
    below: list[tuple[int, int]] = []
    first = 0
    occupied = world.occupancy.cells == 100
    for row in range(len(occupied) + 1):
        runs: list[tuple[int, int]] = []
        if row < len(occupied):
            ends = np.flatnonzero(np.diff(np.concatenate([[0], occupied[row].astype(int), [0]]))).tolist()
            runs = list(zip(ends[::2], ends[1::2], strict=True))
        if runs != below:
            found += [(a * CELL_M, first * CELL_M, b * CELL_M, row * CELL_M) for a, b in below]
            below, first = runs, row
    return found


def picture(title: str, robot: Robot, world: World, run: Run, top: float) -> str:
    """Return one picture as SVG: walls, the robot's outline at even times, people at the end, the outcome."""

    def at(x: float, y: float) -> str:
        return f"{x * SCALE:.1f},{top + (HIGH_M - y) * SCALE:.1f}"

    parts = [f'<rect x="0" y="{top:.0f}" width="{WIDE_M * SCALE:.0f}" height="{HIGH_M * SCALE:.0f}" fill="#f4f4f1"/>']
    for x0, y0, x1, y1 in boxes(world):
        parts.append(
            f'<rect x="{x0 * SCALE:.1f}" y="{top + (HIGH_M - y1) * SCALE:.1f}" width="{(x1 - x0) * SCALE:.1f}" '
            f'height="{(y1 - y0) * SCALE:.1f}" fill="#555"/>'
        )
    path = run.trajectory
    rows = np.unique(np.linspace(0, len(path) - 1, OUTLINES).astype(int))
    for k in rows:
        cos, sin = math.cos(path.yaw[k]), math.sin(path.yaw[k])
        corners = [(path.x[k] + cos * a - sin * b, path.y[k] + sin * a + cos * b) for a, b in robot.outline]
        shape = " ".join(at(float(x), float(y)) for x, y in corners)
        solid = k == rows[-1]
        parts.append(
            f'<polygon points="{shape}" fill="{"#2f6fb0" if solid else "none"}" fill-opacity="0.5" stroke="#2f6fb0" '
            f'stroke-width="{1.2 if solid else 0.6}"/>'
        )
    for x, y, radius in zip(path.human_x[-1], path.human_y[-1], run.human_radius_m, strict=True):
        where = at(float(x), float(y)).split(",")
        parts.append(
            f'<circle cx="{where[0]}" cy="{where[1]}" r="{radius * SCALE:.1f}" fill="#d9822b" fill-opacity="0.6"/>'
        )
    walls = sum(event.kind == "obstacle_contact" for event in run.events)
    touched = sum(event.kind == "robot_contact" for event in run.events)
    told = (
        f"{title}: {run.outcome.value}",
        f"after {path.t[-1]:.0f} s; contacts: {walls} with walls, {touched} with people",
    )
    for number, line in enumerate(told):
        y = top - 4 - 9 * (1 - number)
        parts.append(f'<text x="2" y="{y:.0f}" font-size="8" font-family="sans-serif" fill="#222">{line}</text>')
    return "\n".join(parts)


def strip(robot: Robot) -> str:
    """Return the strip of a robot as SVG."""
    high = HIGH_M * SCALE + GAP
    drawn = []
    for number, (title, world, people) in enumerate(scenes(robot)):
        run = run_of(robot, world, people)
        print(robot.name, "|", title, "|", run.outcome.value, f"{run.trajectory.t[-1]:.1f} s")
        drawn.append(picture(title, robot, world, run, number * high + GAP))
    size = f"{WIDE_M * SCALE:.0f} {5 * high:.0f}"
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size}">\n' + "\n".join(drawn) + "\n</svg>\n"


def main() -> None:
    """Draw the strips of all shipped robots."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "images")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    for name in sorted(shipped_robots()):
        (folder / f"robot-{name}.svg").write_text(strip(load_robot(name)), encoding="utf-8")


if __name__ == "__main__":
    main()
