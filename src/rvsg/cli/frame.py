"""The frame around every verb: lazy loading, global options, and errors turned into messages."""

from __future__ import annotations

import errno
import importlib
import os
import shlex
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

import rvsg
from rvsg.cli.console import as_started, harmless
from rvsg.cli.interruption import interruptible
from rvsg.core import permission
from rvsg.core.errors import InputError, Interrupted, RvsgError, how_to_install

HELP = """Find, confirm and explain human behaviours that make a mobile robot violate its requirements, in simulation.

Results for machines go to standard output; everything for people goes to standard error.
"""
EPILOG = (
    "Exit codes: 0 done; 1 violated, with --fail-on-violation or in a suite; 2 usage or input error, or nothing could "
    "be judged; 3 interrupted but resumable; 4 an error in RVSG itself."
)
MOST_OPTIONS = 12
"""A command with more options hides the rarer ones behind `--help-all`."""
ALL = "--help-all"
GROUPS = ("Find failures", "Build worlds and scenarios", "Keep and compare", "Connect", "Other")
FIND, BUILD, KEEP, CONNECT, OTHER = GROUPS
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
NO_NAME = (errno.ENAMETOOLONG, errno.ELOOP)
"""Errors for a name that no file system can hold."""
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 110}
BESIDE = {"export": "exchange", "import": "exchange", "import study": "study", "ros2": "ros2", "studio": "studio"}
"""Verbs of other distributions, with the extra that installs them."""


class Verb(NamedTuple):
    """A verb of the command line.

    Args:
        module: its Typer as MODULE:ATTRIBUTE; MODULE alone is its `app`.
        group: the group of the help that lists it, one of `GROUPS`.
    """

    module: str
    help: str
    group: str = OTHER


Verbs = Mapping[str, tuple[Verb, ...]]
"""Verbs by name; where several distributions add sub-verbs to one, there are several."""


def installed_verbs(built_in: Mapping[str, Verb]) -> Verbs:
    """Return the verbs of the core, then those that other installed distributions register (`rvsg.verbs`)."""
    verbs = {name: (verb,) for name, verb in built_in.items()}
    for entry in sorted(entry_points(group="rvsg.verbs")):
        for name, verb in entry.load().items():
            verbs[name] = (*verbs.get(name, ()), verb)
    return verbs


def verb(**settings: Any) -> typer.Typer:
    """Return a Typer for a verb's module: plain help, no completion commands, errors left to the frame."""
    return typer.Typer(
        rich_markup_mode=None,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings=CONTEXT,
        **settings,
    )


def command_line(verbs: Verbs, argv: Sequence[str] | None = None, moved: Mapping[str, str] | None = None) -> int:
    """Load the verb that is named, run it, and return the exit code; never raises.

    Args:
        moved: the commands that earlier versions called otherwise, by their earlier name.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)

    def work() -> None:
        allowed, source, host = _without_permissions(arguments)
        words = ["--help" if word == ALL else word for word in allowed]
        if host is not None:
            permission.allow_key_for(host)
        with permission.only_in_process(
            permission.typed(allowed), trusted=Path(source) if source is not None else None
        ):
            _root(verbs, moved or {}, everything=ALL in allowed).main(args=words, prog_name="rvsg")

    return guarded(work, arguments)


def _without_permissions(arguments: Sequence[str]) -> tuple[list[str], str | None, str | None]:
    """Take `--allow-code-from FILE` and `--allow-key-for HOST` out of a command line, anywhere before `--`."""
    before: list[str] = []
    values: dict[str, str | None] = dict.fromkeys(("--allow-code-from", "--allow-key-for"))
    rest = iter(arguments)
    for word in rest:
        option, mark, value = word.partition("=")
        if option in values:
            if not (value := value if mark else next(rest, "")):
                raise InputError(f"{option}: its value is missing.", code="code-source-missing")
            if values[option] is not None:
                raise _twice(option)
            values[option] = value
            continue
        before.append(word)
        if word == "--":
            before += rest
    return before, values["--allow-code-from"], values["--allow-key-for"]


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
        _tell(f"Error [{error.code}]: {error}" if error.exit_code != 3 else str(error))
        return error.exit_code
    except KeyboardInterrupt:
        _tell("Interrupted.")
        return 3
    except Exception as unexpected:
        return _report_defect(unexpected, arguments)
    return 0


@cache
def full_command(name: str, verbs: tuple[Verb, ...], *, everything: bool = False) -> Any:
    """Return the command of a verb after importing its module; with `everything`, its help shows all options."""
    commands: list[Any] = [typer.main.get_command(_load(verb.module)) for verb in verbs]
    command = commands[0]
    for more in commands[1:]:
        command.commands |= more.commands
    command.name = name
    _fold(command, everything=everything)
    return command


class OneValue(TyperCommand):
    """Refuses an option that is given twice, unless it is a flag or takes a list: none wins in silence."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Count the options before their values are read."""
        order: list[Any] = self.make_parser(ctx).parse_args(list(args))[2]
        for param, times in Counter(order).items():
            if times > 1 and param.param_type_name == "option" and not (param.multiple or param.is_flag):
                raise _twice(param.opts[0])
        return super().parse_args(ctx, args)


