"""`rvsg metrics`: every metric with its formula, unit, direction and source."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli import console
from rvsg.cli.arguments import AsJson
from rvsg.cli.frame import verb

app = verb()


@app.command()
def metrics(
    name: Annotated[str | None, typer.Argument(help="A metric. [all]")] = None,
    run: Annotated[
        Path | None, typer.Option(help="Measure the runs of this file, which `rvsg simulate` wrote.")
    ] = None,
    json: AsJson = False,
) -> None:
    """List the metrics with formula, unit, direction and source, or measure a run by them."""
    from rvsg.evaluation.metrics import metric
    from rvsg.evaluation.metrics.registry import METRICS, measure

    chosen = list(METRICS.values()) if name is None else [metric(name)]
    if run is not None:
        from rvsg.simulation.run_files import read_runs

        measured = [measure(read, [info.id for info in chosen]) for read in read_runs([run])]
        console.print_json(measured[0] if len(measured) == 1 else measured)
        return
    if json:
        keys = ("id", "title", "unit", "worse", "formula", "source", "series")
        console.print_json([{key: getattr(info, key) for key in keys} for info in chosen])
        return
    for info in chosen:
        worse = "" if info.worse == "neither" else f", worse {info.worse}"
        print(f"{info.id:26} {info.title} [{info.unit}{worse}]\n{'':26} {info.formula}\n{'':26} Source: {info.source}.")
