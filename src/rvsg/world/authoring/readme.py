"""The README of a world folder: what the files are, what was proposed and is to be edited, what to do next."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rvsg.core.errors import FileError
from rvsg.world.authoring.create import Created
from rvsg.world.io.save import one_line
from rvsg.world.space import frame_of

PROPOSAL = (
    "# PROPOSED automatically: names, kinds and places are a first guess. Rename, move, delete, add; then run\n"
    "# `rvsg world check` on this folder.\n"
)


def write_readme(created: Created, folder: Path, remarks: Sequence[str] = ()) -> None:
    """Write README.md into the world folder and mark labels and routes as proposals; FileError where it cannot."""
    try:
        (folder / "README.md").write_text(readme(created, remarks), encoding="utf-8")
        for name in ("labels.yaml", "routes.yaml"):
            path = folder / name
            path.write_text(PROPOSAL + path.read_text(encoding="utf-8"), encoding="utf-8")
    except OSError as error:
        raise FileError(folder, f"the README cannot be written here: {error.strerror}") from None


def readme(created: Created, remarks: Sequence[str] = ()) -> str:
    """Return the text of the README."""
    world = created.world
    rows, columns = world.occupancy.cells.shape
    high, wide = rows * world.occupancy.resolution, columns * world.occupancy.resolution
    grid = world.grid
    lines = [
        f"# {one_line(world.title)}",
        "",
        f"A world for RVSG, made from `{Path(created.source).name}`. Metres and radians in the world frame, which is "
        "the map frame of the robot.",
        "",
        "| file | what it holds | edit it to |",
        "|---|---|---|",
        "| `world.yaml` | name, map, grid, activities | move or refine the grid; say who does what between areas |",
        f"| `map.yaml`, `map.png` | the occupancy map the robot localises in: {columns} x {rows} cells of "
        f"{world.occupancy.resolution:g} m ({wide:.1f} x {high:.1f} m) | replace the map |",
    ]
    if world.objects:
        lines.append(
            f"| `objects.yaml` | {len(world.objects)} solid objects with heights and what the lidar plane at "
            f"{world.lidar_height_m:g} m cuts | add or move furniture |"
        )
    lines += [
        f"| `labels.yaml` | {len(world.areas)} named areas and the waypoints they are worked from | **rename them**: "
        "the names were guessed |",
        f"| `routes.yaml` | {len(world.routes)} routes of the robot | set starts, goals and time limits |",
        "",
        f"The grid has {len(grid.valid)} waypoints on which people can stand, {grid.spacing_m:g} m apart: rows "
        f"{grid.rows[0]} to {grid.rows[-1]}, columns 1 to {len(grid.columns)}. The map's corner lies at "
        f"({frame_of(world.occupancy).origin.x:g}, {frame_of(world.occupancy).origin.y:g}).",
        "",
        "## Next",
        "",
        "1. `rvsg world draw .` writes the pictures a VLM sees; look at them beside `labels.yaml`.",
        "2. Edit `labels.yaml` (names and kinds), `routes.yaml`, and `activities` in `world.yaml`, such as",
        '   `- "A clerk carries returns from Area 1 to Shelf 3."`',
        "3. `rvsg world check .` tells everything that is wrong or suspicious, with file and line.",
        "4. `rvsg run --world . --route route_1` searches for scenarios.",
    ]
    if created.notes:
        lines += ["", "## What happened on import", "", *(f"- {note[:1].upper()}{note[1:]}" for note in created.notes)]
    if remarks:
        lines += ["", "## What the check said then", "", *(f"- {remark}" for remark in remarks)]
    return "\n".join(lines) + "\n"
