"""`rvsg world`: make, copy, check, draw, describe and compare worlds."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from rvsg.cli.console import as_started, print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.model import describe
from rvsg.cli.options import AsJson, Prices, Record, named_world, setting_options

if TYPE_CHECKING:
    from rvsg.world.checks import Remark
    from rvsg.world.creation import Created
    from rvsg.world.world import World

app = verb(no_args_is_help=True, help="Make, copy, check, draw, describe and compare worlds.")
app.command()(describe)

WorldName = Annotated[
    str, typer.Argument(metavar="WORLD", help="A shipped world or a world folder.", callback=named_world)
]
Robot = Annotated[
    str | None,
    typer.Option(help="A shipped robot (`rvsg robots`) or a robot file. [tiago_omni]"),
]
Stack = Annotated[str | None, typer.Option(help="A stack (`rvsg stacks`) or a parameter file that drives. [nav2-dwb]")]
NoSimulation = Annotated[bool, typer.Option("--no-simulation", help="Do not try routes and hops in the simulator.")]


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
        Path | None, typer.Option(metavar="FILE", help="An objects.yaml: oriented boxes and polygons.")
    ] = None,
    title: Annotated[str, typer.Option(help="Title of the world in pictures and reports.")] = "",
    spacing: Annotated[float | None, typer.Option(help="Metres between waypoints. [1, more in a large map]")] = None,
    human_clearance: Annotated[
        float, typer.Option(hidden=True, help="Metres a person keeps from obstacles on a waypoint.")
    ] = 0.3,
    robot_clearance: Annotated[
        float | None,
        typer.Option(
            hidden=True, help="Metres from an obstacle at which the robot fits. [0.3, or half its width plus 0.05]"
        ),
    ] = None,
    robot: Robot = None,
    stack: Stack = None,
    free_thresh: Annotated[
        float | None,
        typer.Option(hidden=True, min=0, max=1, help="With --map: use this instead of the map's free_thresh."),
    ] = None,
    model_path: Annotated[
        list[Path] | None, typer.Option(hidden=True, metavar="DIR", help="With --sdf: a folder of models; repeatable.")
    ] = None,
    lidar_height: Annotated[
        float,
        typer.Option(hidden=True, help="With --sdf, --objects: height of the lidar plane above the floor, metres."),
    ] = 0.21,
    floor: Annotated[
        float, typer.Option(hidden=True, help="With --sdf: height of the floor in the world in metres.")
    ] = 0.0,
    resolution: Annotated[
        float | None,
        typer.Option(
            hidden=True, help="With --sdf, --objects: metres per cell of the map. [0.05, coarser in a large building]"
        ),
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(
            hidden=True, metavar="NAME", help="With --sdf: leave out models with this name (robot*); repeatable."
        ),
    ] = None,
    box_for_unreadable: Annotated[
        bool,
        typer.Option(
            "--box-for-unreadable",
            hidden=True,
            help="With --sdf: replace a mesh that cannot be read by its bounding box.",
        ),
    ] = False,
    lenient: Annotated[
        bool,
        typer.Option(
            "--lenient", hidden=True, help="With --sdf: leave out models and meshes that are missing or unreadable."
        ),
    ] = False,
    indoors: Annotated[
        list[str] | None,
        typer.Option(hidden=True, metavar="X,Y", help="With --sdf, --objects: floor that is no courtyard; repeatable."),
    ] = None,
    outdoors: Annotated[
        list[str] | None,
        typer.Option(hidden=True, metavar="X,Y", help="With --sdf, --objects: floor that is a courtyard; repeatable."),
    ] = None,
    no_simulation: NoSimulation = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the world in a folder that has one.")] = False,
    json: AsJson = False,
) -> None:
    """Make a world folder from a map.

    The map is a Nav2 map, a Gazebo world or a file of objects.

    Labels and routes are proposals: read the README in the folder, edit them, then run `rvsg world check DIR`. RVSG
    drives each route once in the simulator before it proposes it.
    """
    from rvsg.simulation.route_trial import trial_of
    from rvsg.world.creation import create_world, other_robot
    from rvsg.world.world_folder import world_summary

    driver = other_robot(robot)
    trial = None if no_simulation else trial_of(driver, stack, progress=say)
    created, remarks = create_world(
        folder,
        map_file=map_file,
        sdf=sdf,
        objects=objects,
        title=title,
        spacing=spacing,
        human_clearance=human_clearance,
        robot_clearance=robot_clearance,
        free_thresh=free_thresh,
        model_path=model_path,
        lidar_height=lidar_height,
        floor=floor,
        resolution=resolution,
        without=without,
        box_for_unreadable=box_for_unreadable,
        lenient=lenient,
        indoors=[_point("--indoors", at) for at in indoors or ()],
        outdoors=[_point("--outdoors", at) for at in outdoors or ()],
        force=force,
        robot=driver,
        trial=trial,
        progress=_progress(),
    )
    _show_created(created, remarks, folder)
    if json:
        print_json(world_summary(created.world) | {"folder": str(folder), "notes": list(created.notes)})


@app.command("copy")
def copy(
    world: WorldName,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The world folder to make.")],
    force: Annotated[bool, typer.Option("--force", help="Replace the world in a folder that has one.")] = False,
) -> None:
    """Copy a world into a folder of its own.

    Edit a shipped world there, or give its map to your navigation: the folder
    holds it as map.yaml.
    """
    from rvsg.world.creation import copy_world
    from rvsg.world.world_folder import as_named, load_world

    copy_world(load_world(world), folder, force=force)
    say(f"Wrote {folder}; its map is {folder / 'map.yaml'}")
    say(f"Next: {as_started(shlex.join(['rvsg', 'run', '--world', as_named(folder)]))}")


@app.command()
def check(
    world: WorldName = ".",
    robot: Robot = None,
    stack: Stack = None,
    no_simulation: NoSimulation = False,
    json: AsJson = False,
) -> None:
    """List every error and warning in a world's files, with file and line.

    The robot drives every route and a person walks every hop in the simulator, alone. The results are cached, so
    checking an unchanged world takes no time.

    Exits with code 2 if there is an error, with 0 if there are only warnings or nothing.
    """
    from rvsg.simulation.route_trial import trial_of
    from rvsg.world.checks import check_world
    from rvsg.world.creation import other_robot
    from rvsg.world.world_folder import folder_named, load_world

    driver = other_robot(robot)
    trial = None if no_simulation else trial_of(driver, stack, progress=say)
    remarks = check_world(folder_named(world), trial=trial, robot=driver)
    _show_remarks(remarks)
    if json:
        remarked = [(remark, remark.problem) for remark in remarks]
        print_json(
            [
                {
                    "path": str(at.path),
                    "line": at.line,
                    "serious": remark.serious,
                    "code": remark.code,
                    "message": at.message,
                }
                for remark, at in remarked
            ]
        )
    if any(remark.serious for remark in remarks):
        raise typer.Exit(2)
    if routes := load_world(world).routes:
        driven = [word for option, name in (("--robot", robot), ("--stack", stack)) if name for word in (option, name)]
        words = ["rvsg", "run", "--world", world, "--route", routes[0].name, *driven]
        say(f"Next: {as_started(shlex.join(words))}")


@app.command()
def draw(
    world: WorldName,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the pictures here. [pictures in the world folder]")
    ] = None,
    what: Annotated[Literal["all", "labels", "grid", "birdseye", "svg"], typer.Option(help="Which picture.")] = "all",
    route: Annotated[str | None, typer.Option(help="Also draw this route.")] = None,
    width: Annotated[int, typer.Option(help="Width in pixels, 400 to 6000.")] = 1600,
    colours: Annotated[str, typer.Option(help="Palette: light, grey or dark.")] = "light",
    window: Annotated[
        str | None, typer.Option(metavar="X0,Y0,X1,Y1", help="Show only this part of the world, metres.")
    ] = None,
    json: AsJson = False,
) -> None:
    """Draw the pictures that people and VLMs see.

    Labelled map, grid of waypoints and bird's-eye view as PNG, or an SVG plan. A grid with too many names for one
    picture is also drawn in parts.
    """
    from rvsg.world.drawing import draw_world
    from rvsg.world.world_folder import load_world, shipped_worlds

    own = world not in shipped_worlds() and Path(world).is_dir()
    folder = out or (Path(world) / "pictures" if own else Path())
    shown = _window(window)
    written = draw_world(load_world(world), folder, what=what, route=route, width=width, colours=colours, window=shown)
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
    from rvsg.world.world_folder import load_world, world_summary

    loaded = load_world(world)
    if json:
        print_json(world_summary(loaded))
        return
    _show_world(loaded)


@app.command("list")
def list_worlds(json: AsJson = False) -> None:
    """List the worlds that ship with RVSG."""
    from rvsg.world.world_folder import load_world, shipped_worlds, size_m, world_summary

    worlds = [load_world(name) for name in shipped_worlds()]
    if json:
        print_json([world_summary(world) for world in worlds])
        return
    for world in worlds:
        wide, high = size_m(world)
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

    An asterisk marks changes that can make a saved scenario invalid or different: map, objects, waypoints.
    """
    from rvsg.world.diff import differences
    from rvsg.world.world_folder import load_world

    changes = differences(load_world(old), load_world(new))
    for difference in changes:
        say(f"{'*' if difference.matters else ' '} {difference.message}")
    if not changes:
        say("The worlds are the same.")
    elif not any(difference.matters for difference in changes):
        say("Saved scenarios stay valid.")
    if json:
        print_json([difference.model_dump(mode="json") for difference in changes])


