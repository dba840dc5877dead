"""`rvsg metrics`: every metric with its formula, unit, direction and source."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rvsg.app.cli import console
from rvsg.app.cli.frame import verb

if TYPE_CHECKING:
    from rvsg.simulation.run import Run

app = verb()


@app.command()
def metrics(
    name: Annotated[str | None, typer.Argument(help="One metric; all where none is named.")] = None,
    run: Annotated[Path | None, typer.Option(help="Measure this run (JSON as `rvsg simulate` writes it).")] = None,
    json: Annotated[bool, typer.Option("--json", help="The list as JSON on standard output.")] = False,
) -> None:
    """List the metrics with formula, unit, direction and source, or measure a run by them."""
    from rvsg.evaluation.metrics import METRICS, measure, metric

    chosen = list(METRICS.values()) if name is None else [metric(name)]
    if run is not None:
        console.print_json(measure(_read(run), [info.id for info in chosen]))
        return
    if json:
        keys = ("id", "title", "unit", "worse", "formula", "source", "series")
        console.print_json([{key: getattr(info, key) for key in keys} for info in chosen])
        return
    for info in chosen:
        worse = "" if info.worse == "neither" else f", worse {info.worse}"
        print(f"{info.id:26} {info.title} [{info.unit}{worse}]\n{'':26} {info.formula}\n{'':26} Source: {info.source}.")


def _read(path: Path) -> Run:
    from rvsg.errors import FileError
    from rvsg.simulation.archive import run_from_json

    try:
        return run_from_json(path.read_bytes())
    except OSError as error:
        raise FileError(path, f"the run cannot be read: {error.strerror}") from None
