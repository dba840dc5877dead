"""A navigation stack in another process, for RVSG. Copy this file beside your planner; it needs Python alone.

    import rvsg_client

    class MyPlanner(rvsg_client.Planner):
        def command(self, seen):
            return 0.3, 0.0

    rvsg_client.serve(MyPlanner())

Run it with: rvsg simulate best_scenario.json --stack "exec:python3 my_planner.py"
"""

import json
import os
import struct
import sys
from array import array

_OBSERVATION = struct.Struct("<cId3d2d3d3d3d5I")
_TASK = struct.Struct("<cQ2d3d3dI")
_MAP = struct.Struct("<2I3d")
_SCAN = struct.Struct("<I6d")
REACHED, GAVE_UP = "reached", "gave up"
"""What `command` of a whole stack (exec-stack:) returns when it is done."""


class Planner:
    """Derive your planner from this class. Metres, seconds, radians."""

    scans = people = costmap = True  # set to False what you do not read: it is not sent then
    tunable = ()  # what `rvsg tune` may change: {"name": "gain", "low": 0.5, "high": 4.0, "present": 2.0}

    def hello(self, parameters):
        """Receive the parameters of `--stack-option parameters=...`, once for a process."""

    def reset(self, task):
        """Begin a run: `task` has seed, period, time_limit, limits, start, goals, robot (a dict), map."""

    def command(self, seen):
        """Return (v, w), or (vx, vy, wz) for a base that moves sideways, or None for no valid command."""
        raise NotImplementedError


class _Values:
    def __init__(self, **values):
        self.__dict__.update(values)


def serve(planner, read=None, write=None):
    """Answer until the other side closes. `print` goes to standard error meanwhile."""
    reads = sys.stdin.fileno() if read is None else read
    writes = os.dup(sys.stdout.fileno()) if write is None else write
    if write is None:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    waiting = bytearray()
    protocol = 1
    while True:
        frame = _frame(reads, waiting)
        if frame is None or frame[:1] == b"Q":
            return
        if frame[:1] == b"H":
            hello = json.loads(frame[1:])
            planner.hello(hello["options"])
            protocol = max(set(hello.get("protocols", [1])) & {1, 2})
            wants = {
                "scans": planner.scans,
                "people": planner.people,
                "costmap": planner.costmap,
                "tunable": list(planner.tunable),
            }
            _send(writes, b"H" + json.dumps({"protocol": protocol, **wants}).encode())
        elif frame[:1] == b"R":
            planner.reset(_task(frame))
            _send(writes, b"R")
        elif frame[:1] == b"O":
            number, seen = _observation(frame, protocol)
            _send(writes, _answer(number, planner.command(seen), protocol))


def _answer(number, given, protocol):
    status, values = 1, given
    if given is None or given in (REACHED, GAVE_UP):
        status, values = {None: 0, REACHED: 2, GAVE_UP: 3}[given], (0.0, 0.0)
    v, side, w = values if len(values) == 3 else (values[0], 0.0, values[1])
    if protocol == 1:
        return struct.pack("<cIB2d", b"V", number, status, v, w)
    return struct.pack("<cIB3d", b"V", number, status, v, w, side)


def _task(frame):
    _, seed, period, limit, speed, reverse, turn, x, y, yaw, count = _TASK.unpack_from(frame)
    at = _TASK.size
    goals = [struct.unpack_from("<3d", frame, at + 24 * k) for k in range(count)]
    at += 24 * count
    (size,) = struct.unpack_from("<I", frame, at)
    robot = json.loads(frame[at + 4 : at + 4 + size])
    at += 4 + size
    rows, columns, resolution, origin_x, origin_y = _MAP.unpack_from(frame, at)
    cells = frame[at + _MAP.size :]
    world = _Values(rows=rows, columns=columns, resolution=resolution, origin=(origin_x, origin_y), cells=cells)
    return _Values(seed=seed, period=period, time_limit=limit, limits=(speed, reverse, turn), start=(x, y, yaw),
                   goals=goals, robot=robot, map=world)  # fmt: skip


def _observation(frame, protocol):
    values = _OBSERVATION.unpack_from(frame)
    points, rows, columns, persons, lidars = values[17:]
    at = _OBSERVATION.size
    lateral = 0.0
    if protocol > 1:
        (lateral,) = struct.unpack_from("<d", frame, at)
        at += 8
    plan, at = _floats(frame, at, 2 * points)
    cells, at = frame[at : at + rows * columns], at + rows * columns
    people, at = _floats(frame, at, 4 * persons)
    scans = []
    for _ in range(lidars):
        rays, t, angle_min, step, x, y, yaw = _SCAN.unpack_from(frame, at)
        ranges, at = _floats(frame, at + _SCAN.size, rays)
        scans.append(_Values(t=t, angle_min=angle_min, angle_increment=step, x=x, y=y, yaw=yaw, ranges=ranges))
    costmap = _Values(rows=rows, columns=columns, cells=cells, origin=values[14:16], resolution=values[16])
    return values[1], _Values(
        t=values[2], pose=values[3:6], velocity=values[6:8], lateral=lateral, goal=values[8:11],
        map_from_odom=values[11:14],
        plan=list(zip(plan[::2], plan[1::2])), costmap=costmap, scans=scans,
        people=[tuple(people[4 * k : 4 * k + 4]) for k in range(persons)],
    )  # fmt: skip


def _floats(frame, at, count):
    values = array("f")
    values.frombytes(frame[at : at + 4 * count])
    if sys.byteorder == "big":
        values.byteswap()
    return values, at + 4 * count


def _frame(reads, waiting):
    """Return the next frame, None at the end; `waiting` holds what was read beyond it."""
    while True:
        if len(waiting) >= 4:
            end = 4 + struct.unpack_from("<I", waiting)[0]
            if len(waiting) >= end:
                frame = bytes(waiting[4:end])
                del waiting[:end]
                return frame
        part = os.read(reads, 1 << 20)
        if not part:
            return None
        waiting += part


def _send(writes, frame):
    data = struct.pack("<I", len(frame)) + frame
    while data:
        data = data[os.write(writes, data) :]
