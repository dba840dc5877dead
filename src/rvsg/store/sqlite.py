"""The SQLite ledger: one file, one transaction per attempt, every record by its content id.

The file is in WAL mode: what was committed survives a kill (the last of it not a loss of power). Its
`user_version` is the version of the schema, its `application_id` says it is ours.

The record of an attempt names what other attempts repeat by id: brief, proposal, scenarios and missions are kept once.
Records are compressed JSON in the shape of their models; a new field with a default needs no new schema: an id is of
the text as it was stored.
"""

from __future__ import annotations

import contextlib
import datetime
import functools
import hashlib
import json
import operator
import os
import sqlite3
import threading
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar
from urllib.parse import quote

from pydantic import ValidationError

import rvsg
from rvsg.core.errors import InputError, NewerStore, StoreError
from rvsg.core.records import Record, canonical_json, text_id
from rvsg.generation.generator import Proposal
from rvsg.runs.attempt import Attempt
from rvsg.runs.ledger import Ledger
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.simulation.archive import PackedRun, unpack
from rvsg.simulation.run import Run

R = TypeVar("R", bound=Record)
APPLICATION_ID = 0x52565347
"""`RVSG` in ASCII."""
VERSION = 7
"""Of the schema. Earlier ones kept runs and records in other forms."""
SCHEMA = (
    "CREATE TABLE campaigns (name TEXT PRIMARY KEY, settings TEXT NOT NULL, version TEXT NOT NULL, "
    "begun TEXT NOT NULL)",
    "CREATE TABLE attempts (campaign TEXT NOT NULL, position INTEGER NOT NULL, id TEXT NOT NULL, "
    "purpose TEXT NOT NULL, scenario_id TEXT, PRIMARY KEY (campaign, position))",
    "CREATE TABLE runs (id TEXT PRIMARY KEY, scenario_id TEXT NOT NULL, seed INTEGER NOT NULL, "
    "header TEXT NOT NULL, arrays BLOB NOT NULL, checksum TEXT)",  # the header is empty: it is in the archive
    "CREATE TABLE records (id TEXT PRIMARY KEY, packed BLOB NOT NULL)",
    f"PRAGMA application_id={APPLICATION_ID}",
    f"PRAGMA user_version={VERSION}",
)
LARGEST = 256 * 2**20
"""Bytes that a record may unpack to; a campaign's are below 1 MB."""
PARTS = {part.__name__.lower(): part for part in (Brief, Proposal, Scenario, Mission)}
"""What is kept once and named by its id in every record that holds it."""
PATIENCE_S = 30.0
"""How long to wait for another process that holds the file."""
PAGE_BYTES = 16384
"""Of a new file: a run takes some 6 kB, and of smaller pages a part would stay empty."""
LOG_PAGES = 250
"""Pages that the write-ahead log holds before they are moved into the file."""
BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR)
"""Result codes for a file that lost a part; the statements are ours, so a failing one misses a table or a column."""
CODES = {
    sqlite3.SQLITE_NOTADB: "store-foreign",
    sqlite3.SQLITE_READONLY: "store-readonly",  # the rights were taken away while it was open
    sqlite3.SQLITE_FULL: "store-full",
} | dict.fromkeys(BUSY, "store-busy")
"""What an error of SQLite is called in an error of RVSG."""


