"""The stack `ros2`: a ROS 2 navigation system of the user's, driven over DDS at a multiple of real time."""

from __future__ import annotations

import atexit
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

from rvsg.core.errors import SimulationError
from rvsg.core.records import text_id
from rvsg.simulation.stacks.protocol import Command, Ended, Observation, StackError, Task, WholeStack
from rvsg_ros2.options import read_options
from rvsg_ros2.running import STEP_S, Running, wait
from rvsg_ros2.session import Session

VERSION = "2"
"""2: commands act within 0.01 s of simulated time, 0.02 s before."""
MISSED_SHARE = 0.02
"""A larger share of missed control periods lowers the speed of the runs that follow."""
REACHED_SHARE = 0.85
"""A smaller share of the speed asked for does so, too: a system whose rates are scaled for it runs them too fast."""
SLOWER = 0.75


class Ros2Stack(WholeStack):
    """The user's running or launched ROS 2 navigation. Runs are not repeatable bit for bit: the seed is a run number.

    Options are those of `rvsg_ros2.options.Ros2Options`.
    """

    name: ClassVar[str] = "ros2"
    title: ClassVar[str] = "your own ROS 2 navigation (Nav2), running or launched, over DDS"
    version: str = "1"
    repeatable: ClassVar[bool] = False
    """Whether equal seeds give equal runs."""
    answer_time_s: ClassVar[float | None] = None
    """No limit of the caller's own: this stack keeps time itself."""

    def __init__(self, **options: Any) -> None:
        self._options = read_options(options)
        self.version = _version(self._options.params)
        self._clear()

    def _clear(self) -> None:
        self._speed = self._options.speed
        self._session: Session | None = None
        self._tell: Callable[[str], None] = _ignore
        self._task: Task | None = None
        self._run: Running | None = None
        self._restart = False

    def __getstate__(self) -> dict[str, Any]:
        """Close the connection: the copy makes its own where it is used."""
        self.close()
        return {"_options": self._options, "version": self.version}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._options, self.version = state["_options"], state["version"]
        self._clear()

    @property
    def options(self) -> Mapping[str, Any]:
        """The effective options."""
        return self._options.model_dump(mode="json")

    @property
    def period_s(self) -> float:
        """Simulated time between two steps."""
        return STEP_S

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Find the running system or start it, so that what is missing is said before the first run.

        Raises:
            InputError, SimulationError: see `Session`.
        """
        self._tell = tell
        if self._session is not None:
            return
        self._open()
        assert self._session is not None
        try:
            self._session.find(wait)
        except BaseException:
            self.close()
            raise
        self._say_what_is_scaled(tell)

    def _open(self) -> Session:
        self._session = Session(self._options, self._speed, self._tell)
        atexit.register(self.close)
        return self._session

    def _say_what_is_scaled(self, tell: Callable[[str], None]) -> None:
        assert self._session is not None
        scaled = self._session.scaled
        if scaled is not None and self._speed != 1.0:
            for change in scaled.changes:
                tell(f"speed {self._speed:g}: {change}")
            for note in scaled.notes:
                tell(f"speed {self._speed:g}: {note}")
        elif self._speed != 1.0:
            tell(
                f"speed {self._speed:g}: the running system keeps its parameters. Start it with those that "
                "`rvsg ros2 params` prints, or its loops run too slowly."
            )

    def reset(self, task: Task) -> None:
        """Keep the task; the system is made ready in the first step, where the robot's sensors are known."""
        if self._run is not None:
            self.finish()
        self._task = task

    def step(self, seen: Observation) -> Command | Ended | None:
        """Send the sensors, keep pace, and return the newest velocity or how the goal ended."""
        try:
            if self._run is None:
                assert self._task is not None
                self._run = self._begin(self._task, seen)
            return self._run.step(seen)
        except SimulationError as error:
            raise StackError(str(error)) from error

    def _begin(self, task: Task, seen: Observation) -> Running:
        if self._session is not None and (self._restart or self._options.restart):
            self._session.close()
            self._session = None
        self._restart = False
        session = self._session or self._open()
        try:
            return Running(session, task, seen)
        except BaseException:
            if session.launched is not None:
                self.close()  # a system that did not get ready is started again for the next run
            raise

    def finish(self) -> Mapping[str, Any]:
        """End the goal and let other processes use the system; return what there is to tell of the run."""
        if self._run is None:
            return {}
        running, self._run = self._run, None
        facts = running.finish()
        too_slow = facts["speed"] < REACHED_SHARE * self._speed
        if (running.record.missed_share > MISSED_SHARE or too_slow) and self._speed > 1.0:
            reached = facts["speed"] if too_slow else self._speed
            self._speed = max(1.0, min(reached, self._speed * SLOWER))
            self._restart = self._options.launch is not None
            facts["speed_of_next_runs"] = self._speed
            if self._session is not None:
                self._session.speed = self._speed
        if running.record.failed and self._options.launch is not None:
            self._restart = True
        return facts

    def close(self) -> None:
        """Disconnect, and end the system where it was launched."""
        if self._run is not None:
            self.finish()
        if self._session is not None:
            self._session.close()
            self._session = None
        atexit.unregister(self.close)


def _version(params: str | None) -> str:
    """Return the version of this stack, with the content of the parameter file."""
    if params is None:
        return VERSION
    return f"{VERSION}+{text_id('params', Path(params).read_text()).removeprefix('params-')}"


def _ignore(_: str) -> None:
    pass
