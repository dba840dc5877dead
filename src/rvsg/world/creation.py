"""New world folders from a Nav2 map, a Gazebo world or a file of objects: grid, proposed labels and routes, README."""

from __future__ import annotations

import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jinja2 import Template
from numpy.typing import NDArray
from pydantic import ValidationError

from rvsg.core import plugins
from rvsg.core.documents import keys_of, read_document
from rvsg.core.errors import FileError, InputError, InvalidOptions
from rvsg.core.files import write_whole
from rvsg.robots.robot import DEFAULT_ROBOT, Robot, load_robot
from rvsg.world.areas import propose_areas
from rvsg.world.checks import Remark, check_world
from rvsg.world.grid import GridSpec
from rvsg.world.lattice import LIDAR_HEIGHT_M, build_grid, build_world, fitting_spacing
from rvsg.world.occupancy import load_nav2_map, occupancy_from_objects, upright
from rvsg.world.rooms import main_part, within
from rvsg.world.routes import Trial, clearance_m, propose_routes, route_notes
from rvsg.world.schema import COARSEST_M, FARTHEST_M, FINEST_M, HIGHEST_LIDAR_M, ObjectsFile, one_line, save_world
from rvsg.world.space import Bools, Frame, Space, covered_cells, frame_of, human_space_of, main_floor
from rvsg.world.world import Door, OccupancyMap, Point, SolidObject, World

OPEN_M = 2.0
RESOLUTIONS_M = (0.05, 0.1, 0.2)
EASY_CELLS = 8_000_000  # a larger map takes minutes and gigabytes
MOST_LINES = 40  # more rows or columns are hard to read on one picture
MOST_LINES_OF_CORRIDORS = 260  # long corridors have few waypoints on many lines
MOST_WAYPOINTS, MOST_CROSSINGS = 1500, 39_000
FINER = (1.0, 0.75, 0.5, 0.35, 0.25, 0.18, 0.12)
CONNECTED, HALF = 0.97, 0.5
ROBOT_CLEARANCE_M = 0.3
Progress = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class WorldSource:
    """What a file says of a building: a map, or solid objects from which one is drawn."""

    objects: tuple[SolidObject, ...] = ()
    occupancy: OccupancyMap | None = None
    doors: tuple[Door, ...] = ()
    overhead: NDArray[np.float64] | None = None
    """The faces over people's heads, seen from above (n, 3, 2); None where there are none."""
    notes: tuple[str, ...] = ()


class WorldReader(Protocol):
    """A reader of a file format, registered under `rvsg.worlds` by the name of the format."""

    def __call__(self, path: Path, *, lidar_height_m: float, progress: Progress | None, **options: Any) -> WorldSource:
        """Read a file with the lidar plane this high above the floor; raise FileError for one that cannot be used."""


@dataclass(frozen=True, kw_only=True)
class Created:
    """A new world, where it came from, and what its maker should know."""

    world: World
    source: str
    notes: tuple[str, ...]


_GOES_WITH: dict[str, tuple[str, ...]] = {"free_thresh": ("map",)}
_GOES_WITH |= dict.fromkeys(("model_path", "without", "box_for_unreadable", "lenient", "floor"), ("sdf",))
_GOES_WITH |= dict.fromkeys(("resolution", "lidar_height", "indoors", "outdoors"), ("sdf", "objects"))
"""The sources for which an option means something."""
_PARAMETERS = {
    "model_path": "model_paths",
    "floor": "floor_m",
    "resolution": "resolution_m",
    "lidar_height": "lidar_height_m",
}
"""The parameters of `world_from` and of the readers whose names differ from those of the options."""


