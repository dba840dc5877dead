"""The answer of a campaign for a terminal: at most 23 lines, and 12 for each campaign of a matrix."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from rvsg.cli.console import as_started, console, say
from rvsg.evaluation.verdict import counted, number
from rvsg.report.answer_row import AnswerRow, Tone
from rvsg.report.result import CampaignAnswer, Result
from rvsg.report.terminal import describe_finding
from rvsg.runs.attempt import Plan
from rvsg.world.world import OCCUPIED, UNKNOWN, Route, World

if TYPE_CHECKING:
    from rvsg.findings.ranking import Front

STYLES: dict[Tone, str] = {"bad": "bold red", "warn": "yellow", "good": "green", "quiet": "dim"}
MOST_ROWS = 6
"""Configurations in the table of one campaign, where there is room; the others are in the report."""
MOST_LINES = 23
WIDE = 100
"""Characters of a terminal with room for the causes."""
COLUMNS: dict[str, Callable[[AnswerRow], str]] = {
    "#": lambda row: row.number,
    "verdict": lambda row: row.status,
    "violated": lambda row: row.share,
    "contact": lambda row: row.contact,
    "cause": lambda row: row.cause,
}
MAP_LINES = 12
BRAILLE = np.array([[1, 8], [2, 16], [4, 32], [64, 128]])
"""The bits of the dots of a character of braille, from the top left."""
LABEL = 10
"""Characters of the labels on the left."""


def map_text(world: World, route: Route, width: int) -> str:
    """Return the map of a world in braille with `S` at the start and `G` at the goal of a route, 12 lines at most.

    The picture shows the part of the map that is known, at most `width` characters wide.
    """
    cells = np.argwhere(world.occupancy.cells != UNKNOWN)
    low, high = cells.min(axis=0), cells.max(axis=0) + 1
    size = max(1.0, *((high - low) / (4 * MAP_LINES, 2 * width)))
    lines, columns = np.ceil((high - low) / size / (4, 2)).astype(int)
    dots = np.zeros((4 * lines, 2 * columns), dtype=int)
    dots[tuple(((np.argwhere(world.occupancy.cells == OCCUPIED) - low) / size).astype(int).T)] = 1
    blocks = dots[::-1].reshape(lines, 4, columns, 2)
    shown = [[chr(0x2800 + code) for code in line] for line in np.einsum("lycx,yx->lc", blocks, BRAILLE)]
    origin, offset = world.occupancy.origin, world.map_offset
    for letter, pose in (("S", route.start), ("G", route.goal)):
        at = np.array([pose.y - offset[1] - origin.y, pose.x - offset[0] - origin.x]) / world.occupancy.resolution - low
        row, column = (at / size / (4, 2)).astype(int)
        if 0 <= row < lines and 0 <= column < columns:
            shown[int(lines - 1 - row)][column] = letter
    return "\n".join("".join(line).rstrip("\u2800") for line in shown)


def show_answer(answer: CampaignAnswer, *, page: str, again: str) -> None:
    """Print the answer of a campaign in at most 23 lines, as many configurations as there is room for.

    Args:
        page: The path of the report.
        again: The command that repeats the campaign.
    """
    head = Text.assemble(
        (answer.status, STYLES[answer.tone]), "  ", answer.title, "  ", ("  ".join(answer.setup), "dim")
    )
    above = [*head.wrap(console(), console().width), *_lines("", answer.headline)]
    if answer.changes:
        above += _lines("!", answer.changes, "warn")
    if answer.alone is not None:
        above += _lines("alone", answer.alone.warning or answer.alone.text, "warn" if answer.alone.warning else None)
    if answer.rows:
        above += _facts(answer)
    if answer.elsewhere is not None:
        above += _lines("!", answer.elsewhere.text, "warn")
    below = [*_lines("open", page), *(_command("next", step.command) for step in answer.next[:1])]
    below.append(_command("again", again))
    room = MOST_LINES - len(above) - len(_rest(answer, MOST_ROWS)) - len(below) - 1
    rows = answer.shown[: max(0, min(MOST_ROWS, room))]
    for line in above:
        say(line, soft_wrap=True)
    if rows:
        say(rows_table(rows, console().width))
    for line in (*_rest(answer, len(rows)), *below):
        say(line, soft_wrap=True)


def _rest(answer: CampaignAnswer, rows: int) -> list[Text]:
    """Return how many configurations the table leaves out."""
    more = len(answer.shown) - rows
    left = [f"{counted(more, 'more configuration')} in the report."] if more > 0 else []
    text = " ".join([*left, answer.rest]).strip()
    return _lines("", text) if text else []


def _facts(answer: CampaignAnswer) -> list[Text]:
    """Return the figures of the most severe configuration."""
    often, measured, closest, cause = answer.figures
    limit = f", {measured.note}" if measured.note else ""
    row = answer.rows[0]
    where = f"{row.place}, {row.moment_s:.1f} s" if row.place else f"{row.moment_s:.1f} s"
    touch = f"{closest.note.removeprefix('contact ')}, closest {closest.value}"
    return [
        *_lines("often", f"{often.value} runs violate, {often.note}   {measured.value}{limit}"),
        *_lines("where", f"{where}   who  {row.who or 'nobody'}   cause  {cause.value} ({cause.note})"),
        *_lines("contact", touch, "bad" if row.contacts else None),
    ]


def _command(label: str, command: str) -> Text:
    return Text(f"  {label:{LABEL}}{as_started(command)}")


def _lines(label: str, text: str, tone: Tone | None = None) -> list[Text]:
    """Return a labelled text, its further lines under its first; paths and commands are not broken."""
    width = max(40, console().width)
    lines = textwrap.wrap(text, width - LABEL - 2, break_long_words=False, break_on_hyphens=False) or [""]
    style = STYLES[tone] if tone else ""
    return [Text(f"  {label if k == 0 else '':{LABEL}}{line}", style=style) for k, line in enumerate(lines)]


def rows_table(rows: Sequence[AnswerRow], width: int) -> Table:
    """Return the table of configurations, the most severe first, a line each."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    wide = width >= WIDE
    longest = {column: max([len(column), *(len(getter(row)) for row in rows)]) for column, getter in COLUMNS.items()}
    longest["cause"] = min(longest["cause"], 18) if wide else -2
    room = width - sum(longest.values()) - 2 * len(longest)
    table.add_column("#", no_wrap=True, min_width=longest["#"])
    table.add_column("what happens", no_wrap=True, overflow="ellipsis", max_width=max(20, room - 2))
    for name in ("verdict", "violated", "contact"):
        table.add_column(name, no_wrap=True, min_width=longest[name])
    if wide:
        table.add_column("cause", no_wrap=True, overflow="ellipsis", max_width=longest["cause"])
    for row in rows:
        contact = Text(row.contact, style=STYLES["bad"] if row.contacts else "")
        verdict, cause = Text(row.status, style=STYLES[row.tone]), [row.cause] if wide else []
        table.add_row(row.number, row.name, verdict, row.share, contact, *cause)
    return table


