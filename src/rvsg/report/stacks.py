"""A comparison of navigation stacks as Markdown, as a figure and as a page."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from itertools import count

from markupsafe import Markup

import rvsg
from rvsg.campaign.suite import StackPair, StackScore, StackScores
from rvsg.evaluation.wording import counted
from rvsg.report.charts import COLOURS, Scale
from rvsg.report.floors import area_colours
from rvsg.report.frames import Turn
from rvsg.report.names import narrow_names
from rvsg.report.page import environment
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.world import World

LABEL_W, BAR_W, ROW_H = 230, 420, 30
HEAD = ("rank", "stack", "version", "violated", "share (95 % interval)", "contact", "arrived", "stack failed")


def percent(share: float) -> str:
    """Return a share in per cent."""
    return f"{100.0 * share:.0f} %"


def rows_of(found: StackScores) -> list[tuple[str, ...]]:
    """Return the table of the ranking."""
    return [
        (
            str(rank), score.label, score.version, f"{score.violated} of {score.judged}",
            f"{percent(score.share)} ({percent(score.interval[0])} to {percent(score.interval[1])})",
            str(score.contacts), f"{score.arrived} of {len(score.runs)}", str(score.failed),
        )
        for rank, score in zip(count(1), found.scores)
    ]  # fmt: skip


def pair_sentence(pair: StackPair) -> str:
    """Return the difference of two stacks as a sentence."""
    if pair.difference is None:
        return f"{pair.first} and {pair.second} have no judged run in common."
    low, high = pair.difference.interval
    points = f"{100 * pair.difference.difference:+.0f} points ({100 * low:+.0f} to {100 * high:+.0f})"
    clear = "the interval excludes 0" if pair.difference.is_clear else "the interval includes 0"
    return f"{pair.first} against {pair.second}: {points}; {clear}."


def _title(found: StackScores) -> str:
    return f"{counted(len(found.scores), 'navigation stack')} on {counted(len(found.cases), 'scenario')}"


def stacks_markdown(found: StackScores) -> str:
    """Return the comparison as Markdown."""
    lines = [f"### {_title(found)}, {counted(found.seeds, 'seed')} each", ""]
    lines += [f"| {' | '.join(HEAD)} |", f"|{'---|' * len(HEAD)}"]
    lines += [f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows_of(found)]
    lines += ["", "Differences of the shares on the same scenarios and seeds (paired, 95 % interval):", ""]
    return "\n".join([*lines, *(f"- {pair_sentence(pair)}" for pair in found.pairs)]) + "\n"


def stacks_figure(found: StackScores) -> str:
    """Return an SVG with the share of violating runs of each stack and its interval."""
    width, height = LABEL_W + BAR_W + 60, 40 + ROW_H * len(found.scores)
    x = Scale(0.0, 1.0, LABEL_W, LABEL_W + BAR_W)
    parts = [
        f'<svg class="figure" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'font-family="sans-serif" font-size="12" role="img" aria-label="Share of violating runs of each stack">'
        f'<rect width="{width}" height="{height}" fill="white"/>'
    ]
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        parts.append(f'<line x1="{x(tick):.1f}" x2="{x(tick):.1f}" y1="8" y2="{height - 24}" stroke="#ddd"/>')
        parts.append(f'<text x="{x(tick):.1f}" y="{height - 8}" text-anchor="middle">{percent(tick)}</text>')
    for k, score in enumerate(found.scores):
        y, colour = 8 + ROW_H * (k + 0.5), COLOURS[k % len(COLOURS)]
        low, high = score.interval
        parts.append(f'<text x="{LABEL_W - 8}" y="{y + 4:.1f}" text-anchor="end">{html.escape(_short(score))}</text>')
        parts.append(
            f'<line x1="{x(low):.1f}" x2="{x(high):.1f}" y1="{y}" y2="{y}" stroke="{colour}" stroke-width="3"/>'
        )
        parts.append(f'<circle cx="{x(score.share):.1f}" cy="{y}" r="6" fill="{colour}"/>')
    return "".join([*parts, "</svg>\n"])


def _short(score: StackScore) -> str:
    return score.label if len(score.label) <= 34 else f"...{score.label[-31:]}"


def stacks_page(found: StackScores, worlds: Mapping[str, World]) -> str:
    """Return the comparison as a page.

    Args:
        worlds: the world of each case; each is drawn once, with the places where the stacks violate.
    """
    cells = [{"case": case, "shares": [_cell(*score.of_case(case)) for score in found.scores]} for case in found.cases]
    pairs = [pair_sentence(pair) for pair in found.pairs]
    drawn = {world.id: world for world in worlds.values()}
    maps = [
        _map(world, found.scores, {case for case, each in worlds.items() if each.id == key})
        for key, world in drawn.items()
    ]
    return environment().get_template("stacks.html").render(
        found=found, title=_title(found), head=HEAD, rows=rows_of(found), figure=Markup(stacks_figure(found)),  # noqa: S704 - made by us
        cells=cells, labels=[_short(score) for score in found.scores], pairs=pairs, maps=maps,
        version=rvsg.__version__,
    )  # fmt: skip


def _cell(violated: int, judged: int) -> dict[str, str]:
    share = violated / judged if judged else 0.0
    return {"text": f"{violated} of {judged}" if judged else "-", "alpha": f"{0.75 * share:.2f}"}


def _map(world: World, scores: Sequence[StackScore], cases: set[str]) -> dict[str, object]:
    """Draw the floor plan with a dot for each violating run, in the colour of its stack."""
    plan = floor_plan(world, tooltips=False)
    turn = Turn.of(plan.matrix)
    dots = []
    for k, score in enumerate(scores):
        for run in score.runs:
            if run.at is not None and run.case in cases:
                x, y = turn.point(*run.at)
                dots.append({"x": f"{x:.2f}", "y": f"{y:.2f}", "colour": COLOURS[k % len(COLOURS)]})
    legend = [{"label": _short(score), "colour": COLOURS[k % len(COLOURS)]} for k, score in enumerate(scores)]
    return {
        "title": world.title,
        "box": plan.view_box,
        "look": Markup(area_colours(world, plan)),  # noqa: S704
        "floor": Markup(plan.shapes),  # noqa: S704 - made by us, its names escaped
        "names": Markup(narrow_names(plan)),  # noqa: S704
        "dots": dots,
        "legend": legend,
    }
