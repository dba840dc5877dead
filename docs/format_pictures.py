"""Draw the pictures of the exported formats for docs/how-to, each from the exported file alone.

    python docs/format_pictures.py SCENARIO [--seed 0] [--out docs/images]

`bag.svg`: the panels of the Foxglove layout, drawn from the messages of the bag. `formats.svg`: a Gazebo world, a
HuNavSim agents file with Nav2 goals, and a table of trajectories. The files are read with rosbags, ElementTree, PyYAML
and csv.
"""

from __future__ import annotations

import argparse
import csv
import html
import json
import math
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import yaml

from rvsg_exchange.formats import export, foxglove_layout
from rvsg_exchange.recordings import bag_messages, open_bag

Point = tuple[float, float]
COLOURS = ("#c4570a", "#0b8270", "#a23bb8", "#8a6d00")
ROBOT, INK, SOFT, RULE = "#1559c9", "#1a2230", "#5b6675", "#d5dae1"
BEGIN_S = 10.0
"""Second of a bag at which the run begins."""


class Panel:
    """A part of a picture with coordinates of its own; y goes up."""

    def __init__(self, box: tuple[float, float, float, float], x: Point, y: Point, title: str) -> None:
        self.left, self.top, self.width, self.height = box
        self.x, self.y = x, y
        self.parts = [f'<text x="{self.left}" y="{self.top - 8}" class="title">{html.escape(title)}</text>']

    def at(self, x: float, y: float) -> Point:
        """Return the pixel of a place."""
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        up = (y - self.y[0]) / (self.y[1] - self.y[0])
        return self.left + across * self.width, self.top + (1.0 - up) * self.height

    def line(self, points: Iterable[Point], colour: str, **style: Any) -> None:
        """Draw a line."""
        found = " ".join(f"{a:.1f},{b:.1f}" for a, b in (self.at(*point) for point in points))
        said = "".join(f' {key.replace("_", "-")}="{value}"' for key, value in ({"stroke_width": 1.5} | style).items())
        self.parts.append(f'<polyline points="{found}" fill="none" stroke="{colour}"{said}/>')

    def polygon(self, points: Iterable[Point], colour: str) -> None:
        """Draw an area."""
        found = " ".join(f"{a:.1f},{b:.1f}" for a, b in (self.at(*point) for point in points))
        self.parts.append(f'<polygon points="{found}" fill="{colour}" stroke="{SOFT}" stroke-width="0.7"/>')

    def dot(self, point: Point, radius_m: float, colour: str) -> None:
        """Draw a disc of a radius in the unit of the panel, or one of 2 pixels."""
        a, b = self.at(*point)
        r = max(2.0, radius_m * self.width / (self.x[1] - self.x[0]))
        self.parts.append(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="{r:.1f}" fill="{colour}"/>')

    def text(self, point: Point, said: str, colour: str = INK) -> None:
        """Write words that begin at a place."""
        a, b = self.at(*point)
        self.parts.append(f'<text x="{a:.1f}" y="{b:.1f}" style="fill:{colour}">{html.escape(said)}</text>')

    def axes(self, unit: str) -> None:
        """Draw lines and numbers of the axes."""
        for value in (self.y[0], (self.y[0] + self.y[1]) / 2, self.y[1]):
            _, b = self.at(self.x[0], value)
            self.parts.append(f'<path d="M{self.left} {b:.1f}h{self.width}" stroke="{RULE}"/>')
            self.parts.append(f'<text x="{self.left - 6}" y="{b + 4:.1f}" text-anchor="end">{value:g}</text>')
        for value in np.arange(0.0, self.x[1], 5.0):
            a, b = self.at(float(value), self.y[0])
            self.parts.append(f'<text x="{a:.1f}" y="{b + 16:.1f}" text-anchor="middle">{value:g}</text>')
        self.parts.append(f'<text x="{self.left + self.width}" y="{self.top + self.height + 30}" '
                          f'text-anchor="end">{unit}</text>')  # fmt: skip


def svg(width: int, height: int, label: str, panels: Sequence[Panel]) -> str:
    """Return a picture of panels."""
    parts = "\n".join(part for panel in panels for part in panel.parts)
    look = f"text {{ font: 12px system-ui, sans-serif; fill: {SOFT}; }} .title {{ fill: {INK}; font-weight: 600; }}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" '
        f'aria-label="{html.escape(label)}"><style>{look}</style>'
        f'<rect width="{width}" height="{height}" fill="#fff"/>\n'
        f"{parts}\n</svg>\n"
    )


