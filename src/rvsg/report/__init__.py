"""Stored attempts become statistics, tables, figures, replays and one HTML page."""
