"""Descriptions of a world and names of its areas, proposed by a model that looks at its map and judged by a person.

The description is made once per world, in three turns. It is stored in the world's own `world.yaml` (key
`description`), or, for a world that ships with RVSG, in the user's data folder under the world's content id.
"""

from __future__ import annotations

import io
import json
import math
import os
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from rvsg.core.documents import mistakes_of, read_yaml
from rvsg.core.errors import FileError, GenerationError, InputError
from rvsg.core.files import write_whole
from rvsg.core.inputs import read_text
from rvsg.core.records import Record
from rvsg.generation.facts import birdseye_of, pictures_of, world_facts
from rvsg.generation.generator import Call
from rvsg.generation.prompts import Dialogue, Prompts
from rvsg.generation.replies import read_object
from rvsg.generation.reply_json import TEXT, find_json, object_schema, texts_schema
from rvsg.generation.vlm.access import ModelAccess, model_access
from rvsg.generation.vlm.model import Access, Answer, Model, Picture
from rvsg.world.passages import doorway
from rvsg.world.world import Description, Door, World
from rvsg.world.world_folder import SHIPPED, load_world

KEYS = ("layout", "grid")
DATA_VARIABLE = "RVSG_DATA_DIR"
WIDE = 116
LONGEST_CHARACTERS = 6000


class EnvironmentDialogue:
    """Describes a world in three turns, and corrects the description for a reason."""

    def __init__(self, world: World, model: Model, prompts: Prompts) -> None:
        self.world = world
        self._shown, self._grid, facts = _views(world)
        self._dialogue = Dialogue(model, prompts, f"describe-{world.name}", facts, (*self._shown, self._grid))

    @property
    def calls(self) -> tuple[Call, ...]:
        """The calls made so far."""
        return tuple(self._dialogue.calls)

    def describe(self) -> Description:
        """The three turns; raises GenerationError where the model gives no description even when asked again."""
        dialogue = self._dialogue
        dialogue.tell("system", role="system")
        self._usable(dialogue.ask("layout", "environment-1-layout", shown=self._shown))
        self._usable(dialogue.ask("grid", "environment-2-grid", shown=(self._grid, self._shown[0])))
        return self._read(dialogue.ask("summary", "environment-3-summary", shape=texts_schema(*KEYS)))

    def begin_with(self, description: Description) -> None:
        """Begin with a description that exists already, in place of the three turns."""
        self._dialogue.tell("system", role="system")
        self._dialogue.tell("environment-given", shown=(*self._shown, self._grid))
        texts = description.model_dump(include=set(KEYS))
        self._dialogue.tell_text("assistant", json.dumps(texts, ensure_ascii=False))

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
            answer = self._dialogue.ask("summary", "reply-unreadable", shape=texts_schema(*KEYS), problem=problem)
            texts = read_object(answer.text, KEYS)
        if texts is None:
            ended = {"complete": "it held no such JSON", "truncated": "it was cut off by the limit of tokens"}
            raise GenerationError(
                f"The model {self._dialogue.model.name} gave no description of {self.world.name} in two answers (of "
                f"the last: {ended.get(answer.finish, f'it was {answer.finish}')}). "
                "Try another model, or write the description into the world's world.yaml yourself.",
                code="no-description",
            )
        return Description(layout=_clipped(texts["layout"]), grid=_clipped(texts["grid"]))


class EnvironmentSession(EnvironmentDialogue):
    """A dialogue about a world with a model that is named or replayed."""

    def __init__(self, world: World, access: ModelAccess, prompts: Prompts) -> None:
        super().__init__(world, access, prompts)
        self.access = access

    def notes(self) -> list[str]:
        """Return what came from the record of an earlier session, and where a replay differs from its record."""
        known, recording = self.access.from_record, self.access.recording
        earlier = []
        if known and recording is not None and not self.access.replaying:
            calls = "1 call was" if known == 1 else f"{known} calls were"
            earlier = [f"{calls} answered at no cost from {recording.folder}; to ask again, give another --record."]
        return [*earlier, *self.access.notes()]

    def revised(self, start: Description | None, reasons: Sequence[str]) -> Description:
        """Return a description corrected for the reasons of a person, of which only the last costs a call.

        `start` is the description that the first reason is about; None lets the model write one first.
        """
        made = start or self.describe()
        if start is not None:
            self.begin_with(start)
        for reason in reasons:
            made = self.revise(reason)
        return made


