"""The base of all records: frozen, strict about keys, free of NaN, with an id made of the content."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cached_property
from typing import Any, Self

from pydantic import BaseModel, ConfigDict


def canonical_json(value: Any) -> str:
    """Return the canonical JSON of `value`: keys sorted, no spaces, shortest floats; ValueError for NaN."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def content_id(kind: str, value: Any) -> str:
    """Return `kind-` and 16 hexadecimal digits of the SHA-256 of the canonical JSON; equal content has equal id."""
    return text_id(kind, canonical_json(value))


def text_id(kind: str, text: str) -> str:
    """Return the `content_id` of the value whose canonical JSON is `text`."""
    return f"{kind}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"


class Record(BaseModel):
    """A frozen record. Unknown keys and non-finite numbers are refused; equal content has equal `id`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @cached_property
    def id(self) -> str:
        """Content id, e.g. `scenario-1f2e3d4c5b6a7988`."""
        return content_id(type(self).__name__.lower(), self.model_dump(mode="json"))

    def replace(self, **changes: Any) -> Self:
        """Return a validated copy with some fields changed and an id of its own."""
        fields = {name: getattr(self, name) for name in type(self).__pydantic_fields__}
        return type(self)(**(fields | changes))

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with some fields changed but not validated; cached properties are not copied."""
        fields = type(self).__pydantic_fields__
        if deep or update is None or not update.keys() <= fields.keys():
            copied = super().model_copy(update=update, deep=deep)
            for name in copied.__dict__.keys() - fields.keys():
                del copied.__dict__[name]
            return copied
        # As pydantic does it, in a third of the time: generators change hundreds of records for each one they keep.
        copied = type(self).__new__(type(self))
        values = {**self.__dict__, **update}
        if len(values) > len(fields):  # a cached property is among them
            values = {name: value for name, value in values.items() if name in fields}
        object.__setattr__(copied, "__dict__", values)
        object.__setattr__(copied, "__pydantic_fields_set__", self.__pydantic_fields_set__ | update.keys())
        object.__setattr__(copied, "__pydantic_extra__", None)
        object.__setattr__(copied, "__pydantic_private__", None)
        return copied

    def to_json(self) -> str:
        """Return the record as readable JSON, ending in a newline."""
        return json.dumps(self.model_dump(mode="json"), indent=2, ensure_ascii=False, allow_nan=False) + "\n"

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Read a record; raises pydantic.ValidationError naming every wrong key."""
        return cls.model_validate_json(text)


class Pose(Record):
    """A pose in the plane: metres, radians counter-clockwise."""

    x: float
    y: float
    yaw: float = 0.0
