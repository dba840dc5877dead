"""`rvsg evaluate`: runs become measurements and a verdict."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def evaluate(
    runs: Annotated[list[Path], typer.Argument(help="Files of runs, as `rvsg simulate` writes them; - is stdin.")],
    requirement: Annotated[str, typer.Option(help="A shipped requirement, or FILE.yaml#NAME.")] = "R1",
    scenario: Annotated[Path | None, typer.Option(help="The scenario of the runs; --feedback needs it.")] = None,
    feedback: Annotated[
        Path | None, typer.Option(help="Write what a generator should be told, for `rvsg propose --feedback`.")
    ] = None,
    fail_on_violation: Annotated[
        bool, typer.Option("--fail-on-violation", help="Exit code 1 if the requirement is violated.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")] = False,
) -> None:
    """Measure runs of one scenario by every metric, and judge them by a requirement."""
    from rvsg.api.record_files import check_writable, once, read_runs, read_scenario, write_text
    from rvsg.api.wiring import requirement_of, world_of
    from rvsg.campaign.attempt import Attempt
    from rvsg.campaign.feedback import feedback_of
    from rvsg.campaign.measuring import Measuring
    from rvsg.core.errors import InputError
    from rvsg.evaluation.judge import DEFAULT, next_repeats, violated
    from rvsg.generation.generator import Proposal
    from rvsg.report.summary import interval, number, status_in_words
    from rvsg.scenario.brief import Brief

    asked = requirement_of(requirement)
    if feedback is not None:
        check_writable(feedback)
    given = read_runs(runs)
    found = once(given)
    if len(found) < len(given):
        say(f"{len(given) - len(found)} of {len(given)} runs are given twice and count once.")
    asked = asked.for_time_limit(found[0].time_limit_s) if found else asked
    if len({run.scenario_id for run in found}) > 1:
        raise InputError("The runs are of different scenarios; a verdict is on one. Evaluate them one by one.")
    measuring = Measuring(asked)
    measurements = tuple(measuring.measure(run) for run in found)
    verdict = measuring.judge(measurements)
    if feedback is not None:
        if scenario is None:
            raise InputError("--feedback needs the scenario of the runs: add --scenario FILE.")
        known = read_scenario(scenario)
        if known.id != found[0].scenario_id:
            raise InputError(f"{scenario}: the runs are of another scenario ({found[0].scenario_id}, not {known.id}).")
        attempt = Attempt(
            campaign="by hand",
            index=0,
            strategy="by hand",
            brief=Brief(mission=known.mission, requirement=asked, seed=0, humans=len(known.people.humans)),
            proposal=Proposal(generator="by hand", scenario=known),
            measurements=measurements,
            verdict=verdict,
        )
        if verdict.mean is None:
            raise InputError("None of the runs has a value of the objective, so there is nothing to tell.")
        told = feedback_of(attempt, found, requirement=asked, grid=world_of(known, None).grid)
        write_text(feedback, told.to_json())
    more = next_repeats(asked, [measured.objective for measured in measurements])
    if json:
        print_json(
            {
                "requirement": asked.model_dump(mode="json"),
                "verdict": verdict.model_dump(mode="json"),
                "next_repeats": more,
                "measurements": [m.model_dump(mode="json") for m in measurements],
            }
        )
    for measured in measurements:
        say(f"seed {measured.seed}: {number(measured.objective, asked.unit)}, {measured.outcome}")
    say(f"{asked.name} {asked.title}: {status_in_words(verdict)}; {interval(verdict, asked.unit)}. {verdict.reason}")
    if more:
        left = DEFAULT.max_runs - len(measurements)
        fewest = DEFAULT.fewest_for(verdict.violations, verdict.runs).items()
        each = ", ".join(f"{count} for {status.value}" for status, count in fewest if count <= left)
        can = f"More runs can decide it: at least {each}" if each else f"{left} more cannot decide it"
        say(f"{can} (budget: {DEFAULT.max_runs} in all).")
    if fail_on_violation and violated(verdict):
        raise typer.Exit(1)
