"""A world as an editor shows it, its changes, and their undoing."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rvsg.core.documents import read_yaml
from rvsg.core.errors import InputError, RvsgError
from rvsg.core.files import write_whole
from rvsg.core.inputs import read_text
from rvsg.robots.robot import Robot
from rvsg.world.checks import check_world
from rvsg.world.drawing.svg import rectangles
from rvsg.world.edits import Edit, edit_world
from rvsg.world.passages import free_width_m, length_m, line_of
from rvsg.world.routes import Trial
from rvsg.world.space import frame_of, world_map
from rvsg.world.world import OCCUPIED, Route, World
from rvsg.world.world_folder import SHIPPED, read_world, shipped_worlds, world_folder
from rvsg_studio.scenario_editor import floor_of
from rvsg_studio.workspace import read_json

MOST_EDGES = 4000
STEPS = 200
"""Changes that can be undone."""


def folder_of_world(name: str | Path) -> Path:
    """Return the folder of a world given by its path or by the name of a shipped one."""
    return SHIPPED / name if isinstance(name, str) and name in shipped_worlds() else world_folder(name)


def editable_world(name: str | Path) -> dict[str, Any]:
    """Return what an editor shows of a world: floor plan, areas, waypoints, routes, and edges to snap to.

    A world with mistakes is shown as far as it can be read; `remarks_on` says what is wrong.

    Raises:
        FileError: its files cannot be read at all.
    """
    world = read_world(folder_of_world(name), [])
    kinds = list(dict.fromkeys(area.kind for area in world.areas))
    all_kinds = sorted({*kinds, *_shipped_kinds()})
    return {
        "name": world.name,
        "title": world.title,
        "editable": not folder_of_world(name).resolve().is_relative_to(SHIPPED.resolve()),
        "floor": floor_of(world, areas=False),
        "kinds": kinds,
        "known_kinds": all_kinds,
        "areas": [
            {
                "name": area.name,
                "kind": area.kind,
                "region": area.region or "",
                "note": area.note or "",
                "outline": [list(point) for point in area.outline],
                "waypoints": list(area.waypoints),
            }
            for area in world.areas
        ],
        "waypoints": [[w.name, w.x, w.y, w.robot] for w in world.grid.waypoints if w.human],
        "routes": [_route(world, route) for route in world.routes],
        "activities": list(world.activities),
        "edges": _edges(world),
    }


def remarks_on(name: str | Path, *, trial: Trial | None = None, robot: Robot | None = None) -> list[dict[str, Any]]:
    """Return what `rvsg world check` finds, each with the place it is about and a fix, if one is known.

    Args:
        trial: drives the routes and walks the hops, too.
    """
    folder = folder_of_world(name)
    remarks = []
    for remark in check_world(folder, trial=trial, robot=robot):
        problem = remark.problem
        said = {"serious": remark.serious, "code": remark.code, "key": list(remark.key)}
        said |= {"message": problem.message, "file": problem.path.name, "line": problem.line}
        fix = {"label": remark.fix.label, "change": dict(remark.fix.change)} if remark.fix is not None else None
        remarks.append(said | {"fix": fix})
    return remarks


Steps = Mapping[str, Sequence[Mapping[str, str]]]


class History:
    """The changes of a world that can be undone, kept in a file so that a restart loses none."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def make(self, folder: str | Path, change: Mapping[str, Any], *, together: str = "") -> None:
        """Make a change and remember it.

        Args:
            together: successive changes of the same file with the same text here are undone in one step.
        """
        edit = edit_world(folder, change)
        if edit.after == edit.before:
            return
        history = self._read()
        step = {"path": str(edit.path), "before": edit.before, "after": edit.after, "together": together}
        done = list(history["done"])
        continued = {"path": step["path"], "after": edit.before, "together": together}
        if together and done and continued.items() <= done[-1].items():
            step |= {"before": done.pop()["before"], "shortly": edit.before}
        self._apply(edit, history, {"done": [*done, step][-STEPS:], "undone": []})

    def undo(self) -> None:
        """Undo the last change; InputError if there is none."""
        self._move("done", "undone", undo=True)

    def redo(self) -> None:
        """Make the change again that was undone last; InputError if there is none."""
        self._move("undone", "done", undo=False)

    @property
    def steps(self) -> tuple[int, int]:
        """Return how many changes can be undone and made again."""
        history = self._read()
        return len(history["done"]), len(history["undone"])

    def _move(self, source: str, target: str, *, undo: bool) -> None:
        before, history = self._read(), self._read()
        while history[source]:
            data = history[source].pop()
            edit = Edit(path=Path(data["path"]), before=data["before"], after=data["after"])
            now = read_text(edit.path)
            if undo and now == edit.before:
                continue  # remembered, but the process died before it was made
            history[target].append(data)
            if undo:
                replace(edit, after=now if now == data.get("shortly") else edit.after).revert()
                self._write(history)
            else:
                self._apply(edit, before, history)
            return
        self._write(history)
        raise InputError(f"There is nothing to {'undo' if undo else 'redo'}.")

    def _apply(self, edit: Edit, before: Steps, after: Steps) -> None:
        """Remember an edit, then make it: whenever the process dies, the file can be undone."""
        self._write(after)
        try:
            edit.apply()
        except RvsgError:
            self._write(before)
            raise

    def _read(self) -> dict[str, list[dict[str, str]]]:
        history: dict[str, list[dict[str, str]]] = read_json(self.path, {"done": [], "undone": []})
        return history

    def _write(self, history: Steps) -> None:
        write_whole(self.path, json.dumps(history))


