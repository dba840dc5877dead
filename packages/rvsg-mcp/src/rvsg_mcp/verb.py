"""`rvsg mcp`: tools for an assistant that speaks the Model Context Protocol."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.frame import CONNECT, Verb, verb

app = verb()


@app.command()
def mcp(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The folder that the assistant may work in.")] = Path(),
) -> None:
    """Serve an assistant over standard input and output (Model Context Protocol).

    It makes worlds from maps, writes, simulates and judges scenarios, runs campaigns, reads findings with pictures, and
    keeps suites. It reads and writes nothing outside DIR, and runs no code that a file or the assistant names.

    Needs the extra `mcp`.
    """
    from rvsg.core import permission
    from rvsg_mcp.tools import server

    with permission.only_in_process(()):
        server(folder).run("stdio")


VERBS = {
    "mcp": Verb("rvsg_mcp.verb", "Serve an assistant", CONNECT),
}
