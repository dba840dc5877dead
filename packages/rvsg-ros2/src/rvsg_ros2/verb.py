"""`rvsg ros2`: check a running ROS 2 navigation, and write or scale Nav2's parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rvsg.cli import console
from rvsg.cli.frame import verb
from rvsg.cli.options import AsJson, setting_options

app = verb(no_args_is_help=True, help="Check a running ROS 2 navigation; write or scale Nav2's parameters.")


@app.command()
@setting_options("stack_options")
def check(
    settings: dict[str, Any],
    robot: Annotated[str, typer.Option(help="A shipped robot (`rvsg robots`) or a robot file.")] = "tiago_omni",
    seconds: Annotated[float, typer.Option(min=0.5, max=60, help="How long to listen.")] = 5.0,
    json: AsJson = False,
) -> None:
    """Report what the running ROS 2 system offers, what is missing and what has another type.

    Exits with code 1 if the system cannot drive. Run it in the environment of your system (ROS_DOMAIN_ID,
    CYCLONEDDS_URI). It starts and changes nothing.
    """
    from rvsg_ros2.check import check_ros2

    found = check_ros2(settings.get("stack_options", {}), robot, seconds=seconds)
    if json:
        listed = [{"name": each.name, "status": each.status.name, "detail": each.detail} for each in found.findings]
        told = {"domain": found.domain, "release": found.release, "usable": found.is_usable}
        console.print_json(told | {"findings": listed})
    else:
        known = f"message definitions of {found.release}" if found.release else "no ROS 2 node is heard"
        print(f"DDS domain {found.domain}, {known}")
        for each in found.findings:
            print(f"{each.status.value:33}{each.name}{f': {each.detail}' if each.detail else ''}")
    if not found.is_usable:
        raise typer.Exit(1)


@app.command()
def params(
    file: Annotated[Path, typer.Argument(help="A Nav2 parameter file.")],
    speed: Annotated[float, typer.Option(min=0.1, max=20, help="Simulated over wall time.")],
    release: Annotated[str, typer.Option(help="humble, jazzy, kilted or lyrical.")] = "jazzy",
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write params.yaml and the behaviour trees there.")
    ] = None,
) -> None:
    """Scale the wall-clock rates of a Nav2 parameter file for a faster clock, and list the changes.

    Nav2 before Lyrical runs its loops on wall time even with use_sim_time.
    """
    from rvsg_ros2.interfaces import release_named
    from rvsg_ros2.nav2_file import scale_nav2_params

    scaled = scale_nav2_params(file, speed, release_named(release))
    if out is None:
        print(scaled.text(), end="")
        if scaled.trees:
            console.say("The behaviour trees need scaling, too. Write them with --out DIR.")
    else:
        out.mkdir(parents=True, exist_ok=True)
        console.say(f"wrote {scaled.write(out)}")
    for change in scaled.changes:
        console.say(str(change))
    for note in scaled.notes:
        console.say(f"note: {note}")


@app.command("new-params")
@setting_options("stack_options")
def new_params(
    settings: dict[str, Any],
    robot: Annotated[str, typer.Option(help="A shipped robot (`rvsg robots`) or a robot file.")] = "tiago_omni",
    stack: Annotated[
        str, typer.Option(help="The stack whose controller is used: nav2-dwb, nav2-rpp or nav2-mppi.")
    ] = "nav2-dwb",
    release: Annotated[str, typer.Option(help="humble, jazzy, kilted or lyrical.")] = "jazzy",
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the file here. [standard output]")] = None,
) -> None:
    """Write a Nav2 parameter file for a robot, with the parameters that a built-in stack uses.

    Frames and topics match those of the stack ros2, so `rvsg run --stack ros2` works with the file as it is.
    """
    from rvsg.core.files import write_whole
    from rvsg_ros2.interfaces import release_named
    from rvsg_ros2.nav2_file import new_nav2_params

    text = new_nav2_params(robot, stack, settings.get("stack_options", {}), release=release_named(release))
    if out is None:
        print(text, end="")
    else:
        write_whole(out, text)
        console.say(f"wrote {out}")
