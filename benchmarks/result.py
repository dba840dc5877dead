"""What happens after a search: store opens, attempts and runs read, and seconds until every door has its output.

    python benchmarks/result.py [FOLDER]

FOLDER is that of a finished campaign; without it one of 283 attempts is made in a temporary folder with the simulator
without physics. Prints one JSON object; `processor_s` does not depend on what else the machine does.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rvsg
from rvsg.cli.tables import show_answer
from rvsg.report.junit import junit_of
from rvsg.store.sqlite import SqliteLedger

ATTEMPTS = 283


def counting(counts: Counter[str], name: str, work: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that is counted under a name."""

    def counted(*args: Any, **options: Any) -> Any:
        counts[name] += 1
        return work(*args, **options)

    return counted


def measured(folder: Path) -> dict[str, Any]:
    """Render the result of a campaign for every door; return what that took."""
    counts, campaign = Counter[str](), rvsg.Campaign.open(folder)
    for name, method in (("store_opens", "_open"), ("attempts_read", "_attempt"), ("runs_read", "find")):
        setattr(SqliteLedger, method, counting(counts, name, getattr(SqliteLedger, method)))
    began, processor = time.perf_counter(), time.process_time()
    with campaign.result() as result, contextlib.redirect_stderr(io.StringIO()):
        page = campaign.report(result=result)
        text, cases = json.dumps(campaign.data(result)), junit_of([result])
        show_answer(result.answer, page=str(page), again=campaign.command)
    return {
        "attempts": len(result.attempts),
        **counts,
        "seconds": round(time.perf_counter() - began, 2),
        "processor_s": round(time.process_time() - processor, 2),
        "page_bytes": page.stat().st_size,
        "json_bytes": len(text),
        "junit_bytes": len(cases),
    }


def searched(folder: Path) -> Path:
    """Run a campaign of `ATTEMPTS` attempts of search."""
    settings = {"strategy": "random", "simulator": "kinematic", "scenarios": ATTEMPTS, "refinements": 0, "repeats": 2}
    for _ in rvsg.Campaign.create(folder, **settings, seed=0).run():
        pass
    return folder


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[1]) if len(sys.argv) > 1 else searched(Path(temporary) / "campaign")
        print(json.dumps(measured(folder), indent=2))
