"""Commands that talk to a generator or a model: `rvsg scenario propose` and `prompt`, `rvsg world describe`."""

from __future__ import annotations

import contextlib
import datetime
import os
import shlex
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rvsg.app.settings import effective
from rvsg.cli.console import as_started, print_json, say
from rvsg.cli.options import AsJson, CallsShown, CallTimeout, Prices, Record, Strict, setting_options

if TYPE_CHECKING:
    from rvsg.app.wiring import Wired
    from rvsg.generation.environment import EnvironmentSession
    from rvsg.generation.generator import Proposal
    from rvsg.generation.vlm.access import CallNews, ModelAccess
    from rvsg.world.world import Description


PROPOSED = (
    *("world", "route", "requirement", "robot", "generator", "generator_options", "humans", "seed"),
    *("model", "base_url", "conversation", "prompts", "replay", "budget_usd", "budget_calls", "budget_tokens"),
)


@setting_options(*PROPOSED)
def propose(
    settings: dict[str, Any],
    feedback: Annotated[
        Path | None, typer.Option(help="Refine with this feedback, which `rvsg evaluate --feedback` wrote.")
    ] = None,
    unguided: Annotated[bool, typer.Option("--unguided", help="Do not tell the generator the requirement.")] = False,
    record: Annotated[str | None, typer.Option(help="Folder to record the model's calls in. [runs/proposals]")] = None,
    out: Annotated[Path, typer.Option(help="Write the proposal here; - is standard output.")] = Path("-"),
) -> None:
    """Ask a generator for one scenario, and show what the checker found.

    Writes the proposal as JSON; `rvsg simulate` reads it. With --feedback the proposal refines an earlier scenario.
    """
    from rvsg.app.proposal import propose_as
    from rvsg.app.wiring import wire
    from rvsg.core.documents import read_record
    from rvsg.core.files import check_writable, write_text
    from rvsg.generation.generator import proposal_json
    from rvsg.scenario.brief import Feedback

    check_writable(out)
    wired = wire(effective(None, {}, settings | {"out": record or "runs/proposals"}))
    learned = read_record(feedback, Feedback) if feedback else None
    with CallsShown(wired.generator.watch):
        proposal = propose_as(wired, unguided=unguided, feedback=learned)
    write_text(out, proposal_json(proposal))
    _show_proposal(wired, proposal)


def _show_proposal(wired: Wired, proposal: Proposal) -> None:
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


