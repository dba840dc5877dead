"""The knowledge base: entries by content id in SQLite, or in PostgreSQL for a team.

An entry is added in one transaction and "on conflict do nothing", so several writers may add the same at once: nothing
is there twice. What `add` returned for is committed, so a writer that is killed loses at most what it was adding.
"""

from __future__ import annotations

import contextlib
import datetime
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Self, get_args

import numpy as np
import sqlalchemy as sa
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError
from sqlalchemy.dialects.postgresql import insert as postgresql_insert
from sqlalchemy.dialects.sqlite import insert as sqlite_insert
from sqlalchemy.exc import ArgumentError, DatabaseError, NoSuchModuleError

from rvsg.core import permission
from rvsg.core.errors import FileError, InputError, StoreError, UnknownName, how_to_install
from rvsg.core.files import write_whole
from rvsg.core.inputs import read_text
from rvsg.core.records import Record, canonical_json, text_id
from rvsg.findings.findings import Entry, Kind, remembered
from rvsg.scenario.brief import Remembered
from rvsg.store.sqlite import write_ahead

_meta = sa.MetaData()
_entries = sa.Table(
    "rvsg_knowledge",
    _meta,
    sa.Column("id", sa.String(80), primary_key=True),
    sa.Column("kind", sa.String(20), nullable=False),
    sa.Column("world", sa.Text, nullable=False),
    sa.Column("place", sa.String(80), nullable=False, index=True),
    sa.Column("route", sa.Text, nullable=False),
    sa.Column("requirement", sa.Text, nullable=False),
    sa.Column("violates", sa.Boolean),
    sa.Column("added", sa.String(32), nullable=False),
    sa.Column("record", sa.Text, nullable=False),
)
_origins = sa.Table(
    "rvsg_knowledge_origins",
    _meta,
    sa.Column("entry", sa.String(80), primary_key=True),
    sa.Column("origin", sa.String(300), primary_key=True),
)
_embeddings = sa.Table(
    "rvsg_knowledge_embeddings",
    _meta,
    sa.Column("text_id", sa.String(80), primary_key=True),
    sa.Column("vector", sa.LargeBinary, nullable=False),
)
_SEARCHED = ("id", "kind", "world", "place", "route", "requirement", "violates")
"""Columns that hold a field of an entry besides its whole record."""
_INSERT: dict[str, Any] = {"sqlite": sqlite_insert, "postgresql": postgresql_insert}
PATIENCE_S = 60.0
_ALONE = {"sqlite": "BEGIN IMMEDIATE", "postgresql": f"SELECT pg_advisory_xact_lock({0x52565347})"}
"""What makes the others that open the same new database wait until this transaction ends."""


