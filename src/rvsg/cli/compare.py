"""`rvsg compare`: generators and strategies at an equal number of runs."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

import rvsg
from rvsg.cli.arguments import JobsPerCore
from rvsg.cli.frame import verb
from rvsg.core.errors import InputError

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
    from rvsg.app.settings import effective

    seeds_asked = range(first_seed, first_seed + seeds)
    lists = (names.split(",") for names in (methods, routes, requirements))
    _benchmark().compare_methods(effective(None, {}, settings), *lists, seeds_asked, json=json, figure=figure)


def _benchmark() -> Any:
    """Return the module of the benchmark, which lies beside the source and in no package."""
    path = Path(rvsg.__file__).parents[2] / "benchmarks" / "search_methods.py"
    spec = importlib.util.spec_from_file_location("search_methods", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise InputError(f"{path} is missing: `rvsg compare` needs a checkout of the source.")
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
