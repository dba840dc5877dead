"""Write what campaigns found in other forms: JUnit XML, the tables of the published study."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from rvsg.api.campaign import Campaign
from rvsg.api.folder import make_folder, reading
from rvsg.core.files import write_whole
from rvsg.report.junit import junit_of


def write_junit(path: Path, campaigns: Sequence[Campaign]) -> None:
    """Write the verdicts of campaigns as JUnit XML, a test suite for each."""
    write_whole(path, junit_of([(campaign.plan, campaign.summary()) for campaign in campaigns]))


def write_study_tables(stores: Sequence[Path], out: Path) -> list[str]:
    """Write the tables of the published study from stores; return notes on what could not be computed."""
    from rvsg.study.table_files import write_tables

    make_folder(out, option="--tables")
    with ExitStack() as stack:
        ledgers = [stack.enter_context(reading(store)) for store in stores]
        return list(write_tables(*ledgers, out=out))
