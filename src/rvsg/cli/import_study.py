"""`rvsg import-study`: published results become a store like that of a campaign."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli import console
from rvsg.cli.frame import verb

app = verb()


@app.command()
def import_study(
    folder: Annotated[Path, typer.Argument(help="Root of the results: holds distance/route_1/0, no_req/..., ...")],
    out: Annotated[Path, typer.Option(help="Folder of the store (DIR/ledger.sqlite), or the file itself.")],
    world: Annotated[str, typer.Option(help="The world of the results: its routes and waypoints.")] = "warehouse",
) -> None:
    """Import results in the layout of the published study into a store, with a file of findings beside it.

    Every metric is computed again from the logs and compared with the logged one. What cannot be trusted is not
    imported and listed with its reason; unknown waypoint names are kept and listed.
    """
    from rvsg.api.authoring import load_world
    from rvsg.api.folder import make_folder
    from rvsg.api.study import SqliteLedger, find_campaigns, write_findings
    from rvsg.api.study import import_study as read

    place = load_world(world)
    find_campaigns(folder, [])  # before a store is made for nothing
    store = out if out.suffix in (".sqlite", ".db") else out / "ledger.sqlite"
    make_folder(store.parent)
    findings = store.with_name("findings.csv")
    added_to = store.exists()
    with SqliteLedger(store) as ledger:
        done = read(folder, ledger, place, console.say)
    listed = write_findings(done.findings, findings, keep=added_to)
    kinds = dict(Counter(finding.kind for finding in done.findings))
    console.say(
        f"{done.runs} runs in {done.attempts} attempts of {done.campaigns} campaigns -> {store}\n"
        f"{done.compared} runs compared with their logged metrics: "
        + ("all equal" if done.compared and not done.differing else f"{done.differing} differences")
        + f"\n{len(done.findings)} findings -> {findings}"
        + (f" (with the earlier ones: {listed})" if listed != len(done.findings) else "")
    )
    console.print_json(
        {
            "store": str(store),
            "findings": str(findings),
            "campaigns": done.campaigns,
            "attempts": done.attempts,
            "runs": done.runs,
            "refused": done.refused,
            "compared": done.compared,
            "differing": done.differing,
            "findings_by_kind": kinds,
        }
    )
