"""`rvsg stacks`: the navigation stacks that can be tested."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli import console
from rvsg.cli.frame import verb

app = verb()


@app.command()
def stacks(
    write_clients: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write the clients of exec: stacks, in Python and C++, and do no more."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the list as JSON on standard output.")] = False,
) -> None:
    """List the navigation stacks with their options; --stack of `run`, `simulate` and `suite run` takes one.

    Your own is given as module:Class, file.py:Class or exec:COMMAND; see docs/how-to/test-your-own-stack.md.
    """
    from rvsg.api.stacks import listed_stacks, write_clients_to

    if write_clients is not None:
        for path in write_clients_to(write_clients):
            console.say(f"wrote {path}")
        return
    found = listed_stacks()
    if json:
        console.print_json([asdict(each) for each in found])
        return
    for each in found:
        print(f"{each.name:14} {each.title} (version {each.version})")
        if each.options:
            print(f"{'':14} options: {', '.join(f'{key}={value}' for key, value in each.options.items())}")
