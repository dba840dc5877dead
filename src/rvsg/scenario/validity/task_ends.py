"""What a task's name promises: "Area 2 → Shelf 6" starts in one labelled area and ends in another."""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass

from rvsg.scenario.scenario import Task
from rvsg.world.world import World

_ARROW = re.compile(r"\s*(?:→|⟶|➔|➜|⇒|-+>|=+>|–>|—>)\s*")
_TO = re.compile(r"\s+to\s+", re.IGNORECASE)
_NOTE = re.compile(r"\s*\([^()]*\)\s*")


@dataclass(frozen=True)
class Side:
    """One end of a task: the text, and the waypoints it allows; None where it claims nothing or is not known."""

    text: str
    waypoints: frozenset[str] | None = None
    known: bool = True

    def allows(self, waypoint: str) -> bool:
        """Whether the task may begin or end there."""
        return self.waypoints is None or waypoint in self.waypoints


ANYWHERE = Side("")


def resolve(text: str, world: World) -> Side:
    """The area or waypoint a text names, case and spacing aside; an unknown one allows anything and says so."""
    wanted = " ".join(text.split()).casefold()
    for area in world.areas:
        if area.name.casefold() == wanted:
            return Side(area.name, frozenset(area.waypoints) & world.grid.valid)
    for name in world.grid.valid:
        if name.casefold() == wanted:
            return Side(name, frozenset({name}))
    bare = " ".join(_NOTE.sub(" ", text).split())
    if bare and bare != " ".join(text.split()):
        return resolve(bare, world)
    return Side(text.strip(), None, known=False)


def parts_of(name: str, world: World) -> tuple[str, ...]:
    """The places a task's name lists: two or more around arrows, one for the name of an area, none for free text."""
    parts = tuple(part.strip() for part in _ARROW.split(name.strip()) if part.strip())
    if len(parts) >= 2:
        return parts
    by_word = tuple(part.strip() for part in _TO.split(name.strip()))
    if len(by_word) == 2 and all(resolve(part, world).known for part in by_word):
        return by_word
    return parts if len(parts) == 1 and resolve(parts[0], world).known else ()


def sides(task: Task, world: World) -> tuple[Side, Side]:
    """The start and the end a task promises: by `start_area` and `end_area`, else by its name."""
    parts = parts_of(task.name, world)
    start = task.start_area or (parts[0] if parts else None)
    end = task.end_area or (parts[-1] if parts else None)
    return (resolve(start, world) if start else ANYWHERE, resolve(end, world) if end else ANYWHERE)


def near_place(text: str, world: World, cutoff: float = 0.6) -> str | None:
    """What an unknown place most likely means: the one area or waypoint its text holds ("Area 3 entry"), else the
    area with the most similar name; None where two are held ("Shelf 2/Shelf 3") or none is similar."""
    held = _held(text, [area.name for area in world.areas]) or _held(text, sorted(world.grid.valid))
    if held:
        return held[0] if len(held) == 1 else None
    bare = _NOTE.sub(" ", text).strip() or text
    near = difflib.get_close_matches(bare, [a.name for a in world.areas], n=1, cutoff=cutoff)
    return near[0] if near else None


def _held(text: str, names: list[str]) -> list[str]:
    """The names that stand in a text as whole words, without those that are part of a longer one found there."""
    held = [name for name in names if re.search(rf"(?<!\w){re.escape(name)}(?!\w)", text, re.IGNORECASE)]
    return [name for name in held if not any(name != other and name in other for other in held)]


def spelled(name: str, world: World) -> str | None:
    """The one waypoint a misspelt name can mean: `e15`, `E-15`, `E 15`, `E015`, `(E15)`; None where there is none."""
    match = re.fullmatch(r"\W*([A-Za-z]{1,2})[\s_\-.,]*0*(\d{1,3})\W*", name)
    if match is None:
        return None
    candidate = f"{match[1].upper()}{match[2]}"
    return candidate if candidate in world.grid.by_name else None
