"""How long a large map takes from its file to labels, grid and pictures: `python benchmarks/world_import.py`.

Makes a map of a hall (default 2000 x 2000 cells of 0.05 m: 100 x 100 m) with shelves, columns, inner walls and a
noisy border, imports it, and prints the seconds of every step as JSON. The aim is under 5 s for all of them.
"""

from __future__ import annotations

import argparse
import json
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
    from rvsg.world.authoring.create import world_from_map
    from rvsg.world.drawing import grid_picture, labelled_map, png_bytes
    from rvsg.world.drawing.birdseye import birdseye
    from rvsg.world.io.save import save_world

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
        world = world_from_map(folder / "map.yaml", name="hall").world
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


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=2000, help="cells along a side")
    json.dump(measure(parser.parse_args().side), sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()
