"""The Run: what happened in one simulation of a scenario, or what was recorded of one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import content_id
from rvsg.simulation.events import Outcome as Outcome
from rvsg.simulation.events import RecordedEvent

Floats = NDArray[np.float64]


def run_id(scenario_id: str, simulator: str, options: Mapping[str, object], seed: int) -> str:
    """Return the content id of a run, which is known before it is simulated, so that no run is simulated twice."""
    return content_id("run", {"scenario": scenario_id, "simulator": simulator, "options": dict(options), "seed": seed})


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Robot and humans over time. N samples, H humans; SI units, world frame.

    `t` (N,) s since the start; `x`, `y`, `yaw` (N,) robot pose; `v`, `omega` (N,) robot forward speed and yaw
    rate; `acceleration` (N,) horizontal acceleration magnitude as an inertial sensor shows it;
    `human_x`, `human_y`, `human_yaw`, `human_speed` (N, H); `lateral` (N,) the robot's speed to its left, empty where
    its base does not move sideways.
    """

    t: Floats
    x: Floats
    y: Floats
    yaw: Floats
    v: Floats
    omega: Floats
    acceleration: Floats
    human_x: Floats
    human_y: Floats
    human_yaw: Floats
    human_speed: Floats
    lateral: Floats = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return len(self.t)

    @property
    def speed(self) -> Floats:
        """(N,) the robot's speed, whichever way it moves."""
        return np.hypot(self.v, self.lateral) if self.lateral.size else np.abs(self.v)

    @property
    def signed_speed(self) -> Floats:
        """(N,) the robot's speed, negative where it drives backwards."""
        return np.copysign(self.speed, self.v) if self.lateral.size else self.v

    def at(self, rows: Any) -> Trajectory:
        """Return the samples of these rows: a slice, indices or a mask."""
        arrays = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return Trajectory(**{name: array[rows] if len(array) else array for name, array in arrays.items()})


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One simulated (or imported) episode.

    `trajectory` is recorded at every control tick (20 Hz); `log` are the rows the published study's client would
    have written (about 2 Hz, wall time: see `clock_ratio` = simulated over wall seconds); an imported run has
    only the log, and its `trajectory` is the log. `imu` (K,) is the acceleration magnitude at 100 Hz, empty where
    unknown. `options` are the simulator's effective options, enough to repeat the run with `seed`. `human_groups`
    names the group of each human (None: alone); it is empty where groups are not known. `events`: what the simulator
    recorded besides, in order of time.
    """

    scenario_id: str
    simulator: str
    options: dict[str, object]
    seed: int
    outcome: Outcome
    trajectory: Trajectory
    log: Trajectory
    imu: Floats = field(default_factory=lambda: np.empty(0))
    clock_ratio: float = 1.0
    human_names: tuple[str, ...]
    robot_radius_m: float = 0.35
    human_radius_m: tuple[float, ...]
    goal: tuple[float, float, float]
    time_limit_s: float
    recoveries: int = 0
    details: dict[str, object] = field(default_factory=dict)
    human_groups: tuple[int | None, ...] = ()
    events: tuple[RecordedEvent, ...] = ()
    robot_outline: tuple[tuple[float, float], ...] = ()
    """Corners of the robot's body in its frame, metres, where the simulator keeps bodies apart and records their
    contacts in `events`; empty: the body is the disc of `robot_radius_m`, and bodies may overlap."""
    human_outlines: tuple[tuple[tuple[float, float], ...], ...] = ()
    """Corners of what each person sits in or pushes, in the person's frame, metres; empty: nobody does."""
    robot_latency_s: float = 0.0
    robot_deceleration_m_s2: float = 2.5

    @cached_property
    def id(self) -> str:
        """Content id of what determines the run: scenario, simulator with options, seed."""
        return run_id(self.scenario_id, self.simulator, self.options, self.seed)

    @property
    def stack_fault(self) -> str:
        """Why the stack under test failed; empty where it did not."""
        return str(self._stack.get("fault", ""))

    @property
    def stack_warnings(self) -> tuple[str, ...]:
        """What the stack under test did not do as it should, such as control periods that it missed."""
        return tuple(map(str, self._stack.get("warnings", ())))

    @property
    def _stack(self) -> dict[str, Any]:
        stack = self.details.get("stack")
        return stack if isinstance(stack, dict) else {}

    @property
    def absent_at(self) -> dict[str, tuple[float, float]]:
        """Where people stand, far outside of the map, while they are absent; the others are always there."""
        places = self.details.get("absent_at")
        return {name: (x, y) for name, (x, y) in places.items()} if isinstance(places, dict) else {}

    @property
    def completed(self) -> bool:
        """Whether the goal was reached in time."""
        return self.outcome is Outcome.REACHED
