"""Feedback as bytes: a campaign keeps that of thousands of attempts, and reads hardly any of it again."""

from __future__ import annotations

import json
import zlib
from typing import Any

from pydantic import GetCoreSchemaHandler
from pydantic_core import core_schema

from rvsg.core.records import Record
from rvsg.scenario.scenario import Scenario

SHARED = ("scenario", "best")
"""The fields that are kept as they are: other attempts hold the same objects."""


class Folded:
    """A record of feedback in some 2 kB instead of 100 kB. Its other fields are read by unfolding all of it."""

    __slots__ = ("_data", "_kind", "best", "scenario")

    def __init__(self, told: Any) -> None:
        self._kind: type[Record] = type(told)
        self.scenario: Scenario = told.scenario
        self.best: Scenario | None = told.best
        self._data = zlib.compress(told.model_dump_json(exclude=set(SHARED)).encode())

    def json_value(self) -> dict[str, Any]:
        """Return what the record is as JSON."""
        own = {"scenario": self.scenario.model_dump(mode="json"), "best": None}
        if self.best is not None:
            own["best"] = self.best.model_dump(mode="json")
        value = {**json.loads(zlib.decompress(self._data)), **own}
        return {name: value[name] for name in self._kind.model_fields if name in value}

    def unfold(self) -> Any:
        """Return an equal record."""
        return self._kind.model_validate(
            {**json.loads(zlib.decompress(self._data)), "scenario": self.scenario, "best": self.best}
        )

    def __getattr__(self, name: str) -> Any:
        return getattr(self.unfold(), name)

    def __eq__(self, other: object) -> bool:
        return bool(self.unfold() == (other.unfold() if isinstance(other, Folded) else other))

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        return Folded, (self.unfold(),)


class Foldable:
    """Lets a field that holds a record of feedback hold it folded."""

    @staticmethod
    def __get_pydantic_core_schema__(source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        def made(given: Any, validated: core_schema.ValidatorFunctionWrapHandler) -> Any:
            return given if isinstance(given, Folded) else validated(given)

        def written(
            kept: Any, write: core_schema.SerializerFunctionWrapHandler, info: core_schema.SerializationInfo
        ) -> Any:
            if not isinstance(kept, Folded):
                return write(kept)
            return kept.json_value() if info.mode == "json" else write(kept.unfold())

        return core_schema.no_info_wrap_validator_function(
            made,
            handler(source),
            serialization=core_schema.wrap_serializer_function_ser_schema(written, info_arg=True),
        )
