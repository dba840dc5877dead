"""The registry of metrics, and `measure`, which reads any of them off a run.

A metric's id ending in `_logged` reads `run.log` (about 2 Hz, wall clock) by the formula of the published study's
client; one ending in `_hunav` gives the HuNavSim evaluator's number, its defects included; all others read
`run.trajectory` (20 Hz for our own runs) by the correct formula.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from rvsg.core.errors import UnknownName
from rvsg.evaluation import formulas as f
from rvsg.evaluation import hunav, safety
from rvsg.evaluation.sampled import Sampled
from rvsg.simulation.run import Run
from rvsg.world.world import World

Worse = Literal["smaller", "larger", "neither"]
Series = Literal["trajectory", "log"]


@dataclass(frozen=True, kw_only=True)
class MetricInfo:
    """One metric: what it is called, how it is computed, in which direction it gets worse, where it comes from.

    `of` computes it from a sampled run; None means that this run holds no judgement. `formula` is its docstring.
    """

    id: str
    title: str
    unit: str
    worse: Worse
    source: str
    of: Callable[[Sampled], float | None]
    series: Series = "trajectory"

    @property
    def least(self) -> float | None:
        """The smallest value it can have: 0, or None where it can be negative."""
        return None if self.id in _SIGNED else 0.0

    @property
    def formula(self) -> str:
        """The formula in words, from the docstring of the function."""
        return " ".join((self.of.__doc__ or "").split())

    def measure(self, run: Run, world: World | None = None) -> float | None:
        """This metric of one run, or None where the run holds no judgement."""
        return self.of(Sampled(run, run.log if self.series == "log" else run.trajectory, world))


STUDY = "RVSG study"
CLIENT = "RVSG study, as its client logged it"
HUNAV = "HuNavSim evaluator, corrected"
EVALUATOR = "HuNavSim evaluator, its defects included"
SAFETY = "common practice in robot safety"


def _both(
    id: str, title: str, unit: str, worse: Worse, of: Callable[[Sampled], float | None], source: str = STUDY
) -> list[MetricInfo]:
    """A metric with one formula, over the trajectory and over the logged rows."""
    return [
        MetricInfo(id=id, title=title, unit=unit, worse=worse, source=source, of=of),
        _logged(id, title, unit, worse, of),
    ]


def _logged(id: str, title: str, unit: str, worse: Worse, of: Callable[[Sampled], float | None]) -> MetricInfo:
    return MetricInfo(
        id=f"{id}_logged", title=f"{title} (as logged)", unit=unit, worse=worse, source=CLIENT, of=of, series="log"
    )


def _one(
    id: str, title: str, unit: str, worse: Worse, of: Callable[[Sampled], float | None], source: str = STUDY
) -> list[MetricInfo]:
    return [MetricInfo(id=id, title=title, unit=unit, worse=worse, source=source, of=of)]


_OBJECTIVES = [
    *_one("dto", "Distance to Obstacles", "m", "smaller", f.distance_to_obstacles),
    _logged("dto", "Distance to Obstacles", "m", "smaller", f.distance_to_obstacles_logged),
    *_one("jerk", "Jerk", "m/s³", "larger", f.jerk),
    _logged("jerk", "Jerk", "m/s³", "larger", f.jerk_logged),
    *_one("expected_jerk", "Expected logged jerk", "m/s³", "larger", f.expected_jerk),
    *_one("trg", "Time to Reach Goal", "s", "larger", f.time_to_goal),
    _logged("trg", "Time to Reach Goal", "s", "larger", f.last_time),
]

_PERFORMANCE = [
    *_both("rpc", "Robot-on-Person Collision", "samples", "larger", f.robot_on_person),
    *_both("por", "Person-on-Robot Collision", "samples", "larger", f.person_on_robot),
    *_both("chc", "Cumulative Heading Changes", "rad", "larger", f.heading_changes),
    *_both("pl", "Path Length", "m", "larger", f.path_length),
    *_one("tnm", "Time Not Moving", "s", "larger", f.time_not_moving),
    _logged("tnm", "Time Not Moving", "s", "larger", f.time_not_moving_logged),
    *_one("completed", "Goal reached in time", "1 or 0", "smaller", f.completed),
    *_one("min_distance", "Minimum distance to people", "m", "smaller", f.minimum_distance),
    _logged("min_distance", "Minimum distance to people", "m", "smaller", f.minimum_distance_clamped),
    *_both("goal_distance_min", "Minimum distance to the goal", "m", "larger", f.goal_distance_minimum),
    *_one("goal_distance", "Final distance to the goal", "m", "larger", f.goal_distance_final),
    _logged("goal_distance", "Final distance to the goal", "m", "larger", f.goal_distance_final_logged),
    *_both("speed", "Mean speed", "m/s", "neither", f.mean_speed),
    *_both("turn_rate", "Mean turn rate", "rad/s", "neither", f.mean_turn_rate),
    *_both("acceleration", "Mean inertial acceleration", "m/s²", "larger", f.mean_inertial_acceleration),
    *_both("human_speed", "Mean speed of the humans", "m/s", "neither", f.mean_human_speed),
    *_both("closest_human_speed", "Mean speed of the closest human", "m/s", "neither", f.mean_closest_human_speed),
]

_SAFETY = [
    *_one("contacts", "Contact events", "events", "larger", safety.contact_events, SAFETY),
    *_one("contact_time", "Time in contact", "s", "larger", safety.contact_time, SAFETY),
    *_one("contact_longest", "Longest contact", "s", "larger", safety.contact_longest, SAFETY),
    *_one("contact_speed", "Relative speed at contact", "m/s", "larger", safety.contact_speed, SAFETY),
    *_one("contact_robot_speed", "Robot's speed in contact", "m/s", "larger", safety.contact_robot_speed, SAFETY),
    *_one("ttc", "Time to collision", "s", "smaller", safety.time_to_collision, SAFETY),
    *_one("stopping_margin", "Stopping-distance margin", "m", "smaller", safety.stopping_margin, SAFETY),
    *_one("intimate_space", "Intimate space intrusion", "%", "larger", safety.intimate_space, HUNAV),
    *_one("personal_space", "Personal space intrusion", "%", "larger", safety.personal_space, HUNAV),
    *_one("social_space", "Social space intrusion", "%", "larger", safety.social_space, HUNAV),
    *_one("obstacle_distance", "Minimum distance to obstacles", "m", "smaller", safety.obstacle_distance, SAFETY),
    *_one("acceleration_peak", "Peak acceleration", "m/s²", "larger", safety.acceleration_peak, SAFETY),
    *_one("emergency_stops", "Emergency stops", "events", "larger", safety.emergency_stops, SAFETY),
    *_one("standstill", "Longest standstill", "s", "larger", safety.longest_standstill, SAFETY),
    *_one("detour", "Detour ratio", "1", "larger", safety.detour_ratio, SAFETY),
    *_one("heading_error", "Final heading error", "rad", "larger", safety.heading_error, SAFETY),
    *_one("time_share", "Share of the time limit used", "1", "larger", safety.time_share, SAFETY),
]

_HUNAV = [
    *_one("max_distance", "Maximum distance to people", "m", "neither", hunav.maximum_distance, HUNAV),
    *_one("acceleration_mean", "Mean change of speed", "m/s²", "larger", hunav.mean_acceleration, HUNAV),
    *_one("force_on_humans", "Social force on the humans", "m/s", "larger", hunav.force_on_humans, HUNAV),
    *_one("force_on_robot", "Social force on the robot", "m/s", "larger", hunav.force_on_robot, HUNAV),
    *_one("social_work", "Social work", "m/s", "larger", hunav.social_work, HUNAV),
    *_one(
        "obstacle_force_on_humans", "Obstacles' force on people", "m/s", "larger", hunav.obstacle_force_on_humans, HUNAV
    ),
    *_one(
        "obstacle_force_on_robot",
        "Obstacles' force on the robot",
        "m/s",
        "larger",
        hunav.obstacle_force_on_robot,
        HUNAV,
    ),
    *_one("group_intimate_space", "Group intimate space intrusion", "%", "larger", hunav.group_intimate_space, HUNAV),
    *_one("group_personal_space", "Group personal space intrusion", "%", "larger", hunav.group_personal_space, HUNAV),
    *_one("group_social_space", "Group social space intrusion", "%", "larger", hunav.group_social_space, HUNAV),
]

_HUNAV_COMPATIBLE = [
    *_one("max_distance_hunav", "Maximum distance to people", "m", "neither", hunav.maximum_distance_hunav, EVALUATOR),
    *_one("tnm_hunav", "Time not moving", "s", "larger", hunav.time_not_moving_hunav, EVALUATOR),
    *_one("rpc_hunav", "Robot-on-person collision", "samples", "larger", hunav.robot_on_person_hunav, EVALUATOR),
    *_one("por_hunav", "Person-on-robot collision", "samples", "larger", hunav.person_on_robot_hunav, EVALUATOR),
    *_one("acceleration_mean_hunav", "Acceleration", "m/s²", "larger", hunav.mean_acceleration_hunav, EVALUATOR),
    *_one("overacceleration_hunav", "Overacceleration", "m/s³", "larger", hunav.overacceleration_hunav, EVALUATOR),
    *_one("completed_hunav", "Completed", "1 or 0", "smaller", hunav.completed_hunav, EVALUATOR),
    *_one("force_on_humans_hunav", "Social force on agents", "sum", "larger", hunav.force_on_humans_hunav, EVALUATOR),
    *_one("force_on_robot_hunav", "Social force on robot", "sum", "larger", hunav.force_on_robot_hunav, EVALUATOR),
    *_one("social_work_hunav", "Social work", "sum", "larger", hunav.social_work_hunav, EVALUATOR),
]

_SIGNED = frozenset({"min_distance", "stopping_margin", "obstacle_distance", "max_distance", "max_distance_hunav"})
"""Distances between surfaces are negative where these overlap; of all other metrics none is ever negative."""

METRICS: dict[str, MetricInfo] = {
    info.id: info for info in [*_OBJECTIVES, *_PERFORMANCE, *_SAFETY, *_HUNAV, *_HUNAV_COMPATIBLE]
}
"""Every built-in metric by its id, in the order they are listed."""


def metric(name: str) -> MetricInfo:
    """The metric of that id; UnknownName with the nearest id where there is none."""
    try:
        return METRICS[name]
    except KeyError:
        raise UnknownName("metric", name, METRICS, hint="`rvsg metrics` lists them with their formulas.") from None


def measure(run: Run, names: Iterable[str] | None = None, *, world: World | None = None) -> dict[str, float | None]:
    """The metrics of those ids (all where None) of one run; None where the run holds no judgement.

    Distances to things that stand still need the `world` of the run and are None without. Raises UnknownName.
    Signals that metrics share are computed once.
    """
    seen = {"trajectory": Sampled(run, run.trajectory, world), "log": Sampled(run, run.log, world)}
    infos = list(METRICS.values()) if names is None else [metric(name) for name in names]
    return {info.id: info.of(seen[info.series]) for info in infos}
