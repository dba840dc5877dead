"""`rvsg robots`: list, check, draw and import robots."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli import console
from rvsg.cli.arguments import AsJson
from rvsg.cli.frame import verb

app = verb()


@app.command()
def robots(
    robot: Annotated[str | None, typer.Argument(help="A shipped robot or a robot file. [all shipped ones]")] = None,
    draw: Annotated[Path | None, typer.Option(metavar="DIR", help="Write a plan view of each as DIR/NAME.svg.")] = None,
    from_urdf: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Print a URDF file as a robot file, and what it lacks."),
    ] = None,
    json: AsJson = False,
) -> None:
    """List robots with size, drive, limits and sensors; check a robot file, draw robots, or read a URDF file."""
    from rvsg.core.files import write_whole
    from rvsg.robots.robot import draw_robot, load_robot, shipped_robots

    if from_urdf is not None:
        _print_urdf(from_urdf)
        return

    chosen = list(shipped_robots().values()) if robot is None else [load_robot(robot)]
    if draw is not None:
        for each in chosen:
            write_whole(draw / f"{each.name}.svg", draw_robot(each))
            console.say(f"wrote {draw / each.name}.svg")
    if json:
        console.print_json([each.model_dump(mode="json") | {"id": each.id} for each in chosen])
        return
    for each in chosen:
        limits, lidars = each.limits, ", ".join(f"{q.name} {q.rays} rays to {q.max_range_m:g} m" for q in each.lidars)
        compared = "calibrated against published runs" if each.calibrated else "not calibrated"
        print(
            f"{each.name:20} {each.title}\n"
            f"{'':20} {each.length_m:.2f} x {each.width_m:.2f} m, {each.drive.kind}, {limits.speed_m_s:g} m/s, "
            f"{limits.acceleration_m_s2:g} m/s2; {compared}\n"
            f"{'':20} lidars: {lidars}; safety zones: {len(each.safety_zones)}; bumper: "
            f"{'yes' if each.bumper else 'no'}\n"
            f"{'':20} Source: {each.source}"
        )


def _print_urdf(path: Path) -> None:
    import yaml

    from rvsg.core.plugins import find_format

    found = find_format("robot", "urdf")(path)
    print(yaml.safe_dump(found.values, sort_keys=False, default_flow_style=None, width=120), end="")
    for sentence in found.missing:
        print(f"# {sentence}")
        console.say(f"missing: {sentence}")
