"""Who is usual in a kind of place besides adults on foot."""

from __future__ import annotations

import re
from collections.abc import Iterable

KINDS: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = (
    (("hospital", "clinic", "ward", "patient", "nurse", "care"), ("trolley", "wheelchair", "moved_object")),
    (("shop", "supermarket", "retail", "bookstore", "mall", "market"), ("trolley", "child", "moved_object")),
    (("airport", "station", "museum", "terminal", "library"), ("trolley", "child", "wheelchair")),
    (("school", "kindergarten", "home", "house", "apartment", "residential"), ("child",)),
    (("warehouse", "factory", "workshop", "shelf", "pallet", "rack"), ("trolley", "moved_object")),
    (("office", "meeting", "laboratory", "lab"), ("trolley", "moved_object")),
)
"""Words of a place, and who takes part there. The first kind that is named counts."""


def usual_actors(texts: Iterable[str]) -> tuple[str, ...]:
    """Return what generators may use in a place, told by its name, its title and its labels; nothing if none fits."""
    for text in texts:
        words = set(re.findall(r"[a-z]+", text.lower()))
        for named, actors in KINDS:
            if words & {form for word in named for form in (word, f"{word}s")}:
                return actors
    return ()
