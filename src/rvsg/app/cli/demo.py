"""`rvsg demo`: a recorded campaign, run again without a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rvsg.app.cli.console import print_json, say
from rvsg.app.cli.frame import verb

app = verb()


@app.command()
def demo(
    name: Annotated[str | None, typer.Argument(help="The recorded campaign. [the first of --list]")] = None,
    listed: Annotated[bool, typer.Option("--list", help="List the recorded campaigns.")] = False,
    out: Annotated[str | None, typer.Option(help="Folder of the campaign. [runs/demo-NAME]")] = None,
    repeats: Annotated[int | None, typer.Option(min=1, help="Runs of each configuration. [as recorded]")] = None,
    confirmations: Annotated[
        int | None, typer.Option(min=0, help="At most so many fresh runs of the best. [as recorded]")
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Worker processes. [one per core]")] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Stop where the present prompts differ from the recorded ones.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")] = False,
) -> None:
    """Run a shipped campaign from the recorded replies of a vision language model: no model, no key, no network.

    The replies are the recorded ones; reading, checking, simulating, judging and reporting happen now. Where today's
    prompts (with what was measured now) differ from the recorded ones, the first differences are told at the end.
    """
    from rvsg.app.cli.run import run_campaign_of
    from rvsg.app.config import read_campaign_file
    from rvsg.app.demos import CAMPAIGN, demo_folder, demos

    if listed:
        _list(demos(), as_json=json)
        return
    chosen = name or next(iter(demos()))
    folder = demo_folder(chosen)
    given: dict[str, Any] = {"replay": str(folder), "out": out or str(Path("runs") / f"demo-{chosen}")}
    asked = {"repeats": repeats, "confirmations": confirmations, "jobs": jobs}
    given |= {key: value for key, value in asked.items() if value is not None}
    if strict:
        given["generator_options"] = {"strict": True}
    say(f"The recorded campaign {chosen}: the replies are those of a vision language model, the runs are made now.")
    raise typer.Exit(run_campaign_of(read_campaign_file(folder / CAMPAIGN), given, as_json=json))


def _list(found: tuple[str, ...], *, as_json: bool) -> None:
    if as_json:
        print_json(list(found))
    else:
        for name in found:
            typer.echo(name)
