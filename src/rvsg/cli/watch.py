"""`rvsg watch`: what a robot does decides what is tested next."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import as_started, say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def watch(
    suite: Annotated[Path, typer.Argument(help="The folder of the suite.")],
    monitor: Annotated[
        Path | None, typer.Option(metavar="DIR", help="A folder of recordings (rosbag2, MCAP), or of campaigns.")
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder of the journal, the log and the plans; resumed where it is.")
    ] = Path("runs/watch"),
    cycles: Annotated[int | None, typer.Option(min=1, help="Stop after so many cycles.")] = None,
    duration: Annotated[
        str | None, typer.Option("--for", metavar="TIME", help="Stop after a time, e.g. 90s, 15m or 1h.")
    ] = None,
    every: Annotated[str, typer.Option(metavar="TIME", help="Pause after a cycle with nothing to do.")] = "30s",
    route: Annotated[str | None, typer.Option(help="Route of all recordings. [the name of their folder]")] = None,
    rules: Annotated[
        Path | None, typer.Option(metavar="FILE", help="What makes a plan legitimate. [SUITE/rules/rules.yaml]")
    ] = None,
    approve: Annotated[
        str | None, typer.Option(metavar="PLAN", help="Approve a plan or change that waits, and end.")
    ] = None,
    generator: Annotated[str, typer.Option(help="Who writes variants.")] = "heuristic",
    simulator: Annotated[str, typer.Option(help="What runs the plans.")] = "embedded",
    simulator_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the simulator.")] = None,
    stack: Annotated[
        str | None,
        typer.Option(help="Navigation stack under test; a parameter file is read again when it changes. [nav2-dwb]"),
    ] = None,
    stack_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the stack.")] = None,
    knowledge: Annotated[
        str | None, typer.Option(metavar="FILE|URL", help="The knowledge base. [OUT/knowledge.sqlite]")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of what is planned.")] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Worker processes.")] = 1,
) -> None:
    """Watch a robot, and let what is seen decide what is tested next.

    Monitor reads new runs, Analyse judges them by the requirements of the suite, Plan writes scenarios for what is near
    its limit, for places never tested and for a new version, Legitimate accepts or refuses each by declared rules,
    Execute runs it, Knowledge keeps it and writes new failures into the suite. OUT/watch.log says what was done and
    why.
    """
    from rvsg.api import watching
    from rvsg.api.errors import Interrupted
    from rvsg.cli.options import seconds_of, spec, stack_spec

    if approve is not None:
        watching.approve(out, approve, on_message=say)
        return
    try:
        journal = watching.watch(
            suite,
            monitor,
            out,
            cycles=cycles,
            seconds=None if duration is None else seconds_of("--for", duration),
            every_s=seconds_of("--every", every),
            route=route,
            rules=rules,
            generator=generator,
            simulator=spec("simulator", simulator, simulator_option),
            stack=stack_spec(stack, stack_option),
            knowledge=knowledge,
            seed=seed,
            jobs=jobs,
            on_note=lambda note: say(watching.note_in_words(note)),
            on_message=say,
        )
    except KeyboardInterrupt:
        command = as_started(f"rvsg watch {suite} --monitor {monitor} --out {out}")
        raise Interrupted(f"Interrupted; everything finished is kept. Go on with: {command}") from None
    say(f"{journal.cycle} cycles, {journal.spent} runs; the log is {journal.words}")
