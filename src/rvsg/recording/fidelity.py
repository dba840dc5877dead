"""Whether a run repeats a recording: path, time, smallest gaps and events of both, and parameters of the robot.

Both runs have the same bodies, so that their gaps differ by the motion alone. People count where they were seen.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Callable

import numpy as np

from rvsg.core.records import Record
from rvsg.evaluation.detection import events_of
from rvsg.evaluation.sampled import sampled
from rvsg.evaluation.verdict import counted
from rvsg.recording.recorded_run import outcome_of, speed_of
from rvsg.recording.tracks import GAP_S, Floats, Recording
from rvsg.robots.robot import Robot
from rvsg.simulation.events import Contact, HardBrake, NearMiss, Outcome, StandStill
from rvsg.simulation.run import Run, Trajectory
from rvsg.world.world import World

NEAR_M = 2.0
"""Gaps are compared where one of both is below this."""
AWAY_M = 1000.0
"""People who are not seen are drawn this far away."""
COUNTED: dict[type, str] = {Contact: "contacts", NearMiss: "near misses", HardBrake: "hard brakes", StandStill: "stops"}
FRESH_S = 0.5
"""Speeds change over this when the acceleration of a recording is estimated."""
LATENCIES_S = np.arange(0.0, 0.8, 0.02)
LEAST_COMMANDS = 50
SHOWN = 0.1
"""A drive that never goes, or speeds up, faster than this, m/s or m/s², shows nothing of what the robot can."""


class FidelityLimits(Record):
    """How near a run has to come to a recording to repeat it."""

    gap_m: float = 0.1
    """Difference of the smallest gap of the drive."""
    time_share: float = 0.05
    """Difference of the time to the end of the drive, as a share of the recorded one."""
    path_m: float = 0.5
    """Greatest distance of the path from the recorded one."""


class GapPair(Record):
    """The smallest gap to a person, m, and when, s; recorded and simulated."""

    person: str
    recorded_m: float
    simulated_m: float
    recorded_s: float
    simulated_s: float
    error_m: float
    """Standard error of the recorded gap, by those of the robot's and the person's places along the line of both."""


class Fidelity(Record):
    """How a simulated run differs from a recording of the same people."""

    seed: int
    time_s: tuple[float, float]
    """When the drive ends, as stories tell it, recorded and simulated."""
    path_m: float
    """The greatest distance of the simulated path from the recorded one."""
    gap_m: tuple[float, float] | None
    """The smallest gap of all people, recorded and simulated; None where nobody comes near."""
    gaps: tuple[GapPair, ...]
    events: dict[str, tuple[int, int]]
    """How often contacts, near misses, hard brakes and stops happen, recorded and simulated."""
    differences: tuple[str, ...]
    """What is beyond the limits, in words; without any the run repeats the recording."""
    contact: str = ""
    """Why the recording does not tell whether they touched, in words."""

    @property
    def repeats(self) -> bool:
        """Whether the run repeats the recording by the limits."""
        return not self.differences

    def __str__(self) -> str:
        return " ".join(self.differences) or "repeats the recording."


class RobotEstimate(Record):
    """A parameter of the robot that the recording shows otherwise than the robot file says."""

    parameter: str
    """As the robot file names it."""
    file: float
    recorded: float


def recorded_as(recording: Recording, run: Run) -> Run:
    """Return a cleaned recording as a run with the bodies, people and goal of a simulated one."""
    t = recording.robot[:, 0]
    people = {person.name: person for person in recording.people}
    tracks = [people[name].at(t, GAP_S) for name in run.human_names]
    places = np.nan_to_num(np.stack(tracks, axis=1), nan=-AWAY_M) if tracks else np.empty((len(t), 0, 2))
    speeds = [np.interp(t, people[n].rows[:, 0], people[n].rows[:, 4]) for n in run.human_names]
    yaws = [np.interp(t, people[n].rows[:, 0], np.unwrap(people[n].rows[:, 3])) for n in run.human_names]
    speed = speed_of(recording.robot)
    robot = recording.robot
    trajectory = Trajectory(
        t=t, x=robot[:, 1], y=robot[:, 2], yaw=robot[:, 3], v=np.copysign(speed, robot[:, 4]), omega=robot[:, 5],
        acceleration=np.abs(np.gradient(speed, t)), human_x=places[..., 0], human_y=places[..., 1],
        human_yaw=np.stack(yaws, axis=1) if yaws else np.empty((len(t), 0)),
        human_speed=np.stack(speeds, axis=1) if speeds else np.empty((len(t), 0)),
    )  # fmt: skip
    contacts = tuple(contact for contact in recording.contacts if contact.person in people)
    return dataclasses.replace(
        run, simulator="recording", options={"recording": recording.source}, trajectory=trajectory, log=trajectory,
        imu=np.empty(0), events=contacts, outcome=outcome_of(robot, run.goal, run.time_limit_s),
        details={"absent_at": dict.fromkeys(run.human_names, (-AWAY_M, -AWAY_M))}, recoveries=0,
    )  # fmt: skip


def compare(recording: Recording, run: Run, world: World, limits: FidelityLimits | None = None) -> Fidelity:
    """Return how a run differs from the cleaned recording that its scenario was made of."""
    limits = limits or FidelityLimits()
    recorded = recorded_as(recording, run)
    a, b = sampled(recorded, world), sampled(run, world)
    spreads = {
        person.name: math.hypot(person.spread_m, recording.spread_m) / math.sqrt(2) for person in recording.people
    }
    gaps = []
    for k, name in enumerate(run.human_names):
        rows = int(a.gap[:, k].argmin()), int(b.gap[:, k].argmin())
        (m, s), (now_m, now_s) = (
            (round(float(side.gap[row, k]), 3), round(float(side.series.t[row]), 2))
            for side, row in zip((a, b), rows, strict=True)
        )
        if min(m, now_m) <= NEAR_M:
            gaps.append(
                GapPair(
                    person=name, recorded_m=m, simulated_m=now_m, recorded_s=s, simulated_s=now_s,
                    error_m=round(spreads[name], 3),
                )
            )  # fmt: skip
    smallest = (min(g.recorded_m for g in gaps), min(g.simulated_m for g in gaps)) if gaps else None
    time_s = (round(float(recorded.trajectory.t[-1]), 2), round(float(run.trajectory.t[-1]), 2))
    path_m = round(_apart(run.trajectory, recorded.trajectory), 3)
    first, second = (Counter(COUNTED.get(type(e)) for e in events_of(side, world=world)) for side in (recorded, run))
    events = {name: (first[name], second[name]) for name in COUNTED.values()}
    said = []
    if smallest is not None and abs(smallest[0] - smallest[1]) > limits.gap_m:
        said.append(f"The smallest gap is {smallest[1]:.2f} m, recorded {smallest[0]:.2f} m.")
    if abs(time_s[0] - time_s[1]) > limits.time_share * time_s[0]:
        said.append(f"The drive takes {time_s[1]:.1f} s, recorded {time_s[0]:.1f} s.")
    if path_m > limits.path_m:
        said.append(f"The path leaves the recorded one by up to {path_m:.2f} m.")
    touched, touches = events[COUNTED[Contact]]
    near = min(gaps, key=lambda gap: gap.recorded_m, default=None)
    contact = ""
    if near is not None and abs(near.recorded_m) <= near.error_m and not recording.contacts:
        contact = f"Contact cannot be told: the recorded gap is {near.recorded_m:.2f} m ± {near.error_m:.2f} m."
    elif bool(touched) != bool(touches):
        said.append(f"The run has {counted(touches, 'contact')}, the recording {touched}.")
    return Fidelity(
        seed=run.seed, time_s=time_s, path_m=path_m, gap_m=smallest, gaps=tuple(gaps), events=events,
        differences=tuple(said), contact=contact,
    )  # fmt: skip


def _apart(path: Trajectory, other: Trajectory) -> float:
    """Return the greatest distance of a path from another, m, at whatever time."""
    from scipy.spatial import KDTree

    tree = KDTree(np.column_stack([other.x, other.y]))
    return float(tree.query(np.column_stack([path.x, path.y]))[0].max())


def estimates(recording: Recording, run: Run, robot: Robot) -> tuple[RobotEstimate, ...]:
    """Return what of a robot file differs from the recording: speed, acceleration and latency of the base.

    Speed and acceleration are those that both drives reach in one of twenty moments, so the same drive is compared.
    A simulated robot that does not arrive tells nothing; then they are told where the recording exceeds the robot file.
    """
    if len(recording.robot) < LEAST_COMMANDS:
        return ()
    pairs = [(rows[:, 0], speed_of(rows)) for rows in (recording.robot, np.column_stack(_path(run.trajectory)))]
    estimated = []
    for parameter, file, least, of in (
        ("limits.speed_m_s", robot.limits.speed_m_s, 0.1, _fast),
        ("limits.acceleration_m_s2", robot.limits.acceleration_m_s2, 0.3, _quick),
    ):
        measure: Callable[[Floats, Floats], float] = of
        recorded, simulated = (measure(*pair) for pair in pairs)
        if run.outcome is not Outcome.REACHED:
            simulated = min(file, recorded)
        if recorded > SHOWN and abs(recorded - simulated) > least * simulated:
            value = round(file * recorded / simulated, 2)
            estimated.append(RobotEstimate(parameter=parameter, file=file, recorded=value))
    latency_s = _latency(recording)
    if latency_s is not None and abs(latency_s - robot.latency_s) > 0.1:
        estimated.append(RobotEstimate(parameter="latency_s", file=robot.latency_s, recorded=round(latency_s, 2)))
    return tuple(estimated)


def _path(path: Trajectory) -> tuple[Floats, Floats, Floats]:
    return path.t, path.x, path.y


def _fast(t: Floats, speed: Floats) -> float:
    return max(1e-3, float(np.quantile(speed, 0.95)))


def _quick(t: Floats, speed: Floats) -> float:
    times = np.arange(t[0], t[-1] - FRESH_S, 0.05)
    change = np.interp(times + FRESH_S, t, speed) - np.interp(times, t, speed)
    return max(1e-3, float(np.quantile(change / FRESH_S, 0.98)))


def _latency(recording: Recording) -> float | None:
    """Return the delay with which the measured speed follows the commands best; None without commands."""
    commands, robot = recording.commands, recording.robot
    if len(commands) < LEAST_COMMANDS or float(np.ptp(commands[:, 1])) < 0.1:
        return None
    t = robot[:, 0]
    errors = [
        float(np.abs(robot[:, 4] - np.interp(t - delay, commands[:, 0], commands[:, 1])).mean())
        for delay in LATENCIES_S
    ]
    return float(LATENCIES_S[int(np.argmin(errors))])
