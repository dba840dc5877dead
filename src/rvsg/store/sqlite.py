"""The SQLite ledger: one file, one transaction per attempt, every record by its content id.

The file is in WAL mode: what was committed survives a kill (the last of it not a loss of power). Its
`user_version` is the version of the schema, its `application_id` says it is ours.

The record of an attempt is compressed with a dictionary (`deflateSetDictionary`): an earlier record of the same
campaign, kept once. A record needs only the dictionary, no other record.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import sqlite3
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple, Self

import sqlalchemy as sa
from pydantic import ValidationError
from sqlalchemy.exc import DatabaseError, IntegrityError

import rvsg
from rvsg.campaign.attempt import Attempt
from rvsg.campaign.ledger import Ledger, Sharing
from rvsg.core.errors import InputError, StoreError
from rvsg.core.records import canonical_json, text_id
from rvsg.simulation.archive import PackedRun, unpack
from rvsg.simulation.run import Run
from rvsg.store.sqlite_file import BUSY, engine_of, has_log, may_write, migrate, result_code, version_of

LARGEST = 256 * 2**20
"""Bytes that a record may unpack to; a campaign's are below 1 MB."""
_WINDOW = 2**15
"""How far back the compression looks; a longer dictionary adds nothing."""


def dictionary_of(record: bytes) -> bytes:
    """Return the part of a record that others are packed with."""
    return record[-_WINDOW:]


def pack_record(record: bytes, dictionary: bytes = b"") -> bytes:
    """Return a record compressed."""
    compressor = zlib.compressobj(zdict=dictionary) if dictionary else zlib.compressobj()
    return compressor.compress(record) + compressor.flush()


def unpack_record(packed: bytes, dictionary: bytes = b"") -> bytes:
    """Return the record that `pack` was given, packed with this dictionary or with none.

    Raises:
        ValueError: The bytes are damaged, unpack to more than `LARGEST`, or need another dictionary.
    """
    decompressor = zlib.decompressobj(zdict=dictionary) if dictionary else zlib.decompressobj()
    try:
        record = decompressor.decompress(packed, LARGEST)
    except zlib.error as error:
        raise ValueError(f"it is damaged ({error})") from None
    if not decompressor.eof or decompressor.unused_data:
        raise ValueError("it is damaged (it has another length than it should)")
    return record


_meta = sa.MetaData()
_campaigns = sa.Table(
    "campaigns",
    _meta,
    sa.Column("name", sa.Text, primary_key=True),
    sa.Column("settings", sa.Text),
    sa.Column("version", sa.Text),
    sa.Column("begun", sa.Text),
)
_attempts = sa.Table(
    "attempts",
    _meta,
    sa.Column("campaign", sa.Text, primary_key=True),
    sa.Column("position", sa.Integer, primary_key=True),
    sa.Column("id", sa.Text),
    sa.Column("purpose", sa.Text),
    sa.Column("scenario_id", sa.Text),
    sa.Column("record"),  # text in stores of version 3 and older
)
_dictionaries = sa.Table(
    "dictionaries",
    _meta,
    sa.Column("campaign", sa.Text, primary_key=True),
    sa.Column("packed"),
)
_runs = sa.Table(
    "runs",
    _meta,
    sa.Column("id", sa.Text, primary_key=True),
    sa.Column("scenario_id", sa.Text),
    sa.Column("seed", sa.Integer),
    sa.Column("header", sa.Text),
    sa.Column("arrays", sa.LargeBinary),
    sa.Column("checksum", sa.Text),
)
DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR)
"""Result codes for a file that lost a part; the statements are ours, so a failing one misses a table or a column."""
CODES = {
    sqlite3.SQLITE_NOTADB: "store-foreign",
    sqlite3.SQLITE_READONLY: "store-readonly",  # the rights were taken away while it was open
    sqlite3.SQLITE_FULL: "store-full",
} | dict.fromkeys(BUSY, "store-busy")
"""What an error of SQLite is called in an error of RVSG."""
_CHECKSUMS_SINCE = 2
"""The store version from which on runs have a checksum."""
_PACKED_SINCE = 4
"""The store version from which on records are packed."""


