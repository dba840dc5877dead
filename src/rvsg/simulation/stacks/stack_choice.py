"""The choice of a stack under test: a registered one, a class of your own, a command, or a parameter file."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

from rvsg.core import permission, plugins
from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.simulation.stacks.nav2_stack import Nav2Dwb, Nav2DwbHumble
from rvsg.simulation.stacks.protocol import LocalPlanner, NavigationStack, WholeStack

DEFAULT_STACK, STUDY_STACK = Nav2Dwb.name, Nav2DwbHumble.name
HINT = "`rvsg stacks` lists them. Your own: module:Class, file.py:Class, exec:COMMAND, or a nav2_params.yaml."

COMMANDS = ("exec", "exec-stack")
"""Stacks whose name is followed by a command: `exec:./my_planner`."""

StackLike: TypeAlias = "str | Path | Spec | Mapping[str, Any] | NavigationStack | type[NavigationStack]"


class Stack(Record):
    """A navigation stack as data; part of the id of every run that it drives."""

    name: str
    version: str
    options: dict[str, Any]


def default_stack(profile: object = "default") -> str:
    """Return the stack that drives where none is named: the study's in the profile of the study."""
    return STUDY_STACK if profile == "published-study" else DEFAULT_STACK


def stack_names() -> tuple[str, ...]:
    """Return the names of the registered stacks."""
    return tuple(sorted({*plugins.names("stack"), STUDY_STACK}))


def stack_class(name: str) -> type[NavigationStack]:
    """Return the class of a registered stack.

    That of the study is no plug-in: stored runs without a stack are of it, whatever is installed.
    """
    found: type[NavigationStack] = Nav2DwbHumble if name == STUDY_STACK else plugins.find("stack", name)
    return found


def listed_stacks() -> list[dict[str, Any]]:
    """Return name, title, version and options with their defaults of every registered stack, by name."""
    return [
        {"name": name, "title": kind.title, "version": kind.version, "options": dict(kind.default_options())}
        for name, kind in ((name, stack_class(name)) for name in stack_names())
    ]


