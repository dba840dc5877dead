"""`rvsg import study`: import published results into a store."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli import console
from rvsg.cli.frame import verb
from rvsg.core.files import make_folder

app = verb(no_args_is_help=True, help="Read people of HuNavSim, or results of the published study.")


@app.callback()
def _several() -> None:
    """Read people of HuNavSim, or results of the published study."""


@app.command("study")
def import_study(
    folder: Annotated[Path, typer.Argument(help="Root of the results, with distance/route_1/0, no_req/..., ...")],
    out: Annotated[Path, typer.Option(help="Folder of the store (DIR/ledger.sqlite), or the file itself.")],
    world: Annotated[str, typer.Option(help="The world of the results: its routes and waypoints.")] = "warehouse",
) -> None:
    """Import results in the layout of the published study into a store, and write a file of findings beside it.

    Every metric is computed again from the logs and compared with the logged value. Data that cannot be trusted is
    listed with the reason and not imported. Unknown waypoint names are listed and kept.
    """
    from rvsg.scenario.world_lookup import as_world
    from rvsg.store.sqlite import SqliteLedger
    from rvsg_study import import_study as study

    place = as_world(world)
    study.find_campaigns(folder, [])  # before a store is made for nothing
    store = out if out.suffix in (".sqlite", ".db") else out / "ledger.sqlite"
    make_folder(store.parent)
    added_to = store.exists()
    with SqliteLedger(store) as ledger:
        done = study.import_study(folder, ledger, place, console.say)
    findings = store.with_name("findings.csv")
    listed = study.write_findings(done.findings, findings, keep=added_to)
    count = len(done.findings)
    console.say(
        f"{done.runs} runs in {done.attempts} attempts of {done.campaigns} campaigns -> {store}\n"
        f"{done.compared} runs compared with their logged metrics: "
        + ("all equal" if done.compared and not done.differing else f"{done.differing} differences")
        + f"\n{count} findings -> {findings}"
        + (f" (with the earlier ones: {listed})" if listed != count else "")
    )
    counts = {name: value for name, value in vars(done).items() if name != "findings"}
    by_kind = Counter(finding.kind for finding in done.findings)
    console.print_json({"store": str(store), "findings": str(findings), **counts, "findings_by_kind": dict(by_kind)})
