"""The frame around every verb: lazy loading, global options, and errors turned into messages."""

from __future__ import annotations

import contextlib
import errno
import importlib
import os
import shlex
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.metadata import entry_points
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

import rvsg
from rvsg.cli.console import as_started
from rvsg.cli.interruption import interruptible
from rvsg.core.errors import Interrupted, RvsgError

HELP = """Find, confirm and explain human behaviours that make a mobile robot violate its requirements, in simulation.

`rvsg run` does the main job. The other verbs are its stages; they read and write the same records as files.
Standard output carries machine-readable results only; everything for people goes to standard error.
"""
EPILOG = (
    "Exit codes: 0 done; 1 done, and a requirement is violated (--fail-on-violation); 2 usage or input error, "
    "or nothing could be judged; 3 interrupted but resumable; 4 an error in RVSG itself."
)
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
NO_NAME = (errno.ENAMETOOLONG, errno.ELOOP)
"""Errors for a name that no file system can hold."""
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 110}


class Verb(NamedTuple):
    """A verb of the command line: its Typer as MODULE:ATTRIBUTE (MODULE alone: its `app`), and its line in the help."""

    module: str
    help: str


def installed_verbs() -> dict[str, Verb]:
    """Return the verbs that other installed distributions register."""
    tables = [entry.load() for entry in sorted(entry_points(group="rvsg.verbs"))]
    return {name: verb for table in tables for name, verb in table.items()}


def verb(**settings: Any) -> typer.Typer:
    """Return a Typer for a verb's module: plain help, no completion commands, errors left to the frame."""
    return typer.Typer(
        rich_markup_mode=None,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings=CONTEXT,
        **settings,
    )


def command_line(verbs: Mapping[str, Verb], argv: Sequence[str] | None = None) -> int:
    """Load the verb that is named, run it, and return the exit code; never raises."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    return guarded(lambda: _root(verbs).main(args=arguments, prog_name="rvsg"), arguments)


def guarded(work: Callable[[], object], arguments: Sequence[str]) -> int:
    """Do the work of a command and return its exit code: every error becomes a message; never raises."""
    try:
        with interruptible():
            work()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0 if end.code is None else 2
    except RvsgError as error:
        if _debugging(arguments):
            traceback.print_exc()
        _tell(f"Error: {error}" if error.exit_code != 3 else str(error))
        return error.exit_code
    except KeyboardInterrupt:
        _tell("Interrupted.")
        return 3
    except Exception as unexpected:
        return _report_defect(unexpected, arguments)
    return 0


def full_command(verbs: Mapping[str, Verb], name: str) -> Any:
    """Return the command of a verb after importing its module."""
    return _command_of(verbs[name].module, name)


@cache
def _command_of(module: str, name: str) -> Any:
    path, _, attribute = module.partition(":")
    app = getattr(importlib.import_module(path), attribute or "app")
    command = typer.main.get_command(app)
    command.name = name
    return command


class Frame(TyperGroup):
    """Lists verbs from their table alone, and imports a verb's module only to run it."""

    verbs: Mapping[str, Verb]

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the verbs."""
        return list(self.verbs)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a verb for the help, without its options."""
        if cmd_name not in self.verbs:
            return None
        return TyperCommand(cmd_name, help=self.verbs[cmd_name].help, rich_markup_mode=None)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the verb that is named, with its options."""
        name, found, rest = super().resolve_command(ctx, args)
        return name, (full_command(self.verbs, name) if name and found else found), rest

    def invoke(self, ctx: Any) -> Any:
        """Run the verb; an interruption and a reader that is gone become one of our errors."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise Interrupted("Interrupted. Finished work is kept.") from None
        except BrokenPipeError:  # before Click makes of it exit code 1, which means "violated"
            _nobody_reads()
            raise Interrupted("The reader of the output has closed it. Finished work is kept.") from None


def _root(verbs: Mapping[str, Verb]) -> Any:
    """Return the top command, which loads verbs lazily."""
    app = typer.Typer(
        cls=Frame,
        rich_markup_mode=None,
        add_completion=False,
        pretty_exceptions_enable=False,
        no_args_is_help=True,
        context_settings=CONTEXT,
        help=HELP,
        epilog=EPILOG,
    )

    @app.callback()
    def options(
        version: Annotated[
            bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
        ] = False,
        debug: Annotated[
            bool, typer.Option("--debug", envvar="RVSG_DEBUG", help="Show the traceback of an error.")
        ] = False,
    ) -> None:
        """Options before the verb."""

    command: Any = typer.main.get_command(app)
    command.verbs = verbs
    # Suggestions for a misspelt verb read this table.
    command.commands = {name: command.get_command(None, name) for name in verbs}
    return command


def _print_version(asked: bool) -> None:
    if asked:
        print(rvsg.__version__)
        raise typer.Exit


def _debugging(arguments: Sequence[str]) -> bool:
    return "--debug" in arguments or os.environ.get("RVSG_DEBUG", "") not in ("", "0")


def _tell(message: str) -> None:
    with contextlib.suppress(OSError):  # where nothing can be written, the exit code says it
        print(message, file=sys.stderr, flush=True)


def _nobody_reads() -> None:
    """Discard all further output: the reader has closed it (`rvsg ... | head`)."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nowhere, stream.fileno())


def _report_defect(error: Exception, arguments: Sequence[str]) -> int:
    """Print what happened and how to report it; return the exit code."""
    if isinstance(error, BrokenPipeError):
        _nobody_reads()
        return 3
    if isinstance(error, OSError) and error.errno in NO_ROOM:
        _tell(f"Error: {error.strerror}: cannot write all of {error.filename or 'the output'}. Free some space there.")
        return 2
    if isinstance(error, OSError) and error.errno in NO_NAME:
        name = str(error.filename or "")
        shown = name if len(name) <= 200 else f"{name[:100]}...{name[-40:]}"
        _tell(f"Error: {error.strerror}: {shown}. Give a shorter name.")
        return 2
    if _debugging(arguments):
        traceback.print_exc()
    where = traceback.extract_tb(error.__traceback__)[-1]
    shown = as_started(shlex.join(["rvsg", "--debug", *(a for a in arguments if a != "--debug")]))
    from rvsg.core.plugins import at_fault  # imports much, and is needed at this end alone

    what = f"{type(error).__name__}: {error} (line {where.lineno} of {where.filename})\n"
    if package := at_fault(error):
        _tell(
            f"Error in a plug-in of {package}: {what}"
            f"This is a defect in that package, not in RVSG. To see the traceback: {shown}"
        )
        return 4
    _tell(
        f"Error in RVSG itself: {what}"
        f"This is a defect in RVSG, not in your input. To see the traceback: {shown}\n"
        f"Please report it with that traceback and the version ({rvsg.__version__}) in the project's issue tracker."
    )
    return 4