def open_session(
    world: World, model: str | None, record: Path | None, prompts: Path | None, **access: Any
) -> EnvironmentSession | None:
    """Return a session with a model, or None if neither a model nor a replay is named; calls are recorded."""
    if model is None and access.get("replay") is None:
        return None
    return EnvironmentSession(world, reach_model(model, record, f"describe-{world.name}", access), Prompts(prompts))


def reach_model(model: str | None, record: Path | None, folder: str, access: Mapping[str, Any]) -> ModelAccess:
    """Return a model ready to be asked, by default with a record in this folder of `runs`."""
    given = {key: value for key, value in access.items() if value is not None}
    kept = record or (None if given.get("replay") else Path("runs") / folder)
    return model_access(model, Access.of(given, record=kept))


def _views(world: World) -> tuple[tuple[Picture, ...], Picture, dict[str, Any]]:
    """Return the map (with the view from above, where the heights are known), the grid, and the facts of a world."""
    labelled, grid = pictures_of(world)
    birdseye = birdseye_of(world)
    shown = (labelled,) if birdseye is None else (labelled, birdseye)
    return shown, grid, {**world_facts(world), "humans": 2, "heights": birdseye is not None}


def description_of(world: World) -> Description | None:
    """The description of a world: the one in the user's data folder (newer than a shipped one), else its own."""
    path = stored_path(world)
    return read_description_file(path) if path.is_file() else world.description


def stored(world: World, command: str) -> Description:
    """Return the stored description of a world; InputError without one names the `command` that writes it."""
    description = description_of(world)
    if description is None:
        raise InputError(f"{world.name} has no description yet. Let a model write it: {command}", code="no-description")
    return description


def stored_path(world: World) -> Path:
    """Return where the description of a shipped world is stored: in the user's data folder."""
    base = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "rvsg"
    folder = Path(os.environ.get(DATA_VARIABLE) or base)
    return folder / "descriptions" / f"{world.name}-{world.id.removeprefix('world-')}.yaml"


def store_description(world: World, description: Description, place: str | Path | None = None) -> Path:
    """Store the description and return the file.

    `place` is the world's folder (its world.yaml is changed, its other lines are kept), a file ending in .yaml to
    write the description alone into, or None for the user's data folder.
    """
    path = Path(place) if place is not None else stored_path(world)
    if path.suffix in (".yaml", ".yml") and path.name != "world.yaml":
        write_whole(path, _text(description))
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
    return "".join(_folded(key, description, "|-") for key in KEYS)


def _text(description: Description) -> str:
    values = description.model_dump(mode="json", exclude=set(KEYS))
    rest = {key: value for key, value in values.items() if value not in (None, False)}
    tail = yaml.safe_dump(rest, sort_keys=False, allow_unicode=True) if rest else ""
    return "".join(_folded(key, description, ">-") for key in KEYS) + tail


def _folded(key: str, description: Description, style: str) -> str:
    """Return a text as a block of YAML, broken at spaces as YAML folds it back."""
    text = " ".join(description.model_dump()[key].split())
    return f"{key}: {style}\n" + textwrap.indent(
        textwrap.fill(text, WIDE - 4, break_long_words=False, break_on_hyphens=False) + "\n", "  "
    )


def _store_in_world(path: Path, description: Description) -> None:
    """Replace or add the `description` block of a world.yaml, and check that the world reads back with it."""
    before = read_text(path)
    lines, inside = [], False
    for line in before.splitlines():
        if re.match(r"\S", line) and not line.startswith("#"):
            inside = line.startswith("description:")
        if not inside:
            lines.append(line)
    block = "description:\n" + textwrap.indent(_text(description), "  ")
    write_whole(path, "\n".join(lines).rstrip("\n") + "\n\n" + block)
    if load_world(path.parent).description != description:
        write_whole(path, before)
        raise FileError(path, "the description could not be stored there; the file is as it was")


