"""`rvsg prompt`: what a model would be asked, without asking it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

if TYPE_CHECKING:
    from rvsg.api.authoring import World
    from rvsg.api.config import CampaignConfig
    from rvsg.api.models import Brief

app = verb()


@app.command()
def prompt(
    campaign: Annotated[Path | None, typer.Argument(help="A campaign file, or the folder of a campaign.")] = None,
    world: Annotated[str | None, typer.Option(help="A shipped world or a world folder. [warehouse]")] = None,
    route: Annotated[str | None, typer.Option(help="A route of the world. [route_1]")] = None,
    requirement: Annotated[str | None, typer.Option(help="A shipped requirement, or FILE.yaml#NAME. [R1]")] = None,
    strategy: Annotated[str | None, typer.Option(help="study, climb, elite, unguided. [study]")] = None,
    humans: Annotated[int | None, typer.Option(min=1, max=100, help="People in a scenario. [2]")] = None,
    conversation: Annotated[str | None, typer.Option(help="compact or study. [compact]")] = None,
    prompts: Annotated[Path | None, typer.Option(help="Folder of prompt templates that replace ours.")] = None,
    listed: Annotated[bool, typer.Option("--list", help="List the templates and their variables.")] = False,
    copy: Annotated[str | None, typer.Option(metavar="NAME", help="Copy a template, to change it, into --to.")] = None,
    to: Annotated[Path | None, typer.Option(help="Folder for --copy. [the campaign folder's prompts]")] = None,
    pictures: Annotated[
        Path | None, typer.Option(help="Also write the pictures that are shown into this folder.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the messages as JSON.")] = False,
) -> None:
    """Print the messages of the next call of a campaign, without calling a model.

    For a campaign folder that is the attempt the campaign would ask for next, with its memory and feedback; else the
    first one. The text goes to standard output.
    """
    from rvsg.api.models import Scripted, VlmGenerator, estimated_tokens, picture_tokens, pictures_of

    if listed:
        _list(as_json=json)
        return
    given: dict[str, Any] = {
        "world": world,
        "route": route,
        "requirement": requirement,
        "strategy": strategy,
        "humans": humans,
        "conversation": conversation,
    }
    config = _config(campaign, {key: value for key, value in given.items() if value is not None})
    asked = prompts or (Path(config.prompts) if config.prompts else None)
    folder = asked or config.folder / "prompts"
    if copy is not None:
        say(f"Copied to {_copied(copy, to or folder)}")
        return
    brief, loaded = _next_brief(config)
    own = folder if asked or folder.is_dir() else None
    generator = VlmGenerator(Scripted([]), conversation=config.conversation, prompts=own)
    messages = generator.first_prompts(brief, loaded)
    shown = [picture for message in messages for picture in message.pictures]
    if pictures is not None:
        _write_pictures(pictures, pictures_of(loaded, brief.mission.route))
    if json:
        print_json([message.model_dump(mode="json") for message in messages])
    else:
        for message in messages:
            names = f" [{', '.join(p.name for p in message.pictures)}]" if message.pictures else ""
            typer.echo(f"----- {message.role}{names}\n{message.text}")
    tokens = sum(estimated_tokens(m.text) for m in messages) + sum(picture_tokens(p.width, p.height) for p in shown)
    mine = generator.prompts.overridden()
    say(
        f"About {tokens} input tokens, {len(shown)} pictures." + (f" Own templates: {', '.join(mine)}." if mine else "")
    )


def _config(campaign: Path | None, given: dict[str, Any]) -> CampaignConfig:
    """The configuration: of a campaign file, or of the folder of a campaign, with the options on top."""
    from rvsg.api.config import effective, read_campaign_file
    from rvsg.api.folder import CONFIG

    if campaign is None:
        return effective(None, {}, given)
    file = campaign / CONFIG if campaign.is_dir() else campaign
    out = {"out": str(campaign)} if campaign.is_dir() else {}
    return effective(None, {**read_campaign_file(file), **out}, given)


def _next_brief(config: CampaignConfig) -> tuple[Brief, World]:
    """What the campaign would ask for next: from its ledger where it has one, else the first attempt."""
    from rvsg.api.errors import InputError
    from rvsg.api.events import search_attempts
    from rvsg.api.folder import reading, store_of
    from rvsg.api.wiring import wire

    asking_nobody = {"generator": "heuristic", "model": None, "base_url": None, "prompts": None, "replay": None}
    wired = wire(config.model_copy(update={**asking_nobody, "generator_options": {}, **_NO_BUDGET}))
    if store_of(config.folder) is None:
        return wired.strategy(None).ask()[0].brief, wired.world
    with reading(config.folder) as ledger:
        strategy = wired.strategy(ledger)
        known = ledger.campaigns()
        for attempt in search_attempts(list(ledger.attempts(known[0] if known else wired.plan.name))):
            strategy.tell(attempt)
        asks = strategy.ask()
    if not asks:
        raise InputError(f"{config.folder}: the search is finished. Start another campaign with --out.")
    return asks[0].brief, wired.world


_NO_BUDGET: dict[str, Any] = {"budget_usd": None, "budget_calls": None, "budget_tokens": None}


def _list(*, as_json: bool) -> None:
    from rvsg.api.models import declared_variables, shipped_prompts

    declared = {name: sorted(declared_variables(name)) for name in shipped_prompts()}
    if as_json:
        print_json(declared)
        return
    for name, variables in declared.items():
        typer.echo(f"{name}: {', '.join(variables)}")


def _copied(name: str, folder: Path) -> Path:
    from rvsg.api.errors import InputError
    from rvsg.api.files import write_whole
    from rvsg.api.folder import make_folder
    from rvsg.api.models import template_text

    path = folder / f"{name}.md.j2"
    if path.exists():
        raise InputError(f"{path} is there already; it is not overwritten.")
    text = template_text(name)
    make_folder(folder, option="--to")
    write_whole(path, text)
    return path


def _write_pictures(folder: Path, pictures: Any) -> None:
    from rvsg.api.folder import make_folder

    make_folder(folder, option="--pictures")
    for picture in pictures:
        path = folder / f"{picture.name.replace(' ', '_')}.png"
        path.write_bytes(picture.png)
        say(f"Wrote {path}")
