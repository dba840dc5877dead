"""The report of a campaign as one HTML page that works offline: no network, no third-party script.

All text that comes from a person, a model or a file is escaped. The replay's data stands in the page as JSON without
any `<`. The page is a function of the records: equal campaigns give equal pages.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape

import rvsg
from rvsg.campaign.attempt import Attempt, Plan
from rvsg.campaign.feedback import failure_map, separable
from rvsg.campaign.findings import distinct_failures, findings
from rvsg.campaign.observation import met
from rvsg.campaign.ranking import rule
from rvsg.core.files import write_whole
from rvsg.evaluation.verdict import Verdict
from rvsg.evaluation.wording import counted, how_sure, number, why_ended
from rvsg.generation.vlm.recording import Recording
from rvsg.report.answer import answer, headline
from rvsg.report.broken import broken
from rvsg.report.charts import confirmation_chart, search_chart
from rvsg.report.colours import distinct_colours
from rvsg.report.conversation import Conversations
from rvsg.report.facts import facts_of
from rvsg.report.floors import area_colours
from rvsg.report.happened import what_happens
from rvsg.report.names import narrow_names
from rvsg.report.replay import component, replay_data
from rvsg.report.robot import robot_words
from rvsg.report.shown import Shown, look_of
from rvsg.report.summary import Summary, summarise, tried_of
from rvsg.report.tables import finding_rows, people_rows, run_rows
from rvsg.report.thinking import thinking
from rvsg.report.under_test import under_test
from rvsg.report.words import direction, quantity, unbroken
from rvsg.simulation.run import Run
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.world import World

__all__ = ["environment", "headline", "render_page", "write_page"]

SHOWN_TASKS = 4
ALIKE = 0.01
"""Means that differ by less than this share of their size are told as alike."""


def write_page(path: Path, plan: Plan, attempts: Sequence[Attempt], **how: Any) -> None:
    """Write the page to a file, whole or not at all; `how` as for `render_page`."""
    write_whole(path, render_page(plan, attempts, **how))


def render_page(
    plan: Plan,
    attempts: Sequence[Attempt],
    *,
    world: World,
    run_of: Callable[[str], Run],
    command: str,
    simulator: str = "",
    overview: str = "",
    traces: Sequence[Mapping[str, Any]] = (),
    recording: Recording | None = None,
    replayed: bool = False,
) -> str:
    """Return the page of a campaign, finished or not.

    Args:
        run_of: Finds a run by its id.
        command: The command that repeats the campaign.
        overview: The address of the overview this campaign belongs to, seen from the page.
        traces: Traces of runs of the campaign, as `trace_view` makes them; the replay shows them.
        recording: The calls of a model, where they are kept.
        replayed: Whether the model answered earlier, in another campaign.
    """
    run_of = cache(run_of)  # facts, findings and the table of encounters ask for the same runs
    shown = Shown(
        plan=plan,
        world=world,
        attempts=attempts,
        summary=summarise(plan, attempts),
        facts=facts_of(attempts, plan.requirement, world, run_of),
        findings=findings(plan, attempts, run_of=run_of, world=world),
        floor=floor_plan(world, tooltips=False),
    )
    requirement, subject = plan.requirement, shown.subject
    stack = under_test(run.run for facts in shown.facts for run in facts.runs)
    final = shown.summary.confirmed.verdict if shown.summary.confirmed is not None else None
    return (
        environment()
        .get_template("page.html")
        .render(
            version=rvsg.__version__,
            plan=plan,
            robot=robot_words(plan.mission),
            place=f"{world.title}, {plan.mission.route.name}",
            requirement=requirement,
            quantity=quantity(requirement),
            direction=direction(requirement),
            limit=number(requirement.threshold, requirement.unit) if requirement.threshold is not None else "",
            summary=shown.summary,
            answer=answer(plan, shown.summary, shown.confirmed, shown.searched, shown.cause, shown.others),
            happened=what_happens(shown, subject) if subject else None,
            people=people_rows(subject) if subject else [],
            shown_tasks=SHOWN_TASKS,
            doors=plan.mission.doors,
            sure=how_sure(final) if final is not None else "",
            ended=why_ended(final) if final is not None else "",
            curse=_curse(plan, shown.summary, shown.candidate.verdict if shown.candidate else None),
            confirmation_svg=_confirmation_svg(shown),
            rows=finding_rows(shown),
            failures=distinct_failures(shown.findings),
            broken=broken(failure_map(attempts, requirement, run_of=run_of, world=world)),
            rule=rule(requirement),
            search_svg=Markup(search_chart(plan, attempts)),  # noqa: S704 - made by us, its words escaped
            replayed=replayed,
            thoughts=_thoughts(shown, Conversations(recording)),
            runs=run_rows(shown),
            box=shown.floor.view_box,
            floor=Markup(shown.floor.shapes),  # noqa: S704
            names=Markup(narrow_names(shown.floor)),  # noqa: S704
            look=Markup(area_colours(world, shown.floor)),  # noqa: S704
            replay=script_safe(replay_data(shown)) if subject else None,
            component=Markup(component()),  # noqa: S704
            command=escape(command),
            simulator=simulator,
            stack=stack,
            overview=overview,
            traces=[script_safe(trace) for trace in traces],
        )
    )


@cache
def environment() -> jinja2.Environment:
    """Return the renderer of the pages.

    It escapes everything, an unknown name is an error, and no line breaks between a number and its unit.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rvsg.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: unbroken(value) if type(value) is str else value,
    )
    environment.filters["number"] = number
    environment.filters["met"] = met
    environment.globals["tried_of"] = tried_of
    return environment