class KnowledgeBase:
    """Entries in a database. Use it as a context manager, or `close` it.

    Args:
        where: the path of an SQLite file, made where absent, or `postgresql://user@host/database`. Give the password in
            the environment (PGPASSWORD) or in ~/.pgpass, where PostgreSQL's own programs look for it.

    Raises:
        InputError: the address cannot be used, or the driver of PostgreSQL is not installed.
        StoreError: the database cannot be opened.
    """

    def __init__(self, where: str) -> None:
        self._engine = _engine(where)
        self.name = self._engine.url.render_as_string(hide_password=True)
        self._insert = _INSERT[self._engine.dialect.name]
        try:
            with self._translated(), self._engine.begin() as connection:
                if not _meta.tables.keys() <= set(sa.inspect(connection).get_table_names()):
                    connection.exec_driver_sql(_ALONE[self._engine.dialect.name])
                    _meta.create_all(connection)  # looks again: another may have made them meanwhile
        except StoreError:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close every connection."""
        self._engine.dispose()

    def add(self, entries: Iterable[Entry], *, origin: str = "") -> int:
        """Add entries in one transaction and return how many are new.

        Args:
            origin: where they are from, e.g. the name of a campaign; an entry may have several origins.
        """
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        rows: dict[str, dict[str, Any]] = {}
        for entry in entries:
            rows[entry.id] = {name: getattr(entry, name) for name in _SEARCHED}
            rows[entry.id] |= {"added": now, "record": canonical_json(entry.model_dump(mode="json"))}
        if not rows:
            return 0
        ordered = [rows[key] for key in sorted(rows)]  # writers that lock rows in one order do not deadlock
        with self._translated(), self._engine.begin() as connection:
            new = 0
            for row in ordered:
                insert = self._insert(_entries).values(row).on_conflict_do_nothing().returning(_entries.c.id)
                new += connection.execute(insert).first() is not None
            if origin:
                origins = [{"entry": row["id"], "origin": origin[:300]} for row in ordered]
                connection.execute(self._insert(_origins).on_conflict_do_nothing(), origins)
        return new

    def entries(self, **conditions: str | bool | None) -> list[Entry]:
        """Return the entries that fit every condition that is not None, in the order of their ids.

        Args:
            conditions: `world`, `place`, `route`, `requirement`, `kind` and `violates`.
        """
        query = sa.select(_entries.c.id, _entries.c.record).order_by(_entries.c.id)
        for column, wanted in conditions.items():
            if wanted is not None:
                query = query.where(_entries.c[column] == wanted)
        with self._translated(), self._engine.connect() as connection:
            rows = connection.execute(query).all()
        return [self._read(key, record) for key, record in rows]

    def origins(self, entry_id: str) -> tuple[str, ...]:
        """Return where an entry is from."""
        query = sa.select(_origins.c.origin).where(_origins.c.entry == entry_id).order_by(_origins.c.origin)
        with self._translated(), self._engine.connect() as connection:
            return tuple(connection.execute(query).scalars())

    def counts(self) -> dict[tuple[str, str], int]:
        """Return how many entries there are of each world and kind."""
        columns = (_entries.c.world, _entries.c.kind)
        query = sa.select(*columns, sa.func.count()).group_by(*columns).order_by(*columns)
        with self._translated(), self._engine.connect() as connection:
            return {(world, kind): count for world, kind, count in connection.execute(query)}

    def vectors(self, texts: Sequence[str]) -> dict[str, NDArray[np.float32]]:
        """Return the stored embeddings of those texts that have one."""
        ids = {text_id("text", text): text for text in texts}
        query = sa.select(_embeddings).where(_embeddings.c.text_id.in_(list(ids)))
        with self._translated(), self._engine.connect() as connection:
            return {ids[key]: np.frombuffer(raw, np.float32) for key, raw in connection.execute(query)}

    def keep_vectors(self, vectors: dict[str, NDArray[np.float32]]) -> None:
        """Store embeddings of texts, so that a search computes them once."""
        rows = [
            {"text_id": text_id("text", text), "vector": np.ascontiguousarray(vector, np.float32).tobytes()}
            for text, vector in sorted(vectors.items())
        ]
        if rows:
            with self._translated(), self._engine.begin() as connection:
                connection.execute(self._insert(_embeddings).on_conflict_do_nothing(), rows)

    def _read(self, key: str, record: str) -> Entry:
        if text_id("entry", record) != key:
            raise StoreError(f"{self.name}: {key} is not what was stored. Restore the database from a copy.")
        try:
            return Entry.from_json(record)
        except ValidationError as error:
            raise StoreError(f"{self.name}: {key} was written by a newer RVSG. Update RVSG. {error}") from None

    @contextlib.contextmanager
    def _translated(self) -> Iterator[None]:
        """Turn a database error into a StoreError that names the database."""
        try:
            yield
        except DatabaseError as error:
            first = str(error.orig).strip().splitlines()
            raise StoreError(f"{self.name}: {first[0] if first else error.__class__.__name__}") from None


def _engine(where: str) -> sa.Engine:
    if "://" not in where:
        url = sa.URL.create("sqlite", database=where)
    else:
        try:
            url = sa.make_url(where)
        except ArgumentError:
            raise InputError(f"{where.split('@')[-1]!r} is no address of a database. {_EXPECTED}") from None
        if url.drivername == "postgresql":
            url = url.set(drivername="postgresql+psycopg")
    if url.get_backend_name() not in _INSERT:
        raise InputError(f'"{url.get_backend_name()}" is no kind of knowledge base. {_EXPECTED}')
    try:
        if url.get_backend_name() == "postgresql":
            return sa.create_engine(url, pool_pre_ping=True)
        engine = sa.create_engine(url, connect_args={"timeout": PATIENCE_S})
    except (ImportError, NoSuchModuleError):
        raise InputError(f"PostgreSQL needs the driver psycopg: {how_to_install('postgres')}.") from None
    sa.event.listen(engine, "connect", _configure)
    return engine


_EXPECTED = "Give the path of an SQLite file, or postgresql://user@host/database."


def _configure(connection: sqlite3.Connection, _: object) -> None:
    cursor = connection.cursor()
    write_ahead(cursor, PATIENCE_S)
    cursor.execute("PRAGMA synchronous=FULL")
    cursor.close()


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


def open_knowledge(where: str | Path | None = None, *, create: bool = True) -> KnowledgeBase:
    """Open a knowledge base.

    Args:
        where: an SQLite file or the address of a PostgreSQL database; by default what the environment variable
            RVSG_KNOWLEDGE says, else `runs/knowledge.sqlite`.
        create: make an SQLite file that is missing.

    Raises:
        FileError: the file is missing or its folder cannot be made.
    """
    chosen = str(where or os.environ.get(ENVIRONMENT) or DEFAULT_PLACE)
    if where is not None and "://" in chosen:
        permission.check("knowledge", "base", "base", chosen)
    if "://" not in chosen and not create and not Path(chosen).exists():
        raise FileError(chosen, "there is no knowledge base here. Make one: rvsg knowledge add DIR", code="no-base")
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
    entries = base.entries(world=world, route=route, requirement=requirement, kind=kind, violates=violates)
    if at is not None:
        entries = [entry for entry in entries if at in entry.waypoints]
    if text:
        closeness: Sequence[float | None] = similarities(base, text, [entry.description for entry in entries])
    else:
        closeness = [None] * len(entries)
    ranked = sorted(
        zip(closeness, entries, strict=True), key=lambda p: (-_share(p[1]) if p[0] is None else -p[0], p[1].id)
    )
    return tuple(Match(entry=entry, similarity=near, origins=base.origins(entry.id)) for near, entry in ranked[:limit])


def similarities(base: KnowledgeBase, text: str, descriptions: Sequence[str]) -> list[float]:
    """Return how similar a text is to each description.

    By sentence embeddings, stored once computed; by the words in common where the model is not installed.
    """
    from rvsg.evaluation.diversity import embed, model_folder

    if not descriptions:
        return []
    if model_folder() is None:
        from rapidfuzz.fuzz import token_set_ratio

        return [round(token_set_ratio(text, description) / 100.0, 6) for description in descriptions]
    wanted = sorted({text, *descriptions})
    vectors = base.vectors(wanted)
    missing = [description for description in wanted if description not in vectors]
    if missing:
        embedded = dict(zip(missing, embed(missing), strict=True))
        base.keep_vectors(embedded)
        vectors |= embedded
    return [round(float(np.dot(vectors[text], vectors[description])), 6) for description in descriptions]


def tell(matches: Sequence[Match], path: str | Path) -> int:
    """Write matches as earlier scenarios for a generator; return how many.

    `rvsg run --knowledge FILE` reads the file: a new scenario then differs from them.
    """
    earlier = remembered([match.entry for match in matches])
    values = [scenario.model_dump(mode="json") for scenario in earlier]
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


_REMEMBERED = TypeAdapter(tuple[Remembered, ...])


def read_remembered(path: str | Path) -> tuple[Remembered, ...]:
    """Read earlier scenarios as `rvsg knowledge search --out FILE` writes them.

    Raises:
        FileError: the file holds something else.
    """
    try:
        return _REMEMBERED.validate_json(read_text(Path(path)))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise FileError(
            path, f"expected what `rvsg knowledge search --out FILE` writes: {first['msg']} at {first['loc']}."
        ) from None
