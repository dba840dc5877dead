"""Safety measures that users of mobile robots expect beside the study's: contacts, time to collision, intrusions."""

from __future__ import annotations

from functools import partial

import numpy as np

from rvsg.evaluation.detection import contacts
from rvsg.evaluation.metrics.metric import Metric, measures
from rvsg.evaluation.realism import PEOPLE_REALISM, motions, rarest
from rvsg.evaluation.responsibility import REACTION_S, responsible
from rvsg.evaluation.sampled import STILL_SPEED_M_S, Flags, Sampled, stretches
from rvsg.scenario.requirement import Aim

SAFETY = "common practice in robot safety"
HUNAV = "HuNavSim evaluator, corrected"
INTIMATE_M, PERSONAL_M, SOCIAL_M = 0.45, 1.2, 3.6
EMERGENCY_DECELERATION_M_S2 = 2.0
ADVANCING_M = 0.05

METRICS: list[Metric] = []
_metric = partial(measures, METRICS, source=SAFETY)
_of_people = partial(_metric, of_people=True)


@_of_people("contacts", "Contact events", "events", "larger", Aim.MEET)
def contact_events(s: Sampled) -> float | None:
    """Contacts of the robot with each person; those less than 0.5 s apart count as one."""
    return float(len(s.contacts))


@_of_people("robot_contacts", "Contacts the robot is responsible for", "events", "larger", Aim.MEET)
def robot_contacts(s: Sampled) -> float | None:
    """Contacts, counted as for `contacts`, for which the robot or both are responsible."""
    return float(sum(contact.responsible != "person" for contact in contacts(s)))


@_of_people("robot_clearance", "Smallest gap the robot is responsible for", "m", "smaller", Aim.MEET, least=None)
def robot_clearance(s: Sampled) -> float | None:
    """Smallest gap to a person among the moments at which it is least and the robot or both are responsible.

    The largest gap to the nearest person over the run where there is no such moment.
    """
    beyond = np.full((1, s.people), np.inf)
    before, after = np.concatenate([beyond, s.gap[:-1]]), np.concatenate([s.gap[1:], beyond])
    moments = np.argwhere((s.gap <= before) & (s.gap < after))
    for row, person in moments[np.argsort(s.gap[tuple(moments.T)])]:
        if responsible(s, int(row), int(person)) != "person":
            return float(s.gap[row, person])
    return float(s.closest_gap.max())


@_of_people("contact_time", "Time in contact", "s", "larger", Aim.MEET, most="time_limit")
def contact_time(s: Sampled) -> float | None:
    """Seconds in which the robot touches at least one person (at the end of the interval)."""
    touching: Flags = np.any(s.touching, axis=1)
    return float(s.dt[touching[1:]].sum())


@_of_people("contact_longest", "Longest contact", "s", "larger", Aim.MEET, most="time_limit")
def contact_longest(s: Sampled) -> float | None:
    """Duration of the longest contact with one person, seconds, counted as for `contacts`; 0 without contact."""
    return max((float(s.series.t[touch.last] - s.series.t[touch.first]) for touch in s.contacts), default=0.0)


@_of_people("contact_speed", "Relative speed at contact", "m/s", "larger", Aim.MEET)
def contact_speed(s: Sampled) -> float | None:
    """Largest speed of the robot relative to a person it touches; 0 without contact.

    Where the simulator records contacts, the speed along the normal just before the contact counts, too.
    """
    recorded = [touch.recorded.closing_speed_m_s for touch in s.contacts if touch.recorded is not None]
    return max([0.0, *recorded, *(float(speed) for speed in s.relative_speed[s.touching])])


@_of_people("contact_robot_speed", "Robot's speed in contact", "m/s", "larger", Aim.MEET)
def contact_robot_speed(s: Sampled) -> float | None:
    """Largest own speed |v| of the robot while it touches a person; 0 without contact."""
    touching = s.touching.any(axis=1)
    return float(s.series.speed[touching].max()) if touching.any() else 0.0


@_of_people("ttc", "Time to collision", "s", "smaller", Aim.MEET, shown="closing_speed")
def time_to_collision(s: Sampled) -> float | None:
    """Smallest time until the discs would touch if robot and person kept their velocities; 0 in contact.

    Solves |d + w t| = r_robot + r_i for the smallest t > 0 with d the offset and w the relative velocity.
    None where no pair is ever on a collision course.
    """
    if s.touching.any():
        return 0.0
    dx, dy = s.offset
    rx, ry = s.robot_velocity
    hx, hy = s.human_velocity
    wx, wy = hx - rx[:, None], hy - ry[:, None]
    reach = s.run.robot_radius_m + np.asarray(s.run.human_radius_m)[None, :]
    a = wx * wx + wy * wy
    b = dx * wx + dy * wy
    discriminant = b * b - a * (dx * dx + dy * dy - reach * reach)
    course = (b < 0.0) & (discriminant >= 0.0) & (a > 0.0)
    if not course.any():
        return None
    return float(((-b[course] - np.sqrt(discriminant[course])) / a[course]).min())


@_of_people("stopping_margin", "Stopping-distance margin", "m", "smaller", Aim.MEET, least=None)
def stopping_margin(s: Sampled) -> float | None:
    """Smallest gap minus the stopping distance, over samples in which the robot closes in on the person.

    Stopping distance = v (0.3 s + latency) + v^2 / (2 a), a the robot's deceleration (2.5 m/s^2 where it is not known).
    Without an approach the smallest gap.
    """
    reaction, braking = REACTION_S + s.run.robot_latency_s, s.run.robot_deceleration_m_s2
    speed = s.series.speed[:, None]
    stopping = np.where(s.closing_speed > 0.0, speed * reaction + speed**2 / (2 * braking), 0.0)
    return float((s.gap - stopping).min())


