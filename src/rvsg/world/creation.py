"""From a robot's map or a Gazebo world to a world of its own: grid, first labels and routes, all to be edited."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rvsg.core.documents import read_document
from rvsg.core.errors import FileError, InputError
from rvsg.robots.robot import Robot
from rvsg.world.areas import propose_areas
from rvsg.world.grid import Grid, GridSpec
from rvsg.world.lattice import build_grid, build_world, fitting_spacing
from rvsg.world.occupancy import load_nav2_map, occupancy_from_objects, upright
from rvsg.world.rooms import Choices, main_part, within
from rvsg.world.routes import Trial, propose_routes, route_notes
from rvsg.world.schema import COARSEST_M, FARTHEST_M, FINEST_M, HIGHEST_LIDAR_M, ObjectsFile, one_line
from rvsg.world.space import Bools, Frame, Space, covered_cells, frame_of, human_space_of, main_floor
from rvsg.world.world import Area, Door, OccupancyMap, SolidObject, World
from rvsg_exchange.sdf import Progress, load_sdf

KINDS: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = (
    (("hospital", "clinic", "ward", "patient", "nurse", "care"), ("trolley", "wheelchair", "moved_object")),
    (("shop", "supermarket", "retail", "bookstore", "mall", "market"), ("trolley", "child", "moved_object")),
    (("airport", "station", "museum", "terminal", "library"), ("trolley", "child", "wheelchair")),
    (("school", "kindergarten", "home", "house", "apartment", "residential"), ("child",)),
    (("warehouse", "factory", "workshop", "shelf", "pallet", "rack"), ("trolley", "moved_object")),
    (("office", "meeting", "laboratory", "lab"), ("trolley", "moved_object")),
)
"""Words of a place, and who takes part there. The first kind that is named counts."""


def usual_actors(texts: Iterable[str]) -> tuple[str, ...]:
    """Return what generators may use in a place, told by its name, its title and its labels; nothing if none fits."""
    for text in texts:
        words = set(re.findall(r"[a-z]+", text.lower()))
        for named, actors in KINDS:
            if words & {form for word in named for form in (word, f"{word}s")}:
                return actors
    return ()


OPEN_M = 2.0
RESOLUTIONS_M = (0.05, 0.1, 0.2)
EASY_CELLS = 8_000_000  # a larger map takes minutes and gigabytes
MOST_LINES = 40  # more rows or columns are hard to read on one picture
MOST_LINES_OF_CORRIDORS = 260  # long corridors have few waypoints on many lines
MOST_WAYPOINTS, MOST_CROSSINGS = 1500, 39_000
FINER = (1.0, 0.75, 0.5, 0.35, 0.25, 0.18, 0.12)
CONNECTED, HALF = 0.97, 0.5
NO_CHOICES = Choices()


@dataclass(frozen=True, kw_only=True)
class Created:
    """A new world, where it came from, and what its maker should know."""

    world: World
    source: str
    notes: tuple[str, ...]


def world_from_map(
    path: str | Path,
    *,
    name: str,
    title: str = "",
    grid_spec: GridSpec | None = None,
    free_thresh: float | None = None,
    trial: Trial | None = None,
    robot: Robot | None = None,
) -> Created:
    """Return a world from a Nav2 map: labels from free-standing obstacles and open floor, routes between them.

    A map with a turned origin is laid along the axes of its frame. Raises FileError for a map that cannot be used.
    """
    read = load_nav2_map(path, free_thresh=free_thresh)
    occupancy = upright(read.occupancy)
    notes = list(read.notes)
    if occupancy is not read.occupancy and read.occupancy.origin.yaw:
        notes.append(
            f"the map was turned by its origin's yaw of {read.occupancy.origin.yaw:g} rad onto the axes of the map "
            "frame; positions are the same."
        )
    try:
        return _created(name, title, (), occupancy, grid_spec, str(path), notes, trial=trial, robot=robot)
    except FileError:
        raise
    except InputError as error:
        raise FileError(path, f"{error}", code=error.code) from None


def world_from_sdf(
    path: str | Path,
    *,
    name: str,
    title: str = "",
    grid_spec: GridSpec | None = None,
    model_paths: Sequence[Path] = (),
    lidar_height_m: float = 0.21,
    floor_m: float = 0.0,
    resolution_m: float | None = None,
    box_for_unreadable: bool = False,
    lenient: bool = False,
    without: Sequence[str] = (),
    choices: Choices = NO_CHOICES,
    progress: Progress | None = None,
    trial: Trial | None = None,
    robot: Robot | None = None,
) -> Created:
    """Make a world from a Gazebo world: its solid objects, the map a lidar would draw of them, labels and routes.

    The options are those of `load_sdf`; `choices` says what of the floor is inside. Raises DocumentError with all that
    is wrong in the SDF files, and InputError for a size out of range.
    """
    _refuse_absurd_sizes(resolution_m, lidar_height_m, floor_m)
    read = load_sdf(
        path,
        model_paths=model_paths,
        lidar_height_m=lidar_height_m,
        floor_m=floor_m,
        box_for_unreadable=box_for_unreadable,
        lenient=lenient,
        without=without,
        progress=progress,
    )
    if progress:
        progress(f"Drawing the map, the grid and proposals for labels and routes from {len(read.objects)} objects")
    try:
        notes = list(read.notes)
        occupancy = mapped(read.objects, resolution_m, notes, choices, read.overhead)
        return _created(
            name,
            title,
            read.objects,
            occupancy,
            grid_spec,
            str(path),
            notes,
            doors=read.doors,
            lidar_height_m=lidar_height_m,
            trial=trial,
            robot=robot,
        )
    except FileError:
        raise
    except InputError as error:
        raise FileError(path, _why_not(error, read.objects), code=error.code) from None


def world_from_objects(
    path: str | Path,
    *,
    name: str,
    title: str = "",
    grid_spec: GridSpec | None = None,
    lidar_height_m: float = 0.21,
    resolution_m: float | None = None,
    choices: Choices = NO_CHOICES,
    trial: Trial | None = None,
    robot: Robot | None = None,
) -> Created:
    """Return a world from our own file of objects (oriented boxes and polygons), mapped as a lidar would see them."""
    _refuse_absurd_sizes(resolution_m, lidar_height_m)
    file, _ = read_document(Path(path), ObjectsFile)
    objects = tuple(entry.solid(lidar_height_m) for entry in file.objects)
    try:
        notes: list[str] = []
        occupancy = mapped(objects, resolution_m, notes, choices)
        return _created(
            name,
            title,
            objects,
            occupancy,
            grid_spec,
            str(path),
            notes,
            lidar_height_m=lidar_height_m,
            trial=trial,
            robot=robot,
        )
    except FileError:
        raise
    except InputError as error:
        raise FileError(path, _why_not(error, objects), code=error.code) from None


def _why_not(error: InputError, objects: Sequence[SolidObject]) -> str:
    """Return why there is no world; where nobody fits, with the object that covers most of the floor."""
    if error.code not in ("grid-no-room", "map-no-floor"):
        return str(error)
    largest = max(objects, key=lambda thing: thing.box.size[0] * thing.box.size[1])
    wide, high = largest.box.size[:2]
    return (
        f'nobody fits between the objects. The largest is "{largest.name}" ({wide:.1f} x {high:.1f} m): if it is '
        "ground or terrain, leave it out with --without, or give the height of the --floor. Else give a smaller "
        "--human-clearance"
    )


def _refuse_absurd_sizes(resolution_m: float | None, lidar_height_m: float, floor_m: float = 0.0) -> None:
    """Raise InputError for sizes that world.yaml would not take back, and for NaN."""
    if resolution_m is not None and not FINEST_M <= resolution_m <= COARSEST_M:
        raise InputError(
            f"the resolution must be {FINEST_M:g} to {COARSEST_M:g} metres per cell, got {resolution_m:g}",
            code="resolution",
        )
    if not 0 < lidar_height_m <= HIGHEST_LIDAR_M:
        raise InputError(
            f"the lidar plane must be above the floor and at most {HIGHEST_LIDAR_M:g} m high, got {lidar_height_m:g} m",
            code="lidar-height",
        )
    if not abs(floor_m) <= FARTHEST_M:
        raise InputError(f"the height of the floor must be metres in the world, got {floor_m:g}")


def mapped(
    objects: Sequence[SolidObject],
    resolution_m: float | None,
    notes: list[str],
    choices: Choices,
    overhead: NDArray[np.float64] | None = None,
) -> OccupancyMap:
    """Return the map a lidar would draw; where no wall encloses the floor, with OPEN_M of floor around the objects.

    Without a resolution it is the finest of RESOLUTIONS_M that gives a map of at most EASY_CELLS cells.

    Args:
        overhead: Faces over people's heads, seen from above (n, 3, 2).
    """
    if resolution_m is None:
        resolution_m = _fitting_resolution(objects)
        if resolution_m > RESOLUTIONS_M[0]:
            notes.append(
                f"the building is large, so the map has {resolution_m:g} m per cell instead of {RESOLUTIONS_M[0]:g} m; "
                "--resolution sets another."
            )

    def ceilings(frame: Frame) -> Bools | None:
        return None if overhead is None else covered_cells(overhead, frame)

    occupancy = occupancy_from_objects(
        objects,
        resolution_m=resolution_m,
        seeds=choices.indoors,
        main=lambda parts, sizes, frame: main_part(parts, sizes, frame, ceilings(frame)),
    )
    bounded = within(occupancy, objects, ceilings(frame_of(occupancy)), choices, notes)
    if bounded is not None:
        return bounded
    notes.append(f"no wall encloses the floor: {OPEN_M:g} m of it around the objects are taken as free.")
    return occupancy_from_objects(objects, resolution_m=resolution_m, margin_m=OPEN_M)


def _fitting_resolution(objects: Sequence[SolidObject]) -> float:
    corners = np.concatenate([np.asarray(thing.footprint, float) for thing in objects])
    wide, high = np.ptp(corners, axis=0)
    fits = [size for size in RESOLUTIONS_M if wide * high / size**2 <= EASY_CELLS]
    return fits[0] if fits else RESOLUTIONS_M[-1]


def _created(
    name: str,
    title: str,
    objects: Sequence[SolidObject],
    occupancy: OccupancyMap,
    spec: GridSpec | None,
    source: str,
    notes: list[str],
    *,
    doors: Sequence[Door] = (),
    lidar_height_m: float = 0.21,
    trial: Trial | None = None,
    robot: Robot | None = None,
) -> Created:
    spec = fitting_spec(spec or GridSpec(), human_space_of(objects, occupancy))
    areas = propose_areas(objects, occupancy)
    world = build_world(
        name=name,
        title=title or name.replace("_", " ").replace("-", " ").capitalize(),
        objects=objects,
        occupancy=occupancy,
        areas=areas,
        grid_spec=spec,
        lidar_height_m=lidar_height_m,
        doors=doors,
    )
    main = largest_part(world.grid)
    reached = tuple(area for area in world.areas if main & set(area.waypoints))
    if len(reached) < len(world.areas):
        left = [area for area in world.areas if area not in reached]
        notes.append(f"people cannot walk to {len(left)} places found: not labelled. A finer grid may reach them.")
        reached = renumbered(reached)
    texts = (name, title, Path(source).stem, " ".join(f"{area.name} {area.kind}" for area in reached))
    world = replace(world, areas=reached, actors=usual_actors(texts))
    if world.actors:
        notes.append(f"generators may use {', '.join(world.actors)}, as usual here: see actors in world.yaml.")
    if grid_is_coarse(world.grid):
        notes.append(f"the map is large, so the grid is {world.grid.spacing_m:g} m wide; --spacing makes it finer.")
    world = replace(world, routes=propose_routes(world, trial=trial, robot=robot))
    notes += route_notes(world, trial)
    if not world.routes:
        notes.append(
            "no route is proposed: on the ways between areas the robot does not fit, or it does "
            "not arrive when it drives alone. Write some into routes.yaml; `rvsg world check` drives them."
        )
    return Created(world=world, source=source, notes=tuple(notes))


def fitting_spec(spec: GridSpec, space: Space) -> GridSpec:
    """An even grid that suits the floor: lines shifted so that they run through narrow places, and where parts of the
    floor would be cut off from each other, lines nearer together.

    What the specification says of spacing or origin is kept. Raises InputError where nobody fits anywhere.
    """
    if spec.rows is not None:
        return spec
    floor = main_floor(space, spec.human_clearance_m)
    if not floor.any():
        raise InputError(
            f"the map has no place that is {spec.human_clearance_m:g} m clear of obstacles: is it inverted (negate) "
            "or all unknown? Else give a smaller --human-clearance",
            code="grid-no-room",
        )
    rows, columns = np.flatnonzero(floor.any(axis=1)), np.flatnonzero(floor.any(axis=0))
    high, wide = np.ptp(rows) * space.frame.resolution, np.ptp(columns) * space.frame.resolution
    usual = spec.spacing_m or fitting_spacing(float(high), float(wide))
    finer = [usual] if spec.spacing_m else [share * usual for share in FINER]
    best: tuple[float, GridSpec] | None = None
    for spacing in finer:
        lines = max(high, wide) / spacing
        if best is not None and (high / spacing + 1) * (wide / spacing + 1) > MOST_CROSSINGS:
            break
        if best is not None and lines > MOST_LINES and (best[0] >= HALF or lines > MOST_LINES_OF_CORRIDORS):
            break
        tried = spec.model_copy(update={"spacing_m": spacing})
        if spec.origin is None:
            tried = tried.model_copy(update={"origin": _best_origin(space, floor, spacing)})
        grid = build_grid(tried, space, space)
        if best is not None and lines > MOST_LINES and len(grid.valid) > MOST_WAYPOINTS:
            break
        share = len(largest_part(grid)) / len(grid.neighbours)
        if best is None or share > best[0] + 0.02:
            best = (share, tried)
        if share >= CONNECTED:
            break
    assert best is not None
    return best[1]


def _best_origin(space: Space, floor: NDArray[np.bool_], spacing: float) -> tuple[float, float]:
    """Return the point through which grid lines meet most floor, narrow places counting most."""
    step = max(1, round(spacing / space.frame.resolution))
    weight = np.where(floor, 1.0 / np.maximum(space.field, 0.1) ** 2, 0.0)
    rows, columns = weight.shape
    padded = np.zeros((-(-rows // step) * step, -(-columns // step) * step))
    padded[:rows, :columns] = weight
    folded = padded.reshape(padded.shape[0] // step, step, padded.shape[1] // step, step).sum(axis=(0, 2))
    row, column = np.unravel_index(int(folded.argmax()), folded.shape)
    x, y = space.frame.to_metres(np.array([column + 0.5, row + 0.5]))
    return (round(float(x), 3), round(float(y), 3))


def largest_part(grid: Grid) -> set[str]:
    """Return the names of the largest group of waypoints between which people can walk."""
    left = dict.fromkeys(grid.neighbours)
    largest: set[str] = set()
    while left:
        stack = [next(iter(left))]
        part = set(stack)
        while stack:
            name = stack.pop()
            left.pop(name, None)
            fresh = [other for other in grid.neighbours[name] if other not in part]
            part.update(fresh)
            stack += fresh
        if len(part) > len(largest):
            largest = part
    return largest


def grid_is_coarse(grid: Grid) -> bool:
    """Return whether the grid is wider than the metre that suits people's paths."""
    return grid.spacing_m > 1.0


def renumbered(areas: Sequence[Area]) -> tuple[Area, ...]:
    """The areas with the numbers at the end of their names closed up: "Area 2", "Area 5" become "Area 1", "Area 2"."""
    count: dict[str, int] = {}
    named = []
    for area in areas:
        word, _, number = area.name.rpartition(" ")
        if word and number.isdigit():
            count[word] = count.get(word, 0) + 1
            area = area.model_copy(update={"name": f"{word} {count[word]}"})
        named.append(area)
    return tuple(named)


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