def _clipped(text: str) -> str:
    return " ".join(text.split())[:LONGEST_CHARACTERS]


LONGEST_NAME, LONGEST_KIND = 60, 30
LONGEST_REASON = 400
MOST_ACTIVITIES = 8
_LABELS = {"type": "array", "items": object_schema(dict.fromkeys(("area", "name", "kind", "region", "why"), TEXT))}
_TEXTS = {"type": "array", "items": TEXT}
_KINDS = {"type": "string", "enum": ["swing", "sliding"]}
_DOORS = {"type": "array", "items": object_schema({"name": TEXT, "between": _TEXTS, "kind": _KINDS, "why": TEXT})}
SHAPE = object_schema({"names": _LABELS, "activities": _TEXTS, "doors": _DOORS})
WIDEST_DOOR_M = 3.0
LARGEST_PHOTO_BYTES, PHOTO_WIDTH_PX = 20_000_000, 1600


class ProposedLabel(Record):
    """What a model proposes for an area, and why; a kind or region that is empty stays as it is."""

    area: str
    name: str
    kind: str = ""
    region: str = ""
    why: str = ""

    @property
    def values(self) -> dict[str, str]:
        """What changes of the area."""
        new = {"name": self.name if self.name != self.area else "", "kind": self.kind, "region": self.region}
        return {key: value for key, value in new.items() if value}


class ProposedDoor(Record):
    """A door that a model proposes in the narrowest place between two waypoints, and why."""

    door: Door
    between: tuple[str, str]
    why: str = ""


class ProposedLabels(Record):
    """What a model proposes for areas, doors and usual work of a world, and what cannot be used."""

    names: tuple[ProposedLabel, ...]
    activities: tuple[str, ...] = ()
    doors: tuple[ProposedDoor, ...] = ()
    unusable: tuple[str, ...] = ()
    calls: tuple[Call, ...] = ()


def propose_area_names(
    world: World, model: Model, prompts: Prompts, photographs: Sequence[Picture] = ()
) -> ProposedLabels:
    """Ask a model once for labels and doors; GenerationError where it answers without a list of names twice."""
    shown, grid, facts = _views(world)
    facts |= {"doors": [door.name for door in world.doors], "photographs": len(photographs)}
    shown = (*shown, grid, *photographs)
    dialogue = Dialogue(model, prompts, f"names-{world.name}", facts, shown)
    dialogue.tell("system", role="system")
    answer = _answered(dialogue.ask("names", "area-names", shown=shown, shape=SHAPE).text)
    if answer is None:
        problem = 'it holds no JSON object with a list under "names".'
        answer = _answered(dialogue.ask("names", "reply-unreadable", shape=SHAPE, problem=problem).text)
    if answer is None:
        raise GenerationError(f"The model {model.name} proposed no names in two answers. Try another model.")
    names, unusable = _usable(answer["names"], world)
    given = answer.get("activities")
    known = {text.casefold() for text in world.activities}
    texts = (" ".join(str(each).split())[:LONGEST_REASON] for each in (given if isinstance(given, list) else ()))
    activities = tuple(dict.fromkeys(text for text in texts if text and text.casefold() not in known))
    doors, wrong = _usable_doors(answer.get("doors"), world)
    return ProposedLabels(
        names=names,
        activities=activities[:MOST_ACTIVITIES],
        doors=doors,
        unusable=(*unusable, *wrong),
        calls=tuple(dialogue.calls),
    )


def propose_names(
    world: World,
    model: str | None,
    record: Path | None = None,
    prompts: Path | None = None,
    photographs: Sequence[Path] = (),
    **access: Any,
) -> ProposedLabels:
    """Ask a vision language model for better labels of the areas of a world and its doors; calls are recorded."""
    given = [read_photograph(path, f"photograph {k}") for k, path in enumerate(photographs, start=1)]
    reached = reach_model(model, record, f"names-{world.name}", access)
    return propose_area_names(world, reached, Prompts(prompts), given)


