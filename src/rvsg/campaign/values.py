"""The metrics of one run, kept small: a campaign holds those of thousands of runs."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler
from pydantic_core import core_schema

_PLACES: dict[tuple[str, ...], dict[str, int]] = {}
"""Where each metric stands, for every list of metrics; all runs of a campaign have the same."""


class Values(Mapping[str, float | None]):
    """Metrics by id; None where a metric has no value. It never changes, and takes 8 bytes a metric."""

    __slots__ = ("_numbers", "_places")

    def __init__(self, given: Mapping[str, float | None]) -> None:
        names = tuple(given)
        places = _PLACES.get(names)
        if places is None:
            places = _PLACES[names] = {name: place for place, name in enumerate(names)}
        self._places = places
        self._numbers = array("d", (math.nan if value is None else value for value in given.values()))

    def __getitem__(self, name: str) -> float | None:
        value = self._numbers[self._places[name]]
        return None if math.isnan(value) else value

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __repr__(self) -> str:
        return repr(dict(self))

    def __reduce__(self) -> tuple[type[Values], tuple[dict[str, float | None]]]:
        return Values, (dict(self),)


class _Kept:
    """Has a field of a record kept as `Values`, whatever mapping it is given."""

    @staticmethod
    def __get_pydantic_core_schema__(_: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        def made(given: Any, validated: core_schema.ValidatorFunctionWrapHandler) -> Values:
            return given if isinstance(given, Values) else Values(validated(given))

        return core_schema.no_info_wrap_validator_function(
            made,
            handler.generate_schema(dict[str, float | None]),
            serialization=core_schema.plain_serializer_function_ser_schema(dict),
        )


Metrics = Annotated[Mapping[str, float | None], _Kept]
"""Metrics of a run by id; None where a metric has no value for it."""
