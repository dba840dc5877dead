"""Storage of every record by content id, in order, permanently; in SQLite by default."""
