"""ROS 2 interfaces as cyclonedds types: the message definitions of a release become dataclasses that DDS can send.

The definitions of ROS itself are those that rosbags holds for every release. Those of Nav2 are in
`interfaces.yaml`; services and actions are made of them as `rosidl` does.
"""

from __future__ import annotations

import types as python_types
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args

import yaml

from rvsg.core.errors import InputError, UnknownName, how_to_install

Release = Literal["humble", "jazzy", "kilted", "lyrical"]
RELEASES: tuple[Release, ...] = get_args(Release)
NEWEST: Release = "lyrical"


def definitions(release: Release) -> dict[str, str]:
    """Return the definitions that rosbags does not hold, as message texts by name, for one release."""
    described = yaml.safe_load(Path(__file__).with_name("interfaces.yaml").read_text(encoding="utf-8"))
    texts = {}
    for name, versions in described.items():
        # The newest version that is not newer than the release.
        known = [each for each in RELEASES[: RELEASES.index(release) + 1] if each in versions]
        parts = [part.lstrip("\n") for part in versions[known[-1]].split("---")]
        kind = name.split("/")[1]
        if kind == "msg":
            texts[name] = parts[0]
        elif kind == "srv":
            texts[f"{name}_Request"], texts[f"{name}_Response"] = parts
        else:
            uuid = "unique_identifier_msgs/UUID goal_id\n"
            texts[f"{name}_Goal"], texts[f"{name}_Result"], texts[f"{name}_Feedback"] = parts
            texts[f"{name}_SendGoal_Request"] = f"{uuid}{name}_Goal goal\n"
            texts[f"{name}_SendGoal_Response"] = "bool accepted\nbuiltin_interfaces/Time stamp\n"
            texts[f"{name}_GetResult_Request"] = uuid
            texts[f"{name}_GetResult_Response"] = f"int8 status\n{name}_Result result\n"
            texts[f"{name}_FeedbackMessage"] = f"{uuid}{name}_Feedback feedback\n"
    return texts


@dataclass(frozen=True, eq=False)
class Interfaces:
    """The interfaces of one release; `self[name]` is the dataclass of `package/msg/Name`.

    Every field has a default (zero, empty or a message of defaults), so that a message is made and then filled.
    """

    release: Release
    store: Any
    """The typestore of rosbags."""
    _made: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Any:
        if name not in self._made:
            self._made[name] = self._struct(name, self._fields(name))
        return self._made[name]

    def part_of_service(self, name: str) -> Any:
        """Return the dataclass of a request or reply with the header that rmw_cyclonedds puts before it."""
        key = f"{name} with header"
        if key not in self._made:
            header = [("rmw_guid", _base("uint64")), ("rmw_sequence", _base("int64"))]
            self._made[key] = self._struct(name, [*header, *self._fields(name)])
        return self._made[key]

    def type_hash(self, name: str) -> str:
        """Return the RIHS01 hash of an interface, which ROS 2 from Iron on announces with every endpoint."""
        self._fields(name)
        found: str = self.store.hash_rihs01(name)
        return found

    def register(self, texts: Mapping[str, str]) -> None:
        """Add message definitions, e.g. those of the user's own packages."""
        _register(self.store, texts)

    def _fields(self, name: str) -> list[tuple[str, Any]]:
        if name not in self.store.fielddefs:
            raise UnknownName("ROS interface", name, self.store.fielddefs)
        empty = [("structure_needs_at_least_one_member", _base("uint8"))]
        found: list[tuple[str, Any]] = self.store.fielddefs[name][1] or empty
        return found

    def _struct(self, name: str, fields: list[tuple[str, Any]]) -> Any:
        from cyclonedds.idl import IdlStruct
        from cyclonedds.idl.annotations import final

        body: dict[str, Any] = {"__annotations__": {}, "__module__": __name__}
        for key, kind in fields:
            body["__annotations__"][key], body[key] = self._member(kind)
        made = python_types.new_class(
            name.rsplit("/", 1)[1], (IdlStruct,), {"typename": dds_type(name)}, lambda space: space.update(body)
        )
        return final(dataclass(made))

    def _member(self, kind: Any) -> tuple[Any, Any]:
        """Return the IDL type of a field and its default."""
        from cyclonedds.idl import types
        from rosbags.interfaces import Nodetype

        idl: Any = types
        node, of = kind
        if node == Nodetype.BASE:
            return _primitive(of[0])
        if node == Nodetype.NAME:
            made = self[of]
            return made, field(default_factory=made)
        element, size = of
        inner, default = self._member(element)
        if node == Nodetype.ARRAY:
            one = default.default_factory if hasattr(default, "default_factory") else (lambda: default)
            return idl.array[inner, size], field(default_factory=lambda: [one() for _ in range(size)])
        return idl.sequence[inner], field(default_factory=list)


def _base(name: str) -> Any:
    from rosbags.interfaces import Nodetype

    return (Nodetype.BASE, (name, 0))


def _primitive(name: str) -> tuple[Any, Any]:
    from cyclonedds.idl import types as idl

    if name == "bool":
        return bool, False
    if name in ("string", "wstring"):
        return str, ""
    if name in ("byte", "char", "octet"):
        return idl.uint8, 0
    return getattr(idl, name), 0.0 if name.startswith("float") else 0


def dds_type(name: str) -> str:
    """Return the name of an interface's type in DDS, e.g. `std_msgs::msg::dds_::String_`."""
    package, kind, plain = name.split("/")
    return f"{package}::{kind}::dds_::{plain}_"


def ros_type(name: str) -> str:
    """Return `package/msg/Name` for the name of a type in DDS; other names stay as they are."""
    package, found, plain = name.partition("::dds_::")
    return "/".join((*package.split("::"), plain.removesuffix("_"))) if found else name


@cache
def interfaces(release: Release) -> Interfaces:
    """Return the interfaces of a release.

    Raises:
        InputError: cyclonedds or rosbags is not installed.
    """
    try:
        import cyclonedds.idl  # noqa: F401
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise InputError(f"ROS 2 needs {error.name}: {how_to_install('ros2')}.") from None
    if release not in RELEASES:
        raise UnknownName("ROS 2 release", release, RELEASES)
    store = get_typestore(Stores[f"ROS2_{release.upper()}"])
    _register(store, definitions(release))
    return Interfaces(release, store)


def _register(store: Any, texts: Mapping[str, str]) -> None:
    """Add definitions to a typestore under exactly these names; rosbags puts `msg/` into those of services."""
    from rosbags.typesys import get_types_from_msg

    for name, text in texts.items():
        (parsed,) = get_types_from_msg(text, name).values()
        store.register({name: parsed})


def release_named(name: str) -> Release:
    """Return the release of a name; UnknownName with the nearest one where there is none."""
    for release in RELEASES:
        if release == name:
            return release
    raise UnknownName("ROS 2 release", name, RELEASES)