class SqliteLedger(Ledger):
    """A ledger in one SQLite file, made where absent. Use it as a context manager, or `close` it.

    NewerStore where a newer RVSG wrote it.
    """

    def __init__(self, path: str | Path) -> None:
        self._open(Path(path), readonly=False)

    @classmethod
    def existing(cls, path: str | Path) -> Self:
        """Open an existing ledger, read-only where it cannot be written; StoreError if there is none."""
        path = Path(path)
        if not path.exists():
            raise StoreError(
                f"{path}: there is no store here. `rvsg run --out DIR` makes DIR/ledger.sqlite.", code="store-absent"
            )
        if not path.stat().st_size:
            raise StoreError(f"{path}: the file is empty, so it is no store.")
        ledger = cls.__new__(cls)
        ledger._open(path, readonly=not (os.access(path, os.W_OK) and os.access(path.parent, os.W_OK)))
        return ledger

    def _open(self, path: Path, *, readonly: bool) -> None:
        if path.is_dir():
            raise StoreError(f"{path}: this is a folder; a store is a file in it.")
        self.path, self.readonly = path, readonly
        self._lock = threading.RLock()
        self._connection: sqlite3.Connection | None = None
        try:
            with self._translated():
                self._connection = self._connect()
                if not self.readonly and not self._version():
                    self._make()
                self._version()
                self._check()
        except StoreError:
            self.close()
            raise

    def _connect(self) -> sqlite3.Connection:
        where, uri = str(self.path), self.readonly
        if self.readonly:
            # SQLite would still make files beside it, for locks, unless it knows that nobody writes. Then it
            # passes over a log that is left there by a campaign under way or killed, with what was committed last.
            where = f"file:{quote(str(self.path.absolute()))}?{'mode=ro' if self._has_log() else 'immutable=1'}"
        connection = sqlite3.connect(where, PATIENCE_S, uri=uri, check_same_thread=False, isolation_level=None)
        if not self.readonly:
            try:
                connection.execute(f"PRAGMA page_size={PAGE_BYTES}")  # changes nothing in a file that has pages
                connection.execute(f"PRAGMA wal_autocheckpoint={LOG_PAGES}")
                write_ahead(connection.cursor(), PATIENCE_S)
                connection.execute("PRAGMA synchronous=NORMAL")
            except sqlite3.Error:
                connection.close()
                raise
        return connection

    def _has_log(self) -> bool:
        """Return whether a write-ahead log that holds something lies beside the file."""
        log = self.path.with_name(f"{self.path.name}-wal")
        return log.exists() and log.stat().st_size > 0

    def _make(self) -> None:
        """Make the tables of a new file, unless another process that opened the same new file did so meanwhile."""
        with self._writing() as connection:
            if not self._version():
                for statement in SCHEMA:
                    connection.execute(statement)

    def _version(self) -> int:
        """Return the version of the file, 0 of a new one; StoreError if it is not ours, or of another version."""
        # One statement reads one state of the file: another process may be making it.
        ((version, application, tables),) = self._rows(
            "SELECT (SELECT user_version FROM pragma_user_version), (SELECT application_id FROM pragma_application_id),"
            " (SELECT count(*) FROM sqlite_master)"
        )
        if application != APPLICATION_ID and (tables or version or application):
            raise StoreError(
                f"{self.path}: this is an SQLite file of another program, not an RVSG store. Choose another.",
                code="store-foreign",
            )
        if version > VERSION:
            raise NewerStore(
                f"{self.path}: written by a newer RVSG (store version {version}; this is RVSG {rvsg.__version__} and "
                f"knows {VERSION}). Update RVSG, or use another --out."
            )
        if 0 < version < VERSION:
            raise StoreError(
                f"{self.path}: written by an earlier RVSG (store version {version}; this is RVSG {rvsg.__version__} "
                f"and reads {VERSION}). Read it with that version, or use another --out.",
                code="store-earlier",
            )
        return int(version)

    def _check(self) -> None:
        """Read all of the file once, so that damage is reported before work is built on it."""
        for (name,) in self._rows("SELECT name FROM sqlite_master WHERE type IN ('trigger', 'view')"):
            raise self._damaged(f"it holds {name!r}, a trigger or view, and a store has none")
        ((result,),) = self._rows("PRAGMA quick_check(1)")
        if result != "ok":
            raise self._damaged(str(result).splitlines()[-1])
        with self._lock:
            for row in self._db.execute("SELECT id, header, arrays, checksum FROM runs"):
                self._check_run(*row)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def snapshot(self) -> bytes:
        """Return the content of the file as it stands, the write-ahead log included."""
        with self._lock, self._translated():
            return bytes(self._db.serialize())

    def close(self) -> None:
        """Close the file."""
        if self._connection is not None:
            self._connection.close()

    def begin(self, campaign: str, settings: Mapping[str, Any]) -> None:
        """Keep the settings of a new campaign; again with equal settings changes nothing."""
        text = canonical_json(dict(settings))
        stored = self.settings(campaign)
        if stored is not None:
            if canonical_json(stored) != text:
                raise StoreError(
                    f"{self.path}: campaign {campaign!r} was begun with other settings", code="other-settings"
                )
            return
        begun = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        with self._translated(), self._writing() as connection:
            connection.execute(
                "INSERT INTO campaigns (name, settings, version, begun) VALUES (?, ?, ?, ?)",
                (campaign, text, rvsg.__version__, begun),
            )

    def forget_empty(self, campaign: str) -> bool:
        """Delete a campaign that has no attempt and return True; return False, changing nothing, where it has one."""
        with self._translated(), self._writing() as connection:
            deleted = connection.execute(
                "DELETE FROM campaigns WHERE name = ? AND NOT EXISTS (SELECT * FROM attempts WHERE campaign = ?)",
                (campaign, campaign),
            )
            return deleted.rowcount > 0 or not self._rows("SELECT 1 FROM attempts WHERE campaign = ?", campaign)

    def settings(self, campaign: str) -> dict[str, Any] | None:
        """Return the settings of a campaign; None if it was never begun."""
        rows = self._rows("SELECT settings FROM campaigns WHERE name = ?", campaign)
        try:
            return dict(json.loads(rows[0][0])) if rows else None
        except (ValueError, TypeError):
            raise self._damaged(f"the settings of campaign {campaign!r} are not what was stored") from None

    def campaigns(self) -> tuple[str, ...]:
        """Return the names of all campaigns in the order they were begun, then those that only have attempts."""
        names = [name for (name,) in self._rows("SELECT name FROM campaigns ORDER BY rowid")]
        names += [name for (name,) in self._rows("SELECT DISTINCT campaign FROM attempts ORDER BY campaign")]
        if not all(isinstance(name, str) for name in names):
            raise self._damaged("the name of a campaign is not what was stored")
        return tuple(dict.fromkeys(names))

    def keep(self, run: PackedRun) -> None:
        """Keep a run; one of the same id that is known already stays as it is."""
        with self._translated(), self._writing() as connection:
            _keep(connection, run)

    def append(self, attempt: Attempt, runs: Sequence[PackedRun]) -> None:
        """Keep an attempt with its runs in one transaction; StoreError if its index is taken."""
        records: dict[str, str] = {}
        attempt_id = _split(attempt, attempt.model_dump(mode="json"), records)
        with self._translated(), self._writing() as connection:
            for run in runs:
                _keep(connection, run)
            connection.executemany(
                "INSERT INTO records (id, packed) VALUES (?, ?) ON CONFLICT DO NOTHING",
                ((record_id, zlib.compress(text.encode())) for record_id, text in records.items()),
            )
            row = (attempt.campaign, attempt.index, attempt_id, attempt.purpose, attempt.scenario_id)
            try:
                connection.execute(
                    "INSERT INTO attempts (campaign, position, id, purpose, scenario_id) VALUES (?, ?, ?, ?, ?)", row
                )
            except sqlite3.IntegrityError:
                raise StoreError(
                    f"{self.path}: attempt {attempt.index} of campaign {attempt.campaign!r} is there already. "
                    "Does another process work on the same folder?",
                    code="attempt-taken",
                ) from None

    def attempts(self, campaign: str) -> Iterator[Attempt]:
        """Yield the attempts of a campaign in the order of their index; StoreError if a record was altered."""
        shared: dict[str, Record] = {}
        query = "SELECT position, id FROM attempts WHERE campaign = ? ORDER BY position"
        for position, attempt_id in self._rows(query, campaign):
            try:
                attempt = self._record(Attempt, attempt_id, shared)
            except ValidationError as error:
                raise StoreError(
                    f"{self.path}: attempt {position} of {campaign!r} is whole, but not as RVSG {rvsg.__version__} "
                    f"keeps it; was it written by a newer RVSG? {error}",
                    code="attempt-unreadable",
                ) from None
            except (ValueError, LookupError, TypeError):
                raise self._damaged(f"attempt {position} of campaign {campaign!r} is not what was stored") from None
            yield attempt

    def _record(self, kind: type[R], record_id: str, shared: dict[str, Record]) -> R:
        """Return a record with all that it names; ValueError where one of them is not what was stored.

        Args:
            shared: What was read before, by id; what this one names is added.
        """
        rows = self._rows("SELECT packed FROM records WHERE id = ?", record_id)
        text = _unpacked(rows[0][0]).decode() if rows else ""
        # The text is verified, not the parsed record: an older one lacks the fields that came later.
        if text_id(kind.__name__.lower(), text) != record_id:
            raise ValueError("it is damaged")
        data, named = json.loads(text)
        for where, part_id in named.items():
            if part_id not in shared:
                shared[part_id] = self._record(PARTS[part_id.partition("-")[0]], part_id, shared)
            *path, last = (int(step) if step.isdecimal() else step for step in where.split("."))
            functools.reduce(operator.getitem, path, data)[last] = shared[part_id]
        return kind.model_validate(data)

    def run(self, run_id: str) -> Run:
        """Return the run of that id; StoreError if there is none."""
        run = self.find(run_id)
        if run is None:
            raise self._damaged(f"there is no run {run_id!r}")
        return run

    def find(self, run_id: str) -> Run | None:
        """Return the run of that id, or None."""
        rows = self._rows("SELECT header, arrays, checksum FROM runs WHERE id = ?", run_id)
        if not rows:
            return None
        self._check_run(run_id, *rows[0])
        try:
            run = unpack(rows[0][1])
        except (ValidationError, InputError, ValueError) as error:
            raise self._damaged(f"{run_id} cannot be read ({error})") from None
        if run.id != run_id:
            raise self._damaged(f"{run_id} is not what was stored")
        return run

    def _check_run(self, run_id: str, header: object, arrays: object, checksum: object) -> None:
        """Raise StoreError unless a run is as it was kept: its id is of what determines it, not of what came out."""
        if header != "" or not isinstance(arrays, bytes) or checksum != _checksum(arrays):
            raise self._damaged(f"{run_id} is not what was stored: it lost the checksum it was kept with")

    @property
    def _db(self) -> sqlite3.Connection:
        assert self._connection is not None
        return self._connection

    def _rows(self, query: str, *values: object) -> list[Any]:
        with self._lock, self._translated():
            return self._db.execute(query, values).fetchall()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """Begin a transaction, and commit or undo it; StoreError if the file was opened to be read only."""
        if self.readonly:
            raise StoreError(f"{self.path}: the file cannot be written, only read.", code="store-readonly")
        with self._lock:
            self._db.execute("BEGIN IMMEDIATE")
            with self._db:  # commits, or rolls back
                yield self._db

    @contextlib.contextmanager
    def _translated(self) -> Iterator[None]:
        """Turn an error of SQLite inside into a StoreError that names the file."""
        try:
            yield
        except sqlite3.Error as error:
            raise self._error(error) from None
        except UnicodeDecodeError:  # of a message of SQLite that quotes what is damaged
            raise self._damaged("its tables are not what was stored") from None

    def _error(self, error: sqlite3.Error) -> StoreError:
        reason, code = str(error), result_code(error)
        if code is None and isinstance(error, sqlite3.OperationalError):  # a text that is not UTF-8
            return self._damaged("a text in it is not what was stored")
        if code in DAMAGED:
            return self._damaged(reason)
        if code in BUSY:
            reason += "; another process holds it"
        if code == sqlite3.SQLITE_NOTADB:
            reason = "this is no RVSG store (file is not a database). If it was one, restore it from a copy."
        if code == sqlite3.SQLITE_CANTOPEN and self._has_log():
            reason += f". The last records are in {self.path.name}-wal; copy the folder to where it may be written"
        if code == sqlite3.SQLITE_FULL:
            reason += ". Free some space and run the same command again to resume."
        return StoreError(f"{self.path}: {reason}", code=None if code is None else CODES.get(code))

    def _damaged(self, what: str) -> StoreError:
        return StoreError(
            f"{self.path}: {what}. The file was damaged or changed from outside: restore it from a copy, or repeat the "
            "campaign in another --out.",
            code="store-damaged",
        )


