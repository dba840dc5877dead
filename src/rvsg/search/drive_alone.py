"""The robot alone: the mission without people, before the search, so that a stack that fails by itself is known first.

The runs are stored as a campaign of their own in the ledger of the plan's campaign, none of whose records they change.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rvsg.core.errors import NothingJudged
from rvsg.core.records import Record
from rvsg.core.seeds import fresh_seeds
from rvsg.evaluation.verdict import counted, number
from rvsg.generation.generator import Proposal
from rvsg.runs.attempt import Attempt, Plan
from rvsg.runs.ledger import Ledger
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import HumanConfiguration, Scenario
from rvsg.search.execution import AloneStarted, AttemptFinished, Event, Message, Parts, make, submit
from rvsg.simulation.run import Outcome

RUNS = 3
NEARLY = 0.95
"""A robot that needs more than this share of the time limit is warned about."""
CHECK = "Check the robot's speed limits, the inflation radius and the goal tolerance of the stack under test."


class DroveAlone(Record):
    """How the robot drives the mission without people."""

    runs: int
    arrived: int
    time_s: float | None
    """Mean time of the runs that arrive."""
    limit_s: float
    speed_m_s: float | None
    """Mean speed over the runs."""
    touches: int
    """Runs that touch an obstacle."""
    violations: int
    judged: int
    """Runs that the requirement can measure; one about people measures none."""
    text: str
    """All of it in one line."""
    warning: str
    """What is wrong with the robot alone and what to check; empty where nothing is."""


def name_of(plan: Plan) -> str:
    """Return the name under which the ledger keeps the runs."""
    return f"{plan.name} alone"


def stored_alone(ledger: Ledger, plan: Plan) -> Attempt | None:
    """Return the runs without people that a ledger keeps for a campaign, the last of several; None without."""
    return max(ledger.attempts(name_of(plan)), key=lambda attempt: attempt.index, default=None)


def campaigns_of(ledger: Ledger) -> list[str]:
    """Return the names of the campaigns of a ledger, without those that hold the robot alone."""
    return [name for name in ledger.campaigns() if "alone" not in (ledger.settings(name) or {})]


def drive_alone(plan: Plan, parts: Parts) -> Iterator[Event]:
    """Run the mission without people, unless that is stored, and report at once what is wrong with it.

    Raises:
        NothingJudged: the robot never arrives, and nobody asked to search all the same.
    """
    name, ledger = name_of(plan), parts.ledger.ledger
    known = stored_alone(ledger, plan)
    if ledger.settings(name) is None:
        ledger.begin(name, {"alone": plan.name})
    scenario = Scenario(mission=plan.mission, people=HumanConfiguration(humans=()), description="")
    attempt = Attempt(
        campaign=name,
        index=0 if known is None else known.index + 1,
        purpose="baseline",
        strategy="alone",
        brief=Brief(mission=plan.mission, requirement=plan.requirement, seed=plan.seed),
        proposal=Proposal(generator="alone", scenario=scenario),
    )
    pending = submit(attempt, fresh_seeds(plan.seed, "alone", RUNS, used=()), parts)
    if known is not None and [m.run_id for m in known.measurements] == [run.run_id for run in pending]:
        _check_arrives(known, parts)
        return  # else another stack began in this folder, and nothing of it was kept
    yield AloneStarted(campaign=plan.name, runs=RUNS)
    for event in make(attempt, pending, parts):
        if not isinstance(event, AttemptFinished):
            yield event
            continue
        _check_arrives(event.attempt, parts)
        if warning := drove_alone(plan, event.attempt).warning:
            yield Message(campaign=plan.name, text=warning)


def _check_arrives(attempt: Attempt, parts: Parts) -> None:
    """Refuse a search in which nothing could be blamed on people."""
    ended = [m.outcome for m in attempt.measurements]
    if not ended or Outcome.REACHED.value in ended or parts.search_anyway:
        return
    fault = parts.ledger.ledger.run(attempt.measurements[0].run_id).stack_fault
    raise NothingJudged(
        f"Without people, the robot arrives in none of {counted(len(ended), 'run')}; the first ended so: {ended[0]}"
        f"{f' ({fault})' if fault else ''}. So what people do to it cannot be judged, and nothing was searched. "
        f"{CHECK} To search all the same, add --search-anyway.",
        code="never-arrives",
    )


def drove_alone(plan: Plan, attempt: Attempt) -> DroveAlone:
    """Return what the runs without people say of the robot and its stack."""
    measured, limit_s = attempt.measurements, plan.mission.route.time_limit_s
    arrived = [m for m in measured if m.outcome == Outcome.REACHED.value]
    time_s, speed = _mean([m.values.get("trg") for m in arrived]), _mean([m.values.get("speed") for m in measured])
    judged = [m for m in measured if m.objective is not None]
    violations = len(attempt.violating(plan.requirement))
    hits = sum((gap := m.values.get("obstacle_distance")) is not None and gap <= 0.0 for m in measured)
    late = len(measured) - len(arrived)
    said = [
        f"arrives in {number(time_s, 's')} (limit {number(limit_s, 's')})" if time_s is not None else "never arrives"
    ]
    said += [f"{late} of {counted(len(measured), 'run')} late"] if arrived and late else []
    said += [number(speed, "m/s")] if speed is not None else []
    said += [f"{hits} of {counted(len(measured), 'run')} touch an obstacle"] if hits else []
    said += [f"{violations} of {len(judged)} runs violate"] if judged else []
    wrong = [f"does not arrive in {late} of {counted(len(measured), 'run')}"] if late else []
    if time_s is not None and time_s > NEARLY * limit_s:
        wrong.append(f"needs {number(time_s, 's')} of the limit of {number(limit_s, 's')}")
    wrong += [f"violates {plan.requirement.name} in {violations} of {len(judged)} runs"] if violations else []
    wrong += [f"touches an obstacle in {hits} of {counted(len(measured), 'run')}"] if hits else []
    turns = plan.mission.robot_record.turning_note if late and plan.mission.robot_record else ""
    warning = f"Without people, the robot {' and '.join(wrong)}. {turns}{CHECK}" if wrong else ""
    return DroveAlone(
        runs=len(measured),
        arrived=len(arrived),
        time_s=time_s,
        limit_s=limit_s,
        speed_m_s=speed,
        touches=hits,
        violations=violations,
        judged=len(judged),
        text=", ".join(said),
        warning=warning,
    )


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return math.fsum(known) / len(known) if known else None
