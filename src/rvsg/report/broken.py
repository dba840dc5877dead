"""The map of what breaks where, as rows of a table."""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.campaign.feedback import MapCell
from rvsg.core.records import Record


class Broken(Record):
    """A table: the worst configuration of every kind of encounter (rows) at every place (columns), None where none."""

    places: tuple[str, ...]
    rows: tuple[tuple[str, tuple[MapCell | None, ...]], ...]


def broken(cells: Sequence[MapCell]) -> Broken:
    """Return the table of a failure map; the worst cell of each place and kind stands for all parts of the way."""
    worst: dict[tuple[str, str], MapCell] = {}
    for cell in cells:  # the worst first
        worst.setdefault((cell.encounter.kind, cell.encounter.place), cell)
    kinds = tuple(dict.fromkeys(kind for kind, _ in worst))
    places = tuple(dict.fromkeys(place for _, place in worst))
    return Broken(places=places, rows=tuple((kind, tuple(worst.get((kind, p)) for p in places)) for kind in kinds))