PROGRESS_EVERY_S = 2.0


def _progress() -> Callable[[str], None]:
    """Return a function that prints a line of progress, at most one every two seconds."""
    last = time.monotonic()

    def show(line: str) -> None:
        nonlocal last
        if time.monotonic() - last >= PROGRESS_EVERY_S:
            last = time.monotonic()
            say(line)

    return show


def _window(text: str | None) -> tuple[float, float, float, float] | None:
    if text is None:
        return None
    x0, y0, x1, y1 = _numbers("--window", "X0,Y0,X1,Y1", text)
    return (x0, y0, x1, y1)


def _point(option: str, text: str) -> tuple[float, float]:
    x, y = _numbers(option, "X,Y", text)
    return x, y


def _numbers(option: str, form: str, text: str) -> tuple[float, ...]:
    """Return the numbers of an option such as X,Y in metres."""
    import math

    from rvsg.core.errors import InputError

    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != len(form.split(",")) or not all(math.isfinite(v) for v in numbers):
        raise InputError(f"{option} must be {form} in metres, got {text!r}", code=f"{option.removeprefix('--')}-form")
    return numbers


def _show_world(world: World) -> None:
    from rvsg.world.passages import route_paragraph
    from rvsg.world.world_folder import size_m

    wide, high = size_m(world)
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
    if world.doors:
        say("\nDoors")
    for door in world.doors:
        x, y = door.middle
        say(f"  {door.name} ({door.kind}, {door.width_m:.1f} m wide) about ({x:.1f}, {y:.1f}): {door.state}")
    say("\nRoutes")
    for route in world.routes:
        say(f"  {route.name}: {route_paragraph(world, route)}\n")
    if world.activities:
        say("Activities")
        for activity in world.activities:
            say(f"  - {activity}")


