"""Metrics of the published study as its client logged them; registered as plug-ins in `rvsg.metrics`.

They read `run.log` (about 2 Hz, wall clock) by the formulas of the study's client, so that their values compare with
published ones. Their ids end in `_logged`. `expected_jerk` is what `jerk_logged` is on average.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rvsg.evaluation.metrics.metric import Metric
from rvsg.evaluation.metrics.performance import METRICS as CORRECT
from rvsg.evaluation.metrics.performance import STUDY
from rvsg.evaluation.sampled import Sampled
from rvsg.scenario.requirement import Aim

CLIENT = "RVSG study, as its client logged it"
LOG_INTERVAL_S = 0.509
IMU_PERIOD_S = 0.01
GOAL_ZEROED_M = 0.25


def distance_to_obstacles_logged(s: Sampled) -> float | None:
    """Mean over samples of max(0, min_i (|p_robot - p_i| - r_robot - r_i)): surface to surface, clamped at 0.

    People alone, no walls.
    """
    return float(s.clamped_gap.mean()) if s.people else None


def jerk_logged(s: Sampled) -> float | None:
    """Mean over the N-1 intervals of |a(t+1) - a(t)| / dt, a the inertial sensor's horizontal magnitude."""
    if len(s) < 2:
        return None
    return float((np.abs(np.diff(s.series.acceleration)) / s.dt).mean())


def expected_jerk(s: Sampled) -> float | None:
    """Return what `jerk_logged` is on average over the phase at which the log samples the inertial sensor.

    E = 1/(K-m) sum_k |a(k+m) - a(k)| / (m 0.01 / RTF), over all K samples at 100 Hz, m = 0.509 RTF / 0.01 rounded:
    the mean over phases and over intervals commute. The log's short last interval is left out.
    """
    samples = s.run.imu
    lag = round(LOG_INTERVAL_S * s.run.clock_ratio / IMU_PERIOD_S)
    if lag < 1 or len(samples) <= lag:
        return None
    change = np.abs(samples[lag:] - samples[:-lag])
    return float(change.mean() / (lag * IMU_PERIOD_S / s.run.clock_ratio))


def last_time(s: Sampled) -> float | None:
    """Time stamp of the last row, whatever the outcome (wall clock)."""
    return float(s.series.t[-1]) if len(s) else None


def time_not_moving_logged(s: Sampled) -> float | None:
    """(total time / (N-1)) x number of still samples, the first excluded."""
    if len(s) < 2:
        return None
    return float(s.series.t[-1] / (len(s) - 1) * s.still[1:].sum())


def minimum_distance_clamped(s: Sampled) -> float | None:
    """Smallest gap to a person over the run, 0 if the discs overlap."""
    return float(s.clamped_gap.min()) if s.people else None


def goal_distance_final_logged(s: Sampled) -> float | None:
    """Distance from the goal in the last row; the study's client wrote 0 where it was at most 0.25 m."""
    if not len(s):
        return None
    final = float(s.goal_distance[-1])
    return 0.0 if final <= GOAL_ZEROED_M else final


OWN_FORMULAS: dict[str, Callable[[Sampled], float | None]] = {
    "dto": distance_to_obstacles_logged,
    "jerk": jerk_logged,
    "trg": last_time,
    "tnm": time_not_moving_logged,
    "min_distance": minimum_distance_clamped,
    "goal_distance": goal_distance_final_logged,
}
"""Metrics whose formula in the client's log differs from the correct one."""


def _as_logged(known: Metric) -> Metric:
    return replace(
        known,
        id=f"{known.id}_logged",
        title=f"{known.title} (as logged)",
        source=CLIENT,
        of=OWN_FORMULAS.get(known.id, known.of),
        so_far=None,
        series="log",
        least=0.0,
        most=None,
        censored=known.censored,
    )


METRICS = (
    Metric(
        id="expected_jerk",
        title="Expected logged jerk",
        unit="m/s³",
        worse="larger",
        source=STUDY,
        of=expected_jerk,
        aim=Aim.DISTURB,
        shown="jerk",
        moved_by="People who come up in front of the robot repeatedly.",
    ),
    *(_as_logged(known) for known in CORRECT if known.id != "completed"),
)
