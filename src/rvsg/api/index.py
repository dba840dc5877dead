"""The campaigns of a folder or a store."""

from __future__ import annotations

from pathlib import Path

from rvsg.api.campaign import Campaign, no_campaign
from rvsg.api.folder import reading
from rvsg.api.record import CampaignRecord


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
