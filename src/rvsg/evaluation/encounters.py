"""Encounters of the robot with people: who comes near it, in which direction, and how near."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

import numpy as np

from rvsg.core.records import Record
from rvsg.evaluation.detection import place_namer
from rvsg.evaluation.events import Place
from rvsg.evaluation.sampled import Sampled, joined, sampled, stretches, wrap
from rvsg.simulation.run import Run
from rvsg.world.world import World

NEAR_M = 1.5
"""An encounter begins where the gap between the bodies falls below this."""
APART_S = 2.0
"""Approaches of one person with less time between them are one encounter."""
STANDING_M_S = 0.15
BESIDE_RAD = np.deg2rad(45.0)
"""Directions of travel within 45 degrees count as the same, or as opposite."""


class EncounterKind(str, Enum):
    """How a person comes near the robot, by the directions of both when the encounter begins."""

    HEAD_ON = "head-on"
    FROM_LEFT = "crossing from the left"
    FROM_RIGHT = "crossing from the right"
    ROBOT_OVERTAKES = "robot behind a person"
    PERSON_OVERTAKES = "person behind the robot"
    STANDING = "person stands"


class Encounter(Record):
    """One person near the robot, from the moment the gap falls below `NEAR_M`."""

    kind: EncounterKind
    person: str
    time_s: float
    """When the gap is smallest, seconds since the start of the run."""
    gap_m: float
    """The smallest gap between the bodies; negative where they overlap."""
    place: Place
    """Where the robot is at that time."""


def encounters_of(run: Run, *, world: World | None = None) -> tuple[Encounter, ...]:
    """Return every encounter of a run in order of time. A `world` names the places."""
    if not len(run.trajectory) or not run.human_names:
        return ()
    found = _encounters(sampled(run, world))
    return tuple(sorted(found, key=lambda each: (each.time_s, each.person)))


def _encounters(s: Sampled) -> Iterator[Encounter]:
    at = place_namer(s.world)
    for person in range(s.people):
        gap = s.gap[:, person]
        for first, last in joined(stretches(gap < NEAR_M), s.series.t, APART_S):
            closest = first + int(gap[first : last + 1].argmin())
            yield Encounter(
                kind=_kind(s, first, closest, person),
                person=s.run.human_names[person],
                time_s=round(float(s.series.t[closest]), 3),
                gap_m=round(float(gap[closest]), 3),
                place=at(float(s.series.x[closest]), float(s.series.y[closest])),
            )


def _kind(s: Sampled, first: int, closest: int, person: int) -> EncounterKind:
    speed = s.series.human_speed[first : closest + 1, person]
    if float(np.median(speed)) < STANDING_M_S:
        return EncounterKind.STANDING
    # Of the stretch up to the smallest gap the moment in which the person walks: at its start one may still turn.
    walking = first + int(np.argmax(speed >= STANDING_M_S))
    turned = float(wrap(s.series.human_yaw[walking, person] - s.series.yaw[walking]))
    if abs(turned) > np.pi - BESIDE_RAD:
        return EncounterKind.HEAD_ON
    if abs(turned) < BESIDE_RAD:
        ahead = abs(float(s.bearing_of_human[walking, person])) < np.pi / 2
        return EncounterKind.ROBOT_OVERTAKES if ahead else EncounterKind.PERSON_OVERTAKES
    return EncounterKind.FROM_LEFT if turned < 0 else EncounterKind.FROM_RIGHT
