"""World folders: create, copy, draw and summarise them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack

from PIL.Image import Image
from pydantic import ValidationError

from rvsg.core.documents import keys_of
from rvsg.core.errors import FileError, InputError, InvalidOptions
from rvsg.core.outputs import make_folder
from rvsg.robots.robot import DEFAULT_ROBOT, Robot, load_robot
from rvsg.world.checks import Remark, check_world
from rvsg.world.creation import Created, world_from_map, world_from_objects, world_from_sdf, write_readme
from rvsg.world.drawing import png_bytes
from rvsg.world.drawing.birdseye import birdseye
from rvsg.world.drawing.floor_plan import GRID, LABELLED, draw_plan, tiles
from rvsg.world.drawing.svg import floor_plan_svg
from rvsg.world.grid import GridSpec
from rvsg.world.passages import route_paragraph
from rvsg.world.rooms import Choices
from rvsg.world.routes import Trial, clearance_m
from rvsg.world.schema import save_world
from rvsg.world.world import Route, World
from rvsg.world.world_folder import SHIPPED, shipped_worlds

Window = tuple[float, float, float, float]
LIDAR_HEIGHT_M = 0.21
ROBOT_CLEARANCE_M = 0.3


class SourceOptions(TypedDict, total=False):
    """Options that mean something for some sources only; lengths in metres."""

    free_thresh: float | None
    model_path: Sequence[Path] | None
    without: Sequence[str] | None
    box_for_unreadable: bool
    lenient: bool
    floor: float
    resolution: float | None
    lidar_height: float
    indoors: Sequence[tuple[float, float]] | None
    """Points on floor that is inside the building, whatever it looks like."""
    outdoors: Sequence[tuple[float, float]] | None


_GOES_WITH: dict[str, tuple[str, ...]] = dict.fromkeys(SourceOptions.__annotations__, ("sdf",))
_GOES_WITH |= {"free_thresh": ("map",)}
_GOES_WITH |= dict.fromkeys(("resolution", "lidar_height", "indoors", "outdoors"), ("sdf", "objects"))


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
    progress: Callable[[str], None] | None = None,
    **options: Unpack[SourceOptions],
) -> tuple[Created, tuple[Remark, ...]]:
    """Create a world folder from a map, a Gazebo world or a file of objects.

    Lengths are in metres. Labels and routes are proposals; the README in the folder says how to edit them.

    Args:
        folder: Where to write the world; its name becomes the world's.
        map_file: A Nav2 map; or give `sdf` or `objects` instead.
        force: Overwrite a world that is in the folder.
        robot: The robot that routes are proposed for; None: the default robot.
        trial: Drives every proposed route; routes that the robot cannot drive alone are not proposed.

    Returns:
        The world with notes on how it was made, and what `check_world` says of it.

    Raises:
        InputError: not exactly one source, or an option that means nothing for it.
        FileError: a source that cannot be read, or a folder that is occupied.
    """
    source, path = _only_source({"map": map_file, "sdf": sdf, "objects": objects})
    _refuse_unused(source, options)
    _refuse_occupied(folder, force=force)
    if robot_clearance is None:
        robot_clearance = ROBOT_CLEARANCE_M if robot is None else clearance_m(robot)
    spec = _grid_spec(spacing, human_clearance, robot_clearance)
    shared: dict[str, Any] = {"name": folder.resolve().name, "title": title, "grid_spec": spec}
    created = _created(source, path, shared | {"trial": trial, "robot": robot}, options, progress)
    save_world(created.world, folder)
    remarks = check_world(folder, trial=trial, robot=robot)
    write_readme(created, folder, [f"{'error' if r.serious else 'warning'}: {r.problem.message}" for r in remarks])
    return created, remarks


def copy_world(world: World, folder: Path, *, force: bool = False) -> None:
    """Write a world into a folder of its own, with the map that the robot localises in (`map.yaml` with `map.png`).

    Raises:
        FileError: the folder is occupied, or cannot be written.
        InputError: a world without the specification of its grid.
    """
    _refuse_occupied(folder, force=force)
    save_world(world, folder)


def _created(
    source: str,
    path: Path,
    shared: dict[str, Any],
    options: SourceOptions,
    progress: Callable[[str], None] | None,
) -> Created:
    if source == "map":
        return world_from_map(path, free_thresh=options.get("free_thresh"), **shared)
    shared |= {
        "lidar_height_m": options.get("lidar_height", LIDAR_HEIGHT_M),
        "resolution_m": options.get("resolution"),
        "choices": Choices(tuple(options.get("indoors") or ()), tuple(options.get("outdoors") or ())),
    }
    if source == "objects":
        return world_from_objects(path, **shared)
    return world_from_sdf(
        path,
        model_paths=options.get("model_path") or (),
        floor_m=options.get("floor", 0.0),
        box_for_unreadable=options.get("box_for_unreadable", False),
        lenient=options.get("lenient", False),
        without=options.get("without") or (),
        progress=progress,
        **shared,
    )


def other_robot(name: str | Path | None) -> Robot | None:
    """Return a shipped robot or the robot of a file; None for the default one, for which the worlds are written."""
    return None if name is None or str(name) == DEFAULT_ROBOT else load_robot(name)


def folder_named(name: Path) -> Path:
    """Return the folder of a world: the named one, or that of the shipped world of this name."""
    shipped = str(name) in shipped_worlds() and not (name / "world.yaml").is_file()
    return SHIPPED / str(name) if shipped else name


def _only_source(sources: dict[str, Path | None]) -> tuple[str, Path]:
    given = [(name, path) for name, path in sources.items() if path is not None]
    if len(given) != 1:
        options = " and ".join(f"--{name}" for name, _ in given) or "none"
        raise InputError(f"give exactly one of --map, --sdf and --objects; got {options}", code="world-source")
    return given[0]


def _refuse_unused(source: str, options: SourceOptions) -> None:
    """Refuse options that mean nothing for a source."""
    usual = {"lidar_height": LIDAR_HEIGHT_M, "floor": 0.0}
    useless = [
        f"--{name.replace('_', '-')} goes with {' or '.join(f'--{s}' for s in _GOES_WITH[name])}"
        for name, value in options.items()
        if value is not False and value not in (None, [], (), usual.get(name)) and source not in _GOES_WITH[name]
    ]
    if useless:
        raise InputError(f"{'; '.join(useless)}; got --{source}", code="option-unused")


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


def _grid_spec(spacing: float | None, human_clearance: float, robot_clearance: float) -> GridSpec:
    try:
        return GridSpec(spacing_m=spacing, human_clearance_m=human_clearance, robot_clearance_m=robot_clearance)
    except ValidationError as error:
        listed = "; ".join(f"{d['loc'][0]}: {d['msg'].lower()}, got {d['input']}" for d in error.errors())
        raise InvalidOptions(f"these values make no grid: {listed}", keys_of(error)) from None


def draw_world(
    world: World,
    folder: Path,
    *,
    what: Literal["all", "labels", "grid", "birdseye", "svg"] = "all",
    route: str | None = None,
    width: int = 1600,
    colours: str = "light",
    window: Window | None = None,
) -> list[tuple[Path, tuple[str, ...]]]:
    """Draw pictures of a world into a folder; return each file with what it could not show.

    Args:
        route: The name of a route to draw.
        width: Width of the pictures in pixels.
        window: x0, y0, x1, y1 of the part to show, in metres.
    """
    shown = world.route(route) if route else None
    made: list[tuple[str, bytes, tuple[str, ...]]] = []
    whole = ("shows the whole world: --window is for the labelled map and the grid",) if window else ()
    if what == "svg":
        made.append(("plan.svg", floor_plan_svg(world, colours=colours).encode(), whole))
    for name, image, notes in _pictures(world, what, shown, width, colours, window):
        remarks = (*notes, *whole) if name == "birdseye" else notes
        made.append((f"{name}_{shown.name}.png" if shown else f"{name}.png", png_bytes(image), remarks))
    written = []
    try:
        make_folder(folder)
        for file, content, notes in made:
            (folder / file).write_bytes(content)
            written.append((folder / file, notes))
    except OSError as error:
        raise FileError(folder, f"the pictures cannot be written here: {error.strerror}") from None
    return written


def _pictures(
    world: World, what: str, route: Route | None, width: int, colours: str, window: Window | None
) -> Iterator[tuple[str, Image, tuple[str, ...]]]:
    """Yield the name, image and notes of every picture asked for."""
    for name, layers, said in (("labels", LABELLED, "labelled areas"), ("grid", GRID, "grid of waypoints")):
        if what in ("all", name):
            title = f"{world.title}: {said}" + (f" and {route.name}" if route else "")
            plan = draw_plan(
                world, show=layers, width_px=width, route=route, colours=colours, window=window, title=title
            )
            yield name, plan.image, plan.notes
    if what in ("all", "grid") and window is None:
        parts = tiles(world, width_px=width, route=route, colours=colours)
        for part in parts if len(parts) > 1 else ():
            yield f"grid_part_{part.row + 1}_{part.column + 1}", part.picture.image, part.picture.notes
    if what in ("all", "birdseye"):
        yield "birdseye", birdseye(world, width_px=width, colours=colours, route=route), ()


def size_m(world: World) -> tuple[float, float]:
    """Return the width and the height of a world's map in metres."""
    rows, columns = world.occupancy.cells.shape
    return columns * world.occupancy.resolution, rows * world.occupancy.resolution


def world_summary(world: World) -> dict[str, Any]:
    """Return what a world holds, as plain data."""
    wide, high = size_m(world)
    return {
        "name": world.name,
        "title": world.title,
        "id": world.id,
        "size_m": [round(wide, 3), round(high, 3)],
        "objects": len(world.objects),
        "grid": {
            "rows": list(world.grid.rows),
            "columns": list(world.grid.columns),
            "valid_waypoints": len(world.grid.valid),
            "hops": len(world.grid.hops),
        },
        "areas": [
            {"name": a.name, "kind": a.kind, "region": a.region, "waypoints": list(a.waypoints)} for a in world.areas
        ],
        "routes": [
            {
                "name": r.name,
                "purpose": r.purpose,
                "time_limit_s": r.time_limit_s,
                "description": route_paragraph(world, r),
            }
            for r in world.routes
        ],
        "doors": [
            {"name": d.name, "kind": d.kind, "state": d.state, "width_m": round(d.width_m, 3)} for d in world.doors
        ],
        "activities": list(world.activities),
    }
