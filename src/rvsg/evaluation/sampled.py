"""A run seen through one of its two series, with the derived signals that metrics share, each computed once.

Every run has two series. `trajectory` holds our own samples, one per control tick (20 Hz); metrics read it unless
their name ends in `_logged`. `log` holds the rows (about 2 Hz, wall clock) that the client of the published study
would have written; the `_logged` metrics read it, so that their values compare with published ones. An imported run
has only the log, and its trajectory is the log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rvsg.robots.polygons import edges
from rvsg.simulation.events import Contact
from rvsg.simulation.run import Run, Trajectory
from rvsg.world.space import driving_space, human_space
from rvsg.world.world import World

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

STILL_SPEED_M_S = 0.01
STILL_TURN_RAD_S = 0.02
CONTACT_GAP_M = 0.02
CONTACT_APART_S = 0.5
"""Contacts with one person with less time between them are one contact."""
GROUP_SPACE_AHEAD_M = 1.5
ABSENT_M = 1.0
"""Who is nearer than this to where absent people stand is absent."""
OUTLINE_STEP_M = 0.05
"""Two outlines are compared at points this far apart along each."""


def wrap(angle: Floats) -> Floats:
    """Bring angles into [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def stretches(flags: Flags) -> list[tuple[int, int]]:
    """Return the first and the last index of each stretch of True in (N,) flags."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    return [(int(a), int(b) - 1) for a, b in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True)]


def joined(spans: Sequence[tuple[int, int]], t: Floats, apart_s: float) -> list[tuple[int, int]]:
    """Join stretches with less than `apart_s` seconds between them; `t` (N,) are the times of the samples."""
    result: list[tuple[int, int]] = []
    for first, last in spans:
        if result and t[first] - t[result[-1][1]] < apart_s:
            result[-1] = (result[-1][0], last)
        else:
            result.append((first, last))
    return result


@dataclass(frozen=True)
class Touch:
    """A contact of the robot with the human of that index, from sample `first` to `last`."""

    person: int
    first: int
    last: int
    recorded: Contact | None = None
    """What the simulator recorded of it."""


def _outline_distance(outline: Sequence[tuple[float, float]], x: Floats, y: Floats) -> Floats:
    """Return the signed distance of points in the robot's frame from its outline; negative inside."""
    best: Floats = np.full(x.shape, np.inf)
    inside: Flags = np.zeros(x.shape, dtype=np.bool_)
    for (ax, ay), (bx, by) in edges(outline):
        ex, ey = bx - ax, by - ay
        share = np.clip(((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey), 0.0, 1.0)
        best = np.minimum(best, np.hypot(x - ax - share * ex, y - ay - share * ey))
        if ay != by:
            inside ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) / (by - ay) * ex)
    signed: Floats = np.where(inside, -best, best)
    return signed


def outline_gap(
    robot: Sequence[tuple[float, float]], radius_m: float, yaw: Floats, outline: Sequence[tuple[float, float]],
    dx: Floats, dy: Floats, turn: Floats,
) -> Floats:  # fmt: skip
    """Return the gap between the robot and an outline at N samples, metres; negative where they overlap.

    Args:
        robot: The robot's outline in its frame; empty: a disc of `radius_m`.
        yaw: The robot's yaw (N,).
        outline: Corners in the frame of a person.
        dx, dy, turn: Offset of the person from the robot, and the person's yaw (N,).
    """
    ahead, left = _turned(-dx, -dy, -turn)
    if not robot:
        return _outline_distance(outline, ahead, left) - radius_m
    ours = _outline_distance(outline, *_placed(_along(robot), ahead, left, yaw - turn)).min(axis=1)
    ahead, left = _turned(dx, dy, -yaw)
    theirs = _outline_distance(robot, *_placed(_along(outline), ahead, left, turn - yaw)).min(axis=1)
    gap: Floats = np.minimum(theirs, ours)
    return gap


def _turned(x: Floats, y: Floats, angle: Floats) -> tuple[Floats, Floats]:
    cos, sin = np.cos(angle), np.sin(angle)
    return x * cos - y * sin, x * sin + y * cos


def _placed(points: Floats, x: Floats, y: Floats, angle: Floats) -> tuple[Floats, Floats]:
    """Return points (K, 2) of a body's frame at its N poses: x and y (N, K)."""
    px, py = _turned(points[:, 0], points[:, 1], angle[:, None])
    return x[:, None] + px, y[:, None] + py


