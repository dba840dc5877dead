"""`rvsg scenario`: propose, shrink, explore and migrate scenarios, and draft requirements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.model import prompt, propose
from rvsg.cli.options import RERUN, AsJson, FoundRequirement, Jobs, OtherWorld, Prices, Record, setting_options

if TYPE_CHECKING:
    from rvsg.search.smallest_scenario import Shrunk, Simplification


app = verb(no_args_is_help=True, help="Propose, shrink, explore and migrate scenarios.")
app.command()(propose)
app.command()(prompt)


@app.command("requirement")
@setting_options("model", "base_url", "replay", "budget_calls", "budget_usd")
def requirement_(
    settings: dict[str, Any],
    words: Annotated[str, typer.Argument(help="What the robot must do, e.g. 'it stops within 2 s of a contact'.")],
    runs: Annotated[list[Path] | None, typer.Option(metavar="FILE", help="Judge these stored runs by it.")] = None,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Write the accepted requirement.")] = Path("drafted.yaml"),
    record: Record = None,
    prices: Prices = None,
) -> None:
    """Let a vision language model write a requirement from words, and accept it or not.

    RVSG checks that it can be measured, shows it in words, and judges the stored runs that you give: take one that
    should hold and one that should fail. A plot beside --out shows three of them. Nothing else is written before you
    accept.
    """
    from rvsg.app.proposal import draft_requirement, write_requirement
    from rvsg.core.files import write_text
    from rvsg.evaluation.verdict import number, objective
    from rvsg.generation.environment import reach_model
    from rvsg.report.charts import requirement_chart
    from rvsg.simulation.archive import read_runs

    model = settings.pop("model", None)
    drafted = draft_requirement(words, reach_model(model, record, "requirement", settings | {"prices": prices}))
    said = (
        f"{drafted.metric}, worse {drafted.worse}, limit {number(drafted.limit, drafted.unit)}"
        if drafted.metric
        else drafted.formula
    )
    say(
        f"{drafted.title} ({drafted.name}): {drafted.text}\nMeasured by: {said}\n"
        f"Source: {drafted.source or 'none given'}"
    )
    judged = [(run, objective(run, drafted)) for run in read_runs(runs or [])]
    failing = [drafted.violated_by(value) for _, value in judged if value is not None]
    for run, value in judged:
        verdict = "not measured" if value is None else "fails" if drafted.violated_by(value) else "holds"
        say(f"{run.id}: {number(value, drafted.unit)}, {verdict}")
    if chart := requirement_chart(drafted, [run for run, _ in judged]):
        write_text(out.with_suffix(".svg"), chart)
        say(f"Plot: {out.with_suffix('.svg')}")
    if len({*failing}) < 2:
        say("No runs show both, one that holds and one that fails: give such runs with --runs before you trust it.")
    if typer.confirm("Accept", default=False, err=True):
        say(f"Written: {out}. Use it with --requirement {out}#{write_requirement(drafted, out).name}")


@app.command()
def migrate(
    scenario: Annotated[Path, typer.Argument(metavar="FILE", help="A scenario or a proposal as JSON.")],
    world: Annotated[str, typer.Option(help="The world to adapt it to: a shipped world or a world folder.")],
    route: Annotated[str | None, typer.Option(help="Use this route of the world instead of the saved one.")] = None,
    reach: Annotated[float, typer.Option(min=0.0, help="How far a waypoint may move, metres.")] = 1.0,
    repair: Annotated[bool, typer.Option("--repair", help="Repair ways that are barred in the world.")] = False,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="Write the new scenario here; - is standard output.")
    ] = Path("-"),
) -> None:
    """Adapt a scenario to a world that has changed since the scenario was saved.

    Each waypoint becomes the one nearest to its old position. RVSG checks the result before it writes it.
    """
    from rvsg.core.files import check_writable, write_text
    from rvsg.scenario.builder import migrate_scenario, scenario_json

    check_writable(out)
    migrated, changes = migrate_scenario(scenario, world, route=route, reach_m=reach, with_repair=repair)
    for change in changes:
        say(change)
    if not changes:
        say("No waypoint had to be changed.")
    write_text(out, scenario_json(migrated))


@app.command()
@setting_options(*RERUN, as_found=True)
def nearest(
    settings: dict[str, Any],
    scenario: Annotated[Path, typer.Argument(help="A scenario or a proposal as JSON.")],
    requirement: FoundRequirement = None,
    most: Annotated[float, typer.Option(min=0.1, max=20.0, help="The largest change that is tried, m or s.")] = 1.6,
    repeats: Annotated[int, typer.Option(min=1, help="Runs of every change.")] = 4,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first run.")] = 0,
    world: OtherWorld = None,
    jobs: Jobs = 1,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the changed scenario here.")] = None,
    json: AsJson = False,
) -> None:
    """Say how near a scenario is to a violation: the smallest change of one person that violates the requirement.

    A person does everything earlier, later, or nearer to the robot. At least half of the runs have to violate.
    """
    from rvsg.app.saved_scenario import rerun
    from rvsg.core.files import check_writable, write_text
    from rvsg.search.nearest_violation import nearest_violation

    if out is not None:
        check_writable(out)
    again = rerun(scenario, settings, requirement=requirement, world=world, on_message=say)
    near = nearest_violation(
        again.scenario, again.requirement, most=most, repeats=repeats, seed=seed, jobs=jobs, simulator=again.simulator,
        world=again.world, on_message=say,
    )  # fmt: skip
    for change in near.changes:
        say(f"- {change}")
    say(str(near))
    if out is not None and near.changes:
        write_text(out, again.json(near.changes[0].scenario))
    if json:
        print_json(near.model_dump(mode="json"))


@app.command()
@setting_options(*RERUN, as_found=True)
def shrink(
    settings: dict[str, Any],
    scenario: Annotated[Path, typer.Argument(help="A scenario or a proposal as JSON; - is standard input.")],
    requirement: FoundRequirement = None,
    repeats: Annotated[int, typer.Option(min=1, help="Runs of every simpler scenario.")] = 12,
    confirmations: Annotated[int, typer.Option(min=1, help="Confirmation runs of the original and the smallest.")] = 20,
    keep: Annotated[float, typer.Option(min=0.01, max=1.0, help="Share of the violations that must stay.")] = 0.8,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
    world: OtherWorld = None,
    jobs: Jobs = 1,
    out: Annotated[Path, typer.Option(help="Write the smallest scenario here; - is standard output.")] = Path("-"),
    json: Annotated[bool, typer.Option("--json", help="Print every step as JSON on standard output.")] = False,
) -> None:
    """Find the smallest scenario that violates a requirement about as often.

    RVSG removes people, tasks, pauses and delays one by one as long as the violations stay. What is left explains the
    violation. Confirmation runs with new seeds show how often the original and the smallest scenario violate it.
    """
    import rvsg
    from rvsg.app.saved_scenario import rerun
    from rvsg.core.files import check_writable, write_text

    check_writable(out)
    again = rerun(scenario, settings, requirement=requirement, world=world, on_message=say)
    shrunk = rvsg.shrink(
        again.scenario,
        again.requirement,
        repeats=repeats,
        confirmations=confirmations,
        keep=keep,
        seed=seed,
        jobs=jobs,
        simulator=again.simulator,
        world=again.world,
        on_step=_show_step,
        on_message=say,
    )
    _show(shrunk)
    if json:
        print_json(shrunk.model_dump(mode="json"))
    else:
        write_text(out, again.json(shrunk.smallest))


def _show_step(step: Simplification) -> None:
    from rvsg.evaluation.verdict import counted

    violated = f"violated in {step.violations} of {counted(step.runs, 'run')}"
    say(f"{'kept' if step.kept else 'no  '}  {violated}: {step.what}")


def _show(shrunk: Shrunk) -> None:
    """Print the size of the original and of the smallest scenario, how often each violates, and whether that holds."""
    from rvsg.evaluation.verdict import counted

    for name, people, verdict in (
        ("original", shrunk.original.people, shrunk.before),
        ("smallest", shrunk.smallest.people, shrunk.after),
    ):
        tasks = sum(len(human.tasks) for human in people.humans)
        say(
            f"{name}: {counted(len(people.humans), 'human')}, {counted(tasks, 'task')}; {verdict.requirement} violated "
            f"in {verdict.violations} of {counted(verdict.runs, 'confirmation run')}"
        )
    if 2 * shrunk.after.violations < shrunk.before.violations:
        say("The smallest violates less than half as often: use the original, or raise --repeats.")


@app.command()
@setting_options(*RERUN, as_found=True)
def explore(
    settings: dict[str, Any],
    scenario: Annotated[Path, typer.Argument(help='A scenario as JSON; a number of a person may be "0.8 to 1.4".')],
    requirement: FoundRequirement = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(metavar="PERSON.KEY=LOW to HIGH", help="A range, e.g. 'Human 1.speed_m_s=0.8 to 1.4'."),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, max=100_000, help="Points of the Latin hypercube, one run each.")] = 60,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the points and the runs.")] = 0,
    world: OtherWorld = None,
    jobs: Jobs = 1,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a page (.html), the picture (.svg) or .json.")
    ] = None,
    worst: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the worst point as a scenario.")] = None,
    json: AsJson = False,
) -> None:
    """Run a scenario with ranges, and show where in them it violates a requirement and which range matters.

    The points are a Latin hypercube over the ranges. A logistic surface through the runs gives the violation
    probability, its boundary, and the sensitivity to each range.
    """
    from rvsg.app.saved_scenario import rerun
    from rvsg.core.files import check_writable, write_text
    from rvsg.report.comparison_page import check_exploration_file, write_exploration
    from rvsg.report.terminal import describe_exploration
    from rvsg.search.exploration import explore as run_points

    if out is not None:
        check_exploration_file(out)
    if worst is not None:
        check_writable(worst)
    again = rerun(scenario, settings, requirement=requirement, world=world, vary=vary or (), on_message=say)
    assert again.family is not None
    exploration = run_points(
        again.family,
        again.requirement,
        runs=runs,
        seed=seed,
        jobs=jobs,
        simulator=again.simulator,
        world=again.world,
        on_message=say,
    )
    if out is not None:
        write_exploration(out, exploration)
    if worst is not None:
        write_text(worst, again.json(exploration.worst_scenario))
    if json:
        print_json(exploration.model_dump(mode="json"))
    else:
        say(describe_exploration(exploration))
