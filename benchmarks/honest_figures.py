"""The figures of benchmarks/results/honest-statistics.md, from a store of the published study.

`rvsg import study DIR --out STORE`, then `python benchmarks/honest_figures.py STORE docs/images`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from rvsg.store.sqlite import SqliteLedger
from rvsg_study.study_tables import Material, Row, build, gather

METRICS = {"R1": ("dto", "m"), "R2": ("jerk", "m/s³"), "R3": ("trg", "s")}
INK, GREY, RED, BLUE = "#222222", "#8a8a8a", "#c23b22", "#2b6ca3"
WIDTH, LEFT, ROW, TOP = 760, 200, 26, 64


def figure(title: str, groups: list[tuple[str, list[tuple[str, list[tuple[float, str, str]]]]]], key: str) -> str:
    """An SVG of dots on rows. A group has a title and rows; a row a label and (value, colour, shape)."""
    height = TOP + sum(ROW * (len(rows) + 2) for _, rows in groups)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif" '
        f'font-size="13" fill="{INK}"><rect width="{WIDTH}" height="{height}" fill="white"/>',
        f'<text x="12" y="24" font-size="16" font-weight="bold">{title}</text><text x="12" y="46">{key}</text>',
    ]
    y = TOP
    for heading, rows in groups:
        values = [value for _, marks in rows for value, _, _ in marks]
        low, high = min(0.0, *values) if min(values) < 10 else min(values) - 1, max(values)
        scale = (WIDTH - LEFT - 60) / (high - low)
        y += ROW
        parts.append(f'<text x="12" y="{y}" font-weight="bold">{heading}</text>')
        parts.append(f'<text x="{LEFT}" y="{y}" fill="{GREY}" text-anchor="middle">{low:.3g}</text>')
        parts.append(f'<text x="{WIDTH - 60}" y="{y}" fill="{GREY}" text-anchor="middle">{high:.3g}</text>')
        for label, marks in rows:
            y += ROW
            parts.append(f'<text x="24" y="{y + 4}">{label}</text>')
            parts.append(f'<line x1="{LEFT}" x2="{WIDTH - 60}" y1="{y}" y2="{y}" stroke="#e3e3e3"/>')
            for value, colour, shape in marks:
                x = LEFT + (value - low) * scale
                if shape == "tick":
                    parts.append(
                        f'<rect x="{x - 0.75:.1f}" y="{y - 6}" width="1.5" height="12" fill="{colour}" opacity=".5"/>'
                    )
                elif shape == "ring":
                    parts.append(
                        f'<circle cx="{x:.1f}" cy="{y}" r="5" fill="white" stroke="{colour}" stroke-width="2"/>'
                    )
                else:
                    parts.append(f'<circle cx="{x:.1f}" cy="{y}" r="5" fill="{colour}"/>')
        y += ROW
    return "\n".join([*parts, "</svg>"]) + "\n"


def curse(material: Material) -> str:
    """The run by which each best scenario was selected, and its 29 others."""
    groups = []
    for name, (metric, unit) in METRICS.items():
        rows = []
        for (requirement, route), methods in sorted(material.repeats.items()):
            if requirement != name or "best" not in methods:
                continue
            others = [s.values[metric] for s in methods["best"] if not s.selection]
            marks = [(value, GREY, "tick") for value in others]
            marks.append((sum(others) / len(others), BLUE, "dot"))
            marks += [(s.values[metric], RED, "dot") for s in methods["best"] if s.selection]
            rows.append((route, marks))
        if rows:
            groups.append((f"{name}: {metric}, {unit}", rows))
    key = "red: the run that selected the scenario; grey: its 29 repeats; blue: their mean"
    return figure("The winner's curse: what was selected does not come back", groups, key)


def budgets(published: list[Row], honest: list[Row]) -> str:
    """Guided and unguided, as published and at equal budgets."""
    theirs = {(r.requirement, r.route, r.method, r.metric): r.value for r in published}
    ours = {(r.requirement, r.route, r.method, r.metric): r.value for r in honest}
    groups = []
    for name, (metric, unit) in METRICS.items():
        rows = []
        for route in sorted({key[1] for key in theirs if key[0] == name}):
            guided, unguided = (name, route, "rvsg"), (name, route, "unguided")
            if (*unguided, metric) not in theirs:
                continue
            rows.append(
                (
                    f"{route}, as published",
                    [(theirs[*unguided, metric], GREY, "dot"), (theirs[*guided, metric], RED, "dot")],
                )
            )
            rows.append(
                (
                    f"{route}, one run each",
                    [(ours[*unguided, metric], GREY, "dot"), (ours[*guided, metric], BLUE, "dot")],
                )
            )
            best = next((key[3] for key in ours if key[:3] == unguided and key[3].startswith(f"{metric}_best")), None)
            if best:
                rows.append(
                    (
                        f"{route}, worst of five",
                        [(ours[*unguided, best], GREY, "ring"), (ours[*guided, best], BLUE, "ring")],
                    )
                )
        if rows:
            groups.append((f"{name}: {metric}, {unit}", rows))
    key = "grey: unguided; red: guided, best of five; blue: guided with the same number of runs as unguided"
    return figure("What guidance brings at equal budgets", groups, key)


def main() -> None:
    """Write the two figures."""
    store, out = Path(sys.argv[1]), Path(sys.argv[2])
    with SqliteLedger.existing(store / "ledger.sqlite" if store.is_dir() else store) as ledger:
        material = gather(ledger)
        published, honest = build(material)
        (out / "winners-curse.svg").write_text(curse(material), encoding="utf-8")
        (out / "equal-budgets.svg").write_text(budgets(published.rq1, honest.rq1), encoding="utf-8")


if __name__ == "__main__":
    main()
