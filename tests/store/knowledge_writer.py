"""A writer of the test with killed writers: adds entries one by one and acknowledges each in a file.

python knowledge_writer.py DATABASE ACKNOWLEDGED FIRST STEP COUNT
"""

from __future__ import annotations

import os
import sys

from rvsg.findings.findings import Entry
from rvsg.store.knowledge_base import KnowledgeBase


def entry(number: int) -> Entry:
    """Return the entry of that number; the same number gives the same entry in every process."""
    return Entry(
        kind="rejected",
        world="w",
        place="floor-0",
        route="route_1",
        requirement="R1",
        description=f"plan {number}",
    )


def main() -> None:
    """Add the entries 0 to COUNT - 1 in an order of one's own, and note each that was added before the next."""
    database, acknowledged, first, step, count = sys.argv[1], sys.argv[2], *map(int, sys.argv[3:6])
    with KnowledgeBase(database) as base, open(acknowledged, "a", encoding="utf-8") as notes:  # noqa: PTH123
        for k in range(count):
            number = (first + k * step) % count
            base.add([entry(number)], origin=f"writer {first}")
            notes.write(f"{number}\n")
            notes.flush()
            os.fsync(notes.fileno())


if __name__ == "__main__":
    main()