@cache
def _shipped_kinds() -> frozenset[str]:
    """Return the kinds of areas in the worlds that ship with RVSG."""
    labels = (SHIPPED / name / "labels.yaml" for name in shipped_worlds())
    return frozenset(str(area["kind"]) for path in labels if path.is_file() for area in read_yaml(path).value["areas"])


def _route(world: World, route: Route) -> dict[str, Any]:
    line = line_of(world, route)
    steps = np.diff(line, axis=0)
    middle = (line[:-1] + line[1:]) / 2
    widths = [
        free_width_m(world, float(x), float(y), math.atan2(dy, dx))
        for (x, y), (dx, dy) in zip(middle, steps, strict=True)
        if math.hypot(dx, dy) > 0.01
    ]
    return {
        "name": route.name,
        "purpose": route.purpose,
        "time_limit_s": route.time_limit_s,
        "line": [[round(float(x), 3), round(float(y), 3)] for x, y in line],
        "start": [route.start.x, route.start.y, route.start.yaw],
        "goal": [route.goal.x, route.goal.y, route.goal.yaw],
        "length_m": round(length_m(line), 1),
        "narrowest_m": round(min(widths), 2) if widths else None,
    }


def _edges(world: World) -> list[list[float]]:
    """Return edges of walls and things that lie along the axes, [x0, y0, x1, y1] in metres, for areas to snap to."""
    edges = []
    for thing in world.objects:
        for ring in (thing.footprint, *thing.holes):
            for (x0, y0), (x1, y1) in zip(ring, (*ring[1:], ring[0]), strict=True):
                if abs(x0 - x1) < 0.02 or abs(y0 - y1) < 0.02:
                    edges.append([round(v, 2) for v in (x0, y0, x1, y1)])
    if not world.objects:
        occupancy = world_map(world)
        frame = frame_of(occupancy)
        for left, bottom, right, top in rectangles(occupancy.cells == OCCUPIED):
            (x0, y0), (x1, y1) = frame.to_metres(np.array([[left, bottom], [right, top]], float))
            box = [round(float(v), 2) for v in (x0, y0, x1, y1)]
            edges += [[box[0], box[1], box[2], box[1]], [box[0], box[3], box[2], box[3]]]
            edges += [[box[0], box[1], box[0], box[3]], [box[2], box[1], box[2], box[3]]]
    longest = sorted(edges, key=lambda e: -abs(e[2] - e[0]) - abs(e[3] - e[1]))
    return longest[:MOST_EDGES]
