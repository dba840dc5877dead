"""Frames between RVSG and a stack in another process; docs/reference/stack-protocol.md describes every byte.

A frame is its length (4 bytes, unsigned, little-endian) and as many bytes, the first of which is its kind.
"""

from __future__ import annotations

import json
import os
import select
import struct
import time
from typing import Any, NamedTuple

import numpy as np

from rvsg.simulation.stacks.protocol import Command, LocalObservation, StackError, Task

PROTOCOLS = (1, 2)
"""Those that are spoken. From 2 on observations and answers have a speed to the left."""
LENGTH = struct.Struct("<I")
OBSERVATION = struct.Struct("<cId3d2d3d3d3d5I")
"""Kind, number, t, pose, velocity, goal, map_from_odom, origin and resolution of the costmap; then the numbers of plan
points, rows, columns, people and lidars. From protocol 2 on the measured speed to the left follows."""
TASK = struct.Struct("<cQ2d3d3dI")
"""Kind, seed, period, time limit, limits of the robot, start, number of goals."""
MAP = struct.Struct("<2I3d")
"""Rows, columns, resolution and origin of the map."""
SCAN = struct.Struct("<I6d")
"""Rays, t, bearing of the first ray, step, place x, y, yaw in the base."""
ANSWER = struct.Struct("<cIB2d")
"""Kind, number of the observation, status, v, w."""
LATERAL_ANSWER = struct.Struct("<cIB3d")
"""The same from protocol 2 on, with the speed to the left at the end."""
LATERAL = struct.Struct("<d")
NO_COMMAND, VELOCITY, REACHED, GAVE_UP = range(4)
LARGEST_ANSWER = 65_536
NO_PLAN, NO_CELLS, NOBODY = np.zeros((0, 2)), np.zeros((0, 0), np.uint8), np.zeros((0, 4))


class Wanted(NamedTuple):
    """What a stack wants to be told, by its answer to the hello."""

    scans: bool
    people: bool
    costmap: bool
    protocol: int = 1


def hello_frame(options: dict[str, Any]) -> bytes:
    """Return the first frame: the protocols that are spoken, and the options that are for the stack."""
    return b"H" + json.dumps({"protocol": PROTOCOLS[0], "protocols": PROTOCOLS, "options": options}).encode()


def task_frame(task: Task) -> bytes:
    """Return the frame that begins a run."""
    limits, occupancy = task.robot.limits, task.world.occupancy
    goals = [(pose.x, pose.y, pose.yaw) for pose in task.goals]
    cells = np.ascontiguousarray(occupancy.cells, np.uint8)
    robot = task.robot.model_dump_json().encode()
    head = TASK.pack(
        b"R", task.seed % 2**64, task.period_s, task.time_limit_s, limits.speed_m_s, limits.reverse_m_s,
        limits.yaw_rate_rad_s, task.start.x, task.start.y, task.start.yaw, len(goals),
    )  # fmt: skip
    origin = occupancy.origin
    return b"".join((
        head,
        np.array(goals, "<f8").tobytes(),
        LENGTH.pack(len(robot)),
        robot,
        MAP.pack(*cells.shape, occupancy.resolution, origin.x, origin.y),
        cells.tobytes(),
    ))  # fmt: skip


def observation_frame(number: int, seen: LocalObservation, lidars: int, wanted: Wanted, *, local: bool) -> bytes:
    """Return an observation as a frame."""
    plan = seen.plan if local else NO_PLAN
    cells = seen.costmap.cells if local and wanted.costmap else NO_CELLS
    people = seen.people() if wanted.people else NOBODY
    scans = [seen.scan(k) for k in range(lidars)] if wanted.scans else []
    parts = [
        OBSERVATION.pack(
            b"O", number, seen.t, *seen.pose, *seen.velocity, *seen.goal, *seen.map_from_odom, seen.costmap.origin_x,
            seen.costmap.origin_y, seen.costmap.resolution, len(plan), *cells.shape, len(people), len(scans),
        ),
        LATERAL.pack(seen.lateral) if wanted.protocol > 1 else b"",
        plan.astype("<f4").tobytes(),
        cells.tobytes(),
        people.astype("<f4").tobytes(),
    ]  # fmt: skip
    for scan in scans:
        parts.append(
            SCAN.pack(len(scan.ranges), scan.t, scan.angle_min, scan.angle_increment, scan.x, scan.y, scan.yaw)
        )
        parts.append(scan.ranges.astype("<f4").tobytes())
    return b"".join(parts)


