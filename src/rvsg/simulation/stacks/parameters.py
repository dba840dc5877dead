"""Parameters of navigation stacks that may be tuned: their ranges, where these come from, and how a value is set.

A parameter is named by the path of its option, such as `BaseObstacle.scale` or `collision_monitor.0.min_points`. Nav2
documents defaults and types, but hardly any limit. So the ranges of its weights lie around the default, and those of
speeds and accelerations end at the limits of the robot; `source` says which.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from rvsg.core.documents import WrongValue
from rvsg.core.records import Record
from rvsg.robots.robot import Robot


class Parameter(Record):
    """A number among the options of a stack, with the range in which it may be tuned."""

    name: Annotated[str, Field(min_length=1)]
    """The path of the option, with dots."""
    low: float
    high: float
    present: float | None = None
    """Its value before tuning; None: that of the stack's options."""
    log: bool = False
    """Whether the range is searched by its logarithm."""
    whole: bool = False
    """Whether the stack takes whole numbers only."""
    unit: str = ""
    group: str = ""
    source: str = ""
    """Where the range comes from."""

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        if self.low >= self.high:
            raise WrongValue(f"the range {self.low:g} to {self.high:g} is empty; low must be below high", "low")
        if self.log and self.low <= 0.0:
            raise WrongValue("a range that is searched by its logarithm must be above 0", "low")
        return self

    def value(self, number: float) -> float | int:
        """Return a number as the stack is given it: within the range, with three significant digits."""
        if self.whole:
            return round(min(self.high, max(self.low, number)))
        return min(self.high, max(self.low, float(f"{number:.3g}")))

    def at(self, share: float) -> float:
        """Return the number at a share of the range, 0 at `low`."""
        if self.log:
            return float(self.low * (self.high / self.low) ** share)
        return self.low + share * (self.high - self.low)

    def share(self, number: float) -> float:
        """Return where in the range a number lies, from 0 to 1; the inverse of `at`."""
        if self.log:
            return math.log(number / self.low) / math.log(self.high / self.low)
        return (number - self.low) / (self.high - self.low)

    def with_present(self, present: float) -> Parameter:
        """Return the parameter with its present value, which widens the range where it lies outside."""
        low, high = min(self.low, present), max(self.high, present)
        return self.replace(present=present, low=low, high=high, log=self.log and low > 0.0)


def around(name: str, default: float, unit: str = "", group: str = "", *, factor: float = 4.0) -> Parameter:
    """Return a parameter whose range lies around its default in Nav2."""
    source = f"1/{factor:g} to {factor:g} times the default {default:g}; Nav2 documents no limit"
    return Parameter(
        name=name, low=default / factor, high=default * factor, log=True, unit=unit, group=group, source=source
    )


def between(name: str, low: float, high: float, unit: str, group: str, source: str) -> Parameter:
    """Return a parameter with a range of its own."""
    return Parameter(name=name, low=low, high=high, unit=unit, group=group, source=source)


def of_robot(name: str, limit: float, unit: str, group: str) -> Parameter:
    """Return a parameter that ends at a limit of the robot."""
    source = f"up to the robot's limit of {limit:g} {unit}"
    return Parameter(name=name, low=0.25 * limit, high=limit, unit=unit, group=group, source=source)


def of_costmaps() -> tuple[Parameter, ...]:
    """Return the inflation of both costmaps."""
    reach = "from a footprint's size to a free strip beside it"
    return tuple(
        each
        for which in ("local", "global")
        for each in (
            between(f"costmaps.{which}_inflation_m", 0.25, 1.5, "m", "costmaps", reach),
            around(f"costmaps.{which}_cost_scaling", 3.0, "1/m", "costmaps"),
        )
    )


