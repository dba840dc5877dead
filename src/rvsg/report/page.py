"""Report pages: that of a campaign, with its replay, and that of stored runs.

A page works offline: no network, no third-party script. All text that comes from a person, a model or a file is
escaped. The replay's data stands in the page as JSON without any `<`. The page is a function of the records: equal
campaigns give equal pages.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from rvsg.core.errors import InputError
from rvsg.core.files import check_writable, write_whole
from rvsg.core.records import Pose
from rvsg.evaluation.verdict import counted, how_sure, number, why_ended
from rvsg.findings.feedback import MapCell, separable
from rvsg.findings.ranking import rule
from rvsg.generation.people_sampler import added
from rvsg.generation.vlm.call_log import CallLog
from rvsg.report.charts import confirmation_chart, search_chart
from rvsg.report.conversations import Transcript, thinking
from rvsg.report.page_contents import (
    PageContents,
    at,
    group_label,
    in_order,
    manner,
    run_rows,
    run_rows_of,
    scenario_rows,
    tasks_of,
)
from rvsg.report.renderer import component, render, script_safe
from rvsg.report.replay_data import ReplayGroup, replay_payload
from rvsg.report.result import Result, answer_of_runs
from rvsg.report.run_facts import AttemptFacts, RunFacts
from rvsg.report.stills import frame, look_of, plan_markup
from rvsg.report.words import direction, limit_in_words, quantity, robot_words, shown_at, tried_of, under_test, untimed
from rvsg.runs.attempt import BY_HAND, Attempt, Plan
from rvsg.runs.observation import met
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.scenario.world_lookup import as_world, world_of
from rvsg.search.run_set import Judgement, RunSet
from rvsg.simulation.run import Run
from rvsg.world.world import Route, World


def data_of(
    shown: Iterable[AttemptFacts],
    *,
    mission: Mission,
    requirement: Requirement,
    world: World,
    by_hand: bool = False,
) -> dict[str, Any]:
    """Return the data of the replay component for the runs of these configurations, in this order.

    Args:
        by_hand: whether the runs belong to no campaign.
    """

    def worst_first(run: RunFacts) -> float:
        value = run.measurement.objective
        return -requirement.badness(value) if value is not None else float("inf")

    groups = []
    for facts in shown:
        scenario, many = facts.attempt.proposal.scenario, counted(len(facts.runs), "run")
        groups.append(
            ReplayGroup(
                id=str(facts.attempt.index),
                label=many if by_hand else f"{group_label(facts)} ({many})",
                purpose="given" if by_hand else facts.attempt.purpose,
                status=facts.attempt.verdict.status.value if facts.attempt.verdict else "",
                manners={human.name: manner(human) for human in scenario.people.humans} if scenario else {},
                tasks={human.name: tasks_of(human) for human in scenario.people.humans} if scenario else {},
                runs=tuple(sorted(facts.runs, key=worst_first)),
                moved=tuple(thing.footprint for thing in added(mission, scenario.mission)) if scenario else (),
            )
        )
    return replay_payload(groups, mission=mission, requirement=requirement, world=world)


MOST_CARDS = 6
"""Failures that the page shows as cards at once; more of them wait in a fold."""


def failure_cards(shown: PageContents) -> list[dict[str, Any]]:
    """Return a card for every failure, else for the most severe scenario: row, picture of the moment, and story."""
    runs = {run.id: (run, facts) for facts in shown.facts for run in facts.runs}
    cards = []
    for row in shown.answer.failures or shown.answer.rows[:1]:
        run, facts = runs[row.run]
        runs_of = [sibling.run for sibling in facts.runs]
        look = look_of(runs_of, shown.floor, shown.result.plan.mission.robot_record)
        svg = frame(run.run, row.moment_s, look, row.name)
        story = [
            {"t": moment.time_s, "text": untimed(moment), "address": at(run.id, moment.time_s)} for moment in run.story
        ]
        cards.append({"row": row, "svg": Markup(svg), "address": at(run.id, row.moment_s), "story": story})  # noqa: S704
    return cards


def broken(cells: Sequence[MapCell]) -> dict[str, Any]:
    """Return a table: the worst configuration of every kind of encounter (rows) at every place (columns), or None."""
    worst: dict[tuple[str, str], MapCell] = {}
    for cell in cells:  # the worst first
        worst.setdefault((cell.encounter.kind, cell.encounter.place), cell)
    kinds = tuple(dict.fromkeys(kind for kind, _ in worst))
    places = tuple(dict.fromkeys(place for _, place in worst))
    return {"places": places, "rows": [(kind, [worst.get((kind, place)) for place in places]) for kind in kinds]}


ALIKE = 0.01
"""Means that differ by less than this share of their size are told as alike."""


def render_page(
    result: Result,
    *,
    command: str,
    simulator: str = "",
    overview: str = "",
    traces: Sequence[Mapping[str, Any]] = (),
    recording: CallLog | None = None,
    replayed: bool = False,
) -> str:
    """Return the page of a campaign, finished or not.

    Args:
        command: The command that repeats the campaign.
        overview: The address of the overview this campaign belongs to, seen from the page.
        traces: Traces of runs of the campaign, as `trace_view` makes them; the replay shows them.
        recording: The calls of a model, where they are kept.
        replayed: Whether the model answered earlier, in another campaign.
    """
    plan, requirement, attempts = result.plan, result.requirement, result.attempts
    shown = PageContents(result, result.answer)
    confirmed, candidate = result.confirmed, shown.candidate
    final = confirmed.verdict if confirmed is not None else None
    drawn = candidate is not None and confirmed is not None and final is not None and final.objectives
    return render(
        "page.html",
        **_shared(shown, in_order(shown)),
        plan=plan,
        limit=limit_in_words(requirement),
        result=result,
        sure=how_sure(final) if final is not None else "",
        ended=why_ended(final) if final is not None else "",
        curse=_curse(result, confirmed, candidate),
        confirmation_svg=confirmation_chart(plan, candidate, confirmed) if candidate and confirmed and drawn else "",
        scenarios=scenario_rows(shown),
        evidence=[(finding, shown.answer.row(finding.confirmation)) for finding in result.findings],
        broken=broken(result.failure_map),
        met=met,
        tried_of=tried_of,
        rule=rule(requirement),
        search_svg=search_chart(plan, attempts),
        replayed=replayed,
        thoughts=thinking(attempts, requirement.unit, result.world, Transcript(recording)) if shown.subject else [],
        finding=None,
        command=escape(command),
        simulator=simulator,
        stack=under_test(run.run for facts in shown.facts for run in facts.runs),
        overview=overview,
        left_out=len(set().union(*(attempt.left_out(plan.realism) for attempt in attempts))),
        traces=[script_safe(trace) for trace in traces],
    )


def _shared(shown: PageContents, replayed: Sequence[AttemptFacts], *, by_hand: bool = False) -> dict[str, Any]:
    """Return what the pages of campaigns and of runs both show; runs `by_hand` belong to no campaign."""
    plan, world, floor, answer = shown.result.plan, shown.result.world, shown.floor, shown.answer
    mission, requirement = plan.mission, plan.requirement
    data = data_of(replayed, mission=mission, requirement=requirement, world=world, by_hand=by_hand)
    if answer.rows:
        data["opens"] = {"run": answer.rows[0].run, "t": float(shown_at(answer.rows[0].moment_s))}
    return {
        "answer": answer,
        "cards": failure_cards(shown),
        "most_cards": MOST_CARDS,
        "requirement": plan.requirement,
        "quantity": quantity(plan.requirement),
        "direction": direction(plan.requirement),
        "robot": robot_words(plan.mission),
        "place": f"{world.title}, {plan.mission.route.name}",
        "doors": plan.mission.doors,
        "replay": script_safe(data) if data["groups"] else None,
        "runs": run_rows(shown) if not by_hand else run_rows_of(replayed[0], plan.requirement.unit),
        "component": Markup(component()),  # noqa: S704 - our own files
        **plan_markup(world, floor),
    }


def _curse(result: Result, confirmed: Attempt | None, candidate: Attempt | None) -> str:
    """Return how the confirmation mean compares with the mean in the search by which the scenario was selected."""
    selected, fresh = (attempt.verdict if attempt is not None else None for attempt in (candidate, confirmed))
    if selected is None or selected.mean is None or fresh is None or fresh.mean is None:
        return ""
    requirement, count = result.requirement, result.accounting.search_attempts
    unit = requirement.unit
    mean = "mean up to the time limit" if selected.censored or fresh.censored else "mean"
    lost = requirement.badness(selected.mean) - requirement.badness(fresh.mean)
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
    scenario, place = scenario or runs.scenario, world if world is not None else runs.world
    if place is None and scenario is None:
        raise InputError("A page needs the world of the runs: add --scenario FILE or --world.", code="no-world")
    where = world_of(scenario.mission, place) if scenario is not None else as_world(place or "")
    check_writable(path)
    mission = scenario.mission if scenario is not None else _driven(runs[0], where)
    requirement, verdict, measurements = judged.requirement, judged.verdict, judged.measurements
    people = len(runs[0].human_names)
    attempt = Attempt.by_hand(mission, requirement, scenario, people=people, measurements=measurements, verdict=verdict)
    plan = Plan(name=BY_HAND, mission=mission, requirement=requirement)
    result = Result(plan, [attempt], where, {run.id: run for run in runs}.__getitem__)
    shown = PageContents(result, answer_of_runs(plan, attempt, world=where, run_of=result.run_of))
    text = render(
        "runs.html",
        **_shared(shown, shown.facts, by_hand=True),
        notes=[*notes, *(f"{label}: {text}." for label, text in under_test(runs).rows)],
        traces=(),
        sure=how_sure(verdict),
    )
    write_whole(path, text)


def _driven(run: Run, world: World) -> Mission:
    path, (x, y, yaw) = run.trajectory, run.goal
    start = Pose(x=float(path.x[0]), y=float(path.y[0]), yaw=float(path.yaw[0]))
    goal = Pose(x=x, y=y, yaw=yaw)
    route = Route(name="as recorded", start=start, goal=goal, time_limit_s=run.time_limit_s)
    return Mission.of(world, route, robot="as recorded")  # no robot's name, so pages draw the body that the run has