def read_hello(frame: bytes) -> Wanted:
    """Return what the answer to the hello asks for; StackError where it is no such answer."""
    try:
        if frame[:1] != b"H":
            raise ValueError(f"it begins with {frame[:1]!r}")
        told = json.loads(frame[1:])
        version = told["protocol"]
    except (ValueError, TypeError, KeyError) as error:
        raise StackError(
            f"its answer to the hello is not one ({error}); expected H and JSON with protocol", code="stack-hello"
        ) from None
    if isinstance(version, bool) or version not in PROTOCOLS:
        spoken = " and ".join(map(str, PROTOCOLS))
        raise StackError(
            f"it speaks protocol {version!r:.40}, this version of RVSG speaks {spoken}", code="stack-protocol"
        )
    scans, people, costmap = (bool(told.get(key, True)) for key in ("scans", "people", "costmap"))
    return Wanted(scans, people, costmap, int(version))


def read_answer(frame: bytes, number: int, protocol: int = 1) -> tuple[int, Command]:
    """Return status and velocity of the answer to an observation; StackError where it is no such answer."""
    answer = ANSWER if protocol == 1 else LATERAL_ANSWER
    if len(frame) != answer.size or frame[:1] != b"V":
        raise StackError(
            f"it answered {len(frame)} bytes {frame[:12]!r}; expected {answer.size} that begin with V",
            code="stack-answer",
        )
    _, of, status, v, w, *lateral = answer.unpack(frame)
    if of != number:
        raise StackError(
            f"it answered observation {of}, but was asked {number}; send one answer for each observation",
            code="stack-answer",
        )
    if status > GAVE_UP:
        raise StackError(f"it answered with the status {status}; expected 0 to {GAVE_UP}", code="stack-answer")
    return status, (v, *lateral, w)


class Channel:
    """Frames over two file descriptors, with a time limit for each; it takes them over.

    A frame takes one write, and an answer one wait and one read, where the operating system passes them on whole.
    """

    def __init__(self, reads: int, writes: int) -> None:
        self.reads, self.writes = reads, writes
        self._rest = b""
        """What was read beyond the last answer."""
        for descriptor in {reads, writes}:
            os.set_blocking(descriptor, False)

    def send(self, frame: bytes, limit_s: float) -> None:
        """Write a frame.

        Raises:
            StackError: the other side is gone, does not read, or writes on and on without being asked.
        """
        data = memoryview(LENGTH.pack(len(frame)) + frame)
        until = time.monotonic() + limit_s
        while data:
            try:
                data = data[os.write(self.writes, data) :]
            except BlockingIOError:
                left = max(0.0, until - time.monotonic())
                flooded, ready, _ = select.select([self.reads], [self.writes], [], left)
                if flooded and not ready:
                    self._take_unasked()
                elif not ready:
                    raise StackError(f"it did not read within {limit_s:g} s", code="stack-late") from None
            except OSError as error:
                raise StackError("it ended", code="stack-ended") from error

    def _take_unasked(self) -> None:
        """Keep what the other side writes before it has read the question; an early answer is none, a flood ends it."""
        try:
            part = os.read(self.reads, LARGEST_ANSWER)
        except OSError as error:
            raise StackError("it ended", code="stack-ended") from error
        if not part:
            raise StackError("it ended", code="stack-ended")
        self._rest += part
        if len(self._rest) > LARGEST_ANSWER + LENGTH.size:
            raise StackError(
                f"it wrote {len(self._rest)} bytes without being asked, before it read the question. Does it print to "
                "standard output? Print to standard error.",
                code="stack-unasked",
            )

    def receive(self, limit_s: float) -> bytes:
        """Read a frame.

        Raises:
            StackError: the other side is gone, does not answer, or floods.
        """
        until = time.monotonic() + limit_s
        self._read(LENGTH.size, until, limit_s)
        (size,) = LENGTH.unpack_from(self._rest)
        if not 0 < size <= LARGEST_ANSWER:
            self._rest = b""
            raise StackError(
                f"it announced an answer of {size} bytes, at most {LARGEST_ANSWER} are read. Does it print to standard "
                "output? Print to standard error.",
                code="stack-answer",
            )
        end = LENGTH.size + size
        self._read(end, until, limit_s)
        frame, self._rest = self._rest[LENGTH.size : end], self._rest[end:]
        return frame

    def _read(self, size: int, until: float, limit_s: float) -> None:
        """Read until `size` bytes are there."""
        while len(self._rest) < size:
            if not select.select([self.reads], [], [], max(0.0, until - time.monotonic()))[0]:
                raise StackError(f"it did not answer within {limit_s:g} s", code="stack-late")
            try:
                part = os.read(self.reads, LARGEST_ANSWER)
            except BlockingIOError:
                continue
            except OSError as error:
                raise StackError("it ended", code="stack-ended") from error
            if not part:
                raise StackError(
                    "it ended in the middle of an answer" if self._rest else "it ended", code="stack-ended"
                )
            self._rest += part