def result_code(error: sqlite3.Error) -> int | None:
    """Return the primary result code of an SQLite error; None if Python raised it."""
    code = getattr(error, "sqlite_errorcode", None)
    return None if code is None else code & 0xFF


def write_ahead(cursor: sqlite3.Cursor, patience_s: float) -> None:
    """Have the file keep a write-ahead log.

    SQLite does not wait by itself here where another process opens the same new file.

    Raises:
        sqlite3.OperationalError: The file cannot be written, or another process held it for longer than `patience_s`.
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


def _split(record: Record, data: dict[str, Any], records: dict[str, str]) -> str:
    """Add the text of a record, and of all that it names, by their ids; return its id.

    The text is a list: the JSON of the record with null for every one of `PARTS` in it, and their ids by place.
    """
    named: dict[str, str] = {}

    def without(value: object, part: Any, place: str) -> Any:
        if isinstance(value, Record):
            if value is not record and type(value) in PARTS.values():
                named[place] = _split(value, part, records)
                return None
            return {key: without(getattr(value, key, None), v, f"{place}.{key}".lstrip(".")) for key, v in part.items()}
        if isinstance(value, tuple) and isinstance(part, list):
            return [without(*both, f"{place}.{k}") for k, both in enumerate(zip(value, part, strict=True))]
        return part

    text = canonical_json([without(record, data, ""), named])
    record_id = text_id(type(record).__name__.lower(), text)
    records[record_id] = text
    return record_id


def _unpacked(packed: bytes) -> bytes:
    """Return a record as it was before it was compressed; ValueError where it is damaged or larger than `LARGEST`."""
    decompressor = zlib.decompressobj()
    try:
        record = decompressor.decompress(packed, LARGEST)
    except (zlib.error, TypeError) as error:
        raise ValueError(f"it is damaged ({error})") from None
    if not decompressor.eof or decompressor.unused_data:
        raise ValueError("it is damaged (it has another length than it should)")
    return record


def _keep(connection: sqlite3.Connection, run: PackedRun) -> None:
    connection.execute(
        "INSERT INTO runs (id, scenario_id, seed, header, arrays, checksum) VALUES (?, ?, ?, '', ?, ?) "
        "ON CONFLICT DO NOTHING",
        (run.id, run.scenario_id, run.seed, run.data, _checksum(run.data)),
    )


def _checksum(arrays: bytes) -> str:
    """Of a run as it is stored, before it is unpacked."""
    return hashlib.sha256(b"\0" + arrays).hexdigest()
