"""The report of a campaign as one HTML page that needs nothing else: no network, no script of others.

Everything that came from a person, a model or a file is escaped; the data of the replay stands in the page as JSON
in which no `<` occurs. The page is a function of the records: equal campaigns give equal pages.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

import rvsg
from rvsg.campaign.attempt import Attempt
from rvsg.campaign.feedback import gaps, momentary_name, momentary_value, separable
from rvsg.campaign.plan import Plan
from rvsg.campaign.ranking import best_attempt, rule
from rvsg.core.files import write_whole
from rvsg.core.records import Pose
from rvsg.evaluation.judge import OPEN, still_open, violated
from rvsg.evaluation.verdict import Status, Verdict
from rvsg.report.charts import confirmation_chart, search_chart
from rvsg.report.summary import Accounting, Summary, counted, interval, number, summarise
from rvsg.scenario.scenario import Human
from rvsg.simulation.run import Run
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.world import World

Floats = NDArray[np.float64]

REPLAY_PERIOD_S = 0.1
SHOWN_TASKS = 4

ROW = ("rank", "scenario", "configuration", "configurations", "description")


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
) -> str:
    """The page of a campaign, finished or not. `run_of` finds a run by its id; `command` repeats the campaign."""
    summary = summarise(plan, attempts)
    best = best_attempt(attempts, plan.requirement)
    shown = _shown_runs(plan, summary.confirmed or best, run_of) if best else []
    plan_of_floor = floor_plan(world)
    template = environment().get_template("page.html")
    return template.render(
        version=rvsg.__version__,
        plan=plan,
        place=f"{world.title}, {plan.mission.route.name}",
        requirement=plan.requirement,
        limit=number(plan.requirement.threshold, plan.requirement.unit)
        if plan.requirement.threshold is not None
        else "",
        summary=summary,
        headline=headline(plan, summary),
        best=best,
        scenario=best.proposal.scenario if best else None,
        shown_tasks=SHOWN_TASKS,
        tasks=[_tasks(human) for human in best.proposal.scenario.people.humans]
        if best and best.proposal.scenario
        else [],
        rows=_rows(plan, summary, attempts),
        rule=rule(plan.requirement),
        tiles=_tiles(plan, summary),
        curse=_curse(plan, summary),
        box=plan_of_floor.view_box,
        floor=Markup(plan_of_floor.shapes),  # noqa: S704 - made by us, its names escaped
        confirmation_svg=_confirmation_svg(plan, best, summary.confirmed),
        search_svg=Markup(search_chart(plan, attempts)),  # noqa: S704
        replay=_script_safe(_replay(plan, shown, _Turn(plan_of_floor.matrix))),
        command=command,
        simulator=simulator,
        colours=HUMAN_COLOURS,
    )


HUMAN_COLOURS = ("#d9630a", "#0b8f7a", "#a23bb8", "#8a6d00", "#c2255c", "#3f7d20", "#5b5fc7", "#9c4a2f")


def environment() -> jinja2.Environment:
    """What renders the pages: everything in them is escaped, and a name that is not given is an error."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rvsg.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number
    return environment


def headline(plan: Plan, summary: Summary) -> dict[str, str]:
    """What a campaign found in one sentence, in a word (`chip`), and the `tone` in which it is said."""
    confirmed = summary.confirmed.verdict if summary.confirmed else None
    name = plan.requirement.name
    if not summary.ranking:
        return {"tone": "quiet", "chip": "no result", "text": "No valid scenario has been simulated yet."}
    if confirmed is None:
        text = f"The search {'is complete' if summary.complete else 'is not finished'}; nothing is confirmed yet."
        return {"tone": "quiet", "chip": "not confirmed", "text": text}
    if confirmed.status is Status.UNJUDGED:
        text = f"{name} sets no limit: the worst scenario measures {interval(confirmed, plan.requirement.unit)}."
        return {"tone": "quiet", "chip": "no limit", "text": text}
    chip = "violated" if still_open(confirmed) else confirmed.status.value
    text = (
        f"The worst scenario found violates {name} in {confirmed.violations} of {counted(confirmed.runs, 'fresh run')}."
        if confirmed.violations
        else f"The worst scenario found does not violate {name} in any of {counted(confirmed.runs, 'fresh run')}."
    )
    if still_open(confirmed):
        text = f"{text.removesuffix('.')}; {OPEN} (INCONCLUSIVE)."
    return {"tone": _tone(confirmed), "chip": chip, "text": text}


