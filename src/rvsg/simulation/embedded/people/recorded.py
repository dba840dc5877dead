"""Records of the rows in a crowd's event buffer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rvsg.scenario.scenario import Behaviour
from rvsg.simulation.embedded.people import log
from rvsg.simulation.embedded.people.contact import BEARING, CLOSING, OVERLAP, PERSON_PART, ROBOT_PART
from rvsg.simulation.embedded.people.crowd import Crowd
from rvsg.simulation.events import (
    PersonPaused,
    PersonReached,
    PersonReacted,
    PersonStuck,
    RecordedEvent,
    RobotContact,
)


def events_of(crowd: Crowd, names: Sequence[str], behaviours: Sequence[Behaviour]) -> tuple[RecordedEvent, ...]:
    """Return the events of a run in order of time.

    Args:
        names: The name of each person.
        behaviours: The behaviour of each person.
    """
    rows = crowd.events[: int(crowd.event_count[0])]
    rows = rows[np.lexsort((rows[:, log.PERSON], rows[:, log.KIND], rows[:, log.FROM]))]
    return tuple(_event(row, names, behaviours) for row in rows.tolist())


def _event(row: Sequence[float], names: Sequence[str], behaviours: Sequence[Behaviour]) -> RecordedEvent:
    person = int(row[log.PERSON])
    kind = int(row[log.KIND])
    time_s, until_s = round(row[log.FROM], 3), round(row[log.UNTIL], 3)
    x, y = round(row[log.X], 3), round(row[log.Y], 3)
    name = names[person]
    if kind == log.TOUCHED:
        return RobotContact(
            time_s=time_s,
            until_s=until_s,
            x=x,
            y=y,
            person=name,
            closing_speed_m_s=round(row[CLOSING], 3),
            robot_part_m_s=round(row[ROBOT_PART], 3),
            person_part_m_s=round(row[PERSON_PART], 3),
            bearing_rad=round(row[BEARING], 3),
            overlap_m=round(row[OVERLAP], 4),
        )
    if kind == log.REACTED:
        behaviour = behaviours[person]
        return PersonReacted(time_s=time_s, until_s=until_s, x=x, y=y, person=name, behaviour=behaviour)
    goal = int(row[log.FIRST])
    if kind == log.REACHED:
        return PersonReached(time_s=time_s, x=x, y=y, person=name, goal=goal)
    lasting = PersonStuck if kind == log.STUCK else PersonPaused
    return lasting(time_s=time_s, until_s=until_s, x=x, y=y, person=name, goal=goal)
