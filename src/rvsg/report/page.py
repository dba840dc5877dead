"""Report pages: that of a campaign, with its replay, and that of stored runs.

A page works offline: no network, no third-party script. All text that comes from a person, a model or a file is
escaped. The replay's data stands in the page as JSON without any `<`. The page is a function of the records: equal
campaigns give equal pages.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup, escape

import rvsg
from rvsg.campaign.attempt import Attempt, Measurement, Plan
from rvsg.campaign.feedback import MapCell, failure_map, separable
from rvsg.campaign.findings import distinct_failures, findings
from rvsg.campaign.observation import met
from rvsg.campaign.ranking import rule
from rvsg.core.files import write_whole
from rvsg.core.records import Record
from rvsg.evaluation.verdict import Verdict, counted, how_sure, number, outcome_in_words, why_ended
from rvsg.generation.generator import Proposal
from rvsg.generation.people_sampler import added
from rvsg.generation.vlm.recording import Recording
from rvsg.report.answer import (
    answer,
    answer_of_runs,
    direction,
    headline,
    quantity,
    robot_words,
    shown_at,
    unbroken,
    under_test,
    untimed,
)
from rvsg.report.charts import confirmation_chart, search_chart
from rvsg.report.page_contents import (
    Conversations,
    Shown,
    finding_rows,
    group_label,
    in_order,
    look_of,
    manner,
    people_rows,
    run_rows,
    run_rows_of,
    thinking,
)
from rvsg.report.replay_data import ReplayGroup, ReplayRun, distinct_colours, replay_payload
from rvsg.report.run_facts import AttemptFacts, RunFacts, facts_of, footprint_of, run_facts
from rvsg.report.stills import area_colours, frame, narrow_names, nearest_in_words, overview
from rvsg.report.summary import Summary, summarise, tried_of
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.simulation.run import Run
from rvsg.world.drawing.svg import FloorPlan, floor_plan
from rvsg.world.world import World


def component() -> str:
    """Return the JavaScript of the replay and its traces; the files in `static` say how to use them."""
    folder = resources.files("rvsg.report") / "static"
    return "\n".join((folder / name).read_text(encoding="utf-8") for name in ("replay.js", "trace.js"))


def styles() -> str:
    """Return the styles of the replay component, with the colours that they use."""
    folder = resources.files("rvsg.report") / "templates"
    return "\n".join((folder / name).read_text(encoding="utf-8") for name in ("plan.css", "replay.css"))


def look() -> str:
    """Return the style sheet of the pages, that of the replay component included."""
    folder = resources.files("rvsg.report") / "templates"
    return "".join((folder / name).read_text(encoding="utf-8") for name in ("plan.css", "look.css", "replay.css"))


def replay_data(shown: Shown) -> dict[str, Any]:
    """Return the data of the replay: the runs of every configuration, the subject of the page first."""
    plan = shown.plan
    return data_of(
        in_order(shown), mission=plan.mission, requirement=plan.requirement, world=shown.world, floor=shown.floor
    )


def data_of(
    shown: Iterable[AttemptFacts], *, mission: Mission, requirement: Requirement, world: World, floor: FloorPlan
) -> dict[str, Any]:
    """Return the data of the replay component for the runs of these configurations, in this order."""
    groups = []
    for facts in shown:
        scenario = facts.attempt.proposal.scenario
        groups.append(
            ReplayGroup(
                id=str(facts.attempt.index),
                label=f"{group_label(facts)[:1].upper()}{group_label(facts)[1:]} ({counted(len(facts.runs), 'run')})",
                purpose=facts.attempt.purpose,
                status=facts.attempt.verdict.status.value if facts.attempt.verdict else "",
                manners={human.name: manner(human) for human in scenario.people.humans} if scenario else {},
                runs=tuple(_replay_run(run) for run in _worst_first(facts, requirement)),
                moved=tuple(thing.footprint for thing in added(mission, scenario.mission)) if scenario else (),
            )
        )
    return replay_payload(
        groups,
        mission=mission,
        requirement=requirement,
        waypoints=[(w.name, w.x, w.y) for w in world.grid.waypoints if w.human],
        matrix=floor.matrix,
        quantity=f"{quantity(requirement)} so far",
        footprint=lambda run: footprint_of(run, mission.robot_record),
        doors=world.moving_doors,
    )


def _worst_first(facts: AttemptFacts, requirement: Requirement) -> list[RunFacts]:
    def key(run: RunFacts) -> float:
        value = run.measurement.objective
        return -requirement.badness(value) if value is not None else float("inf")

    return sorted(facts.runs, key=key)


def _replay_run(run: RunFacts) -> ReplayRun:
    return ReplayRun(
        run=run.run,
        objective=run.measurement.objective,
        violated=run.violated,
        curve=run.curve,
        opens_s=run.decisive_s,
        note=run.note,
        lanes=run.lanes,
        moments=[(sentence.time_s, unbroken(untimed(sentence))) for sentence in run.story],
    )


STILLS = 4
APART_S = 0.8
"""Moments closer together than this look alike."""


def what_happens(shown: Shown, subject: AttemptFacts) -> dict[str, Any] | None:
    """Tell what happens in the run that represents the finding: sentences, an overview and frames."""
    run, which = _shown_run(shown, subject)
    if run is None:
        return None
    look = look_of(shown, subject)
    times = still_times(run)
    label = f"Way of the robot and of the people it meets, seed {run.run.seed}"
    return {
        "run": run,
        "which": which,
        "story": [
            {"t": sentence.time_s, "text": untimed(sentence), "address": f"#run={run.id}&t={shown_at(sentence.time_s)}"}
            for sentence in run.story
        ],
        "overview": Markup(overview(run.run, times, look, label, narrow_names(shown.floor))),  # noqa: S704
        "frames": [
            {
                "number": place,
                "t": t,
                "address": f"#run={run.id}&t={t:.1f}",
                "caption": caption(run, t),
                "svg": Markup(frame(run.run, t, look, caption(run, t))),  # noqa: S704
            }
            for place, t in enumerate(times, 1)
        ],
        "description": subject.attempt.proposal.scenario.description if subject.attempt.proposal.scenario else "",
    }


def _shown_run(shown: Shown, subject: AttemptFacts) -> tuple[RunFacts | None, str]:
    """Return the run that is told, and which one it is: the worst, or where none violates one with a contact."""
    kind = "confirmation run" if subject.attempt.purpose == "confirmation" else "search run"
    if not shown.summary.ranking and shown.summary.confirmed is None:
        kind = "run"  # of no campaign
    touched = [run for run in subject.runs if run.contacts]
    if touched and not subject.violating:
        run = max(touched, key=lambda each: max(contact.duration_s for contact in each.contacts))
        return run, f"the {kind} with the longest contact, seed {run.run.seed}"
    worst = subject.worst(shown.plan.requirement) or (subject.runs[0] if subject.runs else None)
    return worst, f"the worst {kind}, seed {worst.run.seed}" if worst is not None else ""


def still_times(run: RunFacts) -> list[float]:
    """Return up to four moments worth a picture, in order: the decisive one, the closest, a contact, the end."""
    t = run.run.trajectory.t
    end = float(t[-1])
    contact = [event.time_s for event in run.contacts[:1]]
    wanted = [run.decisive_s, *contact, run.closest_s, end, end / 2, end / 4]
    found: list[float] = []
    for time in wanted:
        if len(found) < STILLS and all(abs(time - other) >= APART_S for other in found):
            found.append(float(shown_at(float(time))))
    return sorted(found)


def caption(run: RunFacts, t_s: float) -> str:
    """Return what a frame shows, in words."""
    path = run.run.trajectory
    row = min(int(np.searchsorted(path.t, t_s - 1e-9)), len(path) - 1)
    speed = round(float(path.signed_speed[row]), 1) + 0.0  # no "-0.0"
    text = f"robot at {speed:.1f} m/s"
    if run.run.human_names:
        text += f", {nearest_in_words(run.run, t_s, '{who} is {gap} away')}"
    if row == len(path) - 1:
        text += f"; {outcome_in_words(run.run.outcome)}"
    return text


class Broken(Record):
    """A table: the worst configuration of every kind of encounter (rows) at every place (columns), None where none."""

    places: tuple[str, ...]
    rows: tuple[tuple[str, tuple[MapCell | None, ...]], ...]


def broken(cells: Sequence[MapCell]) -> Broken:
    """Return the table of a failure map; the worst cell of each place and kind stands for all parts of the way."""
    worst: dict[tuple[str, str], MapCell] = {}
    for cell in cells:  # the worst first
        worst.setdefault((cell.encounter.kind, cell.encounter.place), cell)
    kinds = tuple(dict.fromkeys(kind for kind, _ in worst))
    places = tuple(dict.fromkeys(place for _, place in worst))
    return Broken(places=places, rows=tuple((kind, tuple(worst.get((kind, p)) for p in places)) for kind in kinds))


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


def write_runs_page(
    path: Path,
    runs: Sequence[Run],
    measurements: Sequence[Measurement],
    verdict: Verdict,
    *,
    requirement: Requirement,
    mission: Mission,
    world: World,
    scenario: Scenario | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write the page of runs and their verdict, whole or not at all.

    Args:
        mission: What the robot was to do.
        scenario: What the people were asked to do, where that is known.
        notes: What the runs rest on, and what recordings lack.
    """
    brief = Brief(mission=mission, requirement=requirement, seed=0, humans=max(1, len(runs[0].human_names)))
    attempt = Attempt(
        campaign="by hand",
        index=0,
        strategy="by hand",
        brief=brief,
        proposal=Proposal(generator="by hand", scenario=scenario),
        measurements=tuple(measurements),
        verdict=verdict,
    )
    told = tuple(run_facts(run, m, requirement, world, scenario) for run, m in zip(runs, measurements, strict=True))
    facts = AttemptFacts(attempt=attempt, runs=told)
    plan = Plan(name="by hand", mission=mission, requirement=requirement)
    floor = floor_plan(world, tooltips=False)
    shown = Shown(
        plan=plan, world=world, attempts=[attempt], summary=summarise(plan, []), facts=[facts], findings=(), floor=floor
    )
    data = data_of([facts], mission=mission, requirement=requirement, world=world, floor=floor)
    data["groups"][0]["label"] = counted(len(runs), "run")
    data["groups"][0]["purpose"] = "given"
    page = environment().get_template("runs.html")
    text = page.render(
        version=rvsg.__version__,
        requirement=requirement,
        place=f"{world.title}, {mission.route.name}",
        robot=robot_words(mission) if scenario is not None else "",
        answer=answer_of_runs(plan, facts),
        notes=[*notes, *(f"{label}: {text}." for label, text in under_test(runs).rows)],
        happened=what_happens(shown, facts),
        people=people_rows(facts),
        shown_tasks=SHOWN_TASKS,
        doors=mission.doors,
        box=floor.view_box,
        floor=Markup(floor.shapes),  # noqa: S704 - made by us, its words escaped
        names=Markup(narrow_names(floor)),  # noqa: S704
        look=Markup(area_colours(world, floor)),  # noqa: S704
        replay=script_safe(data),
        component=Markup(component()),  # noqa: S704
        traces=(),
        sure=how_sure(verdict),
        runs=run_rows_of(facts, requirement.unit),
    )
    write_whole(path, text)
