"""Import results of the published study. The names load on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rvsg.core.lazy import lazily

if TYPE_CHECKING:
    from rvsg.store.sqlite import SqliteLedger as SqliteLedger
    from rvsg.study.import_study import find_campaigns as find_campaigns
    from rvsg.study.import_study import import_study as import_study
    from rvsg.study.import_study import write_findings as write_findings

__getattr__ = lazily(
    __name__,
    {
        "SqliteLedger": "rvsg.store.sqlite",
        "find_campaigns": "rvsg.study.import_study",
        "import_study": "rvsg.study.import_study",
        "write_findings": "rvsg.study.import_study",
    },
)
