"""`rvsg stacks`: the navigation stacks that can be tested."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from rvsg.cli import console
from rvsg.cli.frame import verb

app = verb()


@app.command()
def stacks(
    json: Annotated[bool, typer.Option("--json", help="Print the list as JSON on standard output.")] = False,
) -> None:
    """List the navigation stacks with their options; --stack of `run`, `simulate` and `suite run` takes one.

    Your own is given as module:Class or file.py:Class.
    """
    from rvsg.api.stacks import listed_stacks

    found = listed_stacks()
    if json:
        console.print_json([asdict(each) for each in found])
        return
    for each in found:
        print(f"{each.name:14} {each.title} (version {each.version})")
        if each.options:
            print(f"{'':14} options: {', '.join(f'{key}={value}' for key, value in each.options.items())}")
