"""`rvsg propose`: one proposal from a generator, as a file."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def propose(
    world: Annotated[str, typer.Option(help="A shipped world or a world folder.")] = "warehouse",
    route: Annotated[str, typer.Option(help="A route of the world.")] = "route_1",
    requirement: Annotated[str, typer.Option(help="A shipped requirement, or FILE.yaml#NAME.")] = "R1",
    generator: Annotated[str | None, typer.Option(help="heuristic, random, vlm. [heuristic]")] = None,
    humans: Annotated[int, typer.Option(min=1, max=100, help="People in the scenario.")] = 2,
    seed: Annotated[int, typer.Option(min=0, help="Everything random follows from it.")] = 0,
    feedback: Annotated[
        Path | None, typer.Option(help="Refine from this feedback, as `rvsg evaluate --feedback` writes it.")
    ] = None,
    unguided: Annotated[bool, typer.Option("--unguided", help="Tell the generator of no requirement.")] = False,
    model: Annotated[str | None, typer.Option(help="VLM, e.g. openai-chat:gpt-4.1.")] = None,
    base_url: Annotated[str | None, typer.Option(help="Address of an OpenAI-compatible server.")] = None,
    conversation: Annotated[str, typer.Option(help="compact or study.")] = "compact",
    prompts: Annotated[str | None, typer.Option(help="Folder of prompt templates that replace ours.")] = None,
    replay: Annotated[str | None, typer.Option(help="Answer from these recordings, without a model.")] = None,
    record: Annotated[str | None, typer.Option(help="Folder to record the model's calls in. [runs/proposals]")] = None,
    budget_usd: Annotated[float | None, typer.Option(help="Stop before the calls in --record cost more.")] = None,
    budget_calls: Annotated[int | None, typer.Option(help="Stop before more calls in --record.")] = None,
    budget_tokens: Annotated[int | None, typer.Option(help="Stop before more tokens in --record.")] = None,
    generator_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the generator.")] = None,
    out: Annotated[Path, typer.Option(help="Where the proposal is written; - is standard output.")] = Path("-"),
) -> None:
    """Ask a generator for one scenario, and show what the checker said.

    Writes the proposal as JSON; `rvsg simulate` reads it. With --feedback the proposal refines an earlier scenario.
    """
    from rvsg.api.config import effective
    from rvsg.api.record_files import check_writable, read_record, write_text
    from rvsg.api.wiring import wire
    from rvsg.cli.model_options import CallsShown, told_calls, told_from_record, told_unusable
    from rvsg.cli.options import pairs
    from rvsg.scenario.brief import Brief, Feedback
    from rvsg.scenario.validity import warnings

    check_writable(out)
    given = {
        "world": world,
        "route": route,
        "requirement": requirement,
        "generator": generator,
        "humans": humans,
        "seed": seed,
        "model": model,
        "base_url": base_url,
        "conversation": conversation,
        "prompts": prompts,
        "replay": replay,
        "budget_usd": budget_usd,
        "budget_calls": budget_calls,
        "budget_tokens": budget_tokens,
        "out": record or "runs/proposals",
        "generator_options": pairs("generator", generator_option),
    }
    wired = wire(effective(None, {}, given))
    told = read_record(feedback, Feedback) if feedback else None
    brief = Brief(
        mission=wired.plan.mission,
        requirement=None if unguided else wired.plan.requirement,
        kind="refine" if told else "new",
        humans=humans,
        seed=seed,
        configuration_index=1 if told else 0,
        feedback=told,
    )
    wiring = getattr(wired.generator, "wiring", None)
    with CallsShown(wiring) if wiring is not None else contextlib.nullcontext():
        proposal = wired.generator.propose(brief, wired.world)
    write_text(out, proposal.to_json())
    if proposal.scenario is not None:
        say(proposal.scenario.description or "(no description)")
    say(f"{proposal.generator}: {_checked(len(proposal.first_findings), proposal.corrections)}")
    for finding in proposal.first_findings:
        say(f"  found: {finding}")
    for repair in proposal.repairs:
        say(f"  repaired: {repair.human}, {repair.task}: {repair.what}")
    for problem in proposal.problems:
        say(f"  left: {problem}")
    if proposal.scenario is not None:
        for doubtful in warnings(proposal.scenario.people, proposal.scenario.mission, wired.world):
            say(f"  warning: {doubtful}")
    if proposal.calls:
        say(told_calls(proposal.calls))
        if unusable := told_unusable(proposal.calls):
            say(unusable)
        if replay is None:
            say(f"Recorded in {wired.config.folder / 'vlm'}")
        if earlier := (told_from_record(wiring) if wiring is not None else None):
            say(earlier)
        for note in getattr(wired.generator, "notes", ()):
            say(note)
    if proposal.scenario is None:
        say("No scenario came of it.")


def _checked(findings: int, corrections: int) -> str:
    if not findings:
        return "valid as first answered"
    return f"{findings} findings in the first answer, {corrections} corrections asked for"