class Bag:
    """The messages of a bag on the topics of the layout, by topic, with their seconds of the run."""

    def __init__(self, path: Path) -> None:
        self.messages: dict[str, list[tuple[float, Any]]] = {}
        with open_bag(path) as reader:
            topics = {connection.topic for connection in reader.connections}
            for connection, stamp, message in bag_messages(reader, path, topics):
                self.messages.setdefault(connection.topic, []).append((stamp - BEGIN_S, message))

    def latest(self, topic: str, t: float) -> Any:
        """Return the last message up to a time."""
        return [message for stamp, message in self.messages[topic] if stamp <= t or topic == "/map"][-1]

    def pose(self, t: float) -> tuple[float, float, float]:
        """Return where the robot is in the map: its odometry, moved by the transform from the map."""
        pose = self.latest("/odom", t).pose.pose
        moved = next(each.transform.translation for _, message in self.messages["/tf_static"]
                     for each in message.transforms if each.child_frame_id == "odom")  # fmt: skip
        yaw = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        return pose.position.x + moved.x, pose.position.y + moved.y, yaw


def bag_picture(path: Path, t: float) -> str:
    """Return the panels of the layout at a time, drawn from the bag."""
    layout, bag = json.loads(foxglove_layout())["configById"], Bag(path)
    grid = bag.latest("/map", t)
    wide, high = grid.info.width * grid.info.resolution, grid.info.height * grid.info.resolution
    x0, y0 = grid.info.origin.position.x, grid.info.origin.position.y
    scale = min(680 / wide, 560 / high)
    world = Panel((20, 40, scale * wide, scale * high), (x0, x0 + wide), (y0, y0 + high), f"3D: map, at {t:.1f} s")
    cells(world, grid, "#39424f", lambda cost: cost >= 65, 1.0)
    _draw_scene(world, bag, t)
    end, beside = max(stamp for stamp, _ in bag.messages["/odom"]), 20 + scale * wide + 80
    speed = Panel((beside, 40, 480, 150), (0.0, end), (0.0, 1.6), f"Plot: {layout['Plot!speed']['title']}")
    speed.axes("time, s")
    speed.line([(s, m.twist.twist.linear.x) for s, m in bag.messages["/odom"]], ROBOT)
    speed.line([(s, m.linear.x) for s, m in bag.messages["/cmd_vel"]], ROBOT, stroke_dasharray="4 3")
    for k in range(len(bag.messages["/human_states"][0][1].agents)):
        speed.line([(s, m.agents[k].linear_vel) for s, m in bag.messages["/human_states"]], COLOURS[k % len(COLOURS)])
    imu = [(s, m.linear_acceleration.x) for s, m in bag.messages["/imu"] if s >= 0.0]
    most = max(1.0, math.ceil(max(abs(value) for _, value in imu)))
    felt = Panel((beside, 270, 480, 120), (0.0, end), (-most, most), f"Plot: {layout['Plot!acceleration']['title']}")
    felt.axes("time, s")
    felt.line(imu, ROBOT)
    for panel in (speed, felt):
        panel.line([(t, panel.y[0]), (t, panel.y[1])], INK, stroke_width=1)
    said = Panel((beside, 470, 480, 100), (0.0, 1.0), (0.0, 5.0), "Raw messages: /rvsg/navigation, /behavior_tree_log")
    said.text((0.0, 4.0), bag.latest("/rvsg/navigation", t).data)
    for row, change in enumerate(bag.latest("/behavior_tree_log", t).event_log[:3]):
        said.text((0.0, 3.0 - row), f"{change.node_name}: {change.previous_status} → {change.current_status}")
    size = round(beside + 520), round(max(600, 60 + scale * high))
    return svg(*size, "The panels of the Foxglove layout, drawn from a bag", [world, speed, felt, said])


