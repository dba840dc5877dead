"""`rvsg propose`: one proposal from a generator, as a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rvsg.cli.arguments import Requirement
from rvsg.cli.console import say
from rvsg.cli.frame import verb

if TYPE_CHECKING:
    from rvsg.app.wiring import Wired
    from rvsg.generation.generator import Proposal

app = verb()
OWN = ("feedback", "unguided", "record", "generator_option", "out")
"""Options that are not settings of a campaign."""


@app.command()
def propose(
    world: Annotated[str, typer.Option(help="A shipped world or a world folder.")] = "warehouse",
    route: Annotated[str, typer.Option(help="A route of the world.")] = "route_1",
    requirement: Requirement = "R1",
    robot: Annotated[str, typer.Option(help="A shipped robot (`rvsg robots`) or a robot file.")] = "tiago_omni",
    generator: Annotated[str | None, typer.Option(help="heuristic, random, vlm. [heuristic]")] = None,
    humans: Annotated[int, typer.Option(min=1, max=100, help="People in the scenario.")] = 2,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
    feedback: Annotated[
        Path | None, typer.Option(help="Refine with this feedback, which `rvsg evaluate --feedback` wrote.")
    ] = None,
    unguided: Annotated[bool, typer.Option("--unguided", help="Do not tell the generator the requirement.")] = False,
    model: Annotated[str | None, typer.Option(help="VLM, e.g. openai-chat:gpt-4.1.")] = None,
    base_url: Annotated[str | None, typer.Option(help="Address of an OpenAI-compatible server.")] = None,
    conversation: Annotated[str, typer.Option(help="compact or study.")] = "compact",
    prompts: Annotated[str | None, typer.Option(help="Folder of prompt templates that replace ours.")] = None,
    replay: Annotated[str | None, typer.Option(help="Answer from these recordings, without a model.")] = None,
    record: Annotated[str | None, typer.Option(help="Folder to record the model's calls in. [runs/proposals]")] = None,
    budget_usd: Annotated[float | None, typer.Option(help="Limit on the cost of the calls in --record.")] = None,
    budget_calls: Annotated[int | None, typer.Option(help="Limit on the calls in --record.")] = None,
    budget_tokens: Annotated[int | None, typer.Option(help="Limit on the tokens in --record.")] = None,
    generator_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the generator.")] = None,
    out: Annotated[Path, typer.Option(help="Write the proposal here; - is standard output.")] = Path("-"),
) -> None:
    """Ask a generator for one scenario, and show what the checker found.

    Writes the proposal as JSON; `rvsg simulate` reads it. With --feedback the proposal refines an earlier scenario.
    """
    given = {name: value for name, value in locals().items() if name not in OWN}
    from rvsg.app.proposal import proposal_json, propose_as
    from rvsg.app.settings import effective
    from rvsg.app.wiring import wire
    from rvsg.cli.model_options import CallsShown
    from rvsg.cli.options import pairs
    from rvsg.core.documents import read_record
    from rvsg.core.outputs import check_writable, write_text
    from rvsg.scenario.brief import Feedback

    check_writable(out)
    given |= {"out": record or "runs/proposals", "generator_options": pairs("generator", generator_option)}
    wired = wire(effective(None, {}, given))
    learned = read_record(feedback, Feedback) if feedback else None
    with CallsShown(wired.generator.watch):
        proposal = propose_as(wired, unguided=unguided, feedback=learned)
    write_text(out, proposal_json(proposal))
    _show(wired, proposal)


def _show(wired: Wired, proposal: Proposal) -> None:
    """Print what the checker found, and what the calls of a model cost."""
    from rvsg.report.terminal import describe_calls, describe_proposal, describe_unusable

    for line in describe_proposal(proposal, wired.world):
        say(line)
    if proposal.calls:
        say(describe_calls(proposal.calls))
        if unusable := describe_unusable(proposal.calls):
            say(unusable)
        if wired.config.replay is None:
            say(f"Recorded in {wired.config.folder / 'vlm'}")
        for note in wired.generator.notes:
            say(note)
    if proposal.scenario is None:
        say("The generator wrote no scenario.")
