"""The work of a place: which areas an activity names, in which order, and what people do in such a place."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache

from rvsg.generation.places import Place
from rvsg.scenario.scenario import Human, ends_of


def named_in(activity: str, places: Sequence[Place]) -> tuple[tuple[Place, ...], ...]:
    """Return the places that an activity names, in its order: one by its name, or all of a kind.

    A longer name counts before a shorter one in it: in "the large shelves" no "shelf" is named.
    """
    return _named_in(activity, tuple(places))


@lru_cache(maxsize=256)
def _named_in(activity: str, places: tuple[Place, ...]) -> tuple[tuple[Place, ...], ...]:
    text = activity.lower()
    found: list[tuple[int, int, tuple[Place, ...]]] = []
    names: dict[str, list[Place]] = {}
    for place in places:
        names.setdefault(place.name.lower(), []).append(place)
        names.setdefault(place.kind.lower(), []).append(place)
        word, _, number = place.name.lower().rpartition(" ")
        if number.isdigit():
            names.setdefault(word, []).append(place)
    for name in sorted(names, key=lambda each: (-len(each), each)):
        for match in re.finditer(rf"\b{_any_number(name)}\b", text):
            if all(match.end() <= begin or end <= match.start() for begin, end, _ in found):
                found.append((match.start(), match.end(), tuple(dict.fromkeys(names[name]))))
    return tuple(named for _, _, named in sorted(found, key=lambda each: each[:2]))


def _any_number(name: str) -> str:
    """Return a pattern of a name in the singular or the plural."""
    stem = re.escape(name)
    if name.endswith("shelf"):
        return stem.removesuffix("f") + "(?:f|ves)"
    if name.endswith("shelves"):
        return stem.removesuffix("ves") + "(?:f|ves)"
    return stem.removesuffix("s") + "(?:s|es)?" if name.endswith("s") else stem + "(?:s|es)?"


def follows(human: Human, named: Sequence[tuple[Place, ...]]) -> bool:
    """Return whether a person goes to the places that an activity names, in its order (their tasks come round)."""
    stops = [ends_of(task)[0] for task in human.tasks]
    wanted = [{place.name for place in each} for each in named]
    for begin in range(len(stops)):
        turned = iter([*stops[begin:], *stops[:begin]])
        if all(any(stop in each for stop in turned) for each in wanted):
            return True
    return not wanted


def sentence(text: str) -> str:
    """Return a text without the full stop at its end, to be put into a sentence."""
    return text.strip().rstrip(".").rstrip()
