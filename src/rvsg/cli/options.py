"""Options: those made of the settings of a campaign, those that verbs share, and the values of their text."""

from __future__ import annotations

import contextlib
import functools
import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import typer
import yaml

from rvsg.app.settings import LISTED, default_text, option_of, settings, value_type
from rvsg.cli.console import console, say
from rvsg.core.errors import InputError
from rvsg.core.inputs import is_too_deep
from rvsg.report.terminal import describe_spending

if TYPE_CHECKING:
    from rich.status import Status

    from rvsg.generation.vlm.access import CallNews


RERUN = ("stack", "stack_options", "robot", "simulator", "simulator_options")
"""The settings that replace what a scenario was found with."""
FOUND = "as it was found"


def setting_options(
    *keys: str, several: bool = False, as_found: bool = False, **defaults: Any
) -> Callable[[Callable[..., None]], Any]:
    """Give a command the options of these settings of a campaign; its `settings` are those that are given.

    Args:
        several: whether routes and requirements may be given several times.
        as_found: whether those that are left out are as the scenario was found.
        defaults: settings whose default differs in this command.
    """

    def decorate(command: Callable[..., None]) -> Any:
        @functools.wraps(command, assigned=("__module__", "__name__", "__doc__"))
        def with_settings(**values: Any) -> None:
            chosen = {key: _value(key, values.pop(key)) for key in keys}
            command(settings=defaults | {key: value for key, value in chosen.items() if value is not None}, **values)

        own = inspect.signature(command, eval_str=True).parameters
        parameters = [
            *(
                parameter.replace(kind=parameter.KEYWORD_ONLY)
                for name, parameter in own.items()
                if name not in ("settings", "json")
            ),
            *(
                _parameter(key, several=several and key in LISTED, default=FOUND if as_found else defaults.get(key))
                for key in keys
            ),
            *(own[name].replace(kind=inspect.Parameter.KEYWORD_ONLY) for name in own if name == "json"),
        ]
        del with_settings.__wrapped__
        vars(with_settings)["__signature__"] = inspect.Signature(parameters)
        return with_settings

    return decorate


def named_world(name: str | None) -> str | None:
    """Return the name of a world as it was typed; say so where a folder here has the name of a shipped world."""
    from rvsg.world.world_folder import shipped_worlds

    if name in shipped_worlds() and Path(name, "world.yaml").is_file():
        say(f"Note: {name} is the world that ships with RVSG. For the folder here, write ./{name}")
    return name


def _parameter(key: str, *, several: bool, default: Any) -> inspect.Parameter:
    """Return the parameter of a command that takes a setting."""
    setting, kind = settings()[key], value_type(key)
    many = several or kind in (list, dict)
    words = setting.help.removesuffix(".") + ("; repeatable" if many else "") + (", or `all`" if several else "")
    shown = default_text(key) if default is None else str(default)
    option = typer.Option(
        option_of(key),
        help=f"{words}." + (f" [{shown}]" if shown and kind is not bool else ""),
        metavar=setting.metavar or ("NAME=VALUE" if kind is dict else None),
        hidden=not setting.common,
        callback=named_world if key == "world" else None,
    )
    value: Any = list[str] if many else kind
    return inspect.Parameter(
        key, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[value | None, option]
    )


def _value(key: str, value: Any) -> Any:
    """Return the value of a setting from that of its option."""
    if value is None or value_type(key) is not dict:
        return value
    return states(value) if key == "doors" else pairs(key.removesuffix("_options"), value)


def pairs(kind: str, texts: list[str] | None) -> dict[str, Any]:
    """Return the `NAME=VALUE` options of a plug-in, the values read as YAML."""
    return dict(_pair(kind, pair) for pair in texts or [])


def states(texts: list[str] | None) -> dict[str, Any]:
    """Return `NAME=STATE` of doors; the states are checked where the world is known."""
    chosen = {}
    for pair in texts or []:
        name, equals, state = pair.rpartition("=")
        if not equals or not name:
            raise InputError(
                f"--door {pair[:60]!r}: expected NAME=open, NAME=closed or NAME=automatic", code="door-form"
            )
        chosen[name] = state
    return chosen


def _pair(kind: str, pair: str) -> tuple[str, Any]:
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
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smh]?)", text.strip())
    if match is None:
        raise InputError(f"{option} {text!r}: expected a time such as 90s, 15m or 1h.")
    return float(match[1]) * {"": 1.0, "s": 1.0, "m": 60.0, "h": 3600.0}[match[2]]


Verbose = Annotated[bool, typer.Option("--verbose", hidden=True, help="Print every finding in full.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]
Jobs = Annotated[int, typer.Option(min=1, help="Worker processes.")]
JobsPerCore = Annotated[int | None, typer.Option(min=1, help="Worker processes. [one per core]")]
Requirement = Annotated[str, typer.Option(help="A shipped requirement, or FILE.yaml#NAME.")]
FoundRequirement = Annotated[
    str | None, typer.Option("--requirement", help=f"A shipped requirement, or FILE.yaml#NAME. [{FOUND}, else R1]")
]
OtherWorld = Annotated[str | None, typer.Option(help="Instead of the scenario's world.", callback=named_world)]
FailOnViolation = Annotated[
    bool, typer.Option("--fail-on-violation", help="Exit with code 1 if the requirement is violated.")
]
Junit = Annotated[Path | None, typer.Option(metavar="FILE", help="Write the verdicts as JUnit XML.")]
Record = Annotated[Path | None, typer.Option(help="Keep every call in this folder.")]
Strict = Annotated[
    bool, typer.Option("--strict", help="With --replay, treat any difference from the record as an error.")
]
CallTimeout = Annotated[float, typer.Option(min=0.1, help="Seconds to wait for an answer.")]
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
