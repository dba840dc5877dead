"""Comparisons of variants as a page, a figure and Markdown: what changed, who violates least, and where."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

from markupsafe import Markup

import rvsg
from rvsg.campaign.comparison import CaseChange, Change, Comparison, VariantPair, counts
from rvsg.evaluation.wording import counted
from rvsg.report.charts import COLOURS, Scale
from rvsg.report.facts import RunFacts
from rvsg.report.floors import area_colours, floor_svg
from rvsg.report.frames import Turn
from rvsg.report.names import narrow_names
from rvsg.report.page import environment, script_safe
from rvsg.report.payload import ReplayGroup, ReplayRun, replay_payload
from rvsg.report.replay import component, styles
from rvsg.report.robots import footprint_of
from rvsg.report.tables import manner
from rvsg.report.words import quantity, untimed
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.world import World

ORDER = (Change.BROKEN, Change.FIXED, Change.UNCLEAR, Change.MISSING, Change.UNCHANGED)
RANKING = ("rank", "stack", "version", "violated", "share (95 % interval)", "contact", "arrived", "stack failed")
CHANGES = ("case", "requirement", "change", "violated before", "violated now", "difference (95 % interval)", "p (Holm)")
LABEL_W, BAR_W, ROW_H = 230, 420, 30


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
    found: Comparison, *, worlds: Mapping[str, World] | None = None, replayed: Sequence[ReplayedChange] = ()
) -> str:
    """Return a comparison as an HTML page that loads nothing.

    Args:
        worlds: the world of each case; each is drawn once, with the places where the variants violate.
        replayed: changes to replay; both runs are drawn over one floor plan and move on one clock.
    """
    names = tuple(variant.version for variant in found.variants[:2])
    shown = [
        {
            "change": each.change,
            "seed": each.seed,
            "data": script_safe(change_replay(each, names)),
            "ids": script_safe([run.run.id for run in each.runs]),
            "stories": list(zip(names, [[said.text for said in run.story] for run in each.runs], strict=True)),
        }
        for each in replayed
    ]
    by_world = {world.id: world for world in (worlds or {}).values()}
    maps = [
        _map(world, found, {case for case, each in (worlds or {}).items() if each.id == key})
        for key, world in by_world.items()
    ]
    two = len(found.variants) == 2
    return (
        environment()
        .get_template("comparison.html")
        .render(
            title=f"{names[1]} against {names[0]}" if two else _title(found),
            found=found,
            names=names,
            summary=_counted(found.changes) if two else "",
            ranking=RANKING,
            rows=ranking_rows(found),
            figure=Markup(shares_figure(found)),  # noqa: S704  (made here)
            labels=[_short(variant.version) for variant in found.variants],
            cells=_cells(found),
            sentences=[pair_sentence(pair) for pair in found.pairs],
            changes=change_rows(found.changes) if two else [],
            maps=maps,
            shown=shown,
            replay_styles=Markup(styles()),  # noqa: S704  (our own files)
            component=Markup(component()),  # noqa: S704  (our own files)
            version=rvsg.__version__,
        )
    )


def ranking_markdown(found: Comparison) -> str:
    """Return the variants as a Markdown table, and the difference of each two."""
    seeds = max((len(case.seeds) for variant in found.variants for case in variant.cases), default=0)
    lines = [
        f"### {_title(found)}, {counted(seeds, 'seed')} each",
        "",
        *_table(RANKING, [[_plain(cell) for cell in row] for row in ranking_rows(found)]),
    ]
    lines += ["", "Differences of the shares on the same scenarios and seeds (paired, 95 % interval):", ""]
    return "\n".join([*lines, *(f"- {pair_sentence(pair)}" for pair in found.pairs)]) + "\n"


def changes_markdown(found: Comparison) -> str:
    """Return what changed between two variants as Markdown for a pull request, what broke first."""
    first, second = (_plain(variant.version) for variant in found.variants[:2])
    rows = []
    for row in change_rows(found.changes):
        change = f"**{row['change']}**" if row["p"] else row["change"]
        name = f"{_plain(row['title'])} (`{row['case']}`)"
        rows.append((name, _plain(row["requirement"]), change, *(row[k] for k in ("before", "now", "difference", "p"))))
    head = f"### {second} against {first}: {_counted(found.changes) or 'no case in common'}"
    return "\n".join([head, "", *_table(CHANGES, rows)]) + "\n"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    return lines + [f"| {' | '.join(row)} |" for row in rows]


def _plain(text: str) -> str:
    """Return the text of a file so that it fits into a table of Markdown."""
    return " ".join(text.split()).replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;").replace("`", "'")


def _title(found: Comparison) -> str:
    cases = {case for case, _ in found.cases}
    return f"{counted(len(found.variants), 'navigation stack')} on {counted(len(cases), 'scenario')}"


def _counted(changes: Sequence[CaseChange]) -> str:
    found = counts(changes)
    return ", ".join(f"{found[change]} {change.value}" for change in Change if found[change])


def ranking_rows(found: Comparison) -> list[tuple[str, ...]]:
    """Return the table of the variants."""
    return [
        (
            str(rank), variant.version, variant.stack_version, f"{variant.violated} of {variant.judged}",
            f"{percent(variant.share)} ({percent(variant.interval[0])} to {percent(variant.interval[1])})",
            str(variant.contacts), f"{variant.arrived} of {variant.runs}", str(variant.failed),
        )
        for rank, variant in zip(count(1), found.variants)
    ]  # fmt: skip


def percent(share: float) -> str:
    """Return a share in per cent."""
    return f"{100.0 * share:.0f} %"


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


def change_rows(changes: Sequence[CaseChange]) -> list[dict[str, str]]:
    """Return the rows of a table of changes as text, what broke first; `tone` is good, bad or empty."""
    return [_change_row(each) for each in sorted(changes, key=lambda each: ORDER.index(each.change))]


def _change_row(each: CaseChange) -> dict[str, str]:
    tone = {Change.BROKEN: "bad", Change.FIXED: "good"}.get(each.change, "")
    values = {"case": each.case, "title": each.title, "requirement": each.requirement}
    values |= {"change": each.change.value, "tone": tone}
    if each.difference is None or each.interval is None or each.p_corrected is None:
        return values | {"before": "", "now": "", "difference": "", "p": ""}
    return values | {
        "before": f"{each.violations[0]} of {each.seeds}",
        "now": f"{each.violations[1]} of {each.seeds}",
        "difference": _points(each.difference, each.interval),
        "p": f"{each.p_corrected:.3g}",
    }


def _cells(found: Comparison) -> list[dict[str, Any]]:
    """Return for each case how many runs of each variant violate."""
    flags = [{case.key: list(case.flags.values()) for case in variant.cases} for variant in found.variants]
    rows = []
    for case, requirement in found.cases:
        counted_runs = [(sum(known), len(known)) for each in flags for known in [each.get((case, requirement), [])]]
        shares = [
            {"text": f"{bad} of {judged}" if judged else "-", "alpha": f"{0.75 * bad / max(1, judged):.2f}"}
            for bad, judged in counted_runs
        ]
        rows.append({"case": f"{case}, {requirement}", "shares": shares})
    return rows


def shares_figure(found: Comparison) -> str:
    """Return an SVG with the share of violating runs of each variant and its interval."""
    width, height = LABEL_W + BAR_W + 60, 40 + ROW_H * len(found.variants)
    x = Scale(0.0, 1.0, LABEL_W, LABEL_W + BAR_W)
    parts = [
        f'<svg class="figure" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'font-family="sans-serif" font-size="12" role="img" aria-label="Share of violating runs of each stack">'
        f'<rect width="{width}" height="{height}" fill="white"/>'
    ]
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        parts.append(f'<line x1="{x(tick):.1f}" x2="{x(tick):.1f}" y1="8" y2="{height - 24}" stroke="#ddd"/>')
        parts.append(f'<text x="{x(tick):.1f}" y="{height - 8}" text-anchor="middle">{percent(tick)}</text>')
    for k, variant in enumerate(found.variants):
        y, colour = 8 + ROW_H * (k + 0.5), COLOURS[k % len(COLOURS)]
        low, high = variant.interval
        label = html.escape(_short(variant.version))
        parts.append(f'<text x="{LABEL_W - 8}" y="{y + 4:.1f}" text-anchor="end">{label}</text>')
        parts.append(
            f'<line x1="{x(low):.1f}" x2="{x(high):.1f}" y1="{y}" y2="{y}" stroke="{colour}" stroke-width="3"/>'
        )
        parts.append(f'<circle cx="{x(variant.share):.1f}" cy="{y}" r="6" fill="{colour}"/>')
    return "".join([*parts, "</svg>\n"])


def _short(label: str) -> str:
    return label if len(label) <= 34 else f"...{label[-31:]}"


def _map(world: World, found: Comparison, cases: set[str]) -> dict[str, object]:
    """Draw the floor plan with a dot for each violating run, in the colour of its variant."""
    plan = floor_plan(world, tooltips=False)
    turn = Turn.of(plan.matrix)
    dots = []
    for k, variant in enumerate(found.variants):
        for place in (place for case in variant.cases if case.case in cases for place in case.places):
            x, y = turn.point(*place)
            dots.append({"x": f"{x:.2f}", "y": f"{y:.2f}", "colour": COLOURS[k % len(COLOURS)]})
    legend = [
        {"label": _short(each.version), "colour": COLOURS[k % len(COLOURS)]} for k, each in enumerate(found.variants)
    ]
    return {
        "title": world.title,
        "box": plan.view_box,
        "look": Markup(area_colours(world, plan)),  # noqa: S704
        "floor": Markup(plan.shapes),  # noqa: S704 - made by us, its names escaped
        "names": Markup(narrow_names(plan)),  # noqa: S704
        "dots": dots,
        "legend": legend,
    }


def change_replay(each: ReplayedChange, names: Sequence[str]) -> dict[str, object]:
    """Return both runs of a change as data of the replay component: over one floor plan and on one clock."""
    group = ReplayGroup(
        id="pair",
        label=f"seed {each.seed}, {names[0]} and {names[1]}",
        purpose="versions",
        manners={human.name: manner(human) for human in each.scenario.people.humans},
        runs=tuple(_replay_run(run, name) for run, name in zip(each.runs, names, strict=True)),
    )
    mission, world = each.scenario.mission, each.world
    replay = replay_payload(
        [group],
        mission=mission,
        requirement=each.requirement,
        waypoints=[(w.name, w.x, w.y) for w in world.grid.waypoints if w.human],
        matrix=floor_plan(world, tooltips=False).matrix,
        quantity=f"{quantity(each.requirement)} so far",
        footprint=lambda run: footprint_of(run, mission.robot_record),
        doors=world.moving_doors,
    )
    return replay | {"floor": floor_svg(world)}


def _replay_run(facts: RunFacts, name: str) -> ReplayRun:
    return ReplayRun(
        run=facts.run,
        objective=facts.measurement.objective,
        violated=facts.violated,
        curve=facts.curve,
        opens_s=0.0,
        note=name,
        lanes=facts.lanes,
        moments=[(sentence.time_s, untimed(sentence)) for sentence in facts.story],
    )