@setting_options(
    *("model", "base_url", "generator_options", "prompts", "replay", "budget_calls", "budget_tokens", "budget_usd")
)
def describe(
    settings: dict[str, Any],
    world: Annotated[str, typer.Argument(help="A shipped world or a world folder.")],
    review: Annotated[bool, typer.Option("--review", help="Accept, edit or reject the description.")] = False,
    reviewer: Annotated[
        str | None, typer.Option(help="Name of the reviewer, stored with the description.", hidden=True)
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Store it here: a world folder, or a .yaml of its own.")] = None,
    record: Record = None,
    strict: Strict = False,
    call_timeout: CallTimeout = 180.0,
    prices: Prices = None,
    json: AsJson = False,
) -> None:
    """Let a vision language model describe a world from its pictures.

    The model sees the labelled map, then the grid of waypoints, then writes a summary. The description is stored in
    world.yaml (for a shipped world, in your data folder) and is part of every later prompt. Without --model, show the
    stored description; with --review, review it.
    """
    from rvsg.generation.environment import open_session, store_description, stored
    from rvsg.report.terminal import describe_calls
    from rvsg.world.world_folder import load_world, shipped_worlds

    loaded = load_world(world)
    model, prompts = settings.pop("model", None), settings.pop("prompts", None)
    options = settings.pop("generator_options", None) or {}
    access = settings | {"strict": strict or None, "call_timeout_s": call_timeout, "prices": prices} | options
    session = open_session(loaded, model, record, Path(prompts) if prompts else None, **access)
    if session is not None:
        with CallsShown(_watch(session.access)), _kept(session.access):
            description = session.describe()
        for note in (describe_calls(session.calls), *session.notes()):
            say(note)
    else:
        description = stored(
            loaded, as_started(shlex.join(["rvsg", "world", "describe", world, "--model", "PROVIDER:NAME"]))
        )
    if review:
        description = _reviewed(description, reviewer, _revising(session) if session else None)
    else:
        _show_description(description)
    if session is not None or review:
        place = out if out is not None else None if world in shipped_worlds() else Path(world)
        say(f"Stored in {store_description(loaded, description, place)}")
        if not description.reviewed:
            review_it = as_started(shlex.join(["rvsg", "world", "describe", world, "--review"]))
            say(f"It is not reviewed yet. Review it with: {review_it}")
    if json:
        print_json(description.model_dump(mode="json"))


def _watch(model: ModelAccess) -> Callable[[Callable[[CallNews], None] | None], None]:
    """Return a function that sets who receives the calls of a model; a replay makes none."""

    def watch(tell: Callable[[CallNews], None] | None) -> None:
        if not model.replaying:
            model.tell = tell

    return watch


@contextlib.contextmanager
def _kept(model: ModelAccess) -> Iterator[None]:
    """Tell the user where the answers are kept when a call fails or an answer cannot be used."""
    from rvsg.core.errors import BudgetSpent, GenerationError, ModelUnavailable

    try:
        yield
    except GenerationError as error:
        recording = model.recording
        if recording is not None and not model.replaying and recording.spent().calls:
            outside = isinstance(error, (ModelUnavailable, BudgetSpent))
            next_step = "Run the same command to resume" if outside else "To ask again, give another --record"
            say(f"The answers so far are in {recording.folder}. {next_step}.")
        raise


def _revising(session: EnvironmentSession) -> Callable[[str], Description]:
    """Return a function that has the model revise the description for a reason, with progress."""

    def revise(reason: str) -> Description:
        with CallsShown(_watch(session.access)), _kept(session.access):
            return session.revise(reason)

    return revise


def _show_description(description: Description) -> None:
    reviewed = "not reviewed"
    if description.reviewed:
        reviewed = (
            f"reviewed{f' by {description.reviewer}' if description.reviewer else ''} {description.reviewed_on or ''}"
        )
    say(f"Layout\n  {description.layout}\n\nGrid\n  {description.grid}\n\n({reviewed.strip()})")


def _reviewed(
    description: Description, reviewer: str | None, revise: Callable[[str], Description] | None
) -> Description:
    """Ask until the reviewer accepts the description or quits."""
    from rvsg.core.errors import InputError
    from rvsg.generation.environment import editable, edited

    while True:
        _show_description(description)
        choice = typer.prompt("[a]ccept, [e]dit, [r]eject with a reason, [q]uit without accepting", err=True)
        choice = choice.strip().lower()[:1]
        if choice == "a":
            today = datetime.date.today().isoformat()
            return description.model_copy(update={"reviewed": True, "reviewer": reviewer, "reviewed_on": today})
        if choice == "e":
            text = _in_editor(editable(description))
            try:
                description = edited(description, text)
            except InputError as error:
                say(f"Not changed: {error}")
        elif choice == "r" and revise is None:
            say("A rejection goes to a model, and none is set. Run the command with --model, or edit the text.")
        elif choice == "r":
            reason = typer.prompt("What is wrong", err=True)
            description = revise(reason) if revise is not None else description
        elif choice == "q":
            return description.model_copy(update={"reviewed": False})
        else:
            say("Please answer a, e, r or q.")


def _in_editor(text: str) -> str:
    """Return the text as the user's editor ($VISUAL or $EDITOR) saved it; InputError if that fails."""
    from rvsg.core.errors import InputError

    editor = os.environ.get("VISUAL") or os.environ.get("EDITOR")
    if not editor:
        raise InputError("set EDITOR to the program you edit with, e.g. EDITOR=nano.")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "description.yaml"
        file.write_text(text, encoding="utf-8")
        try:
            ended = subprocess.run([*shlex.split(editor), str(file)], check=False)  # noqa: S603
        except OSError as error:
            raise InputError(f"the editor {editor!r} cannot be started: {error}") from None
        if ended.returncode != 0:
            raise InputError(f"the editor {editor!r} exited with code {ended.returncode}.")
        return file.read_text(encoding="utf-8")


@setting_options("world", "route", "requirement", "strategy", "humans", "conversation")
def prompt(
    settings: dict[str, Any],
    campaign: Annotated[Path | None, typer.Argument(help="A campaign file, or the folder of a campaign.")] = None,
    prompts: Annotated[Path | None, typer.Option(help="Folder of your own prompt templates.")] = None,
    listed: Annotated[bool, typer.Option("--list", help="List the templates and their variables.")] = False,
    copy: Annotated[str | None, typer.Option(metavar="NAME", help="Copy a template into --to, to change it.")] = None,
    to: Annotated[Path | None, typer.Option(help="Folder for --copy. [the campaign folder's prompts]")] = None,
    pictures: Annotated[
        Path | None, typer.Option(help="Also write the pictures of the prompt into this folder.")
    ] = None,
    json: AsJson = False,
) -> None:
    """Print the messages of the next call of a campaign, without calling a model.

    For a campaign folder, that is the next attempt with its memory and feedback; otherwise the first attempt. The text
    goes to standard output.
    """
    from rvsg.app.proposal import configured, copy_template, next_prompt, templates_folder, write_pictures

    if listed:
        _list(as_json=json)
        return
    config = configured(campaign, settings)
    if copy is not None:
        say(f"Copied to {copy_template(copy, to or templates_folder(config, prompts))}")
        return
    asked = next_prompt(config, prompts)
    if pictures is not None:
        for path in write_pictures(asked, pictures):
            say(f"Wrote {path}")
    if json:
        print_json([message.model_dump(mode="json") for message in asked.messages])
    else:
        for message in asked.messages:
            names = f" [{', '.join(p.name for p in message.pictures)}]" if message.pictures else ""
            typer.echo(f"----- {message.role}{names}\n{message.text}")
    own = f" Own templates: {', '.join(asked.own_templates)}." if asked.own_templates else ""
    say(f"About {asked.tokens} input tokens, {asked.pictures} pictures.{own}")


def _list(*, as_json: bool) -> None:
    from rvsg.generation.prompts import declared_variables, shipped_prompts

    declared = {name: sorted(declared_variables(name)) for name in shipped_prompts()}
    if as_json:
        print_json(declared)
        return
    for name, variables in declared.items():
        typer.echo(f"{name}: {', '.join(variables)}")
