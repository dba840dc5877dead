"""`rvsg knowledge`: collect and search what campaigns found."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.options import AsJson

app = verb(no_args_is_help=True)

Base = Annotated[
    str | None,
    typer.Option(
        "--base",
        metavar="FILE|URL",
        help="SQLite file, or postgresql://user@host/database. [$RVSG_KNOWLEDGE, else runs/knowledge.sqlite]",
    ),
]


@app.command()
def add(
    sources: Annotated[list[Path], typer.Argument(help="Folders of campaigns, or of several of them.")],
    base: Base = None,
) -> None:
    """Add attempts, findings, lessons and rejected proposals of campaigns. Known entries are not added twice."""
    from rvsg.app.campaign import learn_campaign
    from rvsg.store.knowledge_base import open_knowledge

    with open_knowledge(base) as knowledge:
        for source in sources:
            say(f"{source}: {learn_campaign(knowledge, source)} new entries")


@app.command()
def search(
    text: Annotated[str, typer.Argument(help="Text to look for in the descriptions.")] = "",
    world: Annotated[str | None, typer.Option(help="Entries of this world only.")] = None,
    route: Annotated[str | None, typer.Option(help="Entries of this route only.")] = None,
    requirement: Annotated[str | None, typer.Option(help="Entries of this requirement only.")] = None,
    kind: Annotated[str | None, typer.Option(help="attempt, finding, rejected or watched.")] = None,
    at: Annotated[
        str | None, typer.Option(metavar="WAYPOINT", help="Entries in which a person passes this waypoint.")
    ] = None,
    violated: Annotated[
        bool | None,
        typer.Option("--violated/--not-violated", help="Entries that violate their requirement, or do not."),
    ] = None,
    limit: Annotated[int, typer.Option(min=1, help="Entries at most.")] = 20,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the entries for `rvsg run --knowledge FILE`.")
    ] = None,
    base: Base = None,
    json: AsJson = False,
) -> None:
    """Search the knowledge base: the most similar descriptions first; without a text, the worst entries first."""
    from rvsg.core.files import check_writable
    from rvsg.store.knowledge_base import describe_match, open_knowledge, tell
    from rvsg.store.knowledge_base import search as look

    if out is not None:
        check_writable(out)
    with open_knowledge(base, create=False) as knowledge:
        entries = look(
            knowledge,
            text,
            world=world,
            route=route,
            requirement=requirement,
            kind=kind,
            at=at,
            violates=violated,
            limit=limit,
        )
    if out is not None:
        written = f"{tell(entries, out)} scenarios written to {out}."
        say(f"{written} Give them to a generator with: rvsg run --knowledge {out}")
    if json:
        print_json([entry.model_dump(mode="json") for entry in entries])
        return
    for entry in entries:
        say(describe_match(entry))
    if not entries:
        say("No entry matches.")


@app.command()
def status(base: Base = None) -> None:
    """Count the entries of each world."""
    from rvsg.store.knowledge_base import open_knowledge

    with open_knowledge(base, create=False) as knowledge:
        counts = knowledge.counts()
        say(f"{knowledge.name}: {sum(counts.values())} entries")
    for (world, kind), count in counts.items():
        say(f"  {world}: {count} of kind {kind}")
