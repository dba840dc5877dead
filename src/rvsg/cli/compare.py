"""`rvsg compare`: generators and strategies at an equal number of runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rvsg.cli import console
from rvsg.cli.arguments import JobsPerCore
from rvsg.cli.frame import verb

if TYPE_CHECKING:
    from rvsg.app.search_methods import Row

app = verb()
SETTINGS = (
    *("world", "simulator", "humans", "budget_runs", "jobs"),
    *("budget_calls", "budget_tokens", "budget_usd", "model", "base_url"),
)
"""Options that are settings of every campaign."""


@app.command()
def compare(
    methods: Annotated[
        str, typer.Option(help="Methods as generator:strategy, separated by commas. The first is compared with all.")
    ] = "heuristic:hybrid,heuristic:study,heuristic:unguided,random:random",
    routes: Annotated[str, typer.Option(help="Routes, separated by commas.")] = "route_1",
    requirements: Annotated[str, typer.Option(help="Requirements by name or file, separated by commas.")] = "R1",
    world: Annotated[str, typer.Option(help="World by name or folder.")] = "warehouse",
    simulator: Annotated[str, typer.Option(help="Simulator.")] = "embedded",
    humans: Annotated[int, typer.Option(min=1, max=100, help="People in every scenario.")] = 2,
    seeds: Annotated[int, typer.Option(min=1, max=1000, help="Campaigns for each method, route and requirement.")] = 3,
    first_seed: Annotated[int, typer.Option(min=0, help="Seed of the first campaign.")] = 0,
    budget_runs: Annotated[int, typer.Option(min=10, help="Runs of each search.")] = 250,
    budget_calls: Annotated[int | None, typer.Option(help="Calls of the generator in each search, at most.")] = None,
    budget_tokens: Annotated[int | None, typer.Option(help="Tokens in each search, at most.")] = None,
    budget_usd: Annotated[float | None, typer.Option(help="Limit on the cost of the calls in each search.")] = None,
    model: Annotated[str | None, typer.Option(help="Model of the generator vlm, e.g. openai-chat:gpt-4.1.")] = None,
    base_url: Annotated[str | None, typer.Option(help="Address of an OpenAI-compatible server.")] = None,
    jobs: JobsPerCore = None,
    json: Annotated[
        Path | None, typer.Option(help="File for the rows. Give the same file again to resume or to add more.")
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="SVG file of the curves.")] = None,
) -> None:
    """Compare methods at an equal number of runs, over routes, requirements and seeds.

    Every search gets the same number of runs. Its best configuration then gets 20 confirmation runs, other
    candidates up to 60 more; failures are grouped. The table shows means over seeds; A12 is the
    probability that a campaign of the first method confirms a worse value for the robot than one of the other (0.5: no
    difference), with p values of the Mann-Whitney test after Holm's correction.
    """
    settings = {name: value for name, value in locals().items() if name in SETTINGS}
    from rvsg.app import search_methods as comparing
    from rvsg.app.settings import effective

    base = effective(None, {}, settings)
    rows = comparing.read_rows(json) if json else []

    def report(row: Row) -> None:
        rows.append(row)
        if json:
            comparing.write_rows(json, rows)
        console.say(_line(row))

    asked = methods.split(",")
    found = comparing.run_comparison(
        base,
        asked,
        routes.split(","),
        requirements.split(","),
        range(first_seed, first_seed + seeds),
        rows=tuple(rows),
        report=report,
    )
    _print_tables(found, asked[0], base)
    if figure:
        comparing.write_figure(figure, found)
        console.say(f"Wrote {figure}")
    if json is None:
        console.print_json([row.model_dump(mode="json") for row in found])


def _line(row: Row) -> str:
    return (
        f"{row.method} {row.route} {row.requirement} seed {row.seed}: confirmed {_text(row.confirmed_mean)}, "
        f"violated in {_text(row.violation_probability)} of the confirmation runs, "
        f"{row.distinct_failures} distinct failures"
    )


def _print_tables(rows: list[Row], first: str, base: Any) -> None:
    """Print the means of every method, and the first method against each other one."""
    from rich.table import Table

    from rvsg.app import search_methods as comparing

    means = comparing.table(rows)
    for title, left_out in (("Means over seeds", DIVERSITY), ("Diversity of what was found", RESULTS)):
        keys = [key for key in means[0] if key not in left_out]
        table = Table(title=title, title_justify="left", pad_edge=False)
        for key in keys:
            table.add_column(key, justify="left" if key in CELL else "right")
        for line in means:
            table.add_row(*(line[key] if key in CELL else _text(line[key]) for key in keys))
        console.say(table)
    contrasts = comparing.contrasts(rows, first)
    if not contrasts:
        return
    table = Table(title=f"{first} against the others", title_justify="left", pad_edge=False)
    for key in ("route", "requirement", "against", "A12", "p (Holm)", "failures ratio"):
        table.add_column(key, justify="left" if key in ("route", "requirement", "against") else "right")
    for contrast in contrasts:
        numbers = (contrast.value.a12, contrast.value.p_holm, contrast.failures)
        table.add_row(contrast.route, contrast.requirement, contrast.against, *map(_text, numbers))
    console.say(table)


CELL = ("route", "requirement", "method")
RESULTS = ("seeds", "confirmed", "violation", "failures", "runs", "calls", "usd")
DIVERSITY = ("cells", "sdd", "htd", "ssd")


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
