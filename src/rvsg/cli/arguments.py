"""Options that several verbs share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]
Jobs = Annotated[int, typer.Option(min=1, help="Worker processes.")]
JobsPerCore = Annotated[int | None, typer.Option(min=1, help="Worker processes. [one per core]")]
Requirement = Annotated[str, typer.Option(help="A shipped requirement, or FILE.yaml#NAME.")]
OtherWorld = Annotated[str | None, typer.Option(help="Use this world instead of the one the scenario names.")]
Simulator = Annotated[
    str, typer.Option(help="embedded; kinematic: no physics; ros2-world: your own; or a plug-in by name.")
]
SimulatorOption = Annotated[
    list[str] | None, typer.Option(metavar="NAME=VALUE", help="An option of the simulator; repeatable.")
]
Stack = Annotated[
    str | None, typer.Option(help="Navigation stack under test: a name (`rvsg stacks`) or a file. [nav2-dwb]")
]
StackOption = Annotated[
    list[str] | None, typer.Option(metavar="NAME=VALUE", help="An option of the stack; repeatable.")
]
FailOnViolation = Annotated[
    bool, typer.Option("--fail-on-violation", help="Exit with code 1 if the requirement is violated.")
]
Junit = Annotated[Path | None, typer.Option(metavar="FILE", help="Write the verdicts as JUnit XML.")]
Doors = Annotated[
    list[str] | None, typer.Option(metavar="NAME=STATE", help="A door that is open, closed or automatic; repeatable.")
]