# Given to the driver as they are: SQLAlchemy takes many times longer to prepare a statement than SQLite to execute it,
# and these are executed for every run.
_KEEP = (
    "INSERT INTO runs (id, scenario_id, seed, header, arrays, checksum) VALUES (?, ?, ?, ?, ?, ?) "
    "ON CONFLICT DO NOTHING"
)
_FIND = "SELECT header, arrays, checksum FROM runs WHERE id = ?"
_FIND_WITHOUT_CHECKSUM = "SELECT header, arrays, NULL FROM runs WHERE id = ?"


class _Kept(NamedTuple):
    """The part of a row of a run that `_is_whole` looks at."""

    header: Any
    arrays: Any
    checksum: Any


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
        ledger._open(path, readonly=not may_write(path))
        return ledger

    def _open(self, path: Path, *, readonly: bool) -> None:
        if path.is_dir():
            raise StoreError(f"{path}: this is a folder; a store is a file in it.")
        self.path, self.readonly = path, readonly
        self._engine = engine_of(self.path, readonly=self.readonly)
        try:
            with self._translated(), self._engine.connect() as connection:
                if not self.readonly:
                    migrate(connection, self.path)
                self._version = version_of(connection, self.path)
                self._check(connection)
        except StoreError:
            self.close()
            raise

    def _check(self, connection: sa.Connection) -> None:
        """Read all of the file once, so that damage is reported before work is built on it."""
        result = str(connection.exec_driver_sql("PRAGMA quick_check(1)").scalar_one())
        if result != "ok":
            raise self._damaged(result.splitlines()[-1])
        if self._version < _CHECKSUMS_SINCE:
            return
        columns = sa.select(_runs.c.id, _runs.c.header, _runs.c.arrays, _runs.c.checksum)
        for row in connection.execution_options(yield_per=200).execute(columns):
            if not _is_whole(row):
                raise self._damaged(f"{row.id} is not what was stored: it lost the checksum it was kept with")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._engine.dispose()

    def begin(self, campaign: str, settings: Mapping[str, Any]) -> None:
        """Keep the settings of a new campaign; again with equal settings changes nothing."""
        text = canonical_json(dict(settings))
        known = self.settings(campaign)
        if known is not None:
            if canonical_json(known) != text:
                raise StoreError(
                    f"{self.path}: campaign {campaign!r} was begun with other settings", code="other-settings"
                )
            return
        row = {
            "name": campaign,
            "settings": text,
            "version": rvsg.__version__,
            "begun": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        }
        with self._translated(), self._writing() as connection:
            connection.execute(_campaigns.insert().values(row))

    def forget_empty(self, campaign: str) -> bool:
        """Delete a campaign that has no attempt and return True; return False, changing nothing, where it has one."""
        made = sa.select(_attempts.c.position).where(_attempts.c.campaign == campaign).limit(1)
        with self._translated(), self._writing() as connection:
            if connection.execute(made).first() is not None:
                return False
            connection.execute(_campaigns.delete().where(_campaigns.c.name == campaign))
        return True

    def settings(self, campaign: str) -> dict[str, Any] | None:
        """Return the settings of a campaign; None if it was never begun."""
        query = sa.select(_campaigns.c.settings).where(_campaigns.c.name == campaign)
        with self._translated(), self._engine.connect() as connection:
            text = connection.execute(query).scalar_one_or_none()
        try:
            return None if text is None else dict(json.loads(text))
        except (ValueError, TypeError):
            raise self._damaged(f"the settings of campaign {campaign!r} are not what was stored") from None

    def campaigns(self) -> tuple[str, ...]:
        """Return the names of all campaigns in the order they were begun, then those that only have attempts."""
        with self._translated(), self._engine.connect() as connection:
            begun = connection.execute(sa.select(_campaigns.c.name).order_by(sa.text("rowid"))).scalars().all()
            others = connection.execute(sa.select(_attempts.c.campaign).distinct()).scalars().all()
        if not all(isinstance(name, str) for name in (*begun, *others)):
            raise self._damaged("the name of a campaign is not what was stored")
        return tuple(dict.fromkeys([*begun, *sorted(others)]))

    def keep(self, run: PackedRun) -> None:
        """Keep a run; one of the same id that is known already stays as it is."""
        with self._translated(), self._writing() as connection:
            _keep(connection, run)

    def append(self, attempt: Attempt, runs: Sequence[PackedRun]) -> None:
        """Keep an attempt with its runs in one transaction; StoreError if its index is taken."""
        scenario = attempt.proposal.scenario
        record = canonical_json(attempt.model_dump(mode="json"))
        row = {
            "campaign": attempt.campaign,
            "position": attempt.index,
            "id": text_id(Attempt.__name__.lower(), record),
            "purpose": attempt.purpose,
            "scenario_id": scenario.id if scenario else None,
        }
        try:
            with self._writing() as connection:
                for run in runs:
                    _keep(connection, run)
                packed = self._packed(connection, attempt, record.encode())
                connection.execute(_attempts.insert().values(row | {"record": packed}))
        except (IntegrityError, sqlite3.IntegrityError):
            raise StoreError(
                f"{self.path}: attempt {attempt.index} of campaign {attempt.campaign!r} is there already. "
                "Does another process work on the same folder?",
                code="attempt-taken",
            ) from None
        except (DatabaseError, sqlite3.DatabaseError) as error:
            raise self._error(error) from None

    def attempts(self, campaign: str) -> Iterator[Attempt]:
        """Yield the attempts of a campaign in the order of their index; StoreError if a record was altered."""
        query = (
            sa.select(_attempts.c.position, _attempts.c.id, _attempts.c.record)
            .where(_attempts.c.campaign == campaign)
            .order_by(_attempts.c.position)
        )
        with self._translated(), self._engine.connect() as connection:
            rows = connection.execute(query).all()
            dictionary = self._dictionary(connection, campaign)
        shared = Sharing()
        for row in rows:
            yield shared(self._attempt(campaign, row, dictionary))

    def attempt(self, campaign: str, index: int) -> Attempt:
        """Return one attempt of a campaign; StoreError if there is none, or its record was altered."""
        query = sa.select(_attempts.c.position, _attempts.c.id, _attempts.c.record).where(
            _attempts.c.campaign == campaign, _attempts.c.position == index
        )
        with self._translated(), self._engine.connect() as connection:
            row = connection.execute(query).one_or_none()
            dictionary = self._dictionary(connection, campaign)
        if row is None:
            raise self._damaged(f"there is no attempt {index} of campaign {campaign!r}")
        return self._attempt(campaign, row, dictionary)

    def _attempt(self, campaign: str, row: Any, dictionary: bytes) -> Attempt:
        position, kept_id, kept = row
        try:
            record = unpack_record(kept, dictionary).decode() if isinstance(kept, bytes) else kept
        except ValueError:
            record = None
        # The text is verified, not the parsed record: an older one lacks the fields that came later.
        if not isinstance(record, str) or text_id(Attempt.__name__.lower(), record) != kept_id:
            raise self._damaged(f"attempt {position} of campaign {campaign!r} is not what was stored")
        return self._parsed(record, f"attempt {position} of {campaign!r}")

    def _packed(self, connection: sa.Connection, attempt: Attempt, record: bytes) -> bytes:
        """Pack a record; the first with measurements, so with the names of all metrics, is what the others repeat."""
        dictionary = self._dictionary(connection, attempt.campaign)
        if not dictionary and attempt.measurements:
            dictionary = dictionary_of(record)
            row = {"campaign": attempt.campaign, "packed": pack_record(dictionary)}
            connection.execute(_dictionaries.insert().values(row))
        return pack_record(record, dictionary)

    def _dictionary(self, connection: sa.Connection, campaign: str) -> bytes:
        """Return what the records of a campaign are packed with; nothing if there is none."""
        if self._version < _PACKED_SINCE:
            return b""
        query = sa.select(_dictionaries.c.packed).where(_dictionaries.c.campaign == campaign)
        packed = connection.execute(query).scalar_one_or_none()
        try:
            return b"" if packed is None else unpack_record(packed)
        except (ValueError, TypeError) as error:
            raise self._damaged(f"the dictionary of campaign {campaign!r} cannot be read: {error}") from None

    def run(self, run_id: str) -> Run:
        """Return the run of that id; StoreError if there is none."""
        found = self.find(run_id)
        if found is None:
            raise self._damaged(f"there is no run {run_id!r}")
        return found

    def find(self, run_id: str) -> Run | None:
        """Return the run of that id, or None."""
        query = _FIND if self._version >= _CHECKSUMS_SINCE else _FIND_WITHOUT_CHECKSUM
        with self._translated(), self._engine.connect() as connection:
            found = _driver(connection).execute(query, (run_id,)).fetchone()
        if found is None:
            return None
        row = _Kept(*found)
        if not _is_whole(row):
            raise self._damaged(f"{run_id} is not what was stored: it lost the checksum it was kept with")
        try:
            run = unpack(row.arrays)
        except (ValidationError, InputError, ValueError) as error:
            raise self._damaged(f"{run_id} cannot be read ({error})") from None
        if run.id != run_id:
            raise self._damaged(f"{run_id} is not what was stored")
        return run

    def _parsed(self, record: str, what: str) -> Attempt:
        try:
            return Attempt.from_json(record)
        except ValidationError as error:
            raise StoreError(
                f"{self.path}: {what} is whole, but not as RVSG {rvsg.__version__} keeps it; was it written by a "
                f"newer RVSG? {error}",
                code="attempt-unreadable",
            ) from None

    def _damaged(self, what: str) -> StoreError:
        return StoreError(
            f"{self.path}: {what}. The file was damaged or changed from outside: restore it from a copy, or repeat the "
            "campaign in another --out.",
            code="store-damaged",
        )

    def _writing(self) -> AbstractContextManager[sa.Connection]:
        """Return a transaction; StoreError if the file was opened to be read only."""
        if self.readonly:
            raise StoreError(f"{self.path}: the file cannot be written, only read.", code="store-readonly")
        return self._engine.begin()

    def _translated(self) -> _Translated:
        return _Translated(self)

    def _error(self, given: DatabaseError | sqlite3.DatabaseError) -> StoreError:
        error = given.orig if isinstance(given, DatabaseError) else given
        reason, code = str(error), result_code(error)
        if code is None and isinstance(error, sqlite3.OperationalError):  # a text that is not UTF-8
            return self._damaged("a text in it is not what was stored")
        if code in DAMAGED:
            return self._damaged(reason)
        if code in BUSY:
            reason += "; another process holds it"
        if code == sqlite3.SQLITE_NOTADB:
            reason = "this is no RVSG store (file is not a database). If it was one, restore it from a copy."
        if code == sqlite3.SQLITE_CANTOPEN and has_log(self.path):
            reason += f". The last records are in {self.path.name}-wal; copy the folder to where it may be written"
        if code == sqlite3.SQLITE_FULL:
            reason += ". Free some space and run the same command again to resume."
        return StoreError(f"{self.path}: {reason}", code=None if code is None else CODES.get(code))