def _twice(option: str) -> InputError:
    return InputError(f"{option} is given twice, and takes one value. Give it once.", code="option-twice")


def _load(module: str) -> typer.Typer:
    path, _, attribute = module.partition(":")
    app: typer.Typer = getattr(importlib.import_module(path), attribute or "app")
    for registered in app.registered_commands:
        registered.cls = OneValue
    return app


def options_of(command: Any) -> list[Any]:
    """Return the options of a command, without its arguments."""
    return [param for param in command.params if param.param_type_name == "option"]


def _fold(command: Any, *, everything: bool) -> None:
    """Show all options of a command; or, where these are many, those that are not marked as hidden."""
    if isinstance(command, TyperGroup):
        for subcommand in command.commands.values():
            _fold(subcommand, everything=everything)
    options = options_of(command)
    if everything or len(options) <= MOST_OPTIONS:
        for option in options:
            option.hidden = False
    elif rare := sum(option.hidden for option in options):
        command.epilog = f"{rare} more options: {ALL}."


class VerbGroup(TyperGroup):
    """Lists verbs from their table alone, and imports a verb's module only to run it."""

    verbs: Verbs
    moved: Mapping[str, str]
    everything: bool

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the verbs."""
        return list(self.verbs)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a verb for the help, without its options."""
        if cmd_name not in self.verbs:
            return None
        return TyperCommand(cmd_name, help=self.verbs[cmd_name][0].help, rich_markup_mode=None)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the verbs in their groups."""
        for group in GROUPS:
            rows = [(name, verbs[0].help) for name, verbs in self.verbs.items() if verbs[0].group == group]
            if rows:
                with formatter.section(group):
                    formatter.write_dl(rows)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the verb that is named, with its options; an earlier name of a verb is refused with its new one."""
        if args[0] in self.moved:
            raise InputError(f"`rvsg {args[0]}` is now `rvsg {self.moved[args[0]]}`.", code="verb-moved")
        word = " ".join(args[:2]) if " ".join(args[:2]) in BESIDE else args[0]
        modules = [verb.module for verb in self.verbs.get(args[0], ())]
        if word in BESIDE and not any(word == args[0] or f"rvsg_{BESIDE[word]}." in verb for verb in modules):
            raise InputError(
                f"`rvsg {word}` needs a package that is not installed: {how_to_install(BESIDE[word])}.",
                code="verb-not-installed",
            )
        name, command, rest = super().resolve_command(ctx, args)
        if not name or not command:
            return name, command, rest
        return name, full_command(name, self.verbs[name], everything=self.everything), rest

    def invoke(self, ctx: Any) -> Any:
        """Run the verb; an interruption and a reader that is gone become one of our errors."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise Interrupted("Interrupted.") from None
        except BrokenPipeError:  # before Click makes of it exit code 1, which means "violated"
            _nobody_reads()
            raise Interrupted("The reader of the output has closed it.") from None


def _root(verbs: Verbs, moved: Mapping[str, str], *, everything: bool) -> Any:
    """Return the top command, which loads verbs lazily."""
    app = typer.Typer(
        cls=VerbGroup,
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
        explain: Annotated[
            str | None,
            typer.Option(
                metavar="CODE", callback=_explain, is_eager=True, help="Explain a code in the brackets of an error."
            ),
        ] = None,
        debug: Annotated[
            bool, typer.Option("--debug", envvar="RVSG_DEBUG", help="Show the traceback of an error.")
        ] = False,
        allow_code_from: Annotated[
            str | None,
            typer.Option(metavar="FILE", help="Run code that a file or folder names."),
        ] = None,
        allow_key_for: Annotated[
            str | None,
            typer.Option(metavar="HOST", help="Send RVSG_API_KEY there; remembered."),
        ] = None,
    ) -> None:
        """Options before the verb."""

    command: Any = typer.main.get_command(app)
    command.verbs, command.moved, command.everything = verbs, moved, everything
    # Suggestions for a misspelt verb read this table.
    command.commands = {name: command.get_command(None, name) for name in verbs}
    return command


def _print_version(asked: bool) -> None:
    if asked:
        print(rvsg.__version__)
        raise typer.Exit


def _explain(code: str | None) -> None:
    if code is not None:
        from rvsg.cli.codes import explanation  # reads all sources

        print(explanation(code), end="")
        raise typer.Exit


def _debugging(arguments: Sequence[str]) -> bool:
    return "--debug" in arguments or os.environ.get("RVSG_DEBUG", "") not in ("", "0")


def _tell(message: str) -> None:
    try:
        print(harmless(message), file=sys.stderr, flush=True)
    except OSError:  # where nothing can be written, the exit code says it, also when Python writes what is left
        _nobody_reads()


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
