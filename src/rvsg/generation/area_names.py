"""Names for the areas of a world, proposed by a model that looks at its map; a person accepts them one by one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from rvsg.core.errors import GenerationError
from rvsg.core.records import Record
from rvsg.generation.dialogue import Dialogue
from rvsg.generation.facts import world_facts
from rvsg.generation.generator import Call
from rvsg.generation.lenient_json import find_json
from rvsg.generation.pictures import birdseye_of, pictures_of
from rvsg.generation.prompts import Prompts
from rvsg.generation.reply_schema import TEXT, object_schema
from rvsg.generation.vlm.model import Model
from rvsg.world.world import World

LONGEST_NAME = 60
LONGEST_REASON = 400
SHAPE = object_schema({"names": {"type": "array", "items": object_schema({"area": TEXT, "name": TEXT, "why": TEXT})}})


class ProposedName(Record):
    """A name that a model proposes for an area, and why."""

    area: str
    name: str
    why: str = ""


class AreaNames(Record):
    """What a model proposes, and why some of it cannot be used."""

    names: tuple[ProposedName, ...]
    unusable: tuple[str, ...] = ()
    calls: tuple[Call, ...] = ()


def propose_area_names(world: World, model: Model, prompts: Prompts) -> AreaNames:
    """Ask a model once for names of areas.

    Raises:
        GenerationError: it answers without a list of names, also when asked again.
    """
    labelled, _ = pictures_of(world)
    birdseye = birdseye_of(world)
    shown = (labelled,) if birdseye is None else (labelled, birdseye)
    facts = {**world_facts(world), "humans": 2, "heights": birdseye is not None}
    dialogue = Dialogue(model, prompts, f"names-{world.name}", facts, pictures=shown)
    dialogue.tell("system", role="system")
    answer = dialogue.ask("names", "area-names", shown=shown, shape=SHAPE)
    entries = _entries(answer.text)
    if entries is None:
        problem = 'it holds no JSON object with a list under "names".'
        entries = _entries(dialogue.ask("names", "reply-unreadable", shape=SHAPE, problem=problem).text)
    if entries is None:
        raise GenerationError(f"The model {model.name} proposed no names in two answers. Try another model.")
    names, unusable = _usable(entries, [area.name for area in world.areas])
    return AreaNames(names=names, unusable=unusable, calls=tuple(dialogue.calls))


def _entries(text: str) -> list[Any] | None:
    for found in find_json(text):
        if isinstance(found.value, Mapping) and isinstance(found.value.get("names"), list):
            return list(found.value["names"])
    return None


def _usable(entries: Iterable[Any], known: list[str]) -> tuple[tuple[ProposedName, ...], tuple[str, ...]]:
    """Return the proposals that can be accepted in any order, and what is wrong with the others."""
    names: dict[str, ProposedName] = {}
    wrong = []
    taken = {name.casefold() for name in known}
    for entry in entries:
        values = entry if isinstance(entry, Mapping) else {}
        area, name, why = (" ".join(str(values.get(key) or "").split()) for key in ("area", "name", "why"))
        if area not in known:
            wrong.append(f'"{area[:LONGEST_NAME]}" is no area of this world.')
        elif not name or len(name) > LONGEST_NAME:
            wrong.append(f'The name for "{area}" is empty or longer than {LONGEST_NAME} characters.')
        elif name == area:
            continue
        elif name.casefold() in taken or area in names:
            wrong.append(f'"{name}" for "{area}": the name is given already, or the area has a proposal.')
        else:
            taken.add(name.casefold())
            names[area] = ProposedName(area=area, name=name, why=why[:LONGEST_REASON])
    return tuple(names.values()), tuple(wrong)
