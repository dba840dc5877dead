"""Tuning: `rvsg tune`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from rvsg.cli.console import as_started, console, print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.options import AsJson, JobsPerCore, setting_options

if TYPE_CHECKING:
    from rvsg.tune.parameter_search import ParameterSearch

app = verb(no_args_is_help=True)
Optimiser = Literal["tpe", "cmaes", "nsga2"]
Tries = Literal["parameters", "zones"]


@app.command()
@setting_options("stack", "stack_options", "seed")
def tune(
    settings: dict[str, Any],
    suite: Annotated[Path, typer.Argument(help="The folder of the suite.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of the tuning; the same one resumes. [runs/tune-SUITE]")
    ] = None,
    parameters: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Narrow, fix or add parameters (YAML).")
    ] = None,
    tries: Annotated[
        Tries, typer.Option("--try", help="Values of parameters, or zones of Nav2's filters where the stack fails.")
    ] = "parameters",
    robot: Annotated[
        str | None, typer.Option(help="Drive every case with this robot: a shipped one or a file.")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(metavar="CASE", hidden=True, help="Only this case; repeatable.")
    ] = None,
    budget_runs: Annotated[int, typer.Option(min=1, help="Runs of the search at most; checks come on top.")] = 3000,
    budget_minutes: Annotated[
        float | None, typer.Option(min=0.1, help="End the search earlier; checks come on top.")
    ] = None,
    optimiser: Annotated[Optimiser, typer.Option(hidden=True, help="Optimiser of Optuna.")] = "tpe",
    more_time: Annotated[
        float, typer.Option(min=0.0, max=10.0, hidden=True, help="Largest share of more time.")
    ] = 0.05,
    check_runs: Annotated[
        int, typer.Option(min=2, hidden=True, help="Runs of each case that check the proposal.")
    ] = 10,
    attack_runs: Annotated[
        int,
        typer.Option(min=0, help="Runs, on top, of each of two searches: against the stack before and after; 0: none."),
    ] = 150,
    choose: Annotated[int | None, typer.Option(help="Propose this setting of the front.")] = None,
    jobs: JobsPerCore = None,
    json: AsJson = False,
) -> None:
    """Find parameters of a stack that fail less on a suite, and check them on scenarios they were not tuned on.

    The folder holds the changed parameter file, a page, tuning.json, and every run. The same command resumes.
    """
    from rvsg.app.settings import effective
    from rvsg.app.wiring import jobs_of
    from rvsg.simulation.stacks.stack_choice import DEFAULT_STACK
    from rvsg.tune.tuner import PAGE, Tuner
    from rvsg.tune.tuning_page import headline, result_lines

    chosen = effective(None, {}, {**settings, "jobs": jobs})
    folder = out or Path("runs") / f"tune-{suite.resolve().name}"
    tuning = Tuner(
        suite=suite,
        stack=chosen.stack or DEFAULT_STACK,
        stack_options=chosen.stack_options,
        out=folder,
        narrowing=parameters,
        tries=tries,
        robot=robot,
        only=only or (),
        optimiser=optimiser,
        more_time=more_time,
        budget_runs=budget_runs,
        budget_minutes=budget_minutes,
        check_runs=check_runs,
        attack_runs=attack_runs,
        choose=choose,
        seed=chosen.seed,
        jobs=jobs_of(chosen),
        on_message=say,
        on_search=_Shown(budget_runs).show,
    ).run()
    if json:
        print_json(tuning.model_dump(mode="json"))
        return
    say(headline(tuning))
    for line in result_lines(tuning):
        say(f"  {line}")
    say(f"  open  {folder / PAGE}")
    for command in tuning.commands[:1]:
        say(f"  next  {as_started(command)}")


class _Shown:
    """Says how far a search is: on a terminal after every batch, else at every tenth of the runs."""

    def __init__(self, budget: int) -> None:
        self.budget, self.begun, self.tenth = budget, time.monotonic(), -1

    def show(self, search: ParameterSearch) -> None:
        from rvsg.tune.tuning_page import search_text

        tenth = 10 * search.spent // self.budget
        if not console().is_terminal and tenth == self.tenth:
            return
        self.tenth = tenth
        say(f"  search: {search_text(search, self.budget, time.monotonic() - self.begun)}")
