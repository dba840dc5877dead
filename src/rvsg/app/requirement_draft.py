"""Drafts of requirements: a model writes what somebody asks for in words so that it can be measured."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from rvsg.core.documents import mistakes_of
from rvsg.core.errors import GenerationError, InputError
from rvsg.core.files import write_whole
from rvsg.evaluation.metrics.measurement import METRICS
from rvsg.evaluation.signals import SIGNALS
from rvsg.evaluation.verdict import check_requirement, load_requirement
from rvsg.generation.prompts import Dialogue, Prompts
from rvsg.generation.reply_json import NUMBER, TEXT, find_json, object_schema
from rvsg.generation.vlm.model import Model
from rvsg.scenario.requirement import Requirement

ANSWERS = 3
"""Answers of the model, of which all but the first correct what the schema refused."""
SHAPE = object_schema(
    {
        **dict.fromkeys(("name", "title", "text", "metric", "formula"), TEXT),
        "worse": {"type": "string", "enum": ["smaller", "larger"]},
        "limit": {"anyOf": [NUMBER, {"type": "null"}]},
        "source": TEXT,
    }
)


def draft_requirement(words: str, model: Model) -> Requirement:
    """Return the requirement that a model writes for some words, checked as one of a file is.

    Raises:
        GenerationError: the model answers with none that can be measured, or says that nothing measures it.
    """
    facts = {"words": words, "metrics": list(METRICS.values()), "signals": list(SIGNALS.values())}
    dialogue = Dialogue(model, Prompts(), "requirement", facts, ())
    answer, problem = dialogue.ask("draft", "requirement", shape=SHAPE), ""
    for number in range(1, ANSWERS + 1):
        try:
            return _read(answer.text)
        except ValidationError as error:
            problem = "; ".join(mistakes_of(error, Requirement))
        except InputError as error:
            problem = str(error)
        if number < ANSWERS:
            answer = dialogue.ask("correct", "reply-unreadable", shape=SHAPE, problem=problem)
    raise GenerationError(f"The model {model.name} wrote no requirement in {ANSWERS} answers: {problem}")


def _read(text: str) -> Requirement:
    """Return the requirement of an answer; raises InputError or ValidationError where it cannot be used."""
    found = [each.value for each in find_json(text) if isinstance(each.value, dict)]
    if not found:
        raise InputError("It holds no JSON object.")
    given: dict[str, Any] = {key: value for key, value in found[-1].items() if value not in ("", None)}
    if not given.keys() & {"metric", "formula"}:
        raise GenerationError(f"Nothing measures this requirement: {given.get('text', 'the model gives no reason')}")
    if "formula" in given:
        given.pop("worse", None)
    elif "limit" not in given:
        raise InputError("A metric needs a limit.")
    name = re.sub(r"\W+", "_", str(given.pop("name", "")).casefold()).strip("_")
    return check_requirement(Requirement.model_validate({"name": name, **given}))


def write_requirement(requirement: Requirement, file: Path) -> Requirement:
    """Write a requirement that was accepted into a new file, and return it as the file is read."""
    if file.exists():
        raise InputError(f"{file} exists. Choose another file with --out.")
    kept = requirement.model_dump(mode="json", exclude_defaults=True, exclude={"name"})
    write_whole(file, yaml.safe_dump({requirement.name: kept}, sort_keys=False, allow_unicode=True))
    return load_requirement(str(file))
