"""The options that verbs share, and the values of their text."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import typer

from rvsg import Spec
from rvsg.cli.console import console, say
from rvsg.core.errors import InputError
from rvsg.core.inputs import is_too_deep
from rvsg.report.terminal import describe_spending
from rvsg.simulation.stacks.registry import DEFAULT_STACK

if TYPE_CHECKING:
    from rich.status import Status

    from rvsg.generation.vlm.access import CallNews


def pairs(kind: str, given: list[str] | None) -> dict[str, Any]:
    """Return the `NAME=VALUE` options of a plug-in, the values read as YAML."""
    return dict(_pair(kind, pair) for pair in given or [])


def spec(kind: str, name: str, options: list[str] | None) -> Spec:
    """Return a plug-in by its name and its `NAME=VALUE` options."""
    return Spec(name, pairs(kind, options))


def states(given: list[str] | None) -> dict[str, Any]:
    """Return `NAME=STATE` of doors; the states are checked where the world is known."""
    found = {}
    for pair in given or []:
        name, equals, state = pair.rpartition("=")
        if not equals or not name:
            raise InputError(
                f"--door {pair[:60]!r}: expected NAME=open, NAME=closed or NAME=automatic", code="door-form"
            )
        found[name] = state
    return found


def stack_spec(name: str | None, options: list[str] | None) -> Spec | None:
    """Return the navigation stack under test with its `NAME=VALUE` options; None for the simulator's own."""
    if name is None and not options:
        return None
    return Spec(name or DEFAULT_STACK, pairs("stack", options))


def _pair(kind: str, pair: str) -> tuple[str, Any]:
    import yaml

    name, equals, value = pair.partition("=")
    if not equals or not name:
        raise InputError(f"--{kind}-option {pair!r}: expected NAME=VALUE", code="option-form")
    try:
        read = yaml.safe_load(value)
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"--{kind}-option {name[:60]}: the value cannot be read: {error}") from None
    except RecursionError:
        raise InputError(f"--{kind}-option {name[:60]}: the value is nested too deep") from None
    if is_too_deep(read):
        raise InputError(f"--{kind}-option {name[:60]}: the value is nested too deep")
    if isinstance(read, str):
        with contextlib.suppress(ValueError):
            return name, float(read)  # YAML reads 1e2 and nan as text
    return name, read


def seconds_of(option: str, text: str) -> float:
    """Return a time such as 90s, 15m or 1h in seconds."""
    import re

    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smh]?)", text.strip())
    if match is None:
        raise InputError(f"{option} {text!r}: expected a time such as 90s, 15m or 1h.")
    return float(match[1]) * {"": 1.0, "s": 1.0, "m": 60.0, "h": 3600.0}[match[2]]


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


Model = Annotated[str | None, typer.Option(help="The model, PROVIDER:NAME, e.g. openai-chat:gpt-4.1.")]
BaseUrl = Annotated[str | None, typer.Option(help="Address of an OpenAI-compatible server (key: RVSG_API_KEY).")]
Record = Annotated[Path | None, typer.Option(help="Keep every call in this folder.")]
Replay = Annotated[Path | None, typer.Option(help="Answer from the calls recorded in this folder, without a model.")]
Strict = Annotated[
    bool, typer.Option("--strict", help="With --replay, treat any difference from the record as an error.")
]
CallTimeout = Annotated[float, typer.Option(min=0.1, help="Seconds to wait for an answer.")]
BudgetCalls = Annotated[int | None, typer.Option(help="Stop before more calls of the model.")]
BudgetTokens = Annotated[int | None, typer.Option(help="Stop before more tokens.")]
BudgetUsd = Annotated[float | None, typer.Option(help="Stop before the calls cost more.")]
Prices = Annotated[
    str | None,
    typer.Option(metavar="IN,CACHED,OUT", help="Dollars per million tokens, for a model without a listed price."),
]


class CallsShown:
    """Shows the calls of a model while they run: on a terminal as a status line, else as one line per call.

    Args:
        watch: sets the receiver of every call, e.g. `Generator.watch`; None removes it.
    """

    def __init__(self, watch: Callable[[Callable[[CallNews], None] | None], None]) -> None:
        self.watch = watch
        self.status: Status | None = None

    def __enter__(self) -> Self:
        self.watch(self._show)
        return self

    def __exit__(self, *_: object) -> None:
        self.watch(None)
        self._stop()

    def _stop(self) -> None:
        if self.status is not None:
            self.status.stop()
            self.status = None

    def _show(self, news: CallNews) -> None:
        self._stop()
        if news.what == "answered":
            took = "answered from the record" if news.from_record else f"answered after {news.took_s:.0f} s"
            say(f"  {news.purpose}: {took}; {describe_spending(news.spent)} so far")
            return
        line = f"{news.model}, {news.purpose}: {news.why}" if news.why else f"Asking {news.model}: {news.purpose} ..."
        if news.what == "waiting" or not console().is_terminal:
            say(line)
        if console().is_terminal:
            self.status = console().status(line)
            self.status.start()
