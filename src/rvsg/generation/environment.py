"""Descriptions of a world and names of its areas, proposed by a model that looks at its map and judged by a person.

The description is made once per world, in three turns. It is stored in the world's own `world.yaml` (key
`description`), or, for a world that ships with RVSG, in the user's data folder under the world's content id.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from rvsg.core.documents import read_yaml
from rvsg.core.errors import FileError, GenerationError, InputError
from rvsg.core.records import Record
from rvsg.generation.facts import birdseye_of, pictures_of, world_facts
from rvsg.generation.generator import Call
from rvsg.generation.prompts import Dialogue, Prompts
from rvsg.generation.replies import read_object
from rvsg.generation.reply_json import TEXT, find_json, object_schema, texts_schema
from rvsg.generation.vlm.model import Answer, Model
from rvsg.world.world import Description, World
from rvsg.world.world_folder import SHIPPED, load_world

KEYS = ("layout", "grid")
DATA_VARIABLE = "RVSG_DATA_DIR"
WIDE = 116
LONGEST_CHARACTERS = 6000


class EnvironmentDialogue:
    """Describes a world in three turns, and corrects the description for a reason."""

    def __init__(self, world: World, model: Model, prompts: Prompts) -> None:
        self.world = world
        self._labelled, self._grid = pictures_of(world)
        self._birdseye = birdseye_of(world)
        pictures = [picture for picture in (self._labelled, self._grid, self._birdseye) if picture is not None]
        facts = {**world_facts(world), "humans": 2, "heights": self._birdseye is not None}
        self._dialogue = Dialogue(model, prompts, f"describe-{world.name}", facts, pictures=pictures)

    @property
    def calls(self) -> tuple[Call, ...]:
        """The calls made so far."""
        return tuple(self._dialogue.calls)

    def describe(self) -> Description:
        """The three turns; raises GenerationError where the model gives no description even when asked again."""
        dialogue = self._dialogue
        dialogue.tell("system", role="system")
        first = (self._labelled, self._birdseye) if self._birdseye is not None else (self._labelled,)
        self._usable(dialogue.ask("layout", "environment-1-layout", shown=first))
        self._usable(dialogue.ask("grid", "environment-2-grid", shown=(self._grid, self._labelled)))
        return self._read(dialogue.ask("summary", "environment-3-summary", shape=texts_schema(*KEYS)))

    def begin_with(self, description: Description) -> None:
        """Begin with a description that exists already, in place of the three turns."""
        dialogue = self._dialogue
        dialogue.tell("system", role="system")
        shown = (self._labelled, *([self._birdseye] if self._birdseye is not None else []), self._grid)
        dialogue.tell("environment-given", shown=shown)
        texts = {key: getattr(description, key) for key in KEYS}
        dialogue.tell_text("assistant", json.dumps(texts, ensure_ascii=False))

    def revise(self, reason: str) -> Description:
        """One more turn: the description corrected for a person's reason."""
        answer = self._dialogue.ask("revision", "environment-revision", shape=texts_schema(*KEYS), reason=reason)
        return self._read(answer)

    def _usable(self, answer: Answer) -> None:
        """Stop where an analysis was refused or is empty: what follows would be paid for and worth nothing."""
        if answer.finish in ("refused", "empty"):
            did = f"refused to look at the map. {answer.text}" if answer.finish == "refused" else "answered nothing"
            raise GenerationError(f"The model {self._dialogue.model.name} {did.rstrip(' .')}. Try another model.")

    def _read(self, answer: Answer) -> Description:
        texts = read_object(answer.text, KEYS)
        if texts is None:
            problem = 'it holds no JSON object with a text under "layout" and one under "grid".'
            again = self._dialogue.ask("summary", "reply-unreadable", shape=texts_schema(*KEYS), problem=problem)
            texts = read_object(again.text, KEYS)
            answer = again
        if texts is None:
            ended = {"complete": "it held no such JSON", "truncated": "it was cut off by the limit of tokens"}
            raise GenerationError(
                f"The model {self._dialogue.model.name} gave no description of {self.world.name} in two answers (of "
                f"the last: {ended.get(answer.finish, f'it was {answer.finish}')}). "
                "Try another model, or write the description into the world's world.yaml yourself.",
                code="no-description",
            )
        return Description(layout=_clipped(texts["layout"]), grid=_clipped(texts["grid"]))


def description_of(world: World) -> Description | None:
    """The description of a world: the one in the user's data folder (newer than a shipped one), else its own."""
    path = stored_path(world)
    return read_description_file(path) if path.is_file() else world.description