def matrix_table(answers: Sequence[tuple[Plan, CampaignAnswer]]) -> Table:
    """Return the table of several campaigns, with the most severe configuration of each."""
    table, rows, elsewhere = Table(box=SIMPLE_HEAD, pad_edge=False, caption_justify="left"), [], False
    for plan, answer in answers:
        name, verdict = f"{plan.mission.route.name} {plan.requirement.name}", Text(answer.status, STYLES[answer.tone])
        row = answer.rows[0] if answer.rows else None
        what = f"\n{row.name}" if row is not None and row.counts else ""
        mark = "‡" if answer.elsewhere is not None else ""
        elsewhere = elsewhere or bool(mark)
        touch = Text(
            f"{row.contact if row else ''}{mark}", "bold red" if row and row.contacts else "yellow" * bool(mark)
        )
        numbers = (row.share, row.measured) if row is not None else ("", "")
        rows.append((Text.assemble(name, (what, "dim")), verdict, *numbers, touch))
    table.add_column("campaign", overflow="fold")
    for place, name in enumerate(("verdict", "violated", "measured", "contact"), 1):
        table.add_column(name, no_wrap=True, min_width=max(len(cell) for cell in (name, *(row[place] for row in rows))))
    for cells in rows:
        table.add_row(*cells)
    table.caption = "‡ contact in other configurations of the campaign" if elsewhere else None
    return table


def how_far(result: Result) -> str:
    """Return how far an unfinished campaign came."""
    plan, done = result.plan, result.accounting.search_attempts
    if done >= plan.attempts:
        return f"all {counted(done, 'attempt')} of the search, the confirmation is not finished"
    return f"{done} of {counted(plan.attempts, 'attempt')} of the search"


def show_findings(result: Result) -> None:
    """Print every finding in full, and the front of a strategy that has one."""
    for finding in result.findings:
        for line in describe_finding(finding, result.requirement):
            say(line)
    if (front := result.front) is not None:
        show_front(front)


def show_front(front: Front) -> None:
    """Print the configurations that no other one beats on every requirement."""
    title = (
        f"{counted(len(front.points), 'configuration')} on the Pareto front, hypervolume {number(front.hypervolume)}"
    )
    table = Table(title=title, title_justify="left", caption="Mean, and how many runs violate", caption_justify="left")
    table.add_column("attempt", justify="right")
    for tried in front.points[0].tried if front.points else ():
        table.add_column(tried.requirement, justify="right")
    for point in front.points:
        cells = [f"{number(trial.mean)} ({trial.violations} of {trial.runs})" for trial in point.tried]
        table.add_row(str(point.attempt), *cells)
    say(table)
