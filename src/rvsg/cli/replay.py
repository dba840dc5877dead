"""`rvsg replay`: write a run as a film or a strip of pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.arguments import OtherWorld, Simulator, SimulatorOption
from rvsg.cli.console import say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def replay(
    source: Annotated[Path, typer.Argument(help="The folder of a campaign, a file of runs, or a scenario.")],
    out: Annotated[Path, typer.Option(help="The file to write: .mp4, .webm, .gif, .webp or .png.")],
    run: Annotated[
        str | None, typer.Option(help="The id of a run. [the worst run of the worst finding; the first of a file]")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the run of a scenario.")] = 0,
    speed: Annotated[float, typer.Option(min=0.1, max=20, help="Simulated seconds per second of the film.")] = 2.0,
    width: Annotated[int, typer.Option(min=480, max=3840, help="Width of the film in pixels.")] = 960,
    world: OtherWorld = None,
    simulator: Simulator = "embedded",
    simulator_option: SimulatorOption = None,
) -> None:
    """Write a run as a film, or as a PNG strip of its decisive moments.

    A run of a campaign is shown with the judged quantity and its limit. MP4 and WebM need the extra `video`.
    """
    from rvsg.app.playback import shot_of
    from rvsg.cli.options import spec
    from rvsg.core.outputs import check_writable
    from rvsg.report.film import check_film, write_film

    check_film(out)
    check_writable(out)
    chosen = spec("simulator", simulator, simulator_option)
    shot = shot_of(source, run=run, seed=seed, world=world, simulator=chosen)
    write_film(out, shot, speed=speed, width_px=width)
    say(f"Replay of {shot.run.id}, seed {shot.run.seed}: {out}")