def _tiles(plan: Plan, summary: Summary) -> list[dict[str, str]]:
    """The figures beside the headline."""
    verdict = summary.confirmed.verdict if summary.confirmed else None
    unit = plan.requirement.unit
    found = []
    if verdict and verdict.violation_probability is not None and verdict.violation_interval:
        low, high = verdict.violation_interval
        found.append(
            {
                "name": "Probability of violation",
                "value": f"{verdict.violation_probability:.0%}",
                "note": f"{verdict.confidence:.0%} interval {low:.0%} to {high:.0%} (Clopper-Pearson)",
            }
        )
    if verdict and verdict.mean is not None:
        limit = plan.requirement.threshold
        note = f"limit {number(limit, unit)}, worse when {plan.requirement.worse}" if limit is not None else ""
        spread = f"{number(verdict.interval[0])} to {number(verdict.interval[1])}; " if verdict.interval else ""
        found.append({"name": "Mean in fresh runs", "value": number(verdict.mean, unit), "note": spread + note})
    account = summary.accounting
    found.append(
        {
            "name": "Simulated runs",
            "value": str(account.search_runs + account.confirmation_runs),
            "note": f"{account.search_runs} to search, {account.confirmation_runs} to confirm{_budget(plan, account)}",
        }
    )
    return found


def _budget(plan: Plan, account: Accounting) -> str:
    """How many runs the confirmation might have made, where fewer decided the verdict."""
    decided_early = 0 < account.confirmation_runs < plan.confirmations
    return f" (at most {plan.confirmations})" if decided_early else ""


def _curse(plan: Plan, summary: Summary) -> str:
    """What selection did to the value: the best of many noisy values looks better than it is."""
    if summary.confirmed is None or not summary.ranking:
        return ""
    selected, fresh = summary.ranking[0].verdict, summary.confirmed.verdict
    if selected.mean is None or fresh is None or fresh.mean is None:
        return ""
    unit, count = plan.requirement.unit, summary.accounting.search_attempts
    lost = plan.requirement.badness(selected.mean) - plan.requirement.badness(fresh.mean)
    chosen_by, measured_by = counted(len(selected.objectives), "run"), counted(len(fresh.objectives), "fresh run")
    said = (
        f"It was chosen as the worst of {counted(count, 'configuration')} by {chosen_by} that measured "
        f"{number(selected.mean, unit)} on average; {measured_by}, whose seeds took no part in the choice, measured "
        f"{number(fresh.mean, unit)}. "
    )
    if lost <= 0:
        return said + "They are no milder: nothing here says that the choice was luck, and few runs cannot rule it out."
    if separable(selected, fresh):
        return (
            f"{said}They are milder by {number(lost, unit)}, more than chance among these runs explains (Welch's t "
            "test at 5 %): values that are chosen for being extreme fall back."
        )
    return (
        f"{said}They are milder by {number(lost, unit)}, which chance among these runs can explain as well as that the "
        "most extreme of noisy values was chosen."
    )


def _confirmation_svg(plan: Plan, best: Attempt | None, confirmed: Attempt | None) -> Markup:
    if best is None or confirmed is None or confirmed.verdict is None or not confirmed.verdict.objectives:
        return Markup("")
    return Markup(confirmation_chart(plan, best, confirmed))  # noqa: S704 - made by us, its words escaped


def _rows(plan: Plan, summary: Summary, attempts: Sequence[Attempt]) -> list[dict[str, Any]]:
    """The ranked scenarios as the table shows them."""
    by_index = {attempt.index: attempt for attempt in attempts}
    rows = []
    for entry in summary.ranking:
        scenario = by_index[entry.attempt].proposal.scenario
        assert scenario is not None
        rows.append(
            {name: getattr(entry, name) for name in ROW}
            | {
                "objective": interval(entry.verdict, plan.requirement.unit),
                "violated": f"{entry.verdict.violations} of {entry.verdict.runs}" if _judged(entry.verdict) else "–",
                "status": entry.verdict.status.value,
                "tone": _tone(entry.verdict),
                "means": f"violated; {OPEN}" if still_open(entry.verdict) else "",
                "tasks": [_tasks(human) for human in scenario.people.humans],
                "repairs": [f"{repair.human}: {repair.what}" for repair in by_index[entry.attempt].proposal.repairs],
            }
        )
    return rows


def _judged(verdict: Verdict) -> bool:
    return verdict.status is not Status.UNJUDGED


def _tone(verdict: Verdict) -> str:
    return "bad" if violated(verdict) else "good" if verdict.status is Status.PASS else "quiet"


def _tasks(human: Human) -> dict[str, Any]:
    """A person's work as the page shows it."""
    ways = [f"{human.behaviour.value}, {number(human.speed_m_s, 'm/s')}"]
    if human.start_delay_s:
        ways.append(f"starts after {number(human.start_delay_s, 's')}")
    if human.group is not None:
        ways.append(f"group {human.group}")
    return {
        "name": human.name,
        "manner": ", ".join(ways),
        "tasks": [
            {
                "name": task.name,
                "path": " ".join(task.path),
                "pauses": [f"stands {number(pause.duration_s, 's')} at {pause.at}" for pause in task.pauses],
            }
            for task in human.tasks
        ],
    }


