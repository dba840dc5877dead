"""Recordings of a real robot among people: tracks, scenarios made of them, and how faithful these are."""
