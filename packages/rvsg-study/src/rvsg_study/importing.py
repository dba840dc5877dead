"""Import of results of the published study into a store."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

from rvsg.core.outputs import make_folder
from rvsg.core.records import Record
from rvsg.scenario.world_lookup import as_world
from rvsg.world.world import World


class StudyImport(Record):
    """What was imported, and where it is."""

    store: str
    findings: str
    """The file of everything that could not be trusted, with its reason."""
    campaigns: int
    attempts: int
    runs: int
    refused: int
    compared: int
    """Runs whose metrics were computed again and compared with the logged ones."""
    differing: int
    findings_by_kind: dict[str, int]
    """Findings of this import."""
    listed: int
    """Findings in the file, those of earlier imports too."""


def import_study(
    folder: str | Path, out: str | Path, *, world: World | str = "warehouse", on_message: Callable[[str], None]
) -> StudyImport:
    """Import results in the layout of the published study into a store, with a file of findings beside it.

    Args:
        out: the folder of the store, or its file (.sqlite, .db); a store that exists is added to.

    Raises:
        InputError: the folder holds no results.
    """
    from rvsg.store.sqlite import SqliteLedger
    from rvsg_study.import_study import find_campaigns, write_findings
    from rvsg_study.import_study import import_study as read

    place, root, out = as_world(world), Path(folder), Path(out)
    find_campaigns(root, [])  # before a store is made for nothing
    store = out if out.suffix in (".sqlite", ".db") else out / "ledger.sqlite"
    make_folder(store.parent)
    added_to = store.exists()
    with SqliteLedger(store) as ledger:
        done = read(root, ledger, place, on_message)
    findings = store.with_name("findings.csv")
    return StudyImport(
        store=str(store),
        findings=str(findings),
        campaigns=done.campaigns,
        attempts=done.attempts,
        runs=done.runs,
        refused=done.refused,
        compared=done.compared,
        differing=done.differing,
        findings_by_kind=dict(Counter(finding.kind for finding in done.findings)),
        listed=write_findings(done.findings, findings, keep=added_to),
    )
