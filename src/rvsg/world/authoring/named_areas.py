"""Finds names in free text that look like those of areas and are none: the text of activities is otherwise free."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence

ALIKE = 0.85
"""So similar (difflib's ratio) to a known name is what was meant to be it."""
_CAPITALISED = re.compile(r"\b[A-ZÀ-ÖØ-Þ][\w'-]*(?:\s+[A-ZÀ-ÖØ-Þ][\w'-]*)*(?:\s+\d+)?\b")
_ARROW = re.compile(r"→|->")


def unknown_areas(text: str, known: Sequence[str]) -> list[str]:
    """Return the names in a text that look like those of areas and are none of the known ones, in no order.

    A name looks so where it stands at an end of an arrow, where it is one of a known kind with another number
    (`Shelf 9` beside `Shelf 1`), or where capital letters and a likeness say so (`Wast Area`).
    """
    if _ARROW.search(text):
        sides = [side.strip(" .,;") for side in _ARROW.split(text)]
        return [side for side in dict.fromkeys(sides) if side and not any(_same(side, name) for name in known)]
    rest, found = text, []
    for name in sorted(known, key=len, reverse=True):
        rest = re.sub(_pattern(name), "\0", rest, flags=re.IGNORECASE)
    kinds = {match[1] for name in known if (match := re.fullmatch(r"(.*\S)\s*\d+", name))}
    for kind in sorted(kinds, key=len, reverse=True):
        numbered = re.compile(_pattern(kind).removesuffix(_END) + r"\s*\d+\b", re.IGNORECASE)
        found += numbered.findall(rest)
        rest = numbered.sub("\0", rest)
    folded = [name.casefold() for name in known]
    for phrase in _CAPITALISED.findall(rest):
        one_of = re.sub(r"s(\s+\d+)$", r"\1", phrase.casefold())  # "Areas 3 and 4" begins with a known name
        if one_of not in folded and difflib.get_close_matches(phrase.casefold(), folded, n=1, cutoff=ALIKE):
            found.append(phrase)
    return list(dict.fromkeys(found))


_END = r"(?!\w)"


def _pattern(name: str) -> str:
    """Return a name as a whole word, however its words are spaced."""
    return r"(?<!\w)" + r"\s+".join(re.escape(word) for word in name.split()) + _END


def _same(text: str, name: str) -> bool:
    return text.casefold().split() == name.casefold().split()
