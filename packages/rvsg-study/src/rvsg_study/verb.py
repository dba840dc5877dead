"""`rvsg import-study`: import published results into a store."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli import console
from rvsg.cli.frame import verb

app = verb()


@app.command()
def import_study(
    folder: Annotated[Path, typer.Argument(help="Root of the results, with distance/route_1/0, no_req/..., ...")],
    out: Annotated[Path, typer.Option(help="Folder of the store (DIR/ledger.sqlite), or the file itself.")],
    world: Annotated[str, typer.Option(help="The world of the results: its routes and waypoints.")] = "warehouse",
) -> None:
    """Import results in the layout of the published study into a store, and write a file of findings beside it.

    Every metric is computed again from the logs and compared with the logged value. Data that cannot be trusted is
    listed with the reason and not imported. Unknown waypoint names are listed and kept.
    """
    from rvsg_study.importing import import_study as read

    done = read(folder, out, world=world, on_message=console.say)
    count = sum(done.findings_by_kind.values())
    console.say(
        f"{done.runs} runs in {done.attempts} attempts of {done.campaigns} campaigns -> {done.store}\n"
        f"{done.compared} runs compared with their logged metrics: "
        + ("all equal" if done.compared and not done.differing else f"{done.differing} differences")
        + f"\n{count} findings -> {done.findings}"
        + (f" (with the earlier ones: {done.listed})" if done.listed != count else "")
    )
    console.print_json(done.model_dump(mode="json", exclude={"listed"}))
