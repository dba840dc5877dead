"""Plug-ins by name, from the entry points of installed packages; built-in plug-ins use them, too.

Only the command line reads its verbs itself (`rvsg.cli.frame`): a list of verbs loads no pydantic, which this needs.
A plug-in is loaded when it is asked for. An unknown name raises UnknownName, which suggests the nearest one.
"""

from __future__ import annotations

import difflib
import hashlib
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from importlib.metadata import EntryPoint, distribution, entry_points, packages_distributions
from inspect import getsource, getsourcefile, isfunction, signature
from pathlib import Path
from typing import Annotated, Any, Generic, Protocol, TypeVar

from pydantic import Field

from rvsg.core import permission
from rvsg.core.errors import InputError, UnknownName, how_to_install
from rvsg.core.records import Record

KINDS = {
    "generator": "rvsg.generators",
    "simulator": "rvsg.simulators",
    "strategy": "rvsg.strategies",
    "executor": "rvsg.executors",
    "store": "rvsg.stores",
    "metric": "rvsg.metrics",
    "signal": "rvsg.signals",
    "stack": "rvsg.stacks",
    "world": "rvsg.worlds",
    "exporter": "rvsg.exporters",
    "recording": "rvsg.recordings",
    "robot": "rvsg.robots",
    "tables": "rvsg.tables",
    "page": "rvsg.pages",
}
"""Every kind of plug-in, with its entry point group."""
REMOVED = {("strategy", "map-elites"): "It was removed in 0.3; hybrid looks for every kind of failure."}
"""What to use instead of plug-ins that RVSG shipped once."""


class Spec(Record):
    """A plug-in as data: its registered name and its options. This is what a record keeps of a plug-in."""

    name: Annotated[str, Field(min_length=1)]
    options: dict[str, Any] = Field(default_factory=dict)

    def __init__(self, name: str, options: Mapping[str, Any] | None = None, **unknown: Any) -> None:
        super().__init__(**{"name": name, "options": dict(options or {}), **unknown})

    @classmethod
    def of(cls, given: str | Spec) -> Spec:
        """Return `given` as a Spec; a name stands for the plug-in with its default options."""
        return given if isinstance(given, Spec) else cls(given)

    def __str__(self) -> str:
        options = ", ".join(f"{key}={value!r}" for key, value in self.options.items())
        return f"{self.name}({options})" if options else self.name


def names(kind: str) -> tuple[str, ...]:
    """Return the names of all plug-ins of a kind, e.g. `generator`."""
    return tuple(sorted(_registered(kind)))


def find(kind: str, name: str) -> Any:
    """Return the class registered under a name.

    Raises:
        UnknownName: no plug-in of this kind has this name.
        InputError: several packages register it, or its module cannot be imported.
    """
    registered = _registered(kind)
    if name not in registered:
        raise UnknownName(kind, name, registered, hint=REMOVED.get((kind, name), ""))
    same = sorted({origin(point) for point in _points(kind, tuple(sys.path)) if point.name == name})
    if len(same) > 1:
        raise InputError(
            f'{len(same)} installed packages register the {kind} "{name}": {" and ".join(same)}. Rename it in one of '
            "them, or uninstall that package.",
            code="plug-in-name-taken",
        )
    try:
        return registered[name].load()
    except (ImportError, AttributeError) as error:
        raise InputError(
            f'Cannot load the {kind} "{name}" ({registered[name].value}): {error}. Check that its package is installed.'
        ) from error


def find_format(kind: str, name: str, extra: str = "exchange") -> Any:
    """Return the reader or writer of a file format, which may be in a distribution that is not installed.

    Raises:
        InputError: no installed distribution knows the format; says how to install the one that does.
    """
    if name not in _registered(kind):
        raise InputError(
            f'The format "{name}" needs a package that is not installed: {how_to_install(extra)}.',
            code="format-not-installed",
        )
    return find(kind, name)


