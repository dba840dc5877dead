"""The file of the SQLite ledger, and its schema.

The store's schema as an ordered list of migrations. Append only: what was released is never edited.

Migration k (from 1) brings a store of `user_version` k - 1 to k. Records are JSON in the shape of their models; a
new field with a default needs no migration: an id is checked against the text as it was stored, before it is parsed.
"""

from __future__ import annotations

import os
import sqlite3
import time
from itertools import chain
from pathlib import Path
from typing import Any
from urllib.parse import quote

import sqlalchemy as sa

import rvsg
from rvsg.core.errors import NewerStore, StoreError

APPLICATION_ID = 0x52565347
"""`RVSG` in ASCII."""

MIGRATIONS: tuple[tuple[str, ...], ...] = (
    (
        "CREATE TABLE campaigns (name TEXT PRIMARY KEY, settings TEXT NOT NULL, version TEXT NOT NULL, "
        "begun TEXT NOT NULL)",
        "CREATE TABLE attempts (campaign TEXT NOT NULL, position INTEGER NOT NULL, id TEXT NOT NULL, "
        "purpose TEXT NOT NULL, scenario_id TEXT, record TEXT NOT NULL, PRIMARY KEY (campaign, position))",
        "CREATE INDEX attempts_by_scenario ON attempts (scenario_id)",
        "CREATE TABLE runs (id TEXT PRIMARY KEY, scenario_id TEXT NOT NULL, seed INTEGER NOT NULL, "
        "header TEXT NOT NULL, arrays BLOB NOT NULL)",
        "CREATE INDEX runs_by_scenario ON runs (scenario_id)",
    ),
    # The id of a run is of what determines it; the checksum is of what came out. Older runs have none.
    ("ALTER TABLE runs ADD COLUMN checksum TEXT",),
    # From here on a run is a PackedRun, its header inside the archive and the column `header` empty. No row changes.
    (),
    # From here on the record of an attempt is packed (see `rvsg.store.sqlite`). Text that is there stays.
    ("CREATE TABLE dictionaries (campaign TEXT PRIMARY KEY, packed BLOB NOT NULL)",),
    # Nothing asks for these indexes.
    ("DROP INDEX IF EXISTS runs_by_scenario", "DROP INDEX IF EXISTS attempts_by_scenario"),
    # From here on archives of runs are LZMA streams (see `rvsg.simulation.archive`). Stores before are refused.
    (),
)


PATIENCE_S = 30.0
"""How long to wait for another process that holds the file."""
PAGE_BYTES = 16384
"""Of a new file: a run takes some 6 kB, and of smaller pages a part would stay empty."""
LOG_PAGES = 250
"""Pages that the write-ahead log holds before they are moved into the file."""
BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


def may_write(path: Path) -> bool:
    """Return whether the file can be written, and beside it the files SQLite needs to write it."""
    return os.access(path, os.W_OK) and os.access(path.parent, os.W_OK)


def has_log(path: Path) -> bool:
    """Return whether a write-ahead log that holds something lies beside the file."""
    log = path.with_name(f"{path.name}-wal")
    return log.exists() and log.stat().st_size > 0


def engine_of(path: Path, *, readonly: bool) -> sa.Engine:
    """Return the engine for the file. A read-only one writes no files beside it."""
    if readonly:
        # SQLite would still make files beside it, for locks, unless it knows that nobody writes. Then it
        # passes over a log that is left there by a campaign under way or killed, with what was committed last.
        how = "mode=ro" if has_log(path) else "immutable=1"
        uri = f"file:{quote(str(path.absolute()))}?{how}"
        return sa.create_engine(
            "sqlite://", creator=lambda: sqlite3.connect(uri, uri=True, check_same_thread=False), poolclass=sa.NullPool
        )
    engine = sa.create_engine(sa.URL.create("sqlite", database=str(path)), connect_args={"timeout": PATIENCE_S})
    sa.event.listen(engine, "connect", _configure)
    return engine


def result_code(error: BaseException | None) -> int | None:
    """Return the primary result code of an SQLite error; None if Python raised it."""
    code = getattr(error, "sqlite_errorcode", None)
    return None if code is None else code & 0xFF


def _configure(connection: Any, _: Any) -> None:
    cursor = connection.cursor()
    cursor.execute(f"PRAGMA page_size={PAGE_BYTES}")  # changes nothing in a file that has pages
    cursor.execute(f"PRAGMA wal_autocheckpoint={LOG_PAGES}")
    write_ahead(cursor, PATIENCE_S)
    cursor.execute("PRAGMA synchronous=NORMAL")
    cursor.close()


def write_ahead(cursor: sqlite3.Cursor, patience_s: float) -> None:
    """Have the file keep a write-ahead log.

    SQLite does not wait by itself here where another process opens the same new file.

    Raises:
        sqlite3.OperationalError: the file cannot be written, or another process held it for longer than `patience_s`.
    """
    deadline = time.monotonic() + patience_s
    while True:
        try:
            cursor.execute("PRAGMA journal_mode=WAL")
            return
        except sqlite3.OperationalError as error:
            if result_code(error) not in BUSY or time.monotonic() > deadline:
                raise
            time.sleep(0.02)


def migrate(connection: sa.Connection, path: Path) -> None:
    """Make the tables of a new file; refuse a foreign file, and one of another version.

    One transaction, which begins by taking the file and looking again: another process may have opened the same new
    file, or been killed while it did.
    """
    if version_of(connection, path):
        return
    connection.rollback()
    connection.exec_driver_sql("BEGIN IMMEDIATE")
    if not version_of(connection, path):
        for statement in chain(*MIGRATIONS):
            connection.exec_driver_sql(statement)
        connection.exec_driver_sql(f"PRAGMA application_id={APPLICATION_ID}")
        connection.exec_driver_sql(f"PRAGMA user_version={len(MIGRATIONS)}")
    connection.commit()


def version_of(connection: sa.Connection, path: Path) -> int:
    """Return the version of a file, 0 of a new one; StoreError if it is not ours, or of another version."""
    # One statement reads one state of the file: another process may be making it.
    row = connection.exec_driver_sql(
        "SELECT (SELECT user_version FROM pragma_user_version), (SELECT application_id FROM pragma_application_id), "
        "(SELECT count(*) FROM sqlite_master)"
    ).one()
    version, application, tables = (int(value) for value in row)
    if application != APPLICATION_ID and (tables or version or application):
        raise StoreError(
            f"{path}: this is an SQLite file of another program, not an RVSG store. Choose another.",
            code="store-foreign",
        )
    if version > len(MIGRATIONS):
        raise NewerStore(
            f"{path}: written by a newer RVSG (store version {version}; this is RVSG {rvsg.__version__} and knows "
            f"{len(MIGRATIONS)}). Update RVSG, or use another --out."
        )
    if 0 < version < len(MIGRATIONS):
        raise StoreError(
            f"{path}: written by an earlier RVSG (store version {version}; this is RVSG {rvsg.__version__} and reads "
            f"{len(MIGRATIONS)}). Read it with that version, or use another --out.",
            code="store-earlier",
        )
    return version
