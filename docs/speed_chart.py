"""The chart of the simulator's speed in the README, from the table of benchmarks/results/speed.md.

docs/generate.py renews it; benchmarks/speed.py measures the figures.
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ROW = re.compile(r"^\| (\d+) \| \d+ \| \d+ \| (\d+) \|$", re.M)
METHOD = "whole episodes with set-up, warehouse, routes 1 and 5, one core of a two-core AMD EPYC, wall time"


def chart() -> str:
    """Return the chart as SVG: a bar for each number of people."""
    rows = ROW.findall((ROOT / "benchmarks" / "results" / "speed.md").read_text(encoding="utf-8"))
    if not rows:
        raise SystemExit("benchmarks/results/speed.md: expected rows `| people | route_1 | route_5 | both |`")
    most = max(int(times) for _, times in rows)
    bars = "".join(
        f'<text x="100" y="{30 + 34 * k}" text-anchor="end">{people} people</text>'
        f'<rect x="110" y="{14 + 34 * k}" width="{440 * int(times) / most:.0f}" height="24" fill="#1559c9"/>'
        f'<text x="{118 + 440 * int(times) / most:.0f}" y="{31 + 34 * k}">{times} times real time</text>\n'
        for k, (people, times) in enumerate(rows)
    )
    height = 34 * len(rows) + 40
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="720" height="{height}" '
        'font-family="sans-serif" font-size="15">\n'
        f'<rect width="720" height="{height}" fill="#fff"/>\n<g fill="#1b2430">\n{bars}'
        f'<text x="10" y="{height - 12}" font-size="12">{METHOD}</text>\n</g></svg>\n'
    )
