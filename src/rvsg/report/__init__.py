"""Statistics, tables, figures, replays and one HTML page of stored attempts."""