def _draw_scene(world: Panel, bag: Bag, t: float) -> None:
    """Draw what the layout shows in the map: costmap, plan, samples, scans, people and robot."""
    cells(world, bag.latest("/local_costmap/costmap", t), "#7a4fbf", lambda cost: cost >= 50, 0.35, bag)
    world.line([(p.pose.position.x, p.pose.position.y) for p in bag.latest("/plan", t).poses], "#2e9e5b")
    x, y, yaw = bag.pose(t)
    for k in range(2):
        if f"/scan_{k}" in bag.messages:
            for point in returns(bag, k, t):
                world.dot(point, 0.02, "#d0342c")
    for k, agent in enumerate(bag.latest("/human_states", t).agents):
        place = (agent.position.position.x, agent.position.position.y)
        world.dot(place, agent.radius, COLOURS[k % len(COLOURS)])
        world.text((place[0] + 0.5, place[1] + 0.2), agent.name, COLOURS[k % len(COLOURS)])
    outline = [(0.35, 0.25), (0.35, -0.25), (-0.35, -0.25), (-0.35, 0.25)]
    cos, sin = math.cos(yaw), math.sin(yaw)
    world.polygon([(x + cos * a - sin * b, y + sin * a + cos * b) for a, b in outline], ROBOT)
    world.text((x - 0.2, y - 0.8), "base_footprint", ROBOT)


def cells(
    panel: Panel, grid: Any, colour: str, chosen: Callable[[int], bool], opacity: float, bag: Bag | None = None
) -> None:
    """Draw the chosen cells of a grid, row by row."""
    size, origin = grid.info.resolution, grid.info.origin.position
    dx = dy = 0.0
    if bag is not None and grid.header.frame_id == "odom":
        moved = next(each.transform.translation for _, message in bag.messages["/tf_static"]
                     for each in message.transforms if each.child_frame_id == "odom")  # fmt: skip
        dx, dy = moved.x, moved.y
    data = np.asarray(grid.data).reshape(grid.info.height, grid.info.width)
    path = []
    for row, costs in enumerate(data):
        on = np.flatnonzero([chosen(int(cost)) for cost in costs])
        for run in np.split(on, np.flatnonzero(np.diff(on) > 1) + 1):
            if len(run):
                left, right = origin.x + dx + run[0] * size, origin.x + dx + (run[-1] + 1) * size
                a, b = panel.at(left, origin.y + dy + (row + 1) * size)
                c, d = panel.at(right, origin.y + dy + row * size)
                path.append(f"M{a:.1f} {b:.1f}H{c:.1f}V{d:.1f}H{a:.1f}z")
    panel.parts.append(f'<path d="{"".join(path)}" fill="{colour}" fill-opacity="{opacity}"/>')


def returns(bag: Bag, lidar: int, t: float) -> list[Point]:
    """Return where the rays of a lidar end, in the map, every fourth."""
    scan, (x, y, yaw) = bag.latest(f"/scan_{lidar}", t), bag.pose(t)
    mount = next(each.transform for _, message in bag.messages["/tf_static"]
                 for each in message.transforms if each.child_frame_id == f"lidar_{lidar}")  # fmt: skip
    turned = 2.0 * math.atan2(mount.rotation.z, mount.rotation.w)
    found = []
    for k in range(0, len(scan.ranges), 4):
        if math.isfinite(scan.ranges[k]):
            angle = turned + scan.angle_min + k * scan.angle_increment
            a = mount.translation.x + scan.ranges[k] * math.cos(angle)
            b = mount.translation.y + scan.ranges[k] * math.sin(angle)
            found.append((x + math.cos(yaw) * a - math.sin(yaw) * b, y + math.sin(yaw) * a + math.cos(yaw) * b))
    return found