def origin(point: EntryPoint) -> str:
    """Return which package registers an entry point, and what it stands for."""
    return f"{_package(point)} ({point.value})"


def origins(kind: str, name: str) -> str:
    """Return which packages register a name, for a message."""
    return " and ".join(sorted({origin(point) for point in _points(kind, tuple(sys.path)) if point.name == name}))


def content_of(plugin: Any) -> str:
    """Return distribution, version and content of a plug-in, or of the file that defines it; empty where it ships.

    Args:
        plugin: an instance, a class or a function.
    """
    kind = plugin if isinstance(plugin, type) or isfunction(plugin) else type(plugin)
    top = _top(kind.__module__)
    if top == "rvsg":
        return ""
    distributions = packages_distributions().get(top, ())
    named = [f"{name} {distribution(name).version}" for name in distributions]
    return " ".join([*named, f"{kind.__module__}+{source_hash(kind)}"])


def source_hash(kind: Any) -> str:
    """Return a hash of the file that defines a class or a function; empty where its source is not known."""
    try:
        file = getsourcefile(kind)
        content = Path(file).read_bytes() if file and Path(file).is_file() else getsource(kind).encode()
    except (OSError, TypeError):
        return ""
    return hashlib.sha256(content).hexdigest()[:12]


def at_fault(error: BaseException) -> str | None:
    """Return the installed package, other than RVSG, in whose plug-in an error arose; None where RVSG is at fault."""
    points = [point for kind in KINDS for point in _points(kind, tuple(sys.path))]
    packages = {_top(point.module): _package(point) for point in points}
    for frame, _ in reversed(list(traceback.walk_tb(error.__traceback__))):
        package = _top(str(frame.f_globals.get("__name__", "")))
        if package == "rvsg" or package in packages:
            return None if package == "rvsg" else packages[package]
    return None


def _package(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist is not None else "a package without a name"


def _top(module: str) -> str:
    return module.partition(".")[0]


def make(kind: str, name: str, options: Mapping[str, Any], *given: Any) -> Any:
    """Return an instance of a plug-in, made as `Plugin(*given, **options)`.

    Raises:
        UnknownName, InputError: the plug-in does not exist, or does not accept the options.
    """
    return made(kind, name, find(kind, name), options, *given)


def made(kind: str, name: str, plugin: Any, options: Mapping[str, Any], *given: Any) -> Any:
    """Return an instance of a plug-in whose class is known; see `make`.

    A plug-in names in a class attribute `code_options` those of its options that are run, such as a command. Values of
    these are refused where only stored settings name them (`rvsg.core.permission`).
    """
    check_accepted(kind, name, plugin, options, given=len(given))
    # Plug-ins of some kinds have no base class that could hold the default.
    permission.check_options(kind, name, options, getattr(plugin, "code_options", None))
    try:
        return plugin(*given, **options)
    except (TypeError, ValueError) as error:
        raise InputError(
            f'Cannot make the {kind} "{name}" with {dict(options) or "no options"}: {error}', code="plug-in-options"
        ) from error


def check_options(kind: str, name: str, options: Mapping[str, Any], *, given: int = 0) -> Any:
    """Return the class of a plug-in after checking that it accepts the options.

    Args:
        given: how many positional values every plug-in of this kind receives.

    Raises:
        InputError: names the option that is not accepted, the nearest one, and all that are.
    """
    plugin = find(kind, name)
    check_accepted(kind, name, plugin, options, given=given)
    return plugin


def check_accepted(kind: str, name: str, plugin: Any, options: Mapping[str, Any], *, given: int = 0) -> None:
    """Raise InputError if the class of a plug-in does not accept one of the options."""
    if unknown := _not_accepted(plugin, options, given):
        accepted = _accepted(plugin)[given:]
        near = difflib.get_close_matches(unknown[0], accepted, n=1, cutoff=0.5)
        hint = f' Did you mean "{near[0]}"?' if near else ""
        listed = f"Known options: {', '.join(accepted)}." if accepted else "It takes none."
        raise InputError(f'The {kind} "{name}" has no option "{unknown[0]}".{hint} {listed}', code="unknown-option")


def check_complete(kind: str, plugin: object, protocol: type) -> None:
    """Raise InputError if a plug-in lacks a member of its protocol; names every missing one."""
    members = [name for name in dir(protocol) if not name.startswith("_")]
    missing = [name for name in members if not hasattr(plugin, name)]
    if missing:
        name = plugin.__name__ if isinstance(plugin, type) else type(plugin).__name__
        raise InputError(
            f"The {kind} {name} lacks {', '.join(missing)}. Derive it from "
            f"{protocol.__module__}.{protocol.__name__}, which has defaults for what is optional."
        )


def _accepted(plugin: Any) -> tuple[str, ...]:
    """Return the parameters a plug-in accepts by name."""
    return tuple(
        p.name for p in signature(plugin).parameters.values() if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)
    )


