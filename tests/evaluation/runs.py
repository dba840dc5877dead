"""Small runs built by hand, whose metrics can be worked out on paper."""

from __future__ import annotations

import numpy as np

from rvsg.simulation.run import Outcome, Run, Trajectory


def trajectory(t, x, y=None, *, yaw=None, v=None, omega=None, acceleration=None, humans=()):
    """Zeros for what is not given; `humans` are (x, y) or (x, y, yaw, speed) with numbers or arrays of length N."""
    t = np.asarray(t, float)

    def column(value):
        return np.broadcast_to(np.asarray(0.0 if value is None else value, float), t.shape).copy()

    people = [tuple(human) + (0.0, 0.0)[: 4 - len(human)] for human in humans]

    def table(i):
        return np.stack([column(p[i]) for p in people], axis=1) if people else np.empty((len(t), 0))

    return Trajectory(
        t=t,
        x=column(x),
        y=column(y),
        yaw=column(yaw),
        v=column(v),
        omega=column(omega),
        acceleration=column(acceleration),
        human_x=table(0),
        human_y=table(1),
        human_yaw=table(2),
        human_speed=table(3),
    )


def run_of(series, *, log=None, outcome=Outcome.REACHED, imu=None, goal=(0.0, 0.0, 0.0), time_limit_s=25.0, **other):
    people = series.human_x.shape[1]
    return Run(
        scenario_id="scenario-test",
        simulator="by hand",
        options={},
        seed=0,
        outcome=outcome,
        trajectory=series,
        log=series if log is None else log,
        imu=np.empty(0) if imu is None else np.asarray(imu, float),
        human_names=tuple(f"Human {i + 1}" for i in range(people)),
        human_radius_m=(0.4,) * people,
        goal=goal,
        time_limit_s=time_limit_s,
        **other,
    )