def _curse(plan: Plan, summary: Summary, selected: Verdict | None) -> str:
    """Return how the confirmation mean compares with the mean in the search by which the scenario was selected."""
    fresh = summary.confirmed.verdict if summary.confirmed else None
    if selected is None or selected.mean is None or fresh is None or fresh.mean is None:
        return ""
    unit, count = plan.requirement.unit, summary.accounting.search_attempts
    mean = "mean up to the time limit" if selected.censored or fresh.censored else "mean"
    lost = plan.requirement.badness(selected.mean) - plan.requirement.badness(fresh.mean)
    said = (
        f"One of {count} configurations of the search: {counted(len(selected.objectives), 'run')} with a {mean} of "
        f"{number(selected.mean, unit)}. "
        f"{counted(len(fresh.objectives), 'confirmation run')} with new seeds have a {mean} of "
        f"{number(fresh.mean, unit)}. "
    )
    if abs(lost) < ALIKE * abs(selected.mean):
        alike = f"The two differ by less than {100 * ALIKE:g} %"
        return f"{said}{alike}, so nothing here suggests that the selection was luck."
    if lost <= 0:
        return said + "The confirmation is no less severe, so nothing here suggests that the selection was luck."
    if separable(selected, fresh):
        return (
            f"{said}The confirmation mean is {number(lost, unit)} less severe, more than chance explains (Welch's t "
            "test at 5 %): extreme values tend to fall back when they are measured again."
        )
    return (
        f"{said}The confirmation mean is {number(lost, unit)} less severe. Selection bias or chance can explain the "
        "difference."
    )


def _confirmation_svg(shown: Shown) -> Markup:
    selected, confirmed = shown.candidate, shown.summary.confirmed
    if selected is None or confirmed is None or confirmed.verdict is None or not confirmed.verdict.objectives:
        return Markup("")
    return Markup(confirmation_chart(shown.plan, selected, confirmed))  # noqa: S704 - made by us, its words escaped


def _thoughts(shown: Shown, conversations: Conversations) -> list[dict[str, Any]]:
    subject = shown.subject
    if subject is None:
        return []
    count = max(len(a.proposal.scenario.people.humans) for a in shown.attempts if a.proposal.scenario)
    look = look_of(shown, subject)
    found = thinking(shown.plan, shown.attempts, shown.world, look, distinct_colours(count), conversations)
    for entry in found:
        for configuration in entry["configurations"]:
            configuration["map"] = Markup(configuration["map"])  # noqa: S704 - made by us
    return found


def script_safe(value: Any) -> Markup:
    """Return JSON that can stand in a script element: nothing in it can end the element."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))  # noqa: S704
