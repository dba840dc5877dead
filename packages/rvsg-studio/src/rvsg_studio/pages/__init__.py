"""The pages of the studio, each in a module that adds its addresses."""

from __future__ import annotations

from rvsg_studio.pages import (
    campaign,
    compare,
    conversations,
    describe,
    finding,
    home,
    inbox,
    matrix,
    new_campaign,
    others,
    scenario,
    versions,
    world,
)
from rvsg_studio.workspace import Workspace


def add_pages(workspace: Workspace) -> None:
    """Add every page."""
    for module in (
        home,
        new_campaign,
        campaign,
        matrix,
        finding,
        scenario,
        world,
        describe,
        inbox,
        compare,
        versions,
        conversations,
        others,
    ):
        module.add(workspace)
    compare.add_runs(workspace)