class _Translated:
    """Turns a database error inside into a StoreError that names the file."""

    def __init__(self, ledger: SqliteLedger) -> None:
        self._ledger = ledger

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: object) -> None:
        if isinstance(error, DatabaseError | sqlite3.DatabaseError):
            raise self._ledger._error(error) from None
        if isinstance(error, UnicodeDecodeError):  # of a message of SQLite that quotes what is damaged
            raise self._ledger._damaged("its tables are not what was stored") from None


def _keep(connection: sa.Connection, run: PackedRun) -> None:
    row = (run.id, run.scenario_id, run.seed, "", run.data, _checksum("", run.data))
    _driver(connection).execute(_KEEP, row)


def _driver(connection: sa.Connection) -> sqlite3.Connection:
    """Return SQLite's own connection, in the same transaction."""
    driver = connection.connection.driver_connection
    assert isinstance(driver, sqlite3.Connection)
    return driver


def _is_whole(row: Any) -> bool:
    """Return whether a run is as it was kept; of one that was kept before there were checksums nobody can say."""
    if row.checksum is None:
        return True
    return (
        isinstance(row.header, str)
        and isinstance(row.arrays, bytes)
        and row.checksum == _checksum(row.header, row.arrays)
    )


def _checksum(header: str, arrays: bytes) -> str:
    """Of a run as it is stored, before it is unpacked."""
    return hashlib.sha256(header.encode() + b"\0" + arrays).hexdigest()
