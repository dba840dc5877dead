"""`rvsg prompt`: print the next prompt of a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rvsg.cli.arguments import AsJson
from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

if TYPE_CHECKING:
    from rvsg.generation.vlm.model import Message

app = verb()


@app.command()
def prompt(
    campaign: Annotated[Path | None, typer.Argument(help="A campaign file, or the folder of a campaign.")] = None,
    world: Annotated[str | None, typer.Option(help="A shipped world or a world folder. [warehouse]")] = None,
    route: Annotated[str | None, typer.Option(help="A route of the world. [route_1]")] = None,
    requirement: Annotated[str | None, typer.Option(help="A shipped requirement, or FILE.yaml#NAME. [R1]")] = None,
    strategy: Annotated[str | None, typer.Option(help="study, unguided. [study]")] = None,
    humans: Annotated[int | None, typer.Option(min=1, max=100, help="People in a scenario. [2]")] = None,
    conversation: Annotated[str | None, typer.Option(help="compact or study. [compact]")] = None,
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
    keys = ("world", "route", "requirement", "strategy", "humans", "conversation")
    given = {key: value for key, value in locals().items() if key in keys and value is not None}
    from rvsg.app.proposal import configured, copy_template, next_prompt, templates_folder, write_pictures

    if listed:
        _list(as_json=json)
        return
    config = configured(campaign, given)
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
        _show(asked.messages)
    own = f" Own templates: {', '.join(asked.own_templates)}." if asked.own_templates else ""
    say(f"About {asked.tokens} input tokens, {asked.pictures} pictures.{own}")


def _show(messages: tuple[Message, ...]) -> None:
    for message in messages:
        names = f" [{', '.join(p.name for p in message.pictures)}]" if message.pictures else ""
        typer.echo(f"----- {message.role}{names}\n{message.text}")


def _list(*, as_json: bool) -> None:
    from rvsg.generation.prompts import declared_variables, shipped_prompts

    declared = {name: sorted(declared_variables(name)) for name in shipped_prompts()}
    if as_json:
        print_json(declared)
        return
    for name, variables in declared.items():
        typer.echo(f"{name}: {', '.join(variables)}")
