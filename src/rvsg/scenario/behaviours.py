"""Facts about the six behaviours, for prompts, pages and generators."""

from __future__ import annotations

from rvsg.core.records import Record
from rvsg.scenario.scenario import Behaviour

SEES_RAD = 1.74
"""People react to a robot within this angle (99.7°) to either side of where they look. Walls do not hide it."""


class BehaviourFacts(Record):
    """What a behaviour does in the default profile, with the default reaction."""

    reacts: bool
    """Whether the robot's presence changes what the person does, beyond making room."""
    trigger_distance_m: float | None = None
    """Distance of the centres from which the person reacts."""
    duration_s: float | None = None
    """How long the person reacts in total while the robot is in sight; once per run."""
    keeps_distance_m: float | None = None
    """Distance from the robot's centre at which the person stops or stands."""
    speed_m_s: float | None = None
    """Largest speed while reacting; None: the walking speed."""
    interrupts_pause: bool = False
    """Whether the reaction interrupts a pause; the rest of the pause follows afterwards."""
    leaves_path: bool = False
    """Whether the person leaves the line between waypoints while reacting."""
    does: str
    """What the person does, in one sentence."""


BEHAVIOURS: dict[Behaviour, BehaviourFacts] = {
    Behaviour.REGULAR: BehaviourFacts(reacts=False, does="Makes room for the robot as for a person."),
    Behaviour.IMPASSIVE: BehaviourFacts(
        reacts=False, does="Does not make room for the robot; walks around its body as around an obstacle."
    ),
    Behaviour.SURPRISED: BehaviourFacts(
        reacts=True,
        trigger_distance_m=4.0,
        duration_s=30.0,
        speed_m_s=0.0,
        interrupts_pause=True,
        does="Stops and turns towards the robot at 18°/s; steps back only from a robot that touches.",
    ),
    Behaviour.SCARED: BehaviourFacts(
        reacts=True,
        trigger_distance_m=3.0,
        duration_s=40.0,
        speed_m_s=0.6,
        interrupts_pause=True,
        leaves_path=True,
        does="Goes on towards the waypoint at 0.6 m/s and is pushed away from the robot.",
    ),
    Behaviour.CURIOUS: BehaviourFacts(
        reacts=True,
        trigger_distance_m=10.0,
        duration_s=40.0,
        keeps_distance_m=1.5,
        interrupts_pause=True,
        leaves_path=True,
        does="Walks straight up to the robot, slower the nearer it is, stops and looks at it.",
    ),
    Behaviour.THREATENING: BehaviourFacts(
        reacts=True,
        trigger_distance_m=4.5,
        duration_s=40.0,
        keeps_distance_m=1.4,
        speed_m_s=2.0,
        interrupts_pause=True,
        leaves_path=True,
        does="Hurries to a point in front of the robot and blocks its way.",
    ),
}
"""The facts of each behaviour."""