def _share_between(s: Sampled, low: float, high: float) -> float:
    return float(100.0 * ((s.clamped_gap >= low) & (s.clamped_gap < high)).mean())


@_of_people("intimate_space", "Intimate space intrusion", "%", "larger", Aim.SHARE, source=HUNAV, most=100.0)
def intimate_space(s: Sampled) -> float | None:
    """Percent of samples with the closest person nearer than 0.45 m, surface to surface."""
    return _share_between(s, 0.0, INTIMATE_M)


@_of_people("personal_space", "Personal space intrusion", "%", "larger", Aim.SHARE, source=HUNAV, most=100.0)
def personal_space(s: Sampled) -> float | None:
    """Percent of samples with the closest person between 0.45 m and 1.2 m."""
    return _share_between(s, INTIMATE_M, PERSONAL_M)


@_of_people("social_space", "Social space intrusion", "%", "larger", Aim.SHARE, source=HUNAV, most=100.0)
def social_space(s: Sampled) -> float | None:
    """Percent of samples with the closest person between 1.2 m and 3.6 m."""
    return _share_between(s, PERSONAL_M, SOCIAL_M)


@_metric(
    "obstacle_distance",
    "Minimum distance to obstacles",
    "m",
    "smaller",
    Aim.DISTURB,
    shown="obstacle_distance",
    moved_by="People who make the robot swerve where walls or objects are near.",
    least=None,
)
def obstacle_distance(s: Sampled) -> float | None:
    """Smallest distance from the robot's centre to an obstacle; None where the world is not given."""
    return float(s.obstacle_distance.min()) if s.obstacle_distance is not None and len(s) else None


@_metric("acceleration_peak", "Peak acceleration", "m/s²", "larger", Aim.DISTURB, shown="acceleration")
def acceleration_peak(s: Sampled) -> float | None:
    """Largest magnitude of the robot's acceleration (mean of each interval, along and across)."""
    return float(np.hypot(*s.acceleration).max()) if len(s) > 1 else None


@_metric("emergency_stops", "Emergency stops", "events", "larger", Aim.DISTURB, shown="acceleration")
def emergency_stops(s: Sampled) -> float | None:
    """Stops into which the robot brakes harder than 2 m/s^2 before it stands (|v| < 0.01 m/s), the arrival left out."""
    if len(s) < 2:
        return None
    speed = s.series.speed
    braking = np.diff(speed) / s.dt < -EMERGENCY_DECELERATION_M_S2
    moving = speed >= STILL_SPEED_M_S
    stopped = np.flatnonzero(moving[:-1] & ~moving[1:])
    if s.run.completed and len(stopped) and not moving[stopped[-1] + 1 :].any():
        stopped = stopped[:-1]
    return float(sum(bool(braking[max(0, k - 1) : k + 1].any()) for k in stopped))


@_metric("standstill", "Longest standstill", "s", "larger", Aim.DELAY, shown="speed", most="time_limit")
def longest_standstill(s: Sampled) -> float | None:
    """Longest time the robot neither drives nor turns between its start and its end, seconds."""
    if len(s) < 2:
        return None
    return max((float(np.cumsum(s.dt[a : b + 1])[-1]) for a, b in stretches(s.still[1:])), default=0.0)


@_metric("detour", "Detour ratio", "1", "larger", Aim.DELAY, shown="distance_to_goal")
def detour_ratio(s: Sampled) -> float | None:
    """Path length over the straight distance from the first to the last position; None if those coincide."""
    if len(s) < 2:
        return None
    straight = float(np.hypot(s.series.x[-1] - s.series.x[0], s.series.y[-1] - s.series.y[0]))
    return float(s.steps.sum()) / straight if straight > ADVANCING_M else None


@_metric(
    "heading_error",
    "Final heading error",
    "rad",
    "larger",
    Aim.DELAY,
    shown="distance_to_goal",
    moved_by="People who stand at the goal.",
    most=float(np.pi),
)
def heading_error(s: Sampled) -> float | None:
    """|wrap(yaw - goal yaw)| at the end, radians."""
    if not len(s):
        return None
    error = (float(s.series.yaw[-1]) - s.run.goal[2] + np.pi) % (2 * np.pi) - np.pi
    return abs(float(error))


@_metric(
    "time_share",
    "Share of the time limit used",
    "1",
    "larger",
    Aim.DELAY,
    shown="distance_to_goal",
    most=1.0,
    censored=True,
)
def time_share(s: Sampled) -> float | None:
    """Time to the goal over the route's time limit; at least 1 where the goal was not reached in time."""
    if not len(s) or s.run.time_limit_s <= 0:
        return None
    taken = s.duration_s if s.run.completed else max(s.duration_s, s.run.time_limit_s)
    return taken / s.run.time_limit_s


@_of_people(
    PEOPLE_REALISM,
    "Recorded people who move like the least usual person",
    "%",
    "neither",
    Aim.SHARE,
    source="recordings ETH, HOTEL, ZARA 1 and 2, students 3",
    moved_by="People who start, stop or pass each other as few people do.",
    most=100.0,
)
def people_realism(s: Sampled) -> float | None:
    """The percentage of recorded people who go as far as the person of the run who is least usual in speed,
    acceleration, distance from others or standing."""
    rare = rarest(motions(s.run))
    return None if rare is None else rare.recorded_percent
