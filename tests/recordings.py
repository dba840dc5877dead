"""Recorded conversations with a model: the shipped one and those of the examples, by name."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = {
    path.parent.name: path.parent
    for place in ("src/rvsg/app/recordings", "examples/recordings")
    for path in sorted((ROOT / place).glob("*/calls.jsonl"))
}
CAMPAIGNS = sorted(name for name, folder in FOLDERS.items() if (folder / "campaign.yaml").exists())
