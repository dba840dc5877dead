"""Tables and figures of the study as files: CSV, Markdown and SVG.

Figures need matplotlib (extra `figures`). Equal material gives equal bytes.
"""

from __future__ import annotations

import csv
import importlib.util
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rvsg.core.errors import InputError, how_to_install
from rvsg.core.files import write_whole
from rvsg.evaluation.metrics import metric
from rvsg.evaluation.statistics import magnitude_of
from rvsg.runs.ledger import Ledger
from rvsg_study.study_tables import TABLED, Material, Row, Sample, build, gather

FIGURE_COLUMNS = 4
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
    rows = -(-len(shown) // FIGURE_COLUMNS)
    how = "the runs that selected a scenario left out" if honest else "every run counts, as published"
    with mpl.rc_context({"svg.hashsalt": "rvsg", "font.size": 9, "axes.edgecolor": INK, "text.parse_math": False}):
        figure = Figure(figsize=(13, 3.1 * rows + 0.9), layout="constrained")
        figure.suptitle(f"{requirement}: best (red) and worst (blue) scenario, repeated; {how}")
        grid = figure.subplots(rows, FIGURE_COLUMNS, squeeze=False).ravel()
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
    # The golden ratio's sequence keeps dots apart, and is the same at every drawing.
    beside = [x + 0.24 * ((k * 0.618034) % 1.0 - 0.5) for k in range(len(values))]
    axes.plot(beside, values, ".", gid=name, **dots)


DIVERSITY = ("sdd", "htd", "ssd")
ORDER = {name: at for at, name in enumerate(("unguided", "random", "rvsg", "best", "worst"))}
COLUMNS = ("requirement", "route", "method", "metric", "value")
TITLES = {
    "rq1": "RQ1: how bad and how diverse are the scenarios of each method",
    "rq2": "RQ2: best against worst scenario, repeated, all routes pooled",
    "rq3": "RQ3: best against worst scenario, repeated, per route",
}
WAYS = {
    "published": (
        "As published: the best of a scenario's configurations against single baseline runs; every repeat counts, the "
        "run by which the scenario was selected included; p values as they are."
    ),
    "honest": (
        "Honest: equal numbers of simulated runs per method and no selection in the means; the run by which a scenario "
        "was selected is left out of its repeats; p values corrected by Holm over each requirement and comparison."
    ),
}
DASH = "–"
UNREPEATED = "the store holds no best or worst scenario that was repeated"
UNGUIDED = "the store holds no guided scenario"
MOST_IN_TEX = 8
Cells = list[list[str]]


def write_tables(*ledgers: Ledger, out: Path) -> list[str]:
    """Write `out/published` and `out/honest`, each with rq1, rq2, rq3 as .csv, .md and .tex; return what was left out.

    Where matplotlib is there and scenarios were repeated, RQ3 is drawn too: `rq3_<requirement>.svg` in both folders.
    Several stores are read as one. A table without rows is written with its header and the reason. InputError where
    the stores hold nothing to tabulate.
    """
    material = gather(*ledgers)
    if not material.cells():
        raise InputError(
            "the store holds no guided campaign and no repeated scenario: there is nothing to tabulate",
            code="tables-empty",
        )
    drawn = can_draw()
    for way, tables in zip(WAYS, build(material), strict=True):
        folder = out / way
        folder.mkdir(parents=True, exist_ok=True)
        for name in TITLES:
            notes = [*material.notes, *(material.honest_notes if way == "honest" else ())]
            _write_one(folder, name, way, getattr(tables, name), notes)
        if drawn:
            write_repeat_figures(material, folder, honest=way == "honest")
    unrepeated = [] if material.repeats else [f"rq2 and rq3 are empty: {UNREPEATED}"]
    return [*material.notes, *material.honest_notes, *unrepeated, *([] if drawn or not material.repeats else [ABSENT])]


def _write_one(folder: Path, name: str, way: str, rows: Sequence[Row], notes: Sequence[str]) -> None:
    with (folder / f"{name}.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows([r.requirement, r.route, r.method, r.metric, repr(float(r.value))] for r in rows)
    blocks = _effect_blocks(rows) if name == "rq1" else _repeat_blocks(rows)
    (folder / f"{name}.md").write_text(_markdown(name, way, blocks, notes), encoding="utf-8")
    (folder / f"{name}.tex").write_text(_latex(name, way, blocks, notes), encoding="utf-8")


def _effect_blocks(rows: Sequence[Row]) -> list[tuple[str, Cells]]:
    """Return for each requirement one line per route and method, with a column for each metric that has a value."""
    found = []
    for requirement in _unique(row.requirement for row in rows):
        mine = {(r.route, r.method, r.metric): r.value for r in rows if r.requirement == requirement}
        metrics = [m for m in (*TABLED, *DIVERSITY, "runs") if any(key[2] == m for key in mine)]
        cells = [["route", "method", *metrics]]
        for route in _unique(key[0] for key in mine):
            cells += [
                [route, method, *(shown(m, mine.get((route, method, m))) for m in metrics)]
                for method in sorted(_unique(key[1] for key in mine if key[0] == route), key=_order)
            ]
        found.append((requirement, cells))
        extra = _comparison(mine)
        if extra:
            found.append((f"{requirement}, guided against baseline", extra))
    return found


def _comparison(mine: dict[tuple[str, str, str], float]) -> Cells:
    """Return for each route and baseline p and effect of the guided method, and the best of k runs of each."""
    compared = [(route, method) for route, method, metric in mine if metric == f"{TABLED[0]}_p"]
    best = next((m.removeprefix("dto_") for _, _, m in mine if m.startswith("dto_best")), None)
    cells = [["route", "baseline", "metric", "p (Holm)", "A12", "magnitude", *([f"rvsg {best}", best] if best else [])]]
    for route, method in compared:
        for name in TABLED:
            if (route, method, f"{name}_p") not in mine:
                continue
            a12 = mine[route, method, f"{name}_a12"]
            p = shown(f"{name}_p", mine[route, method, f"{name}_p"])
            line = [route, method, name, p, shown("a12", a12), magnitude_of(a12)]
            if best:
                line += [shown(name, mine.get((route, who, f"{name}_{best}"))) for who in ("rvsg", method)]
            cells.append(line)
    return cells if len(cells) > 1 else []


def _repeat_blocks(rows: Sequence[Row]) -> list[tuple[str, Cells]]:
    """Return for each requirement one line per route and metric: mean and spread of best and worst, p, effect."""
    found = []
    for requirement in _unique(row.requirement for row in rows):
        mine = {(r.route, r.method, r.metric): r.value for r in rows if r.requirement == requirement}
        cells = [["route", "metric", "best", "worst", "std best", "std worst", "p", "A12", "magnitude"]]
        for route in _unique(key[0] for key in mine):
            for name in (*TABLED, "ssd", "runs"):
                if not any(key[0] == route and key[2] == name for key in mine):
                    continue
                a12 = mine.get((route, "best", f"{name}_a12"))
                values = [shown(name, mine.get((route, who, name))) for who in ("best", "worst")]
                spreads = [shown("std", mine.get((route, who, f"{name}_std"))) for who in ("best", "worst")]
                p = shown("x_p", mine.get((route, "best", f"{name}_p")))
                effect = [shown("a12", a12), DASH if a12 is None else magnitude_of(a12)]
                cells.append([route, name, *values, *spreads, p, *effect])
        found.append((requirement, cells))
    return found


def shown(metric: str, value: float | None) -> str:
    """Return a value as the study prints it: three decimals, one for collisions; a dash without a value."""
    if value is None or not math.isfinite(value):
        return DASH
    if metric == "runs":
        return f"{value:.0f}"
    if metric in ("rpc", "por"):
        return f"{value:.1f}"
    if metric.endswith("_p") and value < 0.001:
        return "<0.001"
    return f"{value:.3f}"


def _markdown(name: str, way: str, blocks: Sequence[tuple[str, Cells]], notes: Sequence[str]) -> str:
    parts = [f"# {TITLES[name]}", WAYS[way]]
    for title, cells in blocks:
        parts.append(f"## {title}")
        head, *body = [[cell.replace("|", "\\|") for cell in line] for line in cells]
        rule = ["---" if at < 2 else "---:" for at in range(len(head))]
        parts.append("\n".join("| " + " | ".join(line) + " |" for line in (head, rule, *body)))
    parts += _remarks(name, blocks)
    if notes:
        parts.append("## Left out\n\n" + "\n".join(f"- {note}" for note in notes))
    return "\n\n".join(parts) + "\n"


_TEX = {
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "<": r"$<$",
    ">": r"$>$",
    DASH: "--",
}
_TEX |= {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}


def _remarks(name: str, blocks: Sequence[tuple[str, Cells]]) -> list[str]:
    """Return remarks on the tables of a file: why there are none, what a dash means."""
    if not blocks:
        return [f"No rows: {UNREPEATED if name != 'rq1' else UNGUIDED}."]
    if not any(DASH in line for _, cells in blocks for line in cells):
        return []
    if name == "rq1":
        return [f"{DASH}: no value. sdd needs two described scenarios; random search describes none."]
    return [f"{DASH}: no value. ssd and the number of runs are one number each, without spread or test."]


def _latex(name: str, way: str, blocks: Sequence[tuple[str, Cells]], notes: Sequence[str]) -> str:
    """Return tables that need no LaTeX package, with the remarks below the last one."""
    parts = [f"% {TITLES[name]}\n% {WAYS[way]}"]
    for title, cells in blocks:
        head, *body = [[_tex(cell) for cell in line] for line in cells]
        lines = [" & ".join(head) + r" \\ \hline", *(" & ".join(line) + r" \\" for line in body)]
        parts.append(
            "\\begin{table}\n\\centering\n"
            f"\\caption{{{_tex(title)}: {_tex(TITLES[name])} ({way})}}\n"
            f"\\begin{{tabular}}{{ll{'r' * (len(head) - 2)}}}\n\\hline\n" + "\n".join(lines) + "\n\\hline\n"
            "\\end{tabular}\n\\end{table}"
        )
    more = len(notes) - MOST_IN_TEX
    shortened = [*notes[:MOST_IN_TEX], *([f"and {more} more, listed in {name}.md"] if more > 0 else [])]
    said = [*_remarks(name, blocks), *([f"Left out: {'; '.join(shortened)}."] if notes else [])]
    if said:
        parts.append("{\\footnotesize " + _tex(" ".join(said)) + "\\par}")
    return "\n\n".join(parts) + "\n"


def _tex(text: str) -> str:
    return "".join(_TEX.get(character, character) for character in text)


def _unique(values: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(values))


def _order(method: str) -> tuple[int, str]:
    return ORDER.get(method, len(ORDER)), method
