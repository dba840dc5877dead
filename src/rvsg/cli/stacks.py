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
    file: Annotated[
        Path | None, typer.Argument(help="A nav2_params.yaml: list what becomes of each of its keys.")
    ] = None,
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
    if file is not None:
        _print_params(file, as_json=json)
        return
    found = listed_stacks()
    if json:
        console.print_json([asdict(each) for each in found])
        return
    for each in found:
        print(f"{each.name:14} {each.title} (version {each.version})")
        if each.options:
            print(f"{'':14} options: {', '.join(f'{key}={value}' for key, value in each.options.items())}")


def _print_params(path: Path, *, as_json: bool) -> None:
    """Print what becomes of every key of a parameter file, and the stack it asks for."""
    from rvsg.api.stacks import StackChoice, read_nav2_params

    read, chosen = read_nav2_params(path), StackChoice.of(path)
    if as_json:
        keys = [asdict(entry) for entry in read.entries]
        console.print_json({"stack": chosen.record.model_dump(mode="json"), "counts": read.counts(), "keys": keys})
        return
    for entry in read.entries:
        print(f"{entry.state:14} {entry.key} = {entry.value}{f'  ({entry.note})' if entry.note else ''}")
    counts = ", ".join(f"{number} {state}" for state, number in read.counts().items())
    console.say(f"{read.stack}, of {len(read.entries)} keys: {counts}")