def read_photograph(path: Path, name: str) -> Picture:
    """Return a photograph or a plan as a picture for a model; InputError where the file is no PNG or JPEG."""
    from PIL import Image, UnidentifiedImageError

    try:
        if path.stat().st_size > LARGEST_PHOTO_BYTES:
            most = LARGEST_PHOTO_BYTES // 1_000_000
            raise InputError(f"{path} is larger than {most} MB. Give a smaller picture.", code="photo-large")
        with Image.open(path, formats=("PNG", "JPEG")) as image:
            small = image.convert("RGB")
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError):
        raise InputError(f"{path} is no picture. Give a PNG or JPEG file with --photo.", code="photo-file") from None
    small.thumbnail((PHOTO_WIDTH_PX, PHOTO_WIDTH_PX))
    out = io.BytesIO()
    small.save(out, "PNG")
    return Picture(name=name, png=out.getvalue())


def _usable_doors(entries: Any, world: World) -> tuple[tuple[ProposedDoor, ...], tuple[str, ...]]:
    """Return the doors that can be accepted in any order, and what is wrong with the others."""
    found: list[ProposedDoor] = []
    wrong = []
    for entry in entries if isinstance(entries, list) else ():
        values = entry if isinstance(entry, Mapping) else {}
        name, why = (" ".join(str(values.get(key) or "").split()) for key in ("name", "why"))
        ends = [str(each) for each in between] if isinstance(between := values.get("between"), list) else []
        taken = {door.name.casefold() for door in (*world.doors, *(each.door for each in found))}
        if not 0 < len(name) <= LONGEST_NAME or name.casefold() in taken:
            wrong.append(f'The name of the door "{name[:LONGEST_NAME]}" is empty, given already or too long.')
        elif len(ends) != 2 or not all(end in world.grid.by_name for end in ends):
            wrong.append(f'"{name}": the waypoints on its two sides are not known.')
        elif (place := doorway(world, ends[0], ends[1])) is None or math.dist(*place) > WIDEST_DOOR_M:
            wrong.append(f'"{name}": there is no doorway of at most {WIDEST_DOOR_M:g} m between {" and ".join(ends)}.')
        else:
            try:
                door = Door(name=name, hinge=place[0], end=place[1], kind=values.get("kind") or "swing")
            except ValidationError as error:
                wrong.append(f'"{name}": {"; ".join(mistakes_of(error, Door))}')
            else:
                found.append(ProposedDoor(door=door, between=(ends[0], ends[1]), why=why[:LONGEST_REASON]))
    return tuple(found), tuple(wrong)


def _answered(text: str) -> Mapping[str, Any] | None:
    for found in find_json(text):
        if isinstance(found.value, Mapping) and isinstance(found.value.get("names"), list):
            return found.value
    return None


def _usable(entries: Iterable[Any], world: World) -> tuple[tuple[ProposedLabel, ...], tuple[str, ...]]:
    """Return the proposals that can be accepted in any order, and what is wrong with the others."""
    labels: dict[str, ProposedLabel] = {}
    wrong = []
    areas = {area.name: area for area in world.areas}
    taken = {name.casefold() for name in areas}
    for entry in entries:
        values = entry if isinstance(entry, Mapping) else {}
        said = {key: " ".join(str(values.get(key) or "").split()) for key in ("area", "name", "kind", "region", "why")}
        area, name, kind, region = said["area"], said["name"], said["kind"].casefold(), said["region"]
        if area not in areas:
            wrong.append(f'"{area[:LONGEST_NAME]}" is no area of this world.')
        elif not name or max(len(name), len(region)) > LONGEST_NAME:
            wrong.append(f'The name or region for "{area}" is empty or longer than {LONGEST_NAME} characters.')
        elif len(kind) > LONGEST_KIND:
            wrong.append(f'The kind of "{area}" is longer than {LONGEST_KIND} characters.')
        elif area in labels or (name != area and name.casefold() in taken):
            wrong.append(f'"{name}" for "{area}": the name is given already, or the area has a proposal.')
        else:
            label = ProposedLabel(
                area=area,
                name=name,
                kind=kind if kind != areas[area].kind else "",
                region=region if region != areas[area].region else "",
                why=said["why"][:LONGEST_REASON],
            )
            if label.values:
                taken.add(name.casefold())
                labels[area] = label
    return tuple(labels.values()), tuple(wrong)
