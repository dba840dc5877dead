from __future__ import annotations

import subprocess
import sys


def test_what_judges_and_measures_loads_without_scipy_stats() -> None:
    code = "import sys, rvsg.evaluation.verdict, rvsg.report.summary; sys.exit('scipy.stats' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
