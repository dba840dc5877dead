"""The campaigns of a folder or a store."""

from __future__ import annotations

from pathlib import Path

from rvsg.api.campaign import Campaign
from rvsg.api.folder import LEDGER, reading, store_of
from rvsg.api.record import CampaignRecord, no_campaign


def campaigns_below(folder: Path) -> list[Campaign]:
    """Return the campaigns of a folder, or of the folders in it where it holds none itself.

    Raises:
        InputError: there is no campaign.
        StoreError: there is no store, or it cannot be read.
    """
    below = sorted(path.parent for path in folder.glob(f"*/{LEDGER}")) if folder.is_dir() else []
    if store_of(folder) is not None or not below:
        return campaigns_in(folder)
    return [campaign for path in below for campaign in campaigns_in(path)]


def campaigns_in(store: Path, *, optional: bool = False) -> list[Campaign]:
    """Return every campaign of a store, in the order they were begun.

    Args:
        store: the folder of a campaign, or a ledger file.
        optional: return none where there is no campaign, instead of raising.

    Raises:
        InputError: the store holds no campaign.
        StoreError: there is no store, or it cannot be read.
    """
    with reading(store) as ledger:
        known = ledger.campaigns()
        settings = [(name, ledger.settings(name)) for name in known]
    names = [name for name, kept in settings if kept is not None and CampaignRecord.read(kept) is not None]
    if not names and not optional:
        raise no_campaign(store, len(known))
    return [Campaign.open(store, name) for name in names]