def _shown_runs(plan: Plan, attempt: Attempt | None, run_of: Callable[[str], Run]) -> list[tuple[str, Run]]:
    """The runs to replay: the worst, the middle and the mildest of the attempt, named."""
    if attempt is None:
        return []
    valued = [m for m in attempt.measurements if m.objective is not None] or list(attempt.measurements)
    order = sorted(valued, key=lambda m: -plan.requirement.badness(m.objective) if m.objective is not None else 0.0)
    kind = "fresh run" if attempt.purpose == "confirmation" else "run of the search"
    places = {"worst": 0, "middle": len(order) // 2, "mildest": len(order) - 1}
    chosen: dict[int, str] = {}
    for name, place in places.items():
        chosen.setdefault(place, name)
    unit = plan.requirement.unit
    return [
        (
            f"{name} {kind}: {number(order[place].objective, unit)} (seed {order[place].seed})",
            run_of(order[place].run_id),
        )
        for place, name in chosen.items()
        if place < len(order)
    ]


class _Turn:
    """World coordinates (m, rad) into those of the floor plan, by the plan's `matrix(a b c d e f)`."""

    def __init__(self, matrix: str) -> None:
        self.a, self.b, self.c, self.d, self.e, self.f = (float(v) for v in matrix[7:-1].replace(",", " ").split())

    def points(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """The plan's coordinates of world points."""
        return self.a * x + self.c * y + self.e, self.b * x + self.d * y + self.f

    def degrees(self, yaw: Floats) -> Floats:
        """The plan's angle, clockwise as SVG turns, of a world heading."""
        x, y = np.cos(yaw), np.sin(yaw)
        return np.degrees(np.arctan2(self.b * x + self.d * y, self.a * x + self.c * y))


def _replay(plan: Plan, shown: Sequence[tuple[str, Run]], turn: _Turn) -> dict[str, Any]:
    """What the page's script needs to draw the runs: positions in the plan and gaps, ten times a second."""
    route, measured = plan.mission.route, momentary_name(plan.requirement)
    return {
        "colours": HUMAN_COLOURS,
        "route": {"start": _place(route.start, turn), "goal": _place(route.goal, turn)},
        "measure": "" if measured.startswith("gap") else measured,
        "runs": [_replay_run(label, run, plan, turn) for label, run in shown],
    }


def _replay_run(label: str, run: Run, plan: Plan, turn: _Turn) -> dict[str, Any]:
    path = run.trajectory
    wanted = np.arange(0.0, float(path.t[-1]) + REPLAY_PERIOD_S / 2, REPLAY_PERIOD_S)
    rows = np.clip(np.searchsorted(path.t, wanted - 1e-9), 0, len(path) - 1)
    gap = gaps(run)[rows]
    x, y = turn.points(path.x[rows], path.y[rows])
    human_x, human_y = turn.points(path.human_x[rows], path.human_y[rows])
    return {
        "label": label,
        "outcome": run.outcome.value,
        "robotRadius": run.robot_radius_m,
        "names": list(run.human_names),
        "radii": list(run.human_radius_m),
        "t": _list(path.t[rows], 2),
        "x": _list(x),
        "y": _list(y),
        "angle": _list(turn.degrees(path.yaw[rows]), 1),
        "v": _list(path.v[rows], 2),
        "measure": _list(_highest(momentary_value(run, plan.requirement), rows)),
        "hx": [_list(human_x[:, h]) for h in range(gap.shape[1])],
        "hy": [_list(human_y[:, h]) for h in range(gap.shape[1])],
        "gap": [_list(_not_to_contact(gap[:, h])) for h in range(gap.shape[1])],
    }


def _highest(values: Floats, rows: NDArray[np.intp]) -> Floats:
    """The greatest of the values since the row before, so that thinning out hides no peak; 0 where there is none."""
    values = np.nan_to_num(values, nan=0.0)
    return np.array([values[max(0, a + 1) : b + 1].max() if b > a else values[b] for a, b in pairwise([-1, *rows])])


def _not_to_contact(gap: Floats) -> Floats:
    """Gaps in whole mm, rounded up: 0 is contact, and what is nearly contact does not become it."""
    return np.asarray(np.ceil(gap * 1000.0) / 1000.0)


def _place(pose: Pose, turn: _Turn) -> list[float]:
    x, y = turn.points(np.array([pose.x]), np.array([pose.y]))
    return [round(float(x[0]), 3), round(float(y[0]), 3)]


def _list(values: Floats, digits: int = 3) -> list[float]:
    return [round(float(value), digits) for value in values]


def _script_safe(value: Any) -> Markup:
    """JSON that can stand in a script element: nothing in it can end the element."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))  # noqa: S704
