"""`rvsg demo`: a recorded campaign, run again without a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

if TYPE_CHECKING:
    from rvsg.api.events import Plan
    from rvsg.api.words import Summary

app = verb()


@app.command()
def demo(
    name: Annotated[str | None, typer.Argument(help="The recorded campaign. [the first of --list]")] = None,
    listed: Annotated[bool, typer.Option("--list", help="List the recorded campaigns.")] = False,
    out: Annotated[str | None, typer.Option(help="Folder of the campaign. [runs/demo-NAME]")] = None,
    repeats: Annotated[int | None, typer.Option(min=1, help="Runs of each configuration. [as recorded]")] = None,
    confirmations: Annotated[int | None, typer.Option(min=0, help="Budget of confirmation runs. [as recorded]")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Worker processes. [one per core]")] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Stop where the present prompts differ from the recorded ones.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")] = False,
) -> None:
    """Run a shipped campaign from the recorded replies of a vision language model: no model, no key, no network.

    The replies are the recorded ones; reading, checking, simulating, judging and reporting happen now. Where today's
    prompts differ from the recorded ones, the first differences are listed at the end, and where the simulator measures
    otherwise than then.
    """
    from rvsg.api.config import read_campaign_file
    from rvsg.api.demos import CAMPAIGN, demo_folder, demos
    from rvsg.cli.run import run_campaign_of

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
    from_file = read_campaign_file(folder / CAMPAIGN)
    raise typer.Exit(run_campaign_of(from_file, given, as_json=json, remark=what_it_means))


def what_it_means(plan: Plan, summary: Summary) -> str:
    """What the verdict says, and what it does not, in words for somebody who sees one for the first time."""
    from rvsg.api.words import Status, counted, number, still_open

    confirmed, name = summary.confirmed, plan.requirement.name
    tried = "the model's " + (counted(len(summary.ranking), "scenario") if len(summary.ranking) != 1 else "scenario")
    worst = f"the worst of {tried}" if len(summary.ranking) != 1 else tried
    verdict = confirmed.verdict if confirmed is not None else None
    if verdict is None:
        return (
            f"What it means: the search ranked {tried}; nothing was confirmed, so the values above are "
            "those selected for being bad, and overstate it. --confirmations 20 confirms the first."
        )
    runs = counted(verdict.runs, "confirmation run")
    limit = number(plan.requirement.limit, plan.requirement.unit) if plan.requirement.limit is not None else "its limit"
    said = {
        Status.PASS: (
            f"in {runs} of the scenario that was worst in the search the robot kept {name} ({limit}). That is about "
            f"this scenario alone: {tried} did not break the requirement. It does not show that no scenario can"
        ),
        Status.FAIL: (
            f"{worst} makes the robot violate {name} ({limit}) reliably, in {verdict.violations} of "
            f"{runs}: a weakness to look at. The report replays the runs"
        ),
        Status.FLAKY: (
            f"{worst} makes the robot violate {name} ({limit}) in some runs, {verdict.violations} of "
            f"{verdict.runs}, and not in others. The report replays them"
        ),
    }
    between = "always and sometimes" if still_open(verdict) else "always, sometimes and never"
    unsure = (
        f"{worst} violated {name} ({limit}) in {verdict.violations} of {runs}, which does not decide between "
        f"{between}. More --confirmations can"
    )
    return f"What {verdict.status.value} means: {said.get(verdict.status, unsure)}."


def _list(found: tuple[str, ...], *, as_json: bool) -> None:
    if as_json:
        print_json(list(found))
    else:
        for name in found:
            typer.echo(name)
