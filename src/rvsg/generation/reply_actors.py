"""What a reply says of children, wheelchairs, trolleys and moved objects, in worlds that allow them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from rvsg.generation.actors import CHILD, MOVED, TROLLEY, WHEELCHAIR, box
from rvsg.generation.lenient_json import number_of
from rvsg.scenario.scenario import LIMITS, TROLLEY_LENGTHS_M, TROLLEY_WIDTHS_M, PersonKind, Trolley
from rvsg.world.world import SolidObject

MOST_MOVED = 3
SIZES_M = {"length_m": (0.2, 3.0, 1.2), "width_m": (0.2, 2.0, 0.8), "height_m": (0.1, 2.2, 0.9)}
"""Smallest and largest size of a moved object, and what is taken where nothing is said."""
FARTHEST_M = 10_000.0
Find = Callable[[str, str, str], None]


def known_keys(actors: Sequence[str]) -> set[str]:
    """Return the keys of a person that mean something besides."""
    return ({"trolley"} if TROLLEY in actors else set()) | ({"kind"} if {CHILD, WHEELCHAIR} & set(actors) else set())


def person_of(value: Mapping[str, Any], actors: Sequence[str], find: Find) -> dict[str, Any]:
    """Return the fields of a person that the reply gives: kind, radius, trolley."""
    found: dict[str, Any] = {}
    kind = value.get("kind")
    if kind not in (None, "", PersonKind.ADULT.value) and {CHILD, WHEELCHAIR} & set(actors):
        if kind in (CHILD, WHEELCHAIR) and kind in actors:
            found |= {"kind": PersonKind(kind), "radius_m": LIMITS[PersonKind(kind)].radius_m}
        else:
            allowed = ", ".join(name for name in (CHILD, WHEELCHAIR) if name in actors)
            find("unknown-kind", f'"kind" is {str(kind)[:40]!r}.', f"Take one of adult, {allowed}.")
    pushed = value.get("trolley")
    if TROLLEY in actors and pushed is not None and pushed is not False:
        try:
            found["trolley"] = Trolley.model_validate({} if pushed is True else pushed)
        except ValidationError:
            (short, long), (thin, wide) = TROLLEY_LENGTHS_M, TROLLEY_WIDTHS_M
            sizes = f'Give {{"length_m": {short:g} to {long:g}, "width_m": {thin:g} to {wide:g}}}.'
            find("bad-trolley", "the trolley has no size that a trolley has.", sizes)
    return found


def moved_in(
    holder: Mapping[str, Any], actors: Sequence[str], lidar_height_m: float, find: Find
) -> tuple[SolidObject, ...] | None:
    """Return the objects that a reply moves; None where it says nothing of any."""
    listed = holder.get("moved")
    if MOVED not in actors or listed is None:
        return None
    entries = listed if isinstance(listed, list) else [listed]
    if len(entries) > MOST_MOVED:
        find("too-many-moved", f"{len(entries)} objects are moved; at most {MOST_MOVED} count.", "Leave some out.")
    found: list[SolidObject] = []
    for number, entry in enumerate(entries[:MOST_MOVED], start=1):
        thing = _box(entry, number, lidar_height_m)
        if thing is None:
            find("bad-moved-object", f"object {number} of moved has no x and y in metres.", "Give both as numbers.")
        else:
            found.append(thing)
    return tuple(found)


def _box(entry: Any, number: int, lidar_height_m: float) -> SolidObject | None:
    given = entry if isinstance(entry, dict) else {}
    x, y = number_of(given.get("x")), number_of(given.get("y"))
    if x is None or y is None or max(abs(x), abs(y)) > FARTHEST_M:
        return None
    sizes = []
    for key, (low, high, usual) in SIZES_M.items():
        value = number_of(given.get(key))
        sizes.append(usual if value is None else min(high, max(low, value)))
    yaw = math.remainder(number_of(given.get("yaw")) or 0.0, 2.0 * math.pi)
    name = " ".join(str(given.get("name") or "").split())[:60] or f"object {number}"
    return box(name, (round(x, 3), round(y, 3)), (sizes[0], sizes[1], sizes[2]), round(yaw, 3), lidar_height_m)
