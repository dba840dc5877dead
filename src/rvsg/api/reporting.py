"""Write what campaigns found in other forms: JUnit XML, the tables of the published study."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from rvsg.api.campaign import Campaign
from rvsg.api.folder import holds_several, is_matrix, make_folder, reading
from rvsg.api.index import campaigns_in
from rvsg.api.matrix import Matrix, folders_in, report_all
from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg.report.junit import junit_of


def folders_of(store: Path, *, begin: str) -> list[Path]:
    """Return the folders of the campaigns of a store: of one campaign, or of several in folders of their own.

    Raises:
        InputError: none of several has begun; `begin` is the command that begins them.
    """
    paths = list(folders_in(store)) if holds_several(store) else [store]
    if not paths:
        raise InputError(f"{store}: none of its campaigns has begun. Begin them: {begin}", code="not-begun")
    return paths


def reported(
    paths: Sequence[Path], *, html: Path | None = None, world: str | None = None, optional: bool = False
) -> tuple[list[Campaign], list[Path]]:
    """Write the page of every campaign of some folders; return the campaigns and their pages.

    Args:
        html: where the page is written, of one campaign; by default beside it.
        world: where the world is now, if it was moved.
        optional: whether a store without a campaign is allowed.

    Raises:
        InputError: `html` names one page for several campaigns.
    """
    campaigns = [each for path in paths for each in campaigns_in(path, optional=optional)]
    if len(campaigns) > 1 and html is not None:
        raise InputError(
            f"{paths[0]}: {len(campaigns)} campaigns have a page each; --html names one. Report one at a time."
        )
    several = len(campaigns) > len(paths)
    linked = len(paths) > 1
    pages = [each.report(html or each.page(several=several), world=world, overview=linked) for each in campaigns]
    return campaigns, pages


def overview(folder: Path, campaigns: Sequence[Campaign]) -> tuple[Path, Matrix | None]:
    """Write the overview of the campaigns in a folder; return its path, and what was asked where one command ran them.

    The pages of the campaigns must be written.
    """
    if is_matrix(folder):
        matrix = Matrix.open(folder)
        return matrix.report(), matrix
    return report_all(folder, campaigns, "\n".join(campaign.command for campaign in campaigns)), None


def write_junit(path: Path, campaigns: Sequence[Campaign]) -> None:
    """Write the verdicts of campaigns as JUnit XML, a test suite for each."""
    write_whole(path, junit_of([(campaign.plan, campaign.summary()) for campaign in campaigns]))


def write_study_tables(stores: Sequence[Path], out: Path) -> list[str]:
    """Write the tables of the published study from stores; return notes on what could not be computed."""
    from rvsg_study.table_files import write_tables

    make_folder(out, option="--tables")
    with ExitStack() as stack:
        ledgers = [stack.enter_context(reading(store)) for store in stores]
        return list(write_tables(*ledgers, out=out))