def create_world(
    folder: Path,
    *,
    map_file: Path | None = None,
    sdf: Path | None = None,
    objects: Path | None = None,
    title: str = "",
    spacing: float | None = None,
    human_clearance: float = 0.3,
    robot_clearance: float | None = None,
    force: bool = False,
    robot: Robot | None = None,
    trial: Trial | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> tuple[Created, tuple[Remark, ...]]:
    """Create a world folder from a map, a Gazebo world or a file of objects.

    Lengths are in metres. Labels and routes are proposals; the README in the folder says how to edit them.

    Args:
        folder: Where to write the world; its name becomes the world's.
        map_file: A Nav2 map; or give `sdf` or `objects` instead.
        force: Overwrite a world that is in the folder.
        robot: The robot that routes are proposed for; None: the default robot.
        trial: Drives every proposed route; routes that the robot cannot drive alone are not proposed.
        options: Options that mean something for some sources only, lengths in metres: `resolution`, `lidar_height`,
            `indoors` and `outdoors` (points on floor that is inside the building, or outside, whatever it looks like)
            of SDF and objects; `model_path`, `without`, `box_for_unreadable`, `lenient`, `floor` of SDF;
            `free_thresh` of a map. None or empty where it is not given.

    Returns:
        The world with notes on how it was made, and what `check_world` says of it.

    Raises:
        InputError: not exactly one source, or an option that means nothing for it.
        FileError: a source that cannot be read, or a folder that is occupied.
    """
    sources = {name: path for name, path in (("map", map_file), ("sdf", sdf), ("objects", objects)) if path is not None}
    if len(sources) != 1:
        named = " and ".join(f"--{name}" for name in sources) or "none"
        raise InputError(f"give exactly one of --map, --sdf and --objects; got {named}", code="world-source")
    ((source, path),) = sources.items()
    usual = {"lidar_height": LIDAR_HEIGHT_M, "floor": 0.0}
    wanted = {key: value for key, value in options.items() if value is not None and value not in ([], ())}
    useless = [
        f"--{name.replace('_', '-')} goes with {' or '.join(f'--{s}' for s in _GOES_WITH[name])}"
        for name, value in wanted.items()
        if value is not False and value != usual.get(name) and source not in _GOES_WITH[name]
    ]
    if useless:
        raise InputError(f"{'; '.join(useless)}; got --{source}", code="option-unused")
    _refuse_occupied(folder, force=force)
    if robot_clearance is None:
        robot_clearance = ROBOT_CLEARANCE_M if robot is None else clearance_m(robot)
    try:
        spec = GridSpec(spacing_m=spacing, human_clearance_m=human_clearance, robot_clearance_m=robot_clearance)
    except ValidationError as error:
        listed = "; ".join(f"{d['loc'][0]}: {d['msg'].lower()}, got {d['input']}" for d in error.errors())
        raise InvalidOptions(f"these values make no grid: {listed}", keys_of(error)) from None
    created = world_from(
        source,
        path,
        name=folder.resolve().name,
        title=title,
        grid_spec=spec,
        progress=progress,
        trial=trial,
        robot=robot,
        **{_PARAMETERS.get(key, key): value for key, value in wanted.items() if source in _GOES_WITH[key]},
    )
    return created, save_created(created, folder, trial=trial, robot=robot)


def save_created(
    created: Created, folder: Path, *, trial: Trial | None = None, robot: Robot | None = None
) -> tuple[Remark, ...]:
    """Write a new world into a folder, with a README; return what `check_world` says of it."""
    new = not folder.exists()
    save_world(created.world, folder)
    remarks = check_world(folder, trial=trial, robot=robot)
    said = [f"{'error' if r.serious else 'warning'}: {r.problem.message}" for r in remarks]
    try:
        write_whole(folder / "README.md", readme(created, said))
        for path in (folder / "labels.yaml", folder / "routes.yaml"):
            write_whole(path, PROPOSAL + path.read_text(encoding="utf-8"))
    except FileError:
        if new:
            shutil.rmtree(folder)
        raise
    return remarks


def copy_world(world: World, folder: Path, *, force: bool = False) -> None:
    """Write a world into a folder of its own, with the map that the robot localises in (`map.yaml` with `map.png`)."""
    _refuse_occupied(folder, force=force)
    save_world(world, folder)


def other_robot(name: str | Path | None) -> Robot | None:
    """Return a shipped robot or the robot of a file; None for the default one, for which the worlds are written."""
    return None if name is None or str(name) == DEFAULT_ROBOT else load_robot(name)


def _refuse_occupied(folder: Path, *, force: bool) -> None:
    """Refuse a folder that holds something, unless it may be overwritten."""
    if folder.exists() and not folder.is_dir():
        raise FileError(folder, "this is a file; expected the name of a folder to make")
    if (folder / "world.yaml").exists() and not force:
        raise FileError(
            folder, "the folder already holds a world; --force replaces it, with all your edits", code="world-exists"
        )
    if folder.is_dir() and any(folder.iterdir()) and not (folder / "world.yaml").exists() and not force:
        raise FileError(
            folder, "the folder is not empty; choose a new one, or --force to write into it", code="folder-not-empty"
        )


def world_from(
    kind: str,
    path: str | Path,
    *,
    name: str,
    title: str = "",
    grid_spec: GridSpec | None = None,
    lidar_height_m: float = LIDAR_HEIGHT_M,
    resolution_m: float | None = None,
    indoors: Sequence[Point] = (),
    outdoors: Sequence[Point] = (),
    progress: Progress | None = None,
    trial: Trial | None = None,
    robot: Robot | None = None,
    **options: Any,
) -> Created:
    """Return a world made of a file: its map, or the one a lidar would draw of its objects; labels and routes.

    Args:
        kind: The name of the format: `map` (Nav2), `objects` (objects.yaml), `sdf` (Gazebo or URDF), or a plug-in's.
        indoors, outdoors: Points on floor that is inside the building, or outside, whatever it looks like.
        options: Options of the reader of that format.

    Raises:
        FileError: The file cannot be used; DocumentError with all that is wrong in SDF files.
        InputError: A size out of range, or the format needs a package that is not installed.
    """
    _refuse_absurd_sizes(resolution_m, lidar_height_m, options.get("floor_m", 0.0))
    read: WorldReader = plugins.find_format("world", kind)
    source = read(Path(path), lidar_height_m=lidar_height_m, progress=progress, **options)
    if progress and source.objects:
        progress(f"Drawing the map, the grid and proposals for labels and routes from {len(source.objects)} objects")
    notes = list(source.notes)
    try:
        occupancy = source.occupancy
        if occupancy is None:
            occupancy = mapped(source, resolution_m, notes, indoors, outdoors)
        spec = fitting_spec(grid_spec or GridSpec(), human_space_of(source.objects, occupancy))
        world = build_world(
            name=name,
            title=title or name.replace("_", " ").replace("-", " ").capitalize(),
            objects=source.objects,
            occupancy=occupancy,
            areas=propose_areas(source.objects, occupancy),
            grid_spec=spec,
            lidar_height_m=lidar_height_m,
            doors=source.doors,
        )
        world = _with_proposals(world, Path(path).stem, notes, trial, robot)
    except FileError:
        raise
    except InputError as error:
        why = str(error)
        if error.code in ("grid-no-room", "map-no-floor") and source.objects:
            largest = max(source.objects, key=lambda thing: thing.box.size[0] * thing.box.size[1])
            wide, high = largest.box.size[:2]
            why = (
                f'nobody fits between the objects. The largest is "{largest.name}" ({wide:.1f} x {high:.1f} m): if it '
                "is ground or terrain, leave it out with --without, or give the height of the --floor. Else give a "
                "smaller --human-clearance"
            )
        raise FileError(path, why, code=error.code) from None
    return Created(world=world, source=str(path), notes=tuple(notes))


def read_nav2_source(
    path: Path, *, lidar_height_m: float, progress: Progress | None, free_thresh: float | None = None
) -> WorldSource:
    """Return the map of a Nav2 map file; one with a turned origin is laid along the axes of its frame."""
    read, notes = load_nav2_map(path, free_thresh=free_thresh)
    yaw = read.origin.yaw
    if yaw:
        turned = f"the map was turned by its origin's yaw of {yaw:g} rad onto the axes of the map frame"
        notes += (f"{turned}; positions are the same.",)
    return WorldSource(occupancy=upright(read), notes=notes)


def read_objects_source(path: Path, *, lidar_height_m: float, progress: Progress | None) -> WorldSource:
    """Return the objects of our own file (oriented boxes and polygons)."""
    file, _ = read_document(path, ObjectsFile)
    return WorldSource(objects=tuple(entry.solid(lidar_height_m) for entry in file.objects))


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
    source: WorldSource,
    resolution_m: float | None,
    notes: list[str],
    indoors: Sequence[Point] = (),
    outdoors: Sequence[Point] = (),
) -> OccupancyMap:
    """Return the map a lidar would draw; where no wall encloses the floor, with OPEN_M of floor around the objects.

    Without a resolution it is the finest of RESOLUTIONS_M that gives a map of at most EASY_CELLS cells.
    """
    if resolution_m is None:
        wide, high = np.ptp(np.concatenate([np.asarray(thing.footprint, float) for thing in source.objects]), axis=0)
        fits = (size for size in RESOLUTIONS_M if wide * high / size**2 <= EASY_CELLS)
        resolution_m = next(fits, RESOLUTIONS_M[-1])
        if resolution_m > RESOLUTIONS_M[0]:
            notes.append(
                f"the building is large, so the map has {resolution_m:g} m per cell instead of {RESOLUTIONS_M[0]:g} m; "
                "--resolution sets another."
            )

    def ceilings(frame: Frame) -> Bools | None:
        return None if source.overhead is None else covered_cells(source.overhead, frame)

    occupancy = occupancy_from_objects(
        source.objects,
        resolution_m=resolution_m,
        seeds=indoors,
        main=lambda parts, sizes, frame: main_part(parts, sizes, frame, ceilings(frame)),
    )
    bounded = within(occupancy, source.objects, ceilings(frame_of(occupancy)), indoors, outdoors, notes)
    if bounded is not None:
        return bounded
    notes.append(f"no wall encloses the floor: {OPEN_M:g} m of it around the objects are taken as free.")
    return occupancy_from_objects(source.objects, resolution_m=resolution_m, margin_m=OPEN_M)