def _along(outline: Sequence[tuple[float, float]]) -> Floats:
    """Return points every 5 cm along an outline, its corners among them (K, 2)."""
    points = []
    for (ax, ay), (bx, by) in edges(outline):
        shares = np.linspace(0.0, 1.0, max(2, int(np.hypot(bx - ax, by - ay) / OUTLINE_STEP_M) + 2))[:-1, None]
        points.append(np.array([[ax, ay]]) + shares * np.array([[bx - ax, by - ay]]))
    return np.concatenate(points)


@dataclass(frozen=True, eq=False)
class Sampled:
    """One series of one run: N samples, H humans. Everything below is in SI units and the world frame.

    Without its `world` nothing is known of distances to what stands still.
    """

    run: Run
    series: Trajectory
    world: World | None = None

    def __len__(self) -> int:
        return len(self.series)

    @property
    def people(self) -> int:
        """The number of humans; 0 where there is no sample to see them in."""
        return int(self.series.human_x.shape[1]) if len(self) else 0

    @cached_property
    def dt(self) -> Floats:
        """(N-1,) seconds between samples."""
        return np.diff(self.series.t)

    @property
    def duration_s(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.series.t[-1] - self.series.t[0]) if len(self) else 0.0

    @cached_property
    def steps(self) -> Floats:
        """(N-1,) metres the robot moved between samples."""
        return np.hypot(np.diff(self.series.x), np.diff(self.series.y))

    @cached_property
    def turns(self) -> Floats:
        """(N-1,) radians the robot turned between samples, signed, the short way round."""
        return wrap(np.diff(self.series.yaw))

    @cached_property
    def offset(self) -> tuple[Floats, Floats]:
        """(N, H) twice: x and y from the robot to each human, metres."""
        s = self.series
        return s.human_x - s.x[:, None], s.human_y - s.y[:, None]

    @cached_property
    def distance(self) -> Floats:
        """(N, H) metres between the centres of robot and human."""
        return np.hypot(*self.offset)

    @cached_property
    def present(self) -> Flags:
        """(N, H) whether each human is there; who is absent stands far outside of the map and counts in no mean."""
        flags: Flags = np.ones((len(self), self.people), dtype=np.bool_)
        for name, (x, y) in self.run.absent_at.items() if self.people else ():
            k = self.run.human_names.index(name)
            flags[:, k] = np.hypot(self.series.human_x[:, k] - x, self.series.human_y[:, k] - y) > ABSENT_M
        return flags

    @cached_property
    def nearest_distance(self) -> Floats:
        """(N,) metres from the robot's centre to the nearest centre of a human; NaN where nobody is there."""
        nearest: Floats = self.distance.min(axis=1)
        return np.where(self.present.any(axis=1), nearest, np.nan)

    @cached_property
    def disc_gap(self) -> Floats:
        """(N, H) metres between the discs of robot and human, as in the study; negative where they overlap."""
        gap: Floats = self.distance - self.run.robot_radius_m - np.asarray(self.run.human_radius_m)[None, :]
        return gap

    @cached_property
    def gap(self) -> Floats:
        """(N, H) metres between the bodies of robot and human; negative where they overlap.

        The robot's body is its outline where the run knows it, else a disc; a human's is a disc, with what the human
        sits in or pushes.
        """
        s, (dx, dy) = self.series, self.offset
        if not self.people or not (self.run.robot_outline or any(self.run.human_outlines)):
            return self.disc_gap
        of = (self.gap_of(h, s.yaw, dx[:, h], dy[:, h], s.human_yaw[:, h]) for h in range(self.people))
        return np.stack([*of], axis=1)

    def gap_of(self, person: int, yaw: Floats, dx: Floats, dy: Floats, turn: Floats) -> Floats:
        """Return the gap between the robot's body and a human's at N poses, metres.

        Args:
            person: Index of the human.
            yaw: The robot's yaw (N,).
            dx, dy, turn: Offset of the human from the robot, and the human's yaw (N,).
        """
        run = self.run
        away = np.hypot(dx, dy) - run.robot_radius_m
        if run.robot_outline:
            cos, sin = np.cos(yaw), np.sin(yaw)
            away = _outline_distance(run.robot_outline, dx * cos + dy * sin, dy * cos - dx * sin)
        gap: Floats = away - run.human_radius_m[person]
        pushed = run.human_outlines[person] if any(run.human_outlines) else ()
        if not pushed:
            return gap
        return np.minimum(gap, outline_gap(run.robot_outline, run.robot_radius_m, yaw, pushed, dx, dy, turn))

    @cached_property
    def contacts(self) -> list[Touch]:
        """Contacts of the robot with people; those with one person less than 0.5 s apart count as one.

        A simulator that keeps bodies apart records them; else they are the times at which bodies overlap.
        """
        if not self.people:
            return []
        if self._contacts_are_recorded:
            return self._recorded_contacts()
        return [
            Touch(person, first, last)
            for person in range(self.people)
            for first, last in joined(stretches(self.gap[:, person] <= 0.0), self.series.t, CONTACT_APART_S)
        ]

    @property
    def _contacts_are_recorded(self) -> bool:
        """Whether the events of the run hold its contacts; most recordings do not measure them."""
        if self.run.simulator == "recording":
            return any(isinstance(event, Contact) for event in self.run.events)
        return bool(self.run.robot_outline)

    def _recorded_contacts(self) -> list[Touch]:
        touches, t = [], self.series.t
        for event in self.run.events:
            if isinstance(event, Contact) and event.time_s <= t[-1] + 1e-9:
                first = min(int(np.searchsorted(t, event.time_s - 1e-9)), len(t) - 1)
                last = max(first, int(np.searchsorted(t, event.until_s + 1e-9, side="right")) - 1)
                touches.append(Touch(self.run.human_names.index(event.person), first, last, event))
        return touches

    @cached_property
    def touching(self) -> Flags:
        """(N, H) whether the robot touches each human."""
        flags: Flags = self.gap <= 0.0
        if not self._contacts_are_recorded:
            return flags
        flags = np.zeros((len(self), self.people), dtype=np.bool_)
        for touch in self.contacts:
            flags[touch.first : touch.last + 1, touch.person] = True
        return flags

    @cached_property
    def closest_gap(self) -> Floats:
        """(N,) the smallest gap over the humans."""
        closest: Floats = self.gap.min(axis=1)
        return closest

    @cached_property
    def clamped_gap(self) -> Floats:
        """(N,) the smallest gap between discs, 0 where they overlap."""
        clamped: Floats = np.maximum(self.disc_gap.min(axis=1), 0.0)
        return clamped

    @cached_property
    def closest(self) -> NDArray[np.intp]:
        """(N,) the index of the human whose centre is nearest."""
        index: NDArray[np.intp] = self.distance.argmin(axis=1)
        return index

    @cached_property
    def still(self) -> Flags:
        """(N,) whether the robot neither drives nor turns: |v| < 0.01 m/s and |omega| < 0.02 rad/s."""
        s = self.series
        return (s.speed < STILL_SPEED_M_S) & (np.abs(s.omega) < STILL_TURN_RAD_S)

    @cached_property
    def stops(self) -> list[tuple[int, int]]:
        """The first and the last sample of each time in which the robot, once it has moved, stands still."""
        return [span for span in stretches(self.still) if span[0] > 0] if len(self) else []

    @cached_property
    def closest_approach(self) -> tuple[int, int] | None:
        """The sample and the human with the smallest gap of all, the first of equals; None without people."""
        if not self.people:
            return None
        row, human = np.unravel_index(int(self.gap.argmin()), self.gap.shape)
        return int(row), int(human)

    @cached_property
    def bearing_of_robot(self) -> Floats:
        """(N, H) |angle| at which a human sees the robot off his own heading, radians."""
        dx, dy = self.offset
        return np.abs(wrap(np.arctan2(-dy, -dx) - self.series.human_yaw))

    @cached_property
    def bearing_of_human(self) -> Floats:
        """(N, H) |angle| at which the robot sees a human off its heading, radians."""
        dx, dy = self.offset
        return np.abs(wrap(np.arctan2(dy, dx) - self.series.yaw[:, None]))

    @cached_property
    def near_contact(self) -> Flags:
        """(N, H) the study's contact: a gap between discs under 0.02 m."""
        return self.disc_gap < CONTACT_GAP_M

    @cached_property
    def robot_velocity(self) -> tuple[Floats, Floats]:
        """(N,) twice: the robot's velocity in the world frame, m/s."""
        s = self.series
        if s.lateral.size:
            cos, sin = np.cos(s.yaw), np.sin(s.yaw)
            return s.v * cos - s.lateral * sin, s.v * sin + s.lateral * cos
        return s.v * np.cos(s.yaw), s.v * np.sin(s.yaw)

    @cached_property
    def human_velocity(self) -> tuple[Floats, Floats]:
        """(N, H) twice: the humans' velocities in the world frame, m/s (they walk along their heading)."""
        s = self.series
        return s.human_speed * np.cos(s.human_yaw), s.human_speed * np.sin(s.human_yaw)

    @cached_property
    def closing_speed(self) -> Floats:
        """(N, H) m/s at which robot and human approach each other along the line between them; negative apart."""
        dx, dy = self.offset
        rx, ry = self.robot_velocity
        hx, hy = self.human_velocity
        distance = np.where(self.distance > 1e-9, self.distance, 1.0)
        return ((rx[:, None] - hx) * dx + (ry[:, None] - hy) * dy) / distance

    @cached_property
    def relative_speed(self) -> Floats:
        """(N, H) m/s of the velocity of the robot relative to the human."""
        rx, ry = self.robot_velocity
        hx, hy = self.human_velocity
        return np.hypot(rx[:, None] - hx, ry[:, None] - hy)

    @cached_property
    def acceleration(self) -> tuple[Floats, Floats]:
        """(N-1,) twice: the robot's mean acceleration per interval along and across its heading, m/s^2.

        Along: change of speed over time. Across: mean speed times mean turn rate. Likewise for lateral motion.
        """
        s = self.series
        along, across = np.diff(s.v) / self.dt, (s.v[1:] + s.v[:-1]) / 2 * self.turns / self.dt
        if s.lateral.size:
            along = along - (s.lateral[1:] + s.lateral[:-1]) / 2 * self.turns / self.dt
            across = across + np.diff(s.lateral) / self.dt
        return along, across

    @cached_property
    def obstacle_distance(self) -> Floats | None:
        """(N,) metres from the robot's centre to the nearest obstacle; None where the world is unknown.

        The obstacles are what the robot's map shows, objects that were moved, and doors that stand still.
        """
        if self.world is None:
            return None
        return driving_space(self.world).clearances(np.stack([self.series.x, self.series.y], axis=1))

    @cached_property
    def human_obstacle_distance(self) -> Floats | None:
        """(N, H) metres from each human's centre to the nearest obstacle for people; None where the world is unknown.

        The obstacles are the objects' footprints and what the map shows; the robot is none of them.
        """
        if self.world is None:
            return None
        return human_space(self.world).clearances(np.stack([self.series.human_x, self.series.human_y], axis=2))

    @cached_property
    def group_distance(self) -> Floats | None:
        """(N,) metres from the robot's edge to the nearest centre of a group of two or more; None without groups.

        The centre of a group is the mean over its members of the point 1.5 m ahead of each: the space they share.
        """
        if not self.people:
            return None
        numbers = self.run.human_groups
        members = [[i for i, number in enumerate(numbers) if number == group] for group in set(numbers) - {None}]
        groups = [who for who in members if len(who) > 1]
        if not groups:
            return None
        s = self.series
        ahead_x = s.human_x + GROUP_SPACE_AHEAD_M * np.cos(s.human_yaw)
        ahead_y = s.human_y + GROUP_SPACE_AHEAD_M * np.sin(s.human_yaw)
        distances = [np.hypot(s.x - ahead_x[:, who].mean(axis=1), s.y - ahead_y[:, who].mean(axis=1)) for who in groups]
        return np.asarray(np.min(distances, axis=0) - self.run.robot_radius_m)

    @cached_property
    def goal_distance(self) -> Floats:
        """(N,) metres from the robot's centre to the goal."""
        goal_x, goal_y, _ = self.run.goal
        return np.hypot(self.series.x - goal_x, self.series.y - goal_y)


@lru_cache(maxsize=32)
def sampled(run: Run, world: World | None = None) -> Sampled:
    """Return a run seen through its trajectory.

    The latest are kept: descriptions of a run ask for its signals again and again, and the gap between outlines is
    expensive.
    """
    return Sampled(run, run.trajectory, world)