def of_dwb(robot: Robot) -> tuple[Parameter, ...]:
    """Return the weights of DWB's critics, its horizon and its speed."""
    weights = {
        "BaseObstacle": 0.02, "PathDist": 32.0, "PathAlign": 32.0, "GoalDist": 24.0, "GoalAlign": 24.0,
    }  # fmt: skip
    return (
        of_robot("max_vel_x", robot.limits.speed_m_s, "m/s", "speed"),
        between("sim_time", 0.8, 3.5, "s", "horizon", "about half to twice the default 1.7"),
        *(
            around(f"{critic}.scale", default, "", "critics", factor=16.0 if critic == "BaseObstacle" else 4.0)
            for critic, default in weights.items()
        ),
    )


def of_pure_pursuit(robot: Robot) -> tuple[Parameter, ...]:
    """Return the distances and speeds of regulated pure pursuit."""
    return (
        of_robot("desired_linear_vel", robot.limits.speed_m_s, "m/s", "speed"),
        around("lookahead_dist", 0.6, "m", "path", factor=3.0),
        around("max_allowed_time_to_collision_up_to_carrot", 1.0, "s", "collisions"),
        around("regulated_linear_scaling_min_radius", 0.9, "m", "speed", factor=3.0),
        around("regulated_linear_scaling_min_speed", 0.25, "m/s", "speed"),
        around("cost_scaling_dist", 0.6, "m", "costmaps", factor=3.0),
        between("cost_scaling_gain", 0.2, 1.0, "", "costmaps", "Nav2 asks for at most 1"),
        around("approach_velocity_scaling_dist", 0.6, "m", "goal", factor=3.0),
    )


def of_mppi(robot: Robot) -> tuple[Parameter, ...]:
    """Return the weights of MPPI's critics, its noise and its speed."""
    weights = {"CostCritic": 3.81, "PathAlignCritic": 10.0, "PathFollowCritic": 5.0, "PathAngleCritic": 2.2}
    return (
        of_robot("vx_max", robot.limits.speed_m_s, "m/s", "speed"),
        around("vx_std", 0.2, "m/s", "noise", factor=3.0),
        around("wz_std", 0.4, "rad/s", "noise", factor=3.0),
        around("temperature", 0.3, "", "noise"),
        *(around(f"{critic}.cost_weight", default, "", "critics") for critic, default in weights.items()),
        around("CostCritic.critical_cost", 300.0, "", "critics"),
        around("CostCritic.near_collision_cost", 253.0, "", "critics", factor=2.0),
    )


def of_monitor(polygons: Iterable[Mapping[str, Any]]) -> tuple[Parameter, ...]:
    """Return the one number of each polygon of a collision monitor that says how careful it is."""
    found = []
    for k, polygon in enumerate(polygons):
        name = f"collision_monitor.{k}"
        match polygon["action_type"]:
            case "approach":
                found.append(around(f"{name}.time_before_collision", 2.0, "s", "collision monitor"))
            case "slowdown":
                source = "a standstill to the full speed"
                found.append(between(f"{name}.slowdown_ratio", 0.1, 1.0, "", "collision monitor", source))
            case "limit":
                found.append(around(f"{name}.linear_limit", 0.5, "m/s", "collision monitor"))
    return tuple(found)


def value_at(options: Mapping[str, Any], name: str) -> Any:
    """Return the value of an option by its path; None where there is none."""
    found: Any = options
    for part in name.split("."):
        if isinstance(found, Mapping):
            found = found.get(part)
        elif isinstance(found, list | tuple) and part.isdecimal() and int(part) < len(found):
            found = found[int(part)]
        else:
            return None
    return found


def with_values(options: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return options with the values of some paths changed; what the path needs is made."""
    made: dict[str, Any] = copy.deepcopy(dict(options))
    for name, value in values.items():
        *path, last = name.split(".")
        at: Any = made
        for part in path:
            if isinstance(at, list):
                at = at[int(part)]
            else:
                inner = at.get(part)
                at[part] = list(inner) if isinstance(inner, tuple) else {} if inner is None else inner
                at = at[part]
        at[last] = value
    return made
