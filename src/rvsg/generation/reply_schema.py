"""The JSON schema of a reply, for services that can hold a model to one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rvsg.scenario.scenario import Behaviour, PersonKind


def object_schema(properties: dict[str, Any], required: list[str] | None = None) -> dict[str, Any]:
    """The schema of an object with these properties and no others; all are required unless `required` names some."""
    return {
        "type": "object",
        "properties": properties,
        "required": required if required is not None else list(properties),
        "additionalProperties": False,
    }


TEXT = {"type": "string"}
NUMBER = {"type": "number"}
_PATH = {"type": "array", "items": TEXT, "minItems": 1}
_MOVED = object_schema({"name": TEXT, **dict.fromkeys(("x", "y", "length_m", "width_m", "height_m", "yaw"), NUMBER)})
_PAUSES = {"type": "array", "items": object_schema({"at": TEXT, "duration_s": NUMBER})}


def configuration_schema(
    *,
    rich: bool,
    described: bool = True,
    behaviours: Sequence[Behaviour] = tuple(Behaviour),
    actors: Sequence[str] = (),
) -> dict[str, Any]:
    """The schema of a configuration; `rich` with analysis, description, speeds, delays, pauses and behaviours.

    Without `rich` it is `described` or holds the people alone. `behaviours` are those that may be chosen, `actors`
    who takes part besides adults on foot.
    """
    task = {"task": TEXT, "path": _PATH}
    if not rich:
        plain = object_schema({"name": TEXT, "tasks": {"type": "array", "items": object_schema(task)}})
        humans = {"humans": {"type": "array", "items": plain}}
        return object_schema({"description": TEXT, **humans, "lesson": TEXT} if described else humans)
    human = object_schema(
        {
            "name": TEXT,
            "behaviour": {"type": "string", "enum": [b.value for b in behaviours]},
            "speed_m_s": NUMBER,
            "start_delay_s": NUMBER,
            "group": {"type": ["integer", "null"]},
            "plan": {"type": "array", "items": object_schema({"at": TEXT, "time_s": NUMBER})},
            "tasks": {"type": "array", "items": object_schema({**task, "pauses": _PAUSES})},
            **_of_person(actors),
        }
    )
    texts = {"analysis": TEXT, "lesson": TEXT, "description": TEXT}
    moved = {"moved": {"type": "array", "items": _MOVED}} if "moved_object" in actors else {}
    return object_schema({**texts, "humans": {"type": "array", "items": human}, **moved})


def _of_person(actors: Sequence[str]) -> dict[str, Any]:
    """Return what a person may be and push besides."""
    kinds = [kind.value for kind in PersonKind if kind is PersonKind.ADULT or kind.value in actors]
    found: dict[str, Any] = {"kind": {"type": "string", "enum": kinds}} if len(kinds) > 1 else {}
    if "trolley" in actors:
        trolley = object_schema({"length_m": NUMBER, "width_m": NUMBER})
        found["trolley"] = {"anyOf": [trolley, {"type": "null"}]}
    return found


def texts_schema(*keys: str) -> dict[str, Any]:
    """The schema of an object of texts."""
    return object_schema(dict.fromkeys(keys, TEXT))
