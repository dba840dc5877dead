"""Box plots of the repeated best and worst scenarios: one SVG per requirement, a panel per metric, boxes per route.

They need matplotlib (extra `figures`). Equal material gives equal bytes.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rvsg.core.errors import how_to_install
from rvsg.core.files import write_whole
from rvsg.evaluation.metrics import metric
from rvsg_study.material import TABLED, Material, Sample

COLUMNS = 4
METHODS = ("best", "worst")
COLOURS = {"best": "#c23b22", "worst": "#2b6ca3"}
INK, QUIET = "#222222", "#e3e3e3"
ABSENT = f"the figures of RQ3 are left out: drawing needs matplotlib: {how_to_install('figures')}"


def can_draw() -> bool:
    """Return whether matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def write_repeat_figures(material: Material, folder: Path, *, honest: bool) -> list[Path]:
    """Write `rq3_<requirement>.svg` for each requirement with repeated runs, and return the files.

    With `honest`, boxes leave out the runs by which a scenario was selected. Requires `can_draw()`.
    """
    written = []
    for requirement in sorted({name for name, _ in material.repeats}):
        kept = {
            (route, method): [sample for sample in runs if not (honest and sample.selection)]
            for (name, route), methods in sorted(material.repeats.items())
            if name == requirement
            for method, runs in methods.items()
        }
        if not any(sample.values for runs in kept.values() for sample in runs):
            continue
        path = folder / f"rq3_{re.sub(r'[^A-Za-z0-9_-]+', '_', requirement)}.svg"
        write_whole(path, _drawn(requirement, kept, honest))
        written.append(path)
    return written


def _drawn(requirement: str, kept: dict[tuple[str, str], list[Sample]], honest: bool) -> str:
    """Return the SVG of one requirement."""
    import io

    import matplotlib as mpl
    from matplotlib.figure import Figure

    routes = sorted({route for route, _ in kept})
    shown = [name for name in TABLED if any(name in sample.values for runs in kept.values() for sample in runs)]
    rows = -(-len(shown) // COLUMNS)
    how = "the runs that selected a scenario left out" if honest else "every run counts, as published"
    with mpl.rc_context({"svg.hashsalt": "rvsg", "font.size": 9, "axes.edgecolor": INK, "text.parse_math": False}):
        figure = Figure(figsize=(13, 3.1 * rows + 0.9), layout="constrained")
        figure.suptitle(f"{requirement}: best (red) and worst (blue) scenario, repeated; {how}")
        grid = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
        for axes, name in zip(grid, shown, strict=False):
            _panel(axes, name, routes, kept)
        for axes in grid[len(shown) :]:
            axes.set_axis_off()
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    return text.getvalue()


def _panel(axes: Any, name: str, routes: Sequence[str], kept: dict[tuple[str, str], list[Sample]]) -> None:
    """Draw one metric: a box for each route and method, a dot for each run."""
    info = metric(f"{name}_logged")
    axes.set_title(f"{info.title.removesuffix(' (as logged)')} ({name}), {info.unit}", fontsize=9)
    axes.grid(axis="y", color=QUIET, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.set_xticks(range(len(routes)), [route.replace("_", " ") for route in routes])
    axes.set_xlim(-0.6, len(routes) - 0.4)
    for at, route in enumerate(routes):
        for side, method in zip((-0.2, 0.2), METHODS, strict=True):
            values = [s.values[name] for s in kept.get((route, method), []) if name in s.values]
            if values:
                _box(axes, at + side, values, COLOURS[method], f"runs-{name}-{route}-{method}")


def _box(axes: Any, x: float, values: Sequence[float], colour: str, name: str) -> None:
    """Median, quartiles, whiskers to the farthest value within 1.5 quartile distances; all values as dots.

    `name` is the id of the group of dots in the file.
    """
    line = {"color": colour, "linewidth": 1.2}
    axes.boxplot(
        [values], positions=[x], widths=0.3, showfliers=False, manage_ticks=False,
        boxprops=line, whiskerprops=line, capprops=line, medianprops={"color": INK, "linewidth": 1.6},
    )  # fmt: skip
    dots = {"color": colour, "alpha": 0.55, "markersize": 4, "markeredgewidth": 0}
    axes.plot(list(_beside(x, len(values))), values, ".", gid=name, **dots)


def _beside(x: float, count: int) -> Iterable[float]:
    """Places around x that keep dots apart, the same at every drawing (the golden ratio's sequence)."""
    return (x + 0.24 * ((k * 0.618034) % 1.0 - 0.5) for k in range(count))
