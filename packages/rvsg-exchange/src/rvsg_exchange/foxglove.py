"""The layout for Foxglove that fits the bags of `rvsg_exchange.bag`."""

from __future__ import annotations

from pathlib import Path

LAYOUT = Path(__file__).with_name("foxglove_layout.json")


def foxglove_layout() -> str:
    """Return a layout as Foxglove imports it: the map with robot and people, and plots of speed and acceleration."""
    return LAYOUT.read_text(encoding="utf-8")
