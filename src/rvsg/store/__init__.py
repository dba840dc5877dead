"""Every record, by content id, in order, for ever: SQLite by default."""