def _not_accepted(plugin: Any, options: Mapping[str, Any], given: int) -> list[str]:
    """Return the options that a plug-in does not accept; none if it accepts any."""
    if any(p.kind is p.VAR_KEYWORD for p in signature(plugin).parameters.values()):
        return []
    return sorted(options.keys() - set(_accepted(plugin)[given:]))


def _registered(kind: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in _points(kind, tuple(sys.path))}


@lru_cache(maxsize=64)
def _points(kind: str, path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Return the entry points of a kind; a change of `path`, the module search path, looks them up again."""
    return tuple(entry_points(group=KINDS[kind]))


def ignore(_: object) -> None:
    """Do nothing with a message or an event."""


class Named(Protocol):
    """Anything with an id."""

    @property
    def id(self) -> str:
        """The name it is looked up by."""
        ...


Thing = TypeVar("Thing", bound=Named)


class Registry(Mapping[str, Thing], Generic[Thing]):
    """Things by id: first those that ship, then those of plug-ins, in the order of their entry points' names.

    An entry point gives one thing or a sequence of them. Looking up what ships loads no plug-in.
    """

    def __init__(self, kind: str, of: type[Thing], built_in: Mapping[str, Thing]) -> None:
        self.kind = kind
        self.of = of
        self._built_in = dict(built_in)
        self._all: dict[str, Thing] | None = None

    def find(self, name: str, *, hint: str = "") -> Thing:
        """Return the thing of that id; UnknownName with the nearest id where there is none."""
        if name not in self:
            raise UnknownName(self.kind, name, self, hint=hint)
        return self[name]

    def __getitem__(self, name: str) -> Thing:
        thing = self._built_in.get(name)
        return thing if thing is not None else self._everything()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._everything())

    def __len__(self) -> int:
        return len(self._everything())

    def _everything(self) -> dict[str, Thing]:
        if self._all is None:
            things = dict(self._built_in)
            owners = dict.fromkeys(things, "RVSG itself")
            for name in names(self.kind):
                origin = origins(self.kind, name)
                for thing in self._of_plug_in(name):
                    if thing.id in things:
                        raise InputError(
                            f'The {self.kind} "{thing.id}" is registered twice, by {owners[thing.id]} and by {origin}. '
                            "Rename it in the plug-in, or uninstall its package.",
                            code="plug-in-name-taken",
                        )
                    things[thing.id] = thing
                    owners[thing.id] = origin
            self._all = things
        return self._all

    def _of_plug_in(self, name: str) -> Sequence[Thing]:
        plugin: Any = find(self.kind, name)
        things = list(plugin) if isinstance(plugin, Sequence) else [plugin]
        for thing in things:
            if not isinstance(thing, self.of):
                raise InputError(
                    f'The plug-in "{name}" of {KINDS[self.kind]} must be a {self.of.__name__} or a sequence of '
                    f"them, got {type(thing).__name__}.",
                    code="plug-in-kind",
                )
        return things
