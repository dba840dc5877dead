"""What the robot does in a run because of people: where it stands and why, and on which side it passes whom."""

from __future__ import annotations

from rvsg.campaign.walks import left_of
from rvsg.evaluation.detection import blocked_goals, place_namer, standstills
from rvsg.evaluation.encounters import encounters_of
from rvsg.evaluation.events import StandStill
from rvsg.evaluation.sampled import Sampled, sampled
from rvsg.scenario.brief import Passing, Stop
from rvsg.simulation.events import Recovery
from rvsg.simulation.run import Run
from rvsg.world.world import World

MOST_PASSINGS = 6
NEAR_M = 2.0
"""A person with a smaller gap may keep the planner from finding a way."""


def stops_of(run: Run, world: World) -> tuple[Stop, ...]:
    """Return where the robot stands on its way for at least a second, and why, in order."""
    s, at = sampled(run, world), place_namer(world)
    goals = list(blocked_goals(s, at)) if s.people else []
    found = []
    for stand in standstills(s, at):
        reason, who = _why(s, stand)
        taken = next((g.person for g in goals if g.time_s < stand.until_s and stand.time_s < g.until_s), None)
        found.append(
            Stop(
                time_s=round(stand.time_s, 1),
                until_s=round(stand.until_s, 1),
                at=stand.place.waypoint,
                reason=reason if taken is None else "goal_taken",
                who=who if taken is None else taken,
            )
        )
    return tuple(found)


def _why(s: Sampled, stand: StandStill) -> tuple[str, str]:
    """Why the robot stands, and because of whom: what is next to it, what its navigation does, who is near."""
    if stand.reason != "unknown":
        return stand.reason, stand.person
    recoveries = (e for e in s.run.events if isinstance(e, Recovery))
    if any(e.time_s < stand.until_s and stand.time_s < e.until_s for e in recoveries):
        return "recovery", ""
    if s.people:
        k = int(s.series.t.searchsorted(stand.time_s - 1e-9))
        nearest = int(s.gap[k].argmin())
        if s.gap[k, nearest] < NEAR_M:
            return "person_near", s.run.human_names[nearest]
    return "unknown", ""


def passings_of(run: Run, world: World) -> tuple[Passing, ...]:
    """Return the closest encounters of a run in order of time, each with the side of the robot the person is on."""
    closest = sorted(encounters_of(run, world=world), key=lambda each: each.gap_m)[:MOST_PASSINGS]
    times = run.trajectory.t
    return tuple(
        Passing(
            time_s=round(each.time_s, 1),
            at=each.place.waypoint,
            who=each.person,
            how=each.kind.value,
            left=left_of(run, int(times.searchsorted(each.time_s - 1e-3)), run.human_names.index(each.person)),
            gap_m=round(each.gap_m, 2),
        )
        for each in sorted(closest, key=lambda each: each.time_s)
    )
