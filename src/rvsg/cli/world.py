"""`rvsg world`: make a world from a map, check it, draw it, show it."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from rvsg.cli.console import as_started, print_json, say
from rvsg.cli.frame import verb

if TYPE_CHECKING:
    from rvsg.api.authoring import Created, Remark, World

app = verb(no_args_is_help=True, help="Make a world from a map, check it, draw it, show it.")

WorldName = Annotated[str, typer.Argument(metavar="WORLD", help="A shipped world or a world folder.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]
NoSimulation = Annotated[
    bool, typer.Option("--no-simulation", help="Do not drive routes and walk hops in the simulator.")
]


@app.command("new")
def new(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The world folder to make.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="A Nav2 map: map.yaml beside its pgm, png or bmp.")
    ] = None,
    sdf: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A Gazebo world (.world, .sdf) or a room in URDF.")
    ] = None,
    objects: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Our own objects.yaml: oriented boxes and polygons.")
    ] = None,
    title: Annotated[str, typer.Option(help="How the world is called in pictures and reports.")] = "",
    spacing: Annotated[float | None, typer.Option(help="Metres between waypoints. [1, more in a large map]")] = None,
    human_clearance: Annotated[float, typer.Option(help="Metres a person keeps from obstacles on a waypoint.")] = 0.3,
    robot_clearance: Annotated[float, typer.Option(help="Metres the robot needs to fit.")] = 0.3,
    free_thresh: Annotated[
        float | None, typer.Option(min=0, max=1, help="With --map: instead of the map's own free_thresh.")
    ] = None,
    model_path: Annotated[
        list[Path] | None, typer.Option(metavar="DIR", help="With --sdf: a folder of models; repeatable.")
    ] = None,
    lidar_height: Annotated[
        float, typer.Option(help="With --sdf, --objects: height of the lidar plane above the floor, metres.")
    ] = 0.21,
    floor: Annotated[float, typer.Option(help="With --sdf: height of the floor in the world in metres.")] = 0.0,
    resolution: Annotated[
        float | None,
        typer.Option(help="With --sdf, --objects: metres per cell of the map. [0.05, coarser in a large building]"),
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="With --sdf: leave out models of this name (robot*); repeatable."),
    ] = None,
    box_for_unreadable: Annotated[
        bool,
        typer.Option(
            "--box-for-unreadable", help="With --sdf: replace a mesh that cannot be read by its bounding box."
        ),
    ] = False,
    lenient: Annotated[
        bool, typer.Option("--lenient", help="With --sdf: leave out models and meshes that are missing or unreadable.")
    ] = False,
    no_simulation: NoSimulation = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the world in a folder that has one.")] = False,
    json: AsJson = False,
) -> None:
    """Make a world folder from a map.

    The map is a Nav2 map, a Gazebo world or a file of objects.

    Labels and routes are proposals: read the README in the folder, edit them, then `rvsg world check DIR`.
    Each proposed route is driven once in the simulator; one that the robot cannot drive alone is not proposed.
    """
    from rvsg.api.authoring import (
        check_world,
        save_world,
        trial_of,
        world_from_map,
        world_from_objects,
        world_from_sdf,
        write_readme,
    )
    from rvsg.api.errors import InputError

    given = [option for option, value in (("--map", map_file), ("--sdf", sdf), ("--objects", objects)) if value]
    if len(given) != 1:
        raise InputError(f"give exactly one of --map, --sdf and --objects; got {' and '.join(given) or 'none'}")
    _refuse_unused(
        given[0],
        {
            "--free-thresh": (free_thresh is not None, ("--map",)),
            "--model-path": (bool(model_path), ("--sdf",)),
            "--without": (bool(without), ("--sdf",)),
            "--box-for-unreadable": (box_for_unreadable, ("--sdf",)),
            "--lenient": (lenient, ("--sdf",)),
            "--floor": (floor != 0.0, ("--sdf",)),
            "--resolution": (resolution is not None, ("--sdf", "--objects")),
            "--lidar-height": (lidar_height != 0.21, ("--sdf", "--objects")),
        },
    )
    _refuse_occupied(folder, force=force)
    spec = _grid_spec(spacing, human_clearance, robot_clearance)
    name = folder.resolve().name
    trial = None if no_simulation else trial_of(progress=say)
    if map_file is not None:
        created = world_from_map(map_file, name=name, title=title, grid_spec=spec, free_thresh=free_thresh, trial=trial)
    elif sdf is not None:
        created = world_from_sdf(
            sdf,
            name=name,
            title=title,
            grid_spec=spec,
            model_paths=model_path or (),
            lidar_height_m=lidar_height,
            floor_m=floor,
            resolution_m=resolution,
            box_for_unreadable=box_for_unreadable,
            lenient=lenient,
            without=without or (),
            progress=_progress(),
            trial=trial,
        )
    else:
        assert objects is not None
        created = world_from_objects(
            objects,
            name=name,
            title=title,
            grid_spec=spec,
            lidar_height_m=lidar_height,
            resolution_m=resolution,
            trial=trial,
        )
    save_world(created.world, folder)
    remarks = check_world(folder, trial=trial)
    write_readme(created, folder, [f"{'error' if r.serious else 'warning'}: {r.problem.message}" for r in remarks])
    _show_created(created, remarks, folder)
    if json:
        print_json(_summary(created.world) | {"folder": str(folder), "notes": list(created.notes)})


@app.command()
def check(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The world folder.")] = Path(),
    no_simulation: NoSimulation = False,
    json: AsJson = False,
) -> None:
    """List everything that is wrong or suspicious in a world folder, with file and line.

    The robot drives every route and a person walks every hop in the simulator, with nobody else about. The results are
    kept, so that a world that has not changed is checked at once.

    Exit code 2 if something is wrong, 0 if there are only warnings or nothing.
    """
    from rvsg.api.authoring import SHIPPED, check_world, shipped_worlds, trial_of

    place = (
        SHIPPED / str(folder) if str(folder) in shipped_worlds() and not (folder / "world.yaml").is_file() else folder
    )
    remarks = check_world(place, trial=None if no_simulation else trial_of(progress=say))
    _show_remarks(remarks)
    if json:
        print_json([_remark_json(remark) for remark in remarks])
    raise typer.Exit(2 if any(remark.serious for remark in remarks) else 0)


@app.command()
def draw(
    world: WorldName,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Where to. [pictures in the world folder]")] = None,
    what: Annotated[Literal["all", "labels", "grid", "birdseye", "svg"], typer.Option(help="Which picture.")] = "all",
    route: Annotated[str | None, typer.Option(help="Draw this route of the world on them.")] = None,
    width: Annotated[int, typer.Option(help="Width in pixels, 400 to 6000.")] = 1600,
    colours: Annotated[str, typer.Option(help="Palette: light, grey or dark.")] = "light",
    window: Annotated[
        str | None, typer.Option(metavar="X0,Y0,X1,Y1", help="Show only this part of the world, metres.")
    ] = None,
    json: AsJson = False,
) -> None:
    """Draw the pictures that people and VLMs see.

    Labelled map, grid of waypoints and bird's-eye view as PNG, or an SVG plan.
    Where the names of the waypoints are too many for one picture of the grid, it is also drawn in parts.
    """
    from rvsg.api.authoring import load_world

    loaded = load_world(world)
    shown = loaded.route(route) if route else None
    folder = out or (Path(world) / "pictures" if Path(world).is_dir() else Path())
    written = _draw(loaded, folder, what, shown, width, colours, _window(window))
    for path, notes in written:
        say(f"{path}" + "".join(f"\n  {note}" for note in notes))
    if json:
        print_json([str(path) for path, _ in written])


@app.command()
def show(
    world: WorldName,
    json: AsJson = False,
) -> None:
    """Show what a world holds.

    Grid, areas with their waypoints, routes in words, activities.
    """
    from rvsg.api.authoring import load_world

    loaded = load_world(world)
    if json:
        print_json(_summary(loaded))
        return
    _show_world(loaded)


@app.command("list")
def list_worlds(json: AsJson = False) -> None:
    """List the worlds that ship with RVSG."""
    from rvsg.api.authoring import load_world, shipped_worlds

    worlds = [load_world(name) for name in shipped_worlds()]
    if json:
        print_json([_summary(world) for world in worlds])
        return
    for world in worlds:
        wide, high = _size_m(world)
        say(
            f"{world.name:<12} {world.title}: {wide:.0f} x {high:.0f} m, {len(world.grid.valid)} waypoints, "
            f"{len(world.areas)} areas, routes {', '.join(r.name for r in world.routes)}"
        )


@app.command()
def diff(
    old: Annotated[str, typer.Argument(metavar="OLD", help="A shipped world or a world folder.")],
    new: Annotated[str, typer.Argument(metavar="NEW", help="The world to compare it with.")],
    json: AsJson = False,
) -> None:
    """Compare two versions of a world.

    Changes that can make a saved scenario invalid or different are marked with an asterisk: map, objects, waypoints.
    """
    from rvsg.api.authoring import differences, load_world

    found = differences(load_world(old), load_world(new))
    for difference in found:
        say(f"{'*' if difference.matters else ' '} {difference.message}")
    if not found:
        say("The worlds are the same.")
    elif not any(difference.matters for difference in found):
        say("Saved scenarios stay valid.")
    if json:
        print_json([difference.model_dump(mode="json") for difference in found])


# --- parts --------------------------------------------------------------------------------------------------------


PROGRESS_EVERY_S = 2.0


def _progress() -> Callable[[str], None]:
    """Return a function that shows a line of progress, at most one every two seconds."""
    last = time.monotonic()

    def show(line: str) -> None:
        nonlocal last
        if time.monotonic() - last >= PROGRESS_EVERY_S:
            last = time.monotonic()
            say(line)

    return show


def _refuse_unused(source: str, options: dict[str, tuple[bool, tuple[str, ...]]]) -> None:
    """InputError for options that are given (name: given, sources they go with) and would change nothing."""
    from rvsg.api.errors import InputError

    useless = [
        f"{name} goes with {' or '.join(ok)}" for name, (given, ok) in options.items() if given and source not in ok
    ]
    if useless:
        raise InputError(f"{'; '.join(useless)}; got {source}")


def _refuse_occupied(folder: Path, *, force: bool) -> None:
    from rvsg.api.errors import FileError

    if folder.exists() and not folder.is_dir():
        raise FileError(folder, "this is a file; expected the name of a folder to make")
    if (folder / "world.yaml").exists() and not force:
        raise FileError(folder, "the folder already holds a world; --force replaces it, with all that was edited")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / "world.yaml").exists() and not force:
        raise FileError(folder, "the folder is not empty; choose a new one, or --force to write into it")


def _grid_spec(spacing: float | None, human_clearance: float, robot_clearance: float) -> Any:
    from pydantic import ValidationError

    from rvsg.api.authoring import GridSpec
    from rvsg.api.errors import InputError

    try:
        return GridSpec(spacing_m=spacing, human_clearance_m=human_clearance, robot_clearance_m=robot_clearance)
    except ValidationError as error:
        listed = "; ".join(f"{d['loc'][0]}: {d['msg'].lower()}, got {d['input']}" for d in error.errors())
        raise InputError(f"the grid cannot be laid so: {listed}") from None


def _window(text: str | None) -> tuple[float, float, float, float] | None:
    from rvsg.api.errors import InputError

    if text is None:
        return None
    try:
        x0, y0, x1, y1 = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--window must be four numbers X0,Y0,X1,Y1 in metres, got {text!r}") from None
    return (x0, y0, x1, y1)


def _draw(
    world: World, folder: Path, what: str, route: Any, width: int, colours: str, window: Any
) -> list[tuple[Path, tuple[str, ...]]]:
    """Draw and write; the paths with what each picture could not show."""
    from rvsg.api.authoring import floor_plan_svg, png_bytes
    from rvsg.api.errors import FileError
    from rvsg.api.folder import make_folder

    made: list[tuple[str, bytes, tuple[str, ...]]] = []
    whole = ("shows the whole world: --window is for the labelled map and the grid",) if window else ()
    if what == "svg":
        made.append(("plan.svg", floor_plan_svg(world, colours=colours).encode(), whole))
    for name, image, notes in _pictures(world, what, route, width, colours, window):
        told = (*notes, *whole) if name == "birdseye" else notes
        made.append((f"{name}_{route.name}.png" if route else f"{name}.png", png_bytes(image), told))
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
    world: World, what: str, route: Any, width: int, colours: str, window: Any
) -> Iterator[tuple[str, Any, tuple[str, ...]]]:
    """Name, image and notes of every picture that is asked for."""
    from rvsg.api.authoring import GRID, LABELLED, birdseye, draw_plan, tiles

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


def _size_m(world: World) -> tuple[float, float]:
    rows, columns = world.occupancy.cells.shape
    return columns * world.occupancy.resolution, rows * world.occupancy.resolution


def _summary(world: World) -> dict[str, Any]:
    from rvsg.api.authoring import route_paragraph

    wide, high = _size_m(world)
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
        "activities": list(world.activities),
    }


def _show_world(world: World) -> None:
    from rvsg.api.authoring import route_paragraph

    wide, high = _size_m(world)
    grid = world.grid
    say(f"{world.title} ({world.name}): {wide:.1f} x {high:.1f} m, {len(world.objects)} solid objects")
    say(
        f"Grid: rows {grid.rows[0]} to {grid.rows[-1]}, columns {grid.columns[0]} to {grid.columns[-1]}, "
        f"{len(grid.valid)} waypoints where people can stand, {len(grid.hops)} free hops"
    )
    say("\nAreas")
    for area in world.areas:
        listed = ", ".join(area.waypoints[:12]) + (", ..." if len(area.waypoints) > 12 else "")
        say(f"  {area.name} ({area.kind}): {listed or 'no waypoint'}")
    say("\nRoutes")
    for route in world.routes:
        say(f"  {route.name}: {route_paragraph(world, route)}\n")
    if world.activities:
        say("Activities")
        for activity in world.activities:
            say(f"  - {activity}")


def _show_created(created: Created, remarks: tuple[Remark, ...], folder: Path) -> None:
    from rvsg.api.authoring import shipped_worlds

    world = created.world
    wide, high = _size_m(world)
    say(
        f"{folder}: {wide:.1f} x {high:.1f} m, {len(world.grid.valid)} waypoints, {len(world.areas)} areas and "
        f"{len(world.routes)} routes proposed."
    )
    for note in created.notes:
        say(f"Note: {note}")
    if str(folder) in shipped_worlds():
        say(f"Note: a world that ships has this name too; where a world is asked for, write ./{folder}.")
    _show_remarks(remarks)
    draw = as_started(shlex.join(["rvsg", "world", "draw", str(folder)]))
    say(f"Next: edit labels.yaml and routes.yaml (they are proposals), then: {draw}")


def _show_remarks(remarks: tuple[Remark, ...]) -> None:
    for remark in remarks:
        say(f"{remark}")
    serious = sum(remark.serious for remark in remarks)
    if not remarks:
        say("Nothing is wrong.")
    else:
        say(f"{serious} wrong, {len(remarks) - serious} suspicious.")


def _remark_json(remark: Remark) -> dict[str, Any]:
    problem = remark.problem
    return {
        "path": str(problem.path),
        "line": problem.line,
        "serious": remark.serious,
        "message": problem.message,
    }
