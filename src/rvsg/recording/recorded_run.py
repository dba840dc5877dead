"""The run of a recording, which is judged like a simulated one."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from rvsg.core.errors import FileError
from rvsg.core.records import text_id
from rvsg.evaluation.sampled import wrap
from rvsg.recording.tracks import GAP_S, Floats, Note, PersonTrack, Recording, gaps_of
from rvsg.simulation.archive import RunHeader
from rvsg.simulation.run import Outcome, Run, Trajectory
from rvsg.world.world import Route

SIDEWAYS_M_S = 0.02
"""Less lateral speed than this in an odometry is noise: the base does not move sideways."""
ARRIVES_M = 0.35
"""A robot that stops this near to the goal has arrived: Nav2's tolerance of 0.25 m, and the error of the poses."""
PERSON_RADIUS_M, ROBOT_RADIUS_M = 0.4, 0.35


def recorded_run(recording: Recording, route: Route | None = None) -> tuple[Run, tuple[Note, ...]]:
    """Return a recording as a run at the times of the robot's poses, and all notes on what it rests on.

    Args:
        route: its goal and time limit decide whether the robot arrived; by default those of the recording.

    Raises:
        FileError: the robot was not recorded, there is no goal, or people are on another clock than the robot.
    """
    notes = list(recording.notes)
    robot = recording.robot
    if len(robot) < 2:
        said = f"the recording holds {len(robot)} poses of the robot; at least two are needed."
        raise FileError(Path(recording.source), said)
    times = robot[:, 0]
    if said := _gaps(times):
        notes.append(Note(kind="gap", text=f"The robot's pose has {said}."))
    names = tuple(person.name for person in recording.people)
    humans = [_person(recording, person, times, notes) for person in recording.people]
    x, y, yaw, speed = np.stack(humans, axis=2) if humans else np.zeros((4, len(robot), 0))
    acceleration = recording.acceleration
    if not len(acceleration):
        notes.append(Note(kind="missing", text="The recording has no acceleration; it is that of the measured speed."))
        acceleration = np.column_stack([times, np.abs(np.gradient(robot[:, 4], times))])
    trajectory = Trajectory(
        t=times,
        x=robot[:, 1],
        y=robot[:, 2],
        yaw=robot[:, 3],
        v=robot[:, 4],
        omega=robot[:, 5],
        lateral=robot[:, 6] if np.abs(robot[:, 6]).max() > SIDEWAYS_M_S else np.empty(0),
        acceleration=np.interp(times, acceleration[:, 0], acceleration[:, 1]),
        human_x=x,
        human_y=y,
        human_yaw=yaw,
        human_speed=speed,
    )
    header = recording.header
    if header is not None:
        values = {name: getattr(header, name) for name in RunHeader.model_fields.keys() - {"same_log"}}
        log = recording.log or trajectory
        return Run(**values, trajectory=trajectory, log=log, imu=recording.imu), tuple(notes)
    notes.append(Note(kind="bodies", text=_bodies(recording.people)))
    goal, limit = _task(recording, route)
    if (outcome := outcome_of(robot, goal, limit)) is not Outcome.REACHED:
        away = math.dist(robot[-1, 1:3], goal[:2])
        notes.append(
            Note(kind="goal", text=f"The recording ends {away:.2f} m from the goal after {robot[-1, 0]:.1f} s.")
        )
    name = Path(recording.source).name
    run = Run(
        scenario_id=text_id("scenario", name),
        simulator="recording",
        options={"recording": name},
        seed=0,
        outcome=outcome,
        trajectory=trajectory,
        log=trajectory,
        imu=recording.imu,
        human_names=names,
        robot_radius_m=ROBOT_RADIUS_M,
        human_radius_m=tuple(PERSON_RADIUS_M if p.radius_m is None else p.radius_m for p in recording.people),
        goal=goal,
        time_limit_s=limit,
        human_groups=tuple(person.group for person in recording.people),
    )
    return run, tuple(notes)


def _person(recording: Recording, person: PersonTrack, times: Floats, notes: list[Note]) -> Floats:
    """Return x, y, yaw and speed of a person at the robot's times, (4, N)."""
    track, name = person.rows, person.name
    seen = track[:, 0]
    if seen[0] > times[-1] or seen[-1] < times[0]:
        raise FileError(
            Path(recording.source),
            f"the stamps of {name} are {seen[0] - times[0]:.0f} to {seen[-1] - times[0]:.0f} s after the robot's "
            f"first pose, and the robot is recorded for {times[-1] - times[0]:.0f} s. Both must use one clock: "
            "record with use_sim_time in all nodes, or in none.",
        )
    if seen[0] - times[0] > GAP_S or times[-1] - seen[-1] > GAP_S:
        said = (
            f"{name} is seen from {max(0.0, seen[0]):.1f} s to {seen[-1]:.1f} s only; before and after, the person "
            "is taken to stand at the nearest place seen."
        )
        notes.append(Note(kind="part", text=said, person=name))
    if said := _gaps(seen):
        text = f"{name} is not seen in {said}; there the person is taken to walk straight on."
        notes.append(Note(kind="gap", text=text, person=name))
    speed = track[:, 4]
    if np.isnan(speed).any():
        speed = speed_of(track) if len(track) > 1 else np.zeros(1)
    yaw = np.interp(times, seen, np.unwrap(np.nan_to_num(track[:, 3])))
    return np.stack(
        [
            np.interp(times, seen, track[:, 1]),
            np.interp(times, seen, track[:, 2]),
            wrap(yaw),
            np.interp(times, seen, np.nan_to_num(speed)),
        ]
    )


def speed_of(track: Floats) -> Floats:
    """Return the speed of a track, rows of time, x and y."""
    t, x, y = track[:, 0], track[:, 1], track[:, 2]
    return np.asarray(np.hypot(np.gradient(x, t), np.gradient(y, t)))


def _task(recording: Recording, route: Route | None) -> tuple[tuple[float, float, float], float]:
    """Return the goal in the world frame and the time limit."""
    if route is not None:
        return (route.goal.x, route.goal.y, route.goal.yaw), route.time_limit_s
    if recording.goal is None:
        said = "the recording holds no goal. Name the route the robot drove: --world and --route."
        raise FileError(Path(recording.source), said)
    return recording.goal, float(recording.robot[-1, 0]) + 1.0


def outcome_of(robot: Floats, goal: tuple[float, float, float], limit_s: float) -> Outcome:
    """Return how the recorded drive of a robot ends."""
    end_s = robot[-1, 0]
    if math.dist(robot[-1, 1:3], goal[:2]) <= ARRIVES_M and end_s <= limit_s:
        return Outcome.REACHED
    return Outcome.TIMED_OUT if end_s >= limit_s else Outcome.ABORTED


def _bodies(people: tuple[PersonTrack, ...]) -> str:
    """Say which bodies gaps are measured between; a recording holds no outline of the robot."""
    said = f"Gaps are measured from a disc with a radius of {ROBOT_RADIUS_M:g} m around the robot's pose"
    unknown = [person.name for person in people if person.radius_m is None]
    if unknown:
        who = "people" if len(unknown) == len(people) else ", ".join(unknown)
        said += f", to discs with a radius of {PERSON_RADIUS_M:g} m around {who}"
    return f"The recording does not hold the robot's outline. {said}."


def _gaps(times: Floats) -> str:
    """Say how many gaps there are and the longest; empty without any."""
    gaps = gaps_of(times)
    many = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    return f"{many} of more than {GAP_S:g} s (longest {max(gaps):.1f} s)" if len(gaps) else ""