def _show_created(created: Created, remarks: tuple[Remark, ...], folder: Path) -> None:
    from rvsg.evaluation.verdict import counted
    from rvsg.world.world_folder import as_named, size_m

    world = created.world
    wide, high = size_m(world)
    say(
        f"{folder}: {wide:.1f} x {high:.1f} m, {len(world.grid.valid)} waypoints, "
        f"{counted(len(world.areas), 'area')} and {counted(len(world.routes), 'route')} proposed."
    )
    for note in created.notes:
        say(f"Note: {note}")
    named = as_named(folder)
    if named != str(folder):
        say(f"Note: a shipped world has the same name. Write {named} to use this one.")
    _show_remarks(remarks)
    if world.actors:
        say(f"Scenarios may put these into the world: {', '.join(world.actors)} (actors in world.yaml; [] for none).")
    draw = as_started(shlex.join(["rvsg", "world", "draw", named]))
    say(f"Next: edit labels.yaml and routes.yaml (they are proposals), then: {draw}")


@app.command("label")
@setting_options("model", "base_url", "replay", "budget_calls", "budget_usd")
def label(
    settings: dict[str, Any],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The world folder.")],
    record: Record = None,
    photo: Annotated[
        list[Path] | None, typer.Option(metavar="FILE", help="A photograph or a plan of the place; repeatable.")
    ] = None,
    prices: Prices = None,
    json: AsJson = False,
) -> None:
    """Let a vision language model propose names, kinds, regions, doors and activities; accept them one by one.

    RVSG checks what you accept, writes it into labels.yaml, doors.yaml and world.yaml, and keeps their comments. With
    --json, it prints the proposals and writes nothing. `rvsg world new` proposes labels without a model.
    """
    from rvsg.generation.environment import propose_names
    from rvsg.world.edits import add_door, edit_world
    from rvsg.world.world_folder import load_world

    model = settings.pop("model", None)
    world = load_world(folder)
    proposed = propose_names(world, model, record, photographs=photo or (), **settings, prices=prices)
    for line in proposed.unusable:
        say(line)
    if json:
        print_json(proposed.model_dump(mode="json", include={"names", "activities", "doors"}))
        return
    for proposed_name in proposed.names:
        changes = ", ".join(f"{key} {value}" for key, value in proposed_name.values.items())
        say(f"{proposed_name.area}: {changes}. {proposed_name.why}")
        if typer.confirm("Accept", default=False, err=True):
            edit_world(
                folder, {"what": "change area", "name": proposed_name.area, "values": proposed_name.values}
            ).apply()
    for door in proposed.doors:
        width = f"{door.door.width_m:.2f} m, {door.door.kind}"
        say(f"{door.door.name}: a door between {' and '.join(door.between)}, {width}. {door.why}")
        if typer.confirm("Accept", default=False, err=True):
            add_door(folder, door.door)
    activities = list(world.activities)
    for text in proposed.activities:
        say(f"Activity: {text}")
        if typer.confirm("Accept", default=False, err=True):
            activities.append(text)
            edit_world(folder, {"what": "set activities", "values": activities}).apply()
    if not (proposed.names or proposed.activities or proposed.doors):
        say("The model proposes no other label.")


def _show_remarks(remarks: tuple[Remark, ...]) -> None:
    from rvsg.evaluation.verdict import counted

    for remark in remarks:
        say(f"{remark}")
    serious = sum(remark.serious for remark in remarks)
    if not remarks:
        say("No errors and no warnings.")
    else:
        counts = f"{counted(serious, 'error')}, {counted(len(remarks) - serious, 'warning')}"
        say(f"{counts}. What one means: rvsg --explain {remarks[0].code}")