class StackChoice:
    """A stack that was chosen: its record, and the instance that drives. It can be pickled."""

    def __init__(self, driver: NavigationStack, name: str, options: Mapping[str, Any]) -> None:
        if not isinstance(driver, LocalPlanner | WholeStack):
            raise InputError(
                f"The stack {name} is a {type(driver).__name__}. Derive it from rvsg.stacks.LocalPlanner or WholeStack."
            )
        self.driver = driver
        self.record = Stack(
            name=name, version=_version(driver), options=_as_data(name, {**options, **dict(driver.options)})
        )
        self.messages: tuple[str, ...] = tuple(driver.notes)
        """What a user has to know of it, e.g. which parameters are not supported."""
        self._given = False

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy, such as that of a worker process: its driver was made for it."""
        self.__dict__.update(state, _given=False)

    def close(self) -> None:
        """Close the driver, unless `of` was given it as an instance: that is for who made it."""
        if not self._given:
            self.driver.close()

    @classmethod
    def of(cls, given: StackLike, options: Mapping[str, Any] | None = None) -> StackChoice:
        """Return the stack of a name, a file, a Spec or its data, a class or an instance.

        Args:
            options: for a name, a file or a class.

        Raises:
            UnknownName: there is no such stack.
            InputError: it cannot be made with these options.
            FileError: its file cannot be used.
        """
        if isinstance(given, NavigationStack):
            choice = cls(given, _name(type(given)), {})
            choice._given = True
            return choice
        if isinstance(given, type):
            return _of_class(given, _name(given), options or {})
        if isinstance(given, Mapping):
            given = _spec_of(given)
        if isinstance(given, Spec):
            return _named(given.name, {**given.options, **(options or {})})
        return _named(str(given), options or {})

    @property
    def is_study(self) -> bool:
        """Whether it is the stack of the published study, of which a run stores no record."""
        return self.record.name == STUDY_STACK and not self.record.options


def _spec_of(given: Mapping[str, Any]) -> Spec:
    values = dict(given)
    version = values.pop("version", None)
    if set(values) - {"name", "options"} or not isinstance(values.get("name"), str):
        raise InputError(f"stack: expected a name, or name and options, got {dict(given)!r}")
    options = values.get("options") or {}
    if not isinstance(options, Mapping):
        raise InputError(f"stack: expected options as NAME: VALUE, got {options!r}")
    found = StackChoice.of(Spec(values["name"], options)).record.version if version is not None else None
    if version != found:
        known = f" What it did is {STUDY_STACK}." if (values["name"], version) == (DEFAULT_STACK, "1") else ""
        raise InputError(
            f"stack: {values['name']} is present in version {found}, not {version}. Leave the version out, or restore "
            f"that version.{known}"
        )
    return Spec(values["name"], options)


def _named(name: str, options: Mapping[str, Any]) -> StackChoice:
    if name in stack_names():
        driver = plugins.made("stack", name, stack_class(name), options)
        return StackChoice(driver, name, options)
    kind, _, rest = name.partition(":")
    if rest and kind in COMMANDS:
        return _named(kind, {"command": rest, **options})
    if name.endswith((".yaml", ".yml")):
        return _of_file(name, options)
    if ":" in name:
        module, _, attribute = name.rpartition(":")
        permission.check("stack", name, "stack", name)
        return _of_class(_load_class(module, attribute, name), name, options)
    raise UnknownName("stack", name, stack_names(), hint=HINT)


def _of_file(path: str, options: Mapping[str, Any]) -> StackChoice:
    """Return the stack that a parameter file of Nav2 asks for."""
    from rvsg.simulation.stacks.nav2_params import read_nav2_params

    read = read_nav2_params(path)
    try:
        found = _named(read.stack, {**read.options, **options})
    except InputError as error:
        raise FileError(path, str(error), code=error.code) from error
    found.messages += tuple(read.messages())
    return found


def _of_class(found: Any, name: str, options: Mapping[str, Any]) -> StackChoice:
    if not (isinstance(found, type) and issubclass(found, NavigationStack)):
        raise InputError(f"The stack {name} must be a class derived from rvsg.stacks.LocalPlanner or WholeStack.")
    if missing := sorted(found.__abstractmethods__):
        raise InputError(f"The stack {name} lacks {', '.join(missing)}.")
    return StackChoice(plugins.made("stack", name, found, options), name, options)


def _load_class(module: str, attribute: str, name: str) -> Any:
    loaded = _load_file(Path(module)) if module.endswith(".py") else _load_module(module, name)
    try:
        return getattr(loaded, attribute)
    except AttributeError:
        classes = [
            key for key, value in vars(loaded).items()
            if isinstance(value, type) and issubclass(value, NavigationStack) and value.__module__ == loaded.__name__
        ]  # fmt: skip
        raise UnknownName("class", attribute, classes, hint=f"It was looked for in {module}.") from None


def _load_module(module: str, name: str) -> ModuleType:
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)  # a module beside you; behind all others, so that no file there takes their place
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise InputError(f"Cannot load the stack {name}: {error}. {HINT}") from error
    except Exception as error:
        raise InputError(f"Cannot load the stack {name}: {type(error).__name__}: {error}") from error


def _load_file(path: Path) -> ModuleType:
    """Import a Python file under a name that is made of its path; modules beside it can be imported by it."""
    path = path.resolve()
    if not path.is_file():
        raise FileError(path, "there is no such file. Expected a Python file that defines the stack.")
    import cloudpickle

    name = f"_rvsg_stack_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # it may import a module beside it, as a script may
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        line = error.lineno if isinstance(error, SyntaxError) else None
        raise FileError(path, f"cannot be imported: {type(error).__name__}: {error}", line=line) from error
    # Workers cannot import it by this name; they get its content as it is now, wherever they are.
    cloudpickle.register_pickle_by_value(module)
    return module


def _name(kind: type[NavigationStack]) -> str:
    return kind.name or f"{kind.__module__}:{kind.__qualname__}"


def _version(driver: NavigationStack) -> str:
    """Return the declared version; for a stack that does not ship, with a hash of the file that defines its class."""
    kind = type(driver)
    content = "" if kind.__module__.partition(".")[0] == "rvsg" else plugins.source_hash(kind)
    return f"{driver.version}+{content}" if content else str(driver.version)


def _as_data(name: str, options: Mapping[str, Any]) -> dict[str, Any]:
    try:
        Stack(name=name, version="", options=dict(options)).id  # noqa: B018  (canonical JSON checks every value)
    except (TypeError, ValueError) as error:
        raise InputError(f"The options of the stack {name} are not plain data: {error}") from None
    return dict(options)
