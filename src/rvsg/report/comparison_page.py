"""Comparisons of variants and explorations, as pages, figures and Markdown."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, count, cycle, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.core.files import check_writable, write_whole
from rvsg.evaluation.verdict import arrivals_in_words, counted, percent
from rvsg.recording.fidelity import Fidelity
from rvsg.report.charts import COLOURS, Scale, ticks
from rvsg.report.page_contents import manner
from rvsg.report.renderer import component, render, script_safe
from rvsg.report.replay_data import ReplayGroup, replay_payload
from rvsg.report.run_facts import RunFacts
from rvsg.report.stills import floor_svg, plan_markup
from rvsg.report.words import dependence, limit_in_words, trend
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.variation import Range
from rvsg.search.exploration import Exploration
from rvsg.suites.suite import CaseChange, Change, Comparison, VariantPair, counts
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.world import World

TONES = {Change.BROKEN: "bad", Change.FIXED: "good", Change.UNCLEAR: "", Change.MISSING: "", Change.UNCHANGED: ""}
"""The tone of each change, what broke first."""
RANKING = ("rank", "stack", "version", "violated", "share (95 % interval)", "contact", "arrived", "stack failed")
CHANGES = ("case", "requirement", "change", "violated before", "violated now", "difference (95 % interval)", "p (Holm)")
LABEL_W, BAR_W, ROW_H = 230, 420, 30
SCATTER = 320
Links = Callable[[CaseChange], Mapping[str, Any]]
SIDES = (("violated", True), ("kept", False))


@dataclass(frozen=True, kw_only=True)
class ReplayedChange:
    """The two runs of one seed that show a change."""

    change: CaseChange
    seed: int
    scenario: Scenario
    """As the first variant ran it."""
    requirement: Requirement
    world: World
    runs: tuple[RunFacts, RunFacts]


def comparison_page(
    comparison: Comparison, *, worlds: Mapping[str, World] | None = None, replayed: Sequence[ReplayedChange] = ()
) -> str:
    """Return a comparison as an HTML page that loads nothing.

    Args:
        worlds: the world of each case; each is drawn once, with the places where the variants violate.
        replayed: changes to replay; both runs are drawn over one floor plan and move on one clock.
    """
    names = tuple(variant.version for variant in comparison.variants[:2])
    shown = [
        {
            "change": change.change,
            "seed": change.seed,
            "data": script_safe(change_replay(change, names)),
            "ids": script_safe([run.run.id for run in change.runs]),
            "stories": list(zip(names, [[said.text for said in run.story] for run in change.runs], strict=True)),
        }
        for change in replayed
    ]
    by_world = {world.id: world for world in (worlds or {}).values()}
    maps = [
        _map(world, comparison, {case for case, world in (worlds or {}).items() if world.id == key})
        for key, world in by_world.items()
    ]
    two = len(comparison.variants) == 2
    return render(
        "comparison.html",
        title=f"{names[1]} against {names[0]}" if two else _title(comparison),
        found=comparison,
        names=names,
        summary=_counted(comparison.changes) if two else "",
        ranking=RANKING,
        rows=ranking_rows(comparison),
        figure=shares_figure(comparison),
        labels=[_short(variant.version) for variant in comparison.variants],
        cells=_cells(comparison),
        sentences=[pair_sentence(pair) for pair in comparison.pairs],
        changes=changes_markup(comparison) if two and comparison.changes else "",
        maps=maps,
        shown=shown,
        component=Markup(component()),  # noqa: S704  (our own files)
    )


def ranking_markdown(comparison: Comparison) -> str:
    """Return the variants as a Markdown table, and the difference of each two."""
    seeds = max((len(case.seeds) for variant in comparison.variants for case in variant.cases), default=0)
    lines = [
        f"### {_title(comparison)}, {counted(seeds, 'seed')} each",
        "",
        *_table(RANKING, [[_plain(cell) for cell in row] for row in ranking_rows(comparison)]),
    ]
    lines += ["", "Differences of the shares on the same scenarios and seeds (paired, 95 % interval):", ""]
    return "\n".join([*lines, *(f"- {_plain(pair_sentence(pair))}" for pair in comparison.pairs)]) + "\n"


def changes_markdown(comparison: Comparison) -> str:
    """Return what changed between two variants as Markdown for a pull request, what broke first."""
    first, second = (_plain(variant.version) for variant in comparison.variants[:2])
    rows = []
    for row in change_rows(comparison.changes):
        change = f"**{row['change']}**" if row["p"] else row["change"]
        name = f"{_plain(row['title'])} ({_plain(row['case'])})"
        rows.append((name, _plain(row["requirement"]), change, *(row[k] for k in ("before", "now", "difference", "p"))))
    head = f"### {second} against {first}: {_counted(comparison.changes) or 'no case in common'}"
    tested = [f"{_plain(v.version)}: {_plain(v.tested)}." for v in comparison.variants[:2] if v.tested]
    return "\n".join([head, "", *_table(CHANGES, rows), *(["", "  \n".join(tested)] if tested else [])]) + "\n"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    return lines + [f"| {' | '.join(row)} |" for row in rows]


def _plain(text: str) -> str:
    """Return the text of a file as text of Markdown: it ends no cell, mentions nobody, links to nothing."""
    escaped = re.sub(r"[\\`*\[\]!|~]", r"\\\g<0>", " ".join(text.split()).replace("<", "&lt;"))
    return re.sub("[@#]|://|www(?=[.])", lambda mark: f"{mark[0]}\N{ZERO WIDTH SPACE}", escaped)


def _title(comparison: Comparison) -> str:
    cases = {case for case, _ in comparison.cases}
    return f"{counted(len(comparison.variants), 'navigation stack')} on {counted(len(cases), 'scenario')}"


def _counted(changes: Sequence[CaseChange]) -> str:
    numbers = counts(changes)
    return ", ".join(f"{numbers[change]} {change.value}" for change in Change if numbers[change])


def ranking_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """Return the table of the variants."""
    return [
        (
            str(rank) if variant.judged else "not judged", variant.version, variant.stack_version,
            f"{variant.violated} of {variant.judged}",
            f"{percent(variant.share)} ({percent(variant.interval[0])} to {percent(variant.interval[1])})",
            str(variant.contacts), f"{variant.arrived} of {variant.runs}", str(variant.failed),
        )
        for rank, variant in zip(count(1), comparison.variants)
    ]  # fmt: skip


def pair_sentence(pair: VariantPair) -> str:
    """Return the difference of two variants as a sentence."""
    if pair.difference is None:
        return f"{pair.first} and {pair.second} have no judged run in common."
    clear = "the interval excludes 0" if pair.difference.is_clear else "the interval includes 0"
    return (
        f"{pair.first} against {pair.second}: {_points(pair.difference.difference, pair.difference.interval)}; {clear}."
    )


def _points(difference: float, interval: tuple[float, float]) -> str:
    return f"{100 * difference:+.0f} points ({100 * interval[0]:+.0f} to {100 * interval[1]:+.0f})"


def change_rows(changes: Sequence[CaseChange], links: Links = lambda change: {}) -> list[dict[str, Any]]:
    """Return the rows of a table of changes as text, what broke first; `tone` is good, bad or empty."""
    rows = []
    for change in sorted(changes, key=lambda change: [*TONES].index(change.change)):
        row = {key: getattr(change, key) for key in ("case", "title", "requirement")}
        row |= {"change": change.change.value, "tone": TONES[change.change]}
        row |= dict.fromkeys(("before", "now", "difference", "p"), "")
        if change.difference is not None and change.interval is not None and change.p_corrected is not None:
            row |= zip(("before", "now"), (f"{number} of {change.seeds}" for number in change.violations), strict=True)
            row |= {"difference": _points(change.difference, change.interval), "p": f"{change.p_corrected:.3g}"}
        rows.append(row | {"address": "", "more": ()} | dict(links(change)))
    return rows


def changes_markup(
    comparison: Comparison,
    *,
    sides: Sequence[str] = (),
    quantity: str = "violating share",
    places: Sequence[tuple[float, float]] | None = None,
    links: Links = lambda change: {},
) -> Markup:
    """Return what changed between two variants as a part of a page: counts, a scatter, and a row for every case.

    Args:
        sides: what the variants are called; their versions otherwise.
        quantity: what the scatter shows.
        places: its value for each case in both variants; the shares of violating runs otherwise.
        links: what a page adds to the row of a change: `title`, `address`, `more` as (text, address, label).
    """
    shared = [change for change in comparison.changes if change.change is not Change.MISSING]
    if places is None:
        places = [(c.violations[0] / c.seeds, c.violations[1] / c.seeds) for c in shared if c.seeds]
    cells: dict[tuple[bool, bool], Counter[Change]] = {}
    for change in shared:
        before, after = (violating > 0 for violating in change.violations)
        cells.setdefault((before, after), Counter())[change.change] += 1

    def cell(before: bool, after: bool) -> list[tuple[int, str, str]]:
        numbers = cells.get((before, after), Counter[Change]())
        return [(numbers[change], change.value, TONES[change]) for change in Change if numbers[change]]

    return render(
        "changes.html",
        sides=sides or [variant.version for variant in comparison.variants],
        matrix=[(word, [cell(before, after) for after in (True, False)]) for word, before in SIDES],
        quantity=quantity,
        scatter=_scatter(places),
        changes=change_rows(comparison.changes, links),
    )


def _scatter(places: Sequence[tuple[float, float]]) -> dict[str, Any] | None:
    """Return the drawing of values in both variants; on its line both are equal, a larger circle holds several."""
    if not places:
        return None
    values = [value for place in places for value in place]
    air = 0.08 * (max(values) - min(values)) or 0.5
    left, base, low, high = 46, SCATTER - 40, min(values) - air, max(values) + air
    x, y = Scale(low, high, left, SCATTER - 10), Scale(low, high, base, base - (SCATTER - 10 - left))
    ends = ((x(high), y(high)), (SCATTER - 10, base), (left, 10))
    return {
        "size": SCATTER,
        "base": base,
        "middle": (SCATTER + left) / 2,
        "lines": [(left, base, *end) for end in ends],
        "circles": [(x(a), y(b), 4 + math.sqrt(number)) for (a, b), number in Counter(places).items()],
    }


def _cells(comparison: Comparison) -> list[dict[str, Any]]:
    flags = [{case.key: list(case.flags.values()) for case in variant.cases} for variant in comparison.variants]
    rows = []
    for case, requirement in comparison.cases:
        of_case = [variant.get((case, requirement), []) for variant in flags]
        counted_runs = [(sum(violated), len(violated)) for violated in of_case]
        shares = [
            {"text": f"{bad} of {judged}" if judged else "-", "alpha": f"{0.75 * bad / max(1, judged):.2f}"}
            for bad, judged in counted_runs
        ]
        rows.append({"case": f"{case}, {requirement}", "shares": shares})
    return rows


def shares_figure(comparison: Comparison) -> Markup:
    """Return an SVG with the share of violating runs of each variant and its interval."""
    return render(
        "shares.svg",
        width=LABEL_W + BAR_W + 60,
        height=40 + ROW_H * len(comparison.variants),
        row=ROW_H,
        x=Scale(0.0, 1.0, LABEL_W, LABEL_W + BAR_W),
        variants=[
            {"label": _short(variant.version), "interval": variant.interval, "share": variant.share, "colour": colour}
            for variant, colour in zip(comparison.variants, cycle(COLOURS))
        ],
    )


def _short(label: str) -> str:
    return label if len(label) <= 34 else f"...{label[-31:]}"


def _map(world: World, comparison: Comparison, cases: set[str]) -> dict[str, object]:
    plan = floor_plan(world, tooltips=False)
    dots = []
    for k, variant in enumerate(comparison.variants):
        for place in (place for case in variant.cases if case.case in cases for place in case.places):
            x, y = plan.transform.point(*place)
            dots.append({"x": f"{x:.2f}", "y": f"{y:.2f}", "colour": COLOURS[k % len(COLOURS)]})
    labels = [{"label": _short(v.version), "colour": css} for v, css in zip(comparison.variants, cycle(COLOURS))]
    return {"title": world.title, **plan_markup(world, plan), "dots": dots, "legend": labels}


def change_replay(replayed: ReplayedChange, names: Sequence[str]) -> dict[str, object]:
    """Return both runs of a change as data of the replay component: over one floor plan and on one clock."""
    return pair_replay(replayed.runs, names, replayed.scenario, replayed.requirement, replayed.world)


def pair_replay(
    runs: tuple[RunFacts, RunFacts], names: Sequence[str], scenario: Scenario, requirement: Requirement, world: World
) -> dict[str, object]:
    """Return two runs of one scenario as data of the replay component: over one floor plan and on one clock."""
    group = ReplayGroup(
        id="pair",
        label=f"seed {runs[1].run.seed}, {names[0]} and {names[1]}",
        purpose="versions",
        manners={human.name: manner(human) for human in scenario.people.humans},
        runs=runs,
        notes=tuple(names),
    )
    replay = replay_payload([group], mission=scenario.mission, requirement=requirement, world=world)
    return replay | {"floor": floor_svg(world)}


RECORDED = ("recorded", "simulated")


def recording_page(
    title: str,
    runs: tuple[RunFacts, RunFacts],
    fidelities: Sequence[Fidelity],
    *,
    data: dict[str, object],
    requirement: Requirement,
    verdict: str,
    notes: Sequence[str],
) -> str:
    """Return a recording beside a run of its scenario as an HTML page that loads nothing: both on one clock.

    Args:
        runs: the recording and the simulated run that is nearest to it, of the first of `fidelities`.
        data: both as `pair_replay` returns them.
    """
    return render(
        "recording.html",
        title=title,
        verdict=verdict,
        requirement=requirement,
        fidelities=fidelities,
        notes=notes,
        names=RECORDED,
        stories=list(zip(RECORDED, [[said.text for said in facts.story] for facts in runs], strict=True)),
        data=script_safe(data),
        ids=script_safe([facts.run.id for facts in runs]),
        component=Markup(component()),  # noqa: S704  (our own files)
    )


Floats = NDArray[np.float64]
LEFT, RIGHT, TOP, BOTTOM = 90, 442, 30, 326
CELLS = 48
WHITE, RED = 255.0, np.array([222.0, 92.0, 80.0]) - 255.0
"""The colour of no violation, and what it changes by until every run violates."""
BOUNDARY = 0.5


def response_svg(exploration: Exploration, *, alone: bool = False) -> Markup:
    """Return the picture of an exploration: a curve for one range, a map for each pair of the ranges that matter most.

    Args:
        alone: whether the picture is a file of its own rather than a part of a page.
    """
    ranges = range(len(exploration.ranges))
    if len(ranges) == 1:
        panels = [_curve(exploration)]
    else:
        share = [sensitivity.share for sensitivity in exploration.sensitivities] or [0.0] * len(ranges)
        order = sorted(ranges, key=lambda k: (-share[k], k))[:4]
        panels = [_probability_map(exploration, a, b) for a, b in combinations(order, 2)]
    across = min(2, len(panels))
    size: dict[str, float] = {"left": LEFT, "right": RIGHT, "top": TOP, "bottom": BOTTOM}
    size |= {"wide": (RIGHT - LEFT) / CELLS + 0.4, "high": (BOTTOM - TOP) / CELLS + 0.4}
    rows = -(-len(panels) // across)
    return render("response.svg", panels=panels, alone=alone, across=across, rows=rows, **size)


def response_page(exploration: Exploration) -> str:
    """Return an exploration as an HTML page that loads nothing."""
    low, high = exploration.interval
    ordered = sorted(exploration.sensitivities, key=lambda s: (s.band.p if s.band else 1.0, -s.share))
    ranges = {varied.name: varied for varied in exploration.ranges}
    degree = None if exploration.surface is None else exploration.surface.degree
    values = {
        "found": exploration,
        "came": arrivals_in_words(exploration.arrived, exploration.runs),
        "picture": response_svg(exploration),
        "probability": f"{exploration.violations / exploration.runs:.0%}",
        "interval": f"{low:.0%} to {high:.0%}",
        "limit": limit_in_words(exploration.requirement),
        "rows": [(ranges[s.name], s, dependence(s, ranges[s.name], flat=True), trend(s)) for s in ordered],
        "degree": degree,
        "invalid": sum(bool(point.problems) for point in exploration.points),
    }
    return render("response.html", **values)


def _probability_map(exploration: Exploration, a: int, b: int) -> dict[str, Any]:
    """Return the probability over two ranges, the others at their middles, with the boundary and the runs."""
    first, second = exploration.ranges[a], exploration.ranges[b]
    x, y = Scale(first.low, first.high, LEFT, RIGHT), Scale(second.low, second.high, BOTTOM, TOP)
    panel = _panel(first, x, _ticks(second), y, second.name)
    panel["title"] = f"{first.name} and {second.name}"
    panel["dots"] = [
        (x(p.values[a]), y(p.values[b]), p.violated, _said(exploration, p.values)) for p in exploration.judged
    ]
    if exploration.surface is not None:
        edges = np.linspace(0.0, 1.0, CELLS + 1)
        centres = (edges[1:] + edges[:-1]) / 2
        cells = exploration.surface.probability(_plane(len(exploration.ranges), a, b, centres)).reshape(CELLS, CELLS)
        wide, high = (RIGHT - LEFT) / CELLS, (BOTTOM - TOP) / CELLS
        panel["cells"] = [
            (
                LEFT + i * wide,
                BOTTOM - (j + 1) * high,
                "#{:02x}{:02x}{:02x}".format(*np.rint(WHITE + value * RED).astype(int)),
            )
            for (j, i), value in np.ndenumerate(cells)
        ]
        corners = exploration.surface.probability(_plane(len(exploration.ranges), a, b, edges))
        panel["boundary"] = _boundary(corners.reshape(CELLS + 1, CELLS + 1))
    return panel


def _curve(exploration: Exploration) -> dict[str, Any]:
    """Return the probability over one range with its 95 % interval; runs lie at 1 where they violate, else at 0."""
    (only,) = exploration.ranges
    x, y = Scale(only.low, only.high, LEFT, RIGHT), Scale(0.0, 1.0, BOTTOM, TOP)
    panel = _panel(only, x, [(tick, tick) for tick in (0.0, 0.25, 0.5, 0.75, 1.0)], y, "violation probability")
    panel["dots"] = [
        (x(p.values[0]), y(float(bool(p.violated))), p.violated, _said(exploration, p.values))
        for p in exploration.judged
    ]
    if exploration.surface is not None:
        shares = np.linspace(0.0, 1.0, 101)[:, None]
        low, high = exploration.surface.interval(shares)
        along = [x(only.at(float(share))) for share in shares[:, 0]]

        def points(values: Floats) -> list[str]:
            return [f"{a:.1f},{y(float(value)):.1f}" for a, value in zip(along, values, strict=True)]

        panel["curve"] = " ".join(points(exploration.surface.probability(shares)))
        panel["spread"] = " ".join([*points(high), *reversed(points(low))])
    return panel


def _panel(across: Range, x: Scale, up_ticks: Sequence[tuple[float, float | str]], y: Scale, up: str) -> dict[str, Any]:
    return {
        "title": across.name,
        "across": across.name,
        "up": up,
        "across_ticks": [(x(tick), label) for tick, label in _ticks(across)],
        "up_ticks": [(y(tick), label) for tick, label in up_ticks],
        "cells": (),
        "boundary": "",
        "curve": "",
        "spread": "",
    }


def _boundary(values: Floats) -> str:
    """Return where the probability is `BOUNDARY` as line segments, by marching squares over corner values (N, N)."""
    steps = len(values) - 1
    wide, high = (RIGHT - LEFT) / steps, (BOTTOM - TOP) / steps
    path = []
    for j in range(steps):
        for i in range(steps):
            corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1), (i, j)]
            cut = [
                (x0 + t * (x1 - x0), y0 + t * (y1 - y0))
                for (x0, y0), (x1, y1) in pairwise(corners)
                if (values[y0, x0] < BOUNDARY) != (values[y1, x1] < BOUNDARY)
                for t in [(BOUNDARY - values[y0, x0]) / (values[y1, x1] - values[y0, x0])]
            ]
            for (ax, ay), (bx, by) in zip(cut[::2], cut[1::2], strict=True):
                path.append(
                    f"M{LEFT + ax * wide:.1f} {BOTTOM - ay * high:.1f}L{LEFT + bx * wide:.1f} {BOTTOM - by * high:.1f}"
                )
    return "".join(path)


def _plane(dimensions: int, a: int, b: int, shares: Floats) -> Floats:
    """Return points (N * N, D): rows of `b`, columns of `a`, the other parameters at their middles."""
    columns, rows = np.meshgrid(shares, shares)
    points = np.full((columns.size, dimensions), 0.5)
    points[:, a], points[:, b] = columns.ravel(), rows.ravel()
    return points


def _said(exploration: Exploration, values: Sequence[float]) -> str:
    pairs = zip(exploration.ranges, values, strict=True)
    return ", ".join(f"{varied.name} {varied.word(value) or f'{value:.3g}'}" for varied, value in pairs)


def _ticks(of: Range) -> list[tuple[float, float | str]]:
    """Return the values of a range at which its axis is labelled, and the labels."""
    if of.words:
        return [(k + 0.5, word) for k, word in enumerate(of.words)]
    return [(tick, tick) for tick in ticks(of.low, of.high)]


EXPLORATION_FORMATS = (".html", ".svg", ".json")


def check_exploration_file(path: Path) -> None:
    """Refuse a file that cannot be written, or whose ending is none that an exploration is written as."""
    if path.suffix.lower() not in EXPLORATION_FORMATS:
        listed = ", ".join(EXPLORATION_FORMATS)
        raise InputError(f"{path}: an exploration is written as {listed}. Give --out one of these endings.")
    check_writable(path)


def write_exploration(path: str | Path, exploration: Exploration) -> None:
    """Write an exploration as a page (.html), as its picture (.svg) or as the numbers (.json)."""
    path = Path(path)
    check_exploration_file(path)
    kind = path.suffix.lower()
    if kind == ".json":
        write_whole(path, exploration.to_json())
    else:
        write_whole(path, response_page(exploration) if kind == ".html" else response_svg(exploration, alone=True))