def _with_proposals(world: World, stem: str, notes: list[str], trial: Trial | None, robot: Robot | None) -> World:
    """Return the world with the areas that people can reach, its usual actors and proposed routes; add to the notes."""
    main = world.grid.parts[0]
    reached = [area for area in world.areas if main & set(area.waypoints)]
    if len(reached) < len(world.areas):
        left = len(world.areas) - len(reached)
        notes.append(f"people cannot walk to {left} places found: not labelled. A finer grid may reach them.")
        count: Counter[str] = Counter()
        for index, area in enumerate(reached):  # the numbers at the ends of the names are closed up
            word, _, number = area.name.rpartition(" ")
            if word and number.isdigit():
                count[word] += 1
                reached[index] = area.model_copy(update={"name": f"{word} {count[word]}"})
    texts = (world.name, world.title, stem, " ".join(f"{area.name} {area.kind}" for area in reached))
    world = replace(world, areas=tuple(reached), actors=usual_actors(texts))
    if world.grid.spacing_m > 1.0:  # wider than the metre that suits people's paths
        notes.append(f"the map is large, so the grid is {world.grid.spacing_m:g} m wide; --spacing makes it finer.")
    world = replace(world, routes=propose_routes(world, trial=trial, robot=robot, notes=notes))
    notes += route_notes(world, trial)
    if not world.routes:
        notes.append(
            "no route is proposed: on the ways between areas the robot does not fit, or it does "
            "not arrive when it drives alone. Write some into routes.yaml; `rvsg world check` drives them."
        )
    return world


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


