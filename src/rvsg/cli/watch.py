"""`rvsg watch`: monitor a robot, and test next what its runs suggest."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rvsg.app.settings import effective
from rvsg.cli.console import as_started, say
from rvsg.cli.frame import verb
from rvsg.cli.options import Jobs, seconds_of, setting_options

app = verb()


@app.command()
@setting_options("simulator", "simulator_options", "stack", "stack_options")
def watch(
    settings: dict[str, Any],
    suite: Annotated[Path, typer.Argument(help="The folder of the suite.")],
    monitor: Annotated[
        Path | None, typer.Option(metavar="DIR", help="A folder of recordings (rosbag2, MCAP), or of campaigns.")
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder of the journal, the log and the plans; an existing one is resumed.")
    ] = Path("runs/watch"),
    cycles: Annotated[int | None, typer.Option(min=1, help="Stop after this many cycles.")] = None,
    duration: Annotated[
        str | None, typer.Option("--for", metavar="TIME", help="Stop after a time, e.g. 90s, 15m or 1h.")
    ] = None,
    every: Annotated[str, typer.Option(metavar="TIME", help="Pause after a cycle with nothing to do.")] = "30s",
    route: Annotated[
        str | None, typer.Option(hidden=True, help="Route of all recordings. [the name of their folder]")
    ] = None,
    rules: Annotated[
        Path | None,
        typer.Option(metavar="FILE", hidden=True, help="What makes a plan legitimate. [SUITE/rules/rules.yaml]"),
    ] = None,
    approve: Annotated[
        str | None, typer.Option(metavar="PLAN", help="Approve a waiting plan or change, and exit.")
    ] = None,
    generator: Annotated[str, typer.Option(help="Generator that writes variants.")] = "heuristic",
    knowledge: Annotated[
        str | None, typer.Option(metavar="FILE|URL", hidden=True, help="The knowledge base. [OUT/knowledge.sqlite]")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, hidden=True, help="Seed of the plans.")] = 0,
    jobs: Jobs = 1,
) -> None:
    """Monitor a robot, and test next what its runs suggest.

    Each cycle has five parts. Monitor reads new runs. Analyse judges them by the requirements of the suite. Plan writes
    scenarios for values near a limit, for untested places and for a new version. Legitimate accepts or refuses each
    plan by declared rules. Execute runs it, stores the result in the knowledge base and adds new failures to the suite.
    OUT/watch.log records what was done and why.
    """
    from rvsg.core.errors import Interrupted
    from rvsg.evaluation.verdict import counted
    from rvsg.watch import watch
    from rvsg.watch.self_adaptation import in_words

    if approve is not None:
        watch.approve(out, approve, on_message=say)
        return
    chosen = effective(None, {}, settings)
    try:
        journal = watch.watch(
            suite,
            monitor,
            out,
            cycles=cycles,
            seconds=None if duration is None else seconds_of("--for", duration),
            every_s=seconds_of("--every", every),
            route=route,
            rules=rules,
            generator=generator,
            simulator=chosen.simulator_spec,
            stack=chosen.stack_spec(),
            knowledge=knowledge,
            seed=seed,
            jobs=jobs,
            on_note=lambda note: say(in_words(note)),
            on_message=say,
        )
    except KeyboardInterrupt:
        command = as_started(f"rvsg watch {suite} --monitor {monitor} --out {out}")
        raise Interrupted(f"Interrupted. Resume with: {command}") from None
    if not journal.seen:
        say(f"{monitor} holds no campaign and no recording (.mcap, .db3, rosbag2) that can be read.")
    done, spent = counted(journal.cycle, "cycle"), counted(journal.spent, "run")
    say(f"{done}, {spent}; the log is {journal.words}")
