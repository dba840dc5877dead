"""Scenarios with ranges instead of numbers: "0.8 to 1.4" where a speed would stand."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from rvsg.core.documents import mistakes_of
from rvsg.core.errors import InputError, UnknownName
from rvsg.core.records import Record
from rvsg.scenario.scenario import Scenario

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"\s*({_NUMBER})\s+to\s+({_NUMBER})\s*")
Key = tuple[str | int, ...]


class Range(Record):
    """A number of a scenario that may lie anywhere from `low` to `high`."""

    name: str
    """As people write it: the person and the key, e.g. `Human 1.speed_m_s`."""
    key: Key
    """Where it is in the scenario."""
    low: float
    high: float

    @model_validator(mode="after")
    def _ordered(self) -> Range:
        if not self.low < self.high:
            raise ValueError(f"{self.name}: a range goes from a smaller to a larger number, not {self}")
        return self

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}"

    def at(self, share: float) -> float:
        """Return the value at a share of the range, 0 for `low` and 1 for `high`."""
        return self.low + share * (self.high - self.low)


class ScenarioFamily(Record):
    """The scenarios that ranges span."""

    middle: Scenario
    """The scenario with every range at its middle."""
    ranges: Annotated[tuple[Range, ...], Field(min_length=1, max_length=20)]

    def at(self, values: Sequence[float]) -> Scenario:
        """Return the scenario with these values, in the order of `ranges`.

        Raises:
            InputError: a value is outside what the scenario allows there.
        """
        data = self.middle.model_dump(mode="json")
        for each, value in zip(self.ranges, values, strict=True):
            _set(data, each.key, value)
        return _scenario(data)


def family_of(value: dict[str, Any], vary: Sequence[str] = ()) -> ScenarioFamily:
    """Return the family of a scenario as plain values, with ranges in its people, and those given besides.

    Args:
        value: a scenario as JSON holds it; a number may be the text "LOW to HIGH".
        vary: ranges as `PERSON.KEY=LOW to HIGH`, e.g. `Human 1.speed_m_s=0.8 to 1.4`.

    Raises:
        InputError: a range cannot be read, is outside of `people`, or there is none.
    """
    data = copy.deepcopy(value)
    found = {key: _range(data, key, text) for key, text in _texts(data, ()) if _RANGE.fullmatch(text)}
    for key, each in found.items():
        _set(data, key, each.at(0.5))
    scenario = _scenario(data)
    data = scenario.model_dump(mode="json")
    for text in vary:
        made = _varied(data, text)
        found[made.key] = made
        _set(data, made.key, made.at(0.5))
    if not found:
        raise InputError(
            'The scenario has no range. Write one instead of a number, e.g. "speed_m_s": "0.8 to 1.4", or give '
            "--vary 'Human 1.speed_m_s=0.8 to 1.4'."
        )
    family = ScenarioFamily(middle=_scenario(data), ranges=tuple(found.values()))
    for ends in ([each.low for each in family.ranges], [each.high for each in family.ranges]):
        family.at(ends)
    return family


def _texts(value: Any, key: Key) -> Iterator[tuple[Key, str]]:
    if isinstance(value, str):
        yield key, value
    elif isinstance(value, dict):
        for name, inner in value.items():
            if name not in ("description", "name"):
                yield from _texts(inner, (*key, name))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _texts(inner, (*key, index))


def _range(data: dict[str, Any], key: Key, text: str) -> Range:
    if key[:2] != ("people", "humans") or len(key) < 4:
        raise InputError(f"{_written(key)}: {text!r} is a range, and only numbers of people may be ranges.")
    return _made(_name(data, key), key, text)


def _made(name: str, key: Key, text: str) -> Range:
    match = _RANGE.fullmatch(text)
    if match is None:
        raise InputError(f"{name}: expected a range such as 0.8 to 1.4, got {text!r}.")
    try:
        return Range(name=name, key=key, low=float(match[1]), high=float(match[2]))
    except ValidationError as error:
        raise InputError(str(error.errors()[0]["msg"]).removeprefix("Value error, ")) from None


def _varied(data: dict[str, Any], text: str) -> Range:
    name, equals, span = text.partition("=")
    humans = data["people"]["humans"]
    matching = [(k, human) for k, human in enumerate(humans) if name.startswith(f"{human['name']}.")]
    if not equals or not matching:
        known = ", ".join(human["name"] for human in humans) or "nobody"
        raise InputError(f"{text!r}: expected PERSON.KEY=LOW to HIGH. People of the scenario: {known}.")
    index, human = max(matching, key=lambda pair: len(pair[1]["name"]))
    rest = name.removeprefix(f"{human['name']}.")
    known_keys = {_written(key): key for key in _numbers(human, ())}
    if rest not in known_keys:
        raise UnknownName("number", rest, known_keys, hint=f"Numbers of {human['name']} that may vary.")
    return _made(name, ("people", "humans", index, *known_keys[rest]), span)


def _numbers(value: Any, key: Key) -> Iterator[Key]:
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield key
    elif isinstance(value, dict):
        for name, inner in value.items():
            yield from _numbers(inner, (*key, name))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _numbers(inner, (*key, index))


def _name(data: dict[str, Any], key: Key) -> str:
    human = data["people"]["humans"][key[2]]
    return f"{human.get('name', f'person {key[2]}')}.{_written(key[3:])}"


def _written(key: Key) -> str:
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _set(data: dict[str, Any], key: Key, value: float) -> None:
    at: Any = data
    for part in key[:-1]:
        at = at[part]
    at[key[-1]] = value


def _scenario(data: dict[str, Any]) -> Scenario:
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        raise InputError("The scenario cannot be used: " + "; ".join(mistakes_of(error, Scenario))) from None
