"""Two versions compared as a page: what changed, and for each change both runs of one seed on one clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

import rvsg
from rvsg.campaign.suite import CaseChange, Change, SuiteResult, counts
from rvsg.report.facts import RunFacts
from rvsg.report.floors import floor_svg
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


@dataclass(frozen=True, kw_only=True)
class ShownPair:
    """The two runs of one seed that show a change."""

    change: CaseChange
    seed: int
    scenario: Scenario
    """As the first version ran it."""
    requirement: Requirement
    world: World
    runs: tuple[RunFacts, RunFacts]


def versions_page(
    first: SuiteResult, second: SuiteResult, changes: Sequence[CaseChange], pairs: Sequence[ShownPair]
) -> str:
    """Return the comparison as an HTML page that loads nothing.

    Args:
        pairs: the runs to replay; both runs of a pair are drawn over one floor plan and move on one clock.
    """
    found = counts(changes)
    shown = [
        {
            "pair": pair,
            "data": script_safe(pair_replay(pair, (first.version, second.version))),
            "ids": script_safe([run.run.id for run in pair.runs]),
            "stories": list(zip((first.version, second.version), [_story(run) for run in pair.runs], strict=True)),
        }
        for pair in pairs
    ]
    return (
        environment()
        .get_template("versions.html")
        .render(
            first=first,
            second=second,
            listed=", ".join(f"{found[change]} {change.value}" for change in Change if found[change]),
            rows=change_rows(changes),
            shown=shown,
            replay_styles=Markup(styles()),  # noqa: S704  (our own files)
            component=Markup(component()),  # noqa: S704  (our own files)
            version=rvsg.__version__,
        )
    )


def change_rows(changes: Sequence[CaseChange]) -> list[dict[str, str]]:
    """Return the rows of a table of changes as text, what broke first; `tone` is good, bad or empty."""
    return [_row(each) for each in sorted(changes, key=lambda each: ORDER.index(each.change))]


def _row(each: CaseChange) -> dict[str, str]:
    tone = {Change.BROKEN: "bad", Change.FIXED: "good"}.get(each.change, "")
    values = {"case": each.case, "title": each.title, "requirement": each.requirement}
    values |= {"change": each.change.value, "tone": tone}
    if each.difference is None or each.interval is None or each.p_corrected is None:
        return values | {"before": "", "now": "", "difference": "", "p": ""}
    low, high = each.interval
    return values | {
        "before": f"{each.violations[0]} of {each.seeds}",
        "now": f"{each.violations[1]} of {each.seeds}",
        "difference": f"{100 * each.difference:+.0f} points ({100 * low:+.0f} to {100 * high:+.0f})",
        "p": f"{each.p_corrected:.3g}",
    }


def _story(run: RunFacts) -> list[str]:
    return [sentence.text for sentence in run.story]


def pair_replay(pair: ShownPair, versions: tuple[str, str]) -> dict[str, object]:
    """Return both runs of a pair as data of the replay component: over one floor plan and on one clock."""
    group = ReplayGroup(
        id="pair",
        label=f"seed {pair.seed}, {versions[0]} and {versions[1]}",
        purpose="versions",
        manners={human.name: manner(human) for human in pair.scenario.people.humans},
        runs=tuple(_run(run, version) for run, version in zip(pair.runs, versions, strict=True)),
    )
    mission, world = pair.scenario.mission, pair.world
    replay = replay_payload(
        [group],
        mission=mission,
        requirement=pair.requirement,
        waypoints=[(w.name, w.x, w.y) for w in world.grid.waypoints if w.human],
        matrix=floor_plan(world, tooltips=False).matrix,
        quantity=f"{quantity(pair.requirement)} so far",
        footprint=lambda run: footprint_of(run, mission.robot_record),
        doors=world.moving_doors,
    )
    return replay | {"floor": floor_svg(world)}


def _run(facts: RunFacts, version: str) -> ReplayRun:
    return ReplayRun(
        run=facts.run,
        objective=facts.measurement.objective,
        violated=facts.violated,
        curve=facts.curve,
        opens_s=0.0,
        note=version,
        lanes=facts.lanes,
        moments=[(sentence.time_s, untimed(sentence)) for sentence in facts.story],
    )