def formats_picture(folder: Path) -> str:
    """Return what the other files hold."""
    root = ET.parse(folder / "world.sdf").getroot()
    rings = [[tuple(map(float, (point.text or "").split())) for point in line.findall("point")]
             for line in root.iterfind(".//collision/geometry/polyline")]  # fmt: skip
    every = np.array([point for ring in rings for point in ring])
    (x0, y0), (x1, y1) = every.min(axis=0), every.max(axis=0)
    high = 360 * (y1 - y0) / (x1 - x0)
    gazebo = Panel((20, 40, 360, high), (x0, x1), (y0, y1), "world.sdf: models and actors")
    agents = Panel((420, 40, 360, high), (x0, x1), (y0, y1), "agents.yaml and goals.yaml: starts and goals")
    for panel, colour in ((gazebo, "#d9c2ad"), (agents, "#eceff3")):
        for ring in rings:
            panel.polygon([(a, b) for a, b in ring], colour)
    for k, actor in enumerate(root.iter("actor")):
        way = [tuple(map(float, (pose.text or "").split()[:2])) for pose in actor.iterfind(".//waypoint/pose")]
        gazebo.line([(a, b) for a, b in way], COLOURS[k % len(COLOURS)], stroke_width=2)
        gazebo.text((way[0][0] + 0.3, way[0][1]), actor.attrib["name"], COLOURS[k % len(COLOURS)])
    people = yaml.safe_load((folder / "agents.yaml").read_text())["hunav_loader"]["ros__parameters"]
    for k, name in enumerate(people["agents"]):
        person, colour = people[name], COLOURS[k % len(COLOURS)]
        goals = [(person[goal]["x"], person[goal]["y"]) for goal in person["goals"]]
        start = (person["init_pose"]["x"], person["init_pose"]["y"])
        agents.line([start, *goals, *(goals[:1] if person["cyclic_goals"] else [])], colour, stroke_dasharray="4 3")
        for goal in goals:
            agents.dot(goal, 0.12, colour)
        agents.text((start[0] + 0.3, start[1]), name, colour)
    for pose in yaml.safe_load((folder / "goals.yaml").read_text())["poses"]:
        place = (pose["pose"]["position"]["x"], pose["pose"]["position"]["y"])
        agents.dot(place, 0.3, ROBOT)
        agents.text((place[0] - 0.4, place[1] + 0.5), "goal", ROBOT)
    with (folder / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    end = max(float(row["t"]) for row in rows)
    table = Panel((850, 40, 330, high), (0.0, end), (0.0, 1.6), "runs.csv: speed of each body, m/s")
    table.axes("time, s")
    for k, who in enumerate(dict.fromkeys(row["who"] for row in rows)):
        colour = ROBOT if who == "robot" else COLOURS[(k - 1) % len(COLOURS)]
        table.line([(float(row["t"]), float(row["speed"])) for row in rows if row["who"] == who], colour)
    return svg(1200, round(90 + high), "What exported files hold", [gazebo, agents, table])


def main() -> None:
    """Export, read and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenario", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--time", type=float, default=9.0, help="second of the run that the bag's picture shows")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "images")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        export(asked.scenario, folder / "run.mcap", "mcap", seed=asked.seed, trace=True)
        export(asked.scenario, folder / "runs.csv", "csv", seed=asked.seed)
        export(asked.scenario, folder / "agents.yaml", "hunav")
        export(asked.scenario, folder / "goals.yaml", "nav2-goals")
        runs = simulated(asked.scenario, asked.seed)
        export(runs, folder / "world.sdf", "sdf")
        asked.out.joinpath("bag.svg").write_text(bag_picture(folder / "run.mcap", asked.time), encoding="utf-8")
        asked.out.joinpath("formats.svg").write_text(formats_picture(folder), encoding="utf-8")


def simulated(scenario: Path, seed: int) -> Any:
    """Return the run of a scenario, for the actors of a Gazebo world."""
    import rvsg

    return rvsg.simulate(rvsg.load_scenario(scenario), [seed])


if __name__ == "__main__":
    main()
