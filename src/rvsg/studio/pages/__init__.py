"""The pages of the studio, each in a module that adds its addresses."""

from __future__ import annotations

from rvsg.studio.pages import campaign, finding, home, new_campaign
from rvsg.studio.workspace import Workspace


def add_pages(workspace: Workspace) -> None:
    """Add every page."""
    for module in (home, new_campaign, campaign, finding):
        module.add(workspace)
