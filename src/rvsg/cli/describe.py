"""`rvsg describe`: a model describes a world from its pictures, and a person reviews the text."""

from __future__ import annotations

import contextlib
import datetime
import os
import shlex
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rvsg.cli.arguments import AsJson
from rvsg.cli.console import as_started, print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.model_options import (
    BaseUrl,
    BudgetCalls,
    BudgetTokens,
    BudgetUsd,
    CallsShown,
    CallTimeout,
    Model,
    Prices,
    Record,
    Replay,
    Strict,
)

if TYPE_CHECKING:
    from rvsg.app.description import EnvironmentSession
    from rvsg.generation.vlm.access import CallNews, ModelAccess
    from rvsg.world.world import Description

app = verb()
REVIEWER = Annotated[str | None, typer.Option(help="Name of the reviewer, stored with the description.")]


@app.command()
def describe(
    world: Annotated[str, typer.Argument(help="A shipped world or a world folder.")],
    model: Model = None,
    base_url: BaseUrl = None,
    review: Annotated[bool, typer.Option("--review", help="Accept, edit or reject the description.")] = False,
    reviewer: REVIEWER = None,
    out: Annotated[Path | None, typer.Option(help="Store it here: a world folder, or a .yaml of its own.")] = None,
    prompts: Annotated[Path | None, typer.Option(help="Folder of your own prompt templates.")] = None,
    record: Record = None,
    replay: Replay = None,
    strict: Strict = False,
    call_timeout: CallTimeout = 180.0,
    budget_calls: BudgetCalls = None,
    budget_tokens: BudgetTokens = None,
    budget_usd: BudgetUsd = None,
    prices: Prices = None,
    json: AsJson = False,
) -> None:
    """Let a vision language model describe a world from its pictures.

    The model sees the labelled map, then the grid of waypoints, then writes a summary. The description is stored in
    world.yaml (for a shipped world, in your data folder) and is part of every later prompt. Without --model, show the
    stored description; with --review, review it.
    """
    names = ("base_url", "replay", "budget_calls", "budget_tokens", "budget_usd", "prices")
    access = {key: value for key, value in locals().items() if key in names}
    from rvsg.app.description import open_session, store, stored
    from rvsg.world.world_folder import load_world

    loaded = load_world(world)
    session = open_session(loaded, model, record, prompts, **access, strict=strict or None, call_timeout_s=call_timeout)
    if session is not None:
        with CallsShown(_watch(session.model)), _kept(session.model):
            description = session.dialogue.describe()
        for note in session.notes():
            say(note)
    else:
        description = stored(loaded, as_started(shlex.join(["rvsg", "describe", world, "--model", "PROVIDER:NAME"])))
    if review:
        description = _reviewed(description, reviewer, _revising(session) if session else None)
    else:
        _show(description)
    if session is not None or review:
        say(f"Stored in {store(loaded, description, out=out, name=world)}")
        if not description.reviewed:
            review_it = as_started(shlex.join(["rvsg", "describe", world, "--review"]))
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
        with CallsShown(_watch(session.model)), _kept(session.model):
            return session.dialogue.revise(reason)

    return revise


def _show(description: Description) -> None:
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
        _show(description)
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