def fitting_spec(spec: GridSpec, space: Space) -> GridSpec:
    """Return an even grid whose lines run through narrow places, and nearer together where parts would be cut off.

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
    best = (-1.0, spec)
    for spacing in finer:
        lines = max(high, wide) / spacing
        many = lines > MOST_LINES  # which only corridors are worth that hang together in no coarser grid
        too_many = many and (best[0] >= HALF or lines > MOST_LINES_OF_CORRIDORS)
        if best[0] >= 0 and (too_many or (high / spacing + 1) * (wide / spacing + 1) > MOST_CROSSINGS):
            break
        origin = _best_origin(space, floor, spacing) if spec.origin is None else spec.origin
        tried = spec.model_copy(update={"spacing_m": spacing, "origin": origin})
        grid = build_grid(tried, space, space)
        if best[0] >= 0 and many and len(grid.valid) > MOST_WAYPOINTS:
            break
        share = len(grid.parts[0]) / len(grid.neighbours)
        if share > best[0] + 0.02:
            best = (share, tried)
        if share >= CONNECTED:
            break
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


PROPOSAL = (
    "# PROPOSED automatically: names, kinds and places are a first guess. Rename, move, delete, add; then run\n"
    "# `rvsg world check` on this folder.\n"
)


def readme(created: Created, remarks: Sequence[str] = ()) -> str:
    """Return the text of the README."""
    text = (Path(__file__).parent / "readme.md.j2").read_text(encoding="utf-8")
    world = created.world
    rows, columns = world.occupancy.cells.shape
    said: str = Template(text, trim_blocks=True, keep_trailing_newline=True).render(
        world=world,
        title=one_line(world.title),
        source=Path(created.source).name,
        rows=rows,
        columns=columns,
        resolution=world.occupancy.resolution,
        notes=created.notes,
        remarks=remarks,
    )
    return said
