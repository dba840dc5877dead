"""The store's schema as an ordered list of migrations. Append only: what was released is never edited.

Migration k (from 1) brings a store of `user_version` k - 1 to k. Records are JSON in the shape of their models; a
new field with a default needs no migration: an id is checked against the text as it was stored, before it is parsed.
"""

from __future__ import annotations

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
    # From here on the record of an attempt is packed (see `rvsg.store.packing`). Text that is there stays.
    ("CREATE TABLE dictionaries (campaign TEXT PRIMARY KEY, packed BLOB NOT NULL)",),
    # From here on archives of runs foretell (see `rvsg.simulation.quantised`). Nothing asks for these indexes.
    ("DROP INDEX IF EXISTS runs_by_scenario", "DROP INDEX IF EXISTS attempts_by_scenario"),
)
