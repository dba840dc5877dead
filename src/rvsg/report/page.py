"""Report pages: that of a campaign, with its replay, and that of stored runs.

A page works offline: no network, no third-party script. All text that comes from a person, a model or a file is
escaped. The replay's data stands in the page as JSON without any `<`. The page is a function of the records: equal
campaigns give equal pages.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from rvsg.campaign.attempt import BY_HAND, Attempt, Plan
from rvsg.campaign.feedback import MapCell, failure_map, separable
from rvsg.campaign.findings import distinct_failures, findings
from rvsg.campaign.observation import met
from rvsg.campaign.ranking import rule
from rvsg.campaign.run_set import Judgement, RunSet
from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg.core.outputs import check_writable
from rvsg.core.records import Pose
from rvsg.evaluation.verdict import Verdict, counted, how_sure, number, outcome_in_words, why_ended
from rvsg.generation.people_sampler import added
from rvsg.generation.vlm.recording import Recording
from rvsg.report.answer import (
    answer,
    answer_of_runs,
    direction,
    quantity,
    robot_words,
    shown_at,
    under_test,
    untimed,
)
from rvsg.report.charts import confirmation_chart, search_chart
from rvsg.report.page_contents import (
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
from rvsg.report.renderer import component, render, script_safe
from rvsg.report.replay_data import ReplayGroup, replay_payload
from rvsg.report.run_facts import AttemptFacts, RunFacts, facts_of, row_at, run_facts
from rvsg.report.stills import frame, narrow_names, nearest_in_words, overview, plan_markup
from rvsg.report.summary import Summary, summarise, tried_of
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.scenario.world_lookup import as_world, world_of
from rvsg.simulation.run import Run
from rvsg.world.drawing.svg import FloorPlan, floor_plan
from rvsg.world.world import Route, World


def data_of(
    shown: Iterable[AttemptFacts], *, mission: Mission, requirement: Requirement, world: World, floor: FloorPlan
) -> dict[str, Any]:
    """Return the data of the replay component for the runs of these configurations, in this order."""

    def worst_first(run: RunFacts) -> float:
        value = run.measurement.objective
        return -requirement.badness(value) if value is not None else float("inf")

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
                runs=tuple(sorted(facts.runs, key=worst_first)),
                moved=tuple(thing.footprint for thing in added(mission, scenario.mission)) if scenario else (),
            )
        )
    return replay_payload(groups, mission=mission, requirement=requirement, world=world, matrix=floor.matrix)


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
    row = row_at(run.run, t_s)
    speed = round(float(path.signed_speed[row]), 1) + 0.0  # no "-0.0"
    text = f"robot at {speed:.1f} m/s"
    if run.run.human_names:
        text += f", {nearest_in_words(run.run, t_s, '{who} is {gap} away')}"
    if row == len(path) - 1:
        text += f"; {outcome_in_words(run.run.outcome)}"
    return text


def broken(cells: Sequence[MapCell]) -> dict[str, Any]:
    """Return a table: the worst configuration of every kind of encounter (rows) at every place (columns), or None."""
    worst: dict[tuple[str, str], MapCell] = {}
    for cell in cells:  # the worst first
        worst.setdefault((cell.encounter.kind, cell.encounter.place), cell)
    kinds = tuple(dict.fromkeys(kind for kind, _ in worst))
    places = tuple(dict.fromkeys(place for _, place in worst))
    return {"places": places, "rows": [(kind, [worst.get((kind, place)) for place in places]) for kind in kinds]}


SHOWN_TASKS = 4
ALIKE = 0.01
"""Means that differ by less than this share of their size are told as alike."""


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
    confirmed, candidate = shown.summary.confirmed, shown.candidate
    final = confirmed.verdict if confirmed is not None else None
    drawn = candidate is not None and confirmed is not None and final is not None and final.objectives
    return render(
        "page.html",
        **_shared(shown, subject, in_order(shown)),
        plan=plan,
        robot=robot_words(plan.mission),
        quantity=quantity(requirement),
        direction=direction(requirement),
        limit=number(requirement.threshold, requirement.unit) if requirement.threshold is not None else "",
        summary=shown.summary,
        answer=answer(plan, shown.summary, shown.confirmed, shown.searched, shown.cause, shown.others),
        sure=how_sure(final) if final is not None else "",
        ended=why_ended(final) if final is not None else "",
        curse=_curse(plan, shown.summary, candidate.verdict if candidate else None),
        confirmation_svg=confirmation_chart(plan, candidate, confirmed) if candidate and confirmed and drawn else "",
        rows=finding_rows(shown),
        failures=distinct_failures(shown.findings),
        broken=broken(failure_map(attempts, requirement, run_of=run_of, world=world)),
        met=met,
        tried_of=tried_of,
        rule=rule(requirement),
        search_svg=search_chart(plan, attempts),
        replayed=replayed,
        thoughts=thinking(shown, recording) if subject else [],
        runs=run_rows(shown),
        command=escape(command),
        simulator=simulator,
        stack=under_test(run.run for facts in shown.facts for run in facts.runs),
        overview=overview,
        left_out=len(set().union(*(attempt.left_out(plan.realism) for attempt in attempts))),
        traces=[script_safe(trace) for trace in traces],
    )


def _shared(
    shown: Shown, subject: AttemptFacts | None, replayed: Sequence[AttemptFacts], *, label: str = ""
) -> dict[str, Any]:
    """Return what the pages of campaigns and of runs both show; `label` names runs that belong to no campaign."""
    plan, world, floor = shown.plan, shown.world, shown.floor
    data = data_of(replayed, mission=plan.mission, requirement=plan.requirement, world=world, floor=floor)
    if label:
        data["groups"][0] |= {"label": label, "purpose": "given"}
    return {
        "requirement": plan.requirement,
        "place": f"{world.title}, {plan.mission.route.name}",
        "happened": what_happens(shown, subject) if subject else None,
        "people": people_rows(subject) if subject else [],
        "shown_tasks": SHOWN_TASKS,
        "doors": plan.mission.doors,
        "replay": script_safe(data) if subject else None,
        "component": Markup(component()),  # noqa: S704 - our own files
        **plan_markup(world, floor),
    }


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


def write_runs_page(
    path: Path,
    judged: Judgement,
    runs: RunSet,
    *,
    scenario: Scenario | None = None,
    world: World | str | Path | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write the page of judged runs: verdict, story, replay.

    Args:
        scenario: what the people were asked to do, where the runs do not know it.
        world: the world, where neither the runs nor the scenario know it.
        notes: what the runs rest on, and what recordings lack.

    Raises:
        InputError: the world of the runs is not known.
    """
    scenario, given = scenario or runs.scenario, world if world is not None else runs.world
    if given is None and scenario is None:
        raise InputError("A page needs the world of the runs: add --scenario FILE or --world.", code="no-world")
    where = world_of(scenario.mission, given) if scenario is not None else as_world(given or "")
    check_writable(path)
    mission = scenario.mission if scenario is not None else _driven(runs[0], where)
    requirement, verdict, measurements = judged.requirement, judged.verdict, judged.measurements
    people = len(runs[0].human_names)
    attempt = Attempt.by_hand(mission, requirement, scenario, people=people, measurements=measurements, verdict=verdict)
    told = tuple(run_facts(run, m, requirement, where, scenario) for run, m in zip(runs, measurements, strict=True))
    facts = AttemptFacts(attempt=attempt, runs=told)
    plan = Plan(name=BY_HAND, mission=mission, requirement=requirement)
    floor = floor_plan(where, tooltips=False)
    shown = Shown(
        plan=plan, world=where, attempts=[attempt], summary=summarise(plan, []), facts=[facts], findings=(), floor=floor
    )
    label = counted(len(runs), "run")
    text = render(
        "runs.html",
        **_shared(shown, facts, [facts], label=label),
        robot=robot_words(mission) if scenario is not None else "",
        answer=answer_of_runs(plan, facts),
        notes=[*notes, *(f"{label}: {text}." for label, text in under_test(runs).rows)],
        traces=(),
        sure=how_sure(verdict),
        runs=run_rows_of(facts, requirement.unit),
    )
    write_whole(path, text)


def _driven(run: Run, world: World) -> Mission:
    path, (x, y, yaw) = run.trajectory, run.goal
    start = Pose(x=float(path.x[0]), y=float(path.y[0]), yaw=float(path.yaw[0]))
    goal = Pose(x=x, y=y, yaw=yaw)
    route = Route(name="as recorded", start=start, goal=goal, time_limit_s=run.time_limit_s)
    return Mission.of(world, route, robot="as recorded")  # no robot's name, so pages draw the body that the run has
