"""Time from the file of a large map to labels, grid and pictures: `python benchmarks/world_import.py`.

With `--mesh-mb 30` it imports a building of one STL mesh of that size instead: rooms with doors on both sides of
corridors. The aim is under 60 s and 2 GB.

Makes a map of a hall (default 2000 x 2000 cells of 0.05 m: 100 x 100 m) with shelves, columns, inner walls and a
noisy border, imports it, and prints the seconds of every step as JSON. The aim is under 5 s for all of them.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image


def hall(side: int, seed: int = 1) -> np.ndarray:
    """Grey pixels (side, side) of a hall seen by a mapping robot: unknown outside, speckled walls, shelves, columns."""
    rng = np.random.default_rng(seed)
    pixels = np.full((side, side), 205, np.uint8)
    pixels[20:-20, 20:-20] = 254
    pixels[20:24, 20:-20] = pixels[-24:-20, 20:-20] = pixels[20:-20, 20:24] = pixels[20:-20, -24:-20] = 0
    for row in range(120, side - 200, 110):
        for column in range(100, side - 300, 260):
            if rng.random() < 0.8:
                pixels[row : row + 22, column : column + 200] = 205
                pixels[row : row + 2, column : column + 200] = 0
                pixels[row + 20 : row + 22, column : column + 200] = 0
                pixels[row : row + 22, column : column + 2] = 0
                pixels[row : row + 22, column + 198 : column + 200] = 0
    pixels[side // 2 : side // 2 + 3, 24 : side // 3] = 0
    speckle = rng.integers(24, side - 24, (400, 2))
    pixels[speckle[:, 0], speckle[:, 1]] = 0
    return pixels


def measure(side: int) -> dict[str, object]:
    """Seconds of import (with labels, grid and routes), saving and pictures."""
    from rvsg.world.creation import world_from
    from rvsg.world.drawing import grid_picture, labelled_map, png_bytes
    from rvsg.world.drawing.birdseye import birdseye
    from rvsg.world.schema import save_world

    seconds: dict[str, float] = {}
    busy = time.process_time()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        Image.fromarray(hall(side)).save(folder / "map.pgm")
        (folder / "map.yaml").write_text(
            "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
            "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
        )
        begin = time.perf_counter()
        world = world_from("map", folder / "map.yaml", name="hall").world
        seconds["import, labels, grid, routes"] = time.perf_counter() - begin
        for step, make in (
            ("save", lambda: save_world(world, folder / "world")),
            ("labelled map", lambda: png_bytes(labelled_map(world))),
            ("grid picture", lambda: png_bytes(grid_picture(world))),
            ("bird's-eye picture", lambda: png_bytes(birdseye(world))),
        ):
            start = time.perf_counter()
            make()
            seconds[step] = time.perf_counter() - start
    return {
        "cells": [side, side],
        "waypoints": len(world.grid.valid),
        "areas": len(world.areas),
        "routes": len(world.routes),
        "seconds": {step: round(value, 3) for step, value in seconds.items()},
        "processor_s": round(time.process_time() - busy, 3),
        "total_s": round(sum(seconds.values()), 3),
        "machine": f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}",
    }


def building(megabytes: float) -> np.ndarray:
    """The triangles (n, 3, 3) of 48 rooms of 6 x 5 m along four corridors; every wall a closed box of small faces."""
    boxes = [((0.0, 48.4), (y, y + 0.2)) for y in (0.0, 50.0)] + [((x, x + 0.2), (0.0, 50.2)) for x in (0.0, 48.2)]
    for wing in range(4):
        for row in (12.5 * wing + 5.0, 12.5 * wing + 7.4):  # the walls along a corridor, a door of 1 m in each room
            for room in range(6):
                boxes += [
                    ((8.0 * room, 8.0 * room + 3.5), (row, row + 0.2)),
                    ((8.0 * room + 4.5, 8.0 * room + 8.0), (row, row + 0.2)),
                ]
        for x in (8.0 * n for n in range(1, 6)):
            boxes += [
                ((x, x + 0.2), (12.5 * wing, 12.5 * wing + 5.0)),
                ((x, x + 0.2), (12.5 * wing + 7.4, 12.5 * wing + 11.5)),
            ]
    faces = 2.6 * sum(2 * ((x1 - x0) + (y1 - y0)) for (x0, x1), (y0, y1) in boxes)
    step = (2.0 * faces / (megabytes * 1e6 / 50)) ** 0.5
    return np.concatenate([_box(x, y, (0.0, 2.6), step) for x, y in boxes])


def _box(*spans_and_step: tuple[float, float] | float) -> np.ndarray:
    """A closed box whose sides are divided into squares of about `step` metres, seen from outside counter-clockwise."""
    *spans, step = spans_and_step
    ticks = [np.linspace(low, high, max(2, round((high - low) / step) + 1)) for low, high in spans]
    sides = []
    for axis, (u, v) in enumerate(((1, 2), (2, 0), (0, 1))):
        a, b = np.meshgrid(ticks[u], ticks[v], indexing="ij")
        for end in (0, -1):
            grid = np.zeros((*a.shape, 3))
            grid[..., u], grid[..., v], grid[..., axis] = a, b, ticks[axis][end]
            p, q, r, s = (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:])
            pairs = ((p, q, r), (p, r, s)) if end else ((p, r, q), (p, s, r))
            sides += [np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in pairs]
    return np.concatenate(sides)


def measure_mesh(megabytes: float) -> dict[str, object]:
    """Seconds and memory of the import of a building of one mesh."""
    import resource

    from rvsg.world.creation import world_from

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        triangles = building(megabytes)
        records = np.zeros((len(triangles), 50), np.uint8)
        records[:, 12:48] = triangles.astype("<f4").reshape(-1, 9).view(np.uint8).reshape(-1, 36)
        (folder / "building.stl").write_bytes(bytes(80) + np.uint32(len(triangles)).tobytes() + records.tobytes())
        (folder / "building.sdf").write_text(
            '<sdf version="1.7"><model name="building"><link name="l"><collision name="c"><geometry><mesh>'
            "<uri>building.stl</uri></mesh></geometry></collision></link></model></sdf>"
        )
        size = (folder / "building.stl").stat().st_size
        del triangles, records
        busy, begin = time.process_time(), time.perf_counter()
        world = world_from("sdf", folder / "building.sdf", name="building").world
        return {
            "megabytes": round(size / 1e6, 1),
            "areas": len(world.areas),
            "routes": len(world.routes),
            "processor_s": round(time.process_time() - busy, 1),
            "total_s": round(time.perf_counter() - begin, 1),
            "peak_gb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6, 2),
            "load_average": round(os.getloadavg()[0], 1),
            "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=2000, help="cells along a side")
    parser.add_argument("--mesh-mb", type=float, help="instead, a building of one mesh of so many megabytes")
    options = parser.parse_args()
    found = measure(options.side) if options.mesh_mb is None else measure_mesh(options.mesh_mb)
    json.dump(found, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()
