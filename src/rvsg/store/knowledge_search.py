"""Search in a knowledge base."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import numpy as np

from rvsg.campaign.findings import Entry, Kind, remembered
from rvsg.core.errors import FileError, UnknownName
from rvsg.core.files import write_whole
from rvsg.core.records import Record
from rvsg.store.knowledge_base import KnowledgeBase

DEFAULT_PLACE = "runs/knowledge.sqlite"


KINDS: tuple[str, ...] = get_args(Kind)


ENVIRONMENT = "RVSG_KNOWLEDGE"
"""Names the knowledge base where no command does."""


class Match(Record):
    """An entry that was found."""

    entry: Entry
    similarity: float | None = None
    """Of its description with what was searched for, at most 1; None if nothing was."""
    origins: tuple[str, ...] = ()


def open_knowledge(where: str | Path | None = None) -> KnowledgeBase:
    """Open a knowledge base.

    Args:
        where: an SQLite file or the address of a PostgreSQL database; by default what the environment variable
            RVSG_KNOWLEDGE says, else `runs/knowledge.sqlite`.
    """
    import os

    chosen = str(where or os.environ.get(ENVIRONMENT) or DEFAULT_PLACE)
    if "://" not in chosen:
        try:
            Path(chosen).parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(chosen, f"the folder cannot be made: {error.strerror}.") from None
    return KnowledgeBase(chosen)


def search(
    base: KnowledgeBase,
    text: str = "",
    *,
    world: str | None = None,
    route: str | None = None,
    requirement: str | None = None,
    kind: str | None = None,
    at: str | None = None,
    violates: bool | None = None,
    limit: int = 20,
) -> tuple[Match, ...]:
    """Return what is known, the most similar to a text first, or the worst first without a text.

    Args:
        text: compared with the descriptions by sentence embeddings; without the extra `embeddings` by their words.
        world: the name of a world.
        kind: `attempt`, `finding`, `rejected` or `watched`; UnknownName for another.
        at: a waypoint that a person of the scenario passes.
        violates: whether the requirement is violated more than rarely.
    """
    if kind is not None and kind not in KINDS:
        raise UnknownName("kind", kind, KINDS)
    found = base.entries(world=world, route=route, requirement=requirement, kind=kind, violates=violates)
    if at is not None:
        found = [entry for entry in found if at in entry.waypoints]
    closeness: list[float | None] = [None] * len(found)
    if text:
        similar = similarities(base, text, [entry.description for entry in found])
        closeness = list(similar)
        order = sorted(range(len(found)), key=lambda k: (-similar[k], found[k].id))
    else:
        order = sorted(range(len(found)), key=lambda k: (-_share(found[k]), found[k].id))
    return tuple(
        Match(entry=found[k], similarity=closeness[k], origins=base.origins(found[k].id)) for k in order[:limit]
    )


def similarities(base: KnowledgeBase, text: str, descriptions: Sequence[str]) -> list[float]:
    """Return how similar a text is to each description.

    By sentence embeddings, stored once computed; by the words in common where the model is not installed.
    """
    from rvsg.evaluation.diversity import embed, model_folder

    if not descriptions:
        return []
    if model_folder() is None:
        from rapidfuzz.fuzz import token_set_ratio

        return [round(token_set_ratio(text, each) / 100.0, 6) for each in descriptions]
    wanted = sorted({text, *descriptions})
    known = base.vectors(wanted)
    missing = [each for each in wanted if each not in known]
    if missing:
        made = dict(zip(missing, embed(missing), strict=True))
        base.keep_vectors(made)
        known |= made
    return [round(float(np.dot(known[text], known[each])), 6) for each in descriptions]


def tell(matches: Sequence[Match], path: str | Path) -> int:
    """Write matches as earlier scenarios for a generator; return how many.

    `rvsg run --knowledge FILE` reads the file: a new scenario then differs from them.
    """
    earlier = remembered([match.entry for match in matches])
    values = [each.model_dump(mode="json") for each in earlier]
    write_whole(Path(path), json.dumps(values, indent=2, ensure_ascii=False) + "\n")
    return len(earlier)


def _share(entry: Entry) -> float:
    return -1.0 if entry.verdict is None else entry.verdict.violation_probability or 0.0


def describe_match(match: Match) -> str:
    """Return an entry as lines for a terminal."""
    entry = match.entry
    said = "" if entry.verdict is None else f", violated in {entry.verdict.violations} of {entry.verdict.runs} runs"
    close = "" if match.similarity is None else f" [{match.similarity:.2f}]"
    lines = [f"{entry.kind}{close}  {entry.world}, {entry.route}, {entry.requirement}{said}  {entry.id}"]
    lines += [f"    {' '.join(text.split())[:200]}" for text in (entry.description, *entry.lessons) if text.strip()]
    return "\n".join(lines)