def stored_path(world: World) -> Path:
    """Return where the description of a shipped world is stored."""
    return data_folder() / "descriptions" / f"{world.name}-{world.id.removeprefix('world-')}.yaml"


def data_folder() -> Path:
    """The user's data folder: RVSG_DATA_DIR, else the place the system has for it."""
    if chosen := os.environ.get(DATA_VARIABLE):
        return Path(chosen)
    base = os.environ.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "rvsg"


def store_description(world: World, description: Description, place: str | Path | None = None) -> Path:
    """Store the description and return the file.

    `place` is the world's folder (its world.yaml is changed, its other lines are kept), a file ending in .yaml to
    write the description alone into, or None for the user's data folder.
    """
    path = Path(place) if place is not None else stored_path(world)
    if path.suffix in (".yaml", ".yml") and path.name != "world.yaml":
        _write(path, _text(description))
        return path
    if path.name == "world.yaml":
        path = path.parent
    if path.resolve().is_relative_to(SHIPPED.resolve()):
        raise InputError(
            "A shipped world is not changed; its description goes to the user's data folder or --out.",
            code="world-shipped",
        )
    _store_in_world(path / "world.yaml", description)
    return path / "world.yaml"


def read_description_file(path: Path) -> Description:
    """A description from a file of its own; FileError where it cannot be used."""
    try:
        return Description.model_validate(read_yaml(path).value)
    except ValidationError as error:
        problems = "; ".join(f"{'.'.join(str(p) for p in e['loc'])}: {e['msg']}" for e in error.errors())
        keys = "layout, grid, reviewed, reviewer, reviewed_on"
        raise FileError(path, f"is not a description ({keys}): {problems}", code="description-file") from None


def edited(description: Description, text: str) -> Description:
    """The description as a person edited it (the YAML of `editable`); InputError where it cannot be read."""
    try:
        values = yaml.safe_load(text)
        texts = {key: _clipped(str(values[key])) for key in KEYS}
    except (yaml.YAMLError, KeyError, TypeError) as error:
        raise InputError(f"The edited text must keep the keys layout and grid with their texts: {error}") from None
    if not all(texts.values()):
        raise InputError("The edited description is empty under layout or grid.")
    return description.model_copy(update=texts)


def editable(description: Description) -> str:
    """The two texts of a description as YAML that is pleasant to edit."""
    return "".join(f"{key}: |-\n{_indented(_folded(getattr(description, key)), '  ')}\n" for key in KEYS)


def _text(description: Description) -> str:
    values: dict[str, Any] = description.model_dump(mode="json")
    lines = [f"{key}: >-\n{_indented(_folded(values[key]), '  ')}" for key in KEYS]
    rest = {key: value for key, value in values.items() if key not in KEYS and value not in (None, False)}
    tail = yaml.safe_dump(rest, sort_keys=False, allow_unicode=True) if rest else ""
    return "\n".join(lines) + "\n" + tail


def _store_in_world(path: Path, description: Description) -> None:
    """Replace or add the `description` block of a world.yaml, and check that the world reads back with it."""
    try:
        before = path.read_text(encoding="utf-8")
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror}") from None
    lines, inside = [], False
    for line in before.splitlines():
        if re.match(r"\S", line) and not line.startswith("#"):
            inside = line.startswith("description:")
        if not inside:
            lines.append(line)
    block = "description:\n" + _indented(_text(description).rstrip("\n"), "  ")
    _write(path, "\n".join(lines).rstrip("\n") + "\n\n" + block + "\n")
    if load_world(path.parent).description != description:
        _write(path, before)
        raise FileError(path, "the description could not be stored there; the file is as it was")


def _write(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.with_name(path.name + ".new")
        new.write_text(text, encoding="utf-8")
        new.replace(path)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror}") from None


def _clipped(text: str) -> str:
    return " ".join(text.split())[:LONGEST_CHARACTERS]


def _folded(text: str) -> str:
    """The text broken into lines of bearable width at spaces, as YAML folds them back."""
    lines = [""]
    for word in text.split():
        if lines[-1] and len(lines[-1]) + 1 + len(word) > WIDE - 4:
            lines.append(word)
        else:
            lines[-1] += (" " if lines[-1] else "") + word
    return "\n".join(lines)


def _indented(text: str, by: str) -> str:
    return "\n".join(by + line if line else line for line in text.splitlines())


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
