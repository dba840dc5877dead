"""Texts in pieces: names of areas, and what changed between two texts."""

from __future__ import annotations

import re
from difflib import SequenceMatcher
from typing import Literal

from rvsg.world.areas import unknown_areas
from rvsg.world.world import World


def named_in(text: str, world: World) -> list[tuple[str, Literal["text", "known", "unknown"]]]:
    """Return a text in pieces: names of areas of the world, what looks like one and is none, and the rest."""
    known = [area.name for area in world.areas]
    unknown = [name for name in unknown_areas(text, known) if name.strip()]
    kinds = {name.casefold(): "unknown" for name in unknown} | {name.casefold(): "known" for name in known}
    if not kinds:
        return [(text, "text")]
    longest = sorted(kinds, key=len, reverse=True)
    pattern = re.compile(r"(?<!\w)(" + "|".join(re.escape(name) for name in longest) + r")(?!\w)", re.IGNORECASE)
    pieces: list[tuple[str, Literal["text", "known", "unknown"]]] = []
    for place, piece in enumerate(pattern.split(text)):
        if piece:
            is_known = kinds.get(piece.casefold()) == "known"
            pieces.append((piece, "text" if place % 2 == 0 else "known" if is_known else "unknown"))
    return pieces


def difference(before: str, after: str) -> list[tuple[Literal["same", "removed", "added"], str]]:
    """Return what changed between two texts, word by word: pieces that are the same, removed or added."""
    old, new = (re.findall(r"\S+\s*", text) for text in (before, after))
    matcher = SequenceMatcher(None, [w.strip() for w in old], [w.strip() for w in new], autojunk=False)
    pieces: list[tuple[Literal["same", "removed", "added"], str]] = []
    for kind, i1, i2, j1, j2 in matcher.get_opcodes():
        if kind == "equal":
            pieces.append(("same", "".join(new[j1:j2])))
            continue
        if i2 > i1:
            pieces.append(("removed", "".join(old[i1:i2])))
        if j2 > j1:
            pieces.append(("added", "".join(new[j1:j2])))
    return pieces
