"""The pages of the studio, in modules that add their addresses."""

from __future__ import annotations

from rvsg_studio.pages import campaign, compare, describe, editors, finding, home, inbox, new_campaign
from rvsg_studio.workspace import Workspace


def add_pages(workspace: Workspace) -> None:
    """Add every page."""
    for add in (
        home.add,
        home.add_others,
        new_campaign.add,
        campaign.add,
        campaign.add_matrix,
        finding.add,
        editors.add_world,
        editors.add_scenario,
        describe.add,
        describe.add_conversations,
        inbox.add,
        compare.add,
        compare.add_versions,
        compare.add_runs,
    ):
        add(workspace)
