"""Recorded campaigns: a campaign file, and beside it the calls of the model that wrote the scenarios."""

from __future__ import annotations

from pathlib import Path

from rvsg.core.errors import UnknownName

FOLDER = Path(__file__).parent
CAMPAIGN = "campaign.yaml"


def demos() -> tuple[str, ...]:
    """Return the names of the recorded campaigns."""
    return tuple(sorted(path.parent.name for path in FOLDER.glob(f"*/{CAMPAIGN}")))


def demo_folder(name: str) -> Path:
    """Return the folder of a recorded campaign; UnknownName if there is none."""
    if name not in demos():
        raise UnknownName("recorded campaign", name, demos())
    return FOLDER / name


def recorded_description(world: str) -> Path:
    """Return the folder with the recorded calls in which a shipped world was described."""
    return FOLDER / f"describe-{world}"
