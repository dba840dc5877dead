"""A mapping of built-in and plug-in objects, loaded on first use."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Generic, Protocol, TypeVar

from rvsg.core import plugins
from rvsg.core.errors import InputError, UnknownName


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
        found = self._built_in.get(name)
        return found if found is not None else self._everything()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._everything())

    def __len__(self) -> int:
        return len(self._everything())

    def _everything(self) -> dict[str, Thing]:
        if self._all is None:
            found = dict(self._built_in)
            owners = dict.fromkeys(found, "RVSG itself")
            for name in plugins.names(self.kind):
                origin = plugins.origins(self.kind, name)
                for thing in self._of_plug_in(name):
                    if thing.id in found:
                        raise InputError(
                            f'The {self.kind} "{thing.id}" is registered twice, by {owners[thing.id]} and by {origin}. '
                            "Rename it in the plug-in, or uninstall its package.",
                            code="plug-in-name-taken",
                        )
                    found[thing.id] = thing
                    owners[thing.id] = origin
            self._all = found
        return self._all

    def _of_plug_in(self, name: str) -> Sequence[Thing]:
        given: Any = plugins.find(self.kind, name)
        things = list(given) if isinstance(given, Sequence) else [given]
        for thing in things:
            if not isinstance(thing, self.of):
                raise InputError(
                    f'The plug-in "{name}" of {plugins.KINDS[self.kind]} must be a {self.of.__name__} or a sequence of '
                    f"them, got {type(thing).__name__}.",
                    code="plug-in-kind",
                )
        return things
