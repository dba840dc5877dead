"""The options of the stack `ros2`: names, frames, start, speed and limits, with Nav2's defaults."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import Field, ValidationError, model_validator

from rvsg.core.documents import invalid_options
from rvsg.core.errors import InputError
from rvsg.core.inputs import read_text
from rvsg.core.records import Record
from rvsg.robots.robot import Lidar
from rvsg.simulation.stacks.parameter_file import with_values_in_file
from rvsg_ros2.interfaces import Release

Positive = Annotated[float, Field(gt=0)]
Name = Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z0-9_/~{}.-]+$")]


class Ros2Options(Record):
    """How the ROS 2 system under test is started, and by which names it is spoken to."""

    launch: str | None = None
    """Command that starts the system, e.g. `ros2 launch ...`; `{params}` and `{speed}` are filled in. None: attach to
    the one that runs."""
    params: str | None = None
    """Nav2 parameter file for `launch`; with `speed` its wall-clock rates are scaled."""
    values: dict[str, Any] = Field(default_factory=dict)
    """Values that replace those of `params`, by the options of the built-in stack, e.g. `{sim_time: 2.0}`."""
    speed: Annotated[float, Field(ge=0.1, le=20)] = 1.0
    """Simulated over wall time. Nav2 before Lyrical runs its loops on wall time: see `rvsg ros2 params`."""
    restart: bool = False
    """Restart a launched system before every run instead of resetting it."""
    domain: Annotated[int, Field(ge=0, le=232)] | None = None
    """DDS domain; None: ROS_DOMAIN_ID, else 0. A launched system takes the first free one from there on."""
    release: Release | Literal["auto"] = "auto"
    """Whose message definitions apply; `auto` reads it from what the running nodes announce."""
    goal: Literal["auto", "to_pose", "through_poses"] = "auto"
    """The action that gets the goal; `auto`: through poses where the route has poses to drive through."""
    to_pose_action: Name = "/navigate_to_pose"
    through_poses_action: Name = "/navigate_through_poses"
    cmd_vel: Name = "/cmd_vel"
    cmd_vel_type: Literal["auto", "Twist", "TwistStamped"] = "auto"
    odom: Name = "/odom"
    scan: Name = "/scan"
    """Topic of the first lidar."""
    further_scans: Name = "/scan_{name}"
    """Topics of the other lidars; `{name}` is the name of the lidar, `{index}` its number from 0."""
    map: Name = "/map"
    initial_pose: Name = "/initialpose"
    plan: Name = "/plan"
    behaviour_tree_log: Name = "/behavior_tree_log"
    costmaps: tuple[Name, ...] = ("/local_costmap/costmap",)
    """Costmaps that are kept with the run, at most one a second of each."""
    clear_costmaps: tuple[Name, ...] = (
        "/global_costmap/clear_entirely_global_costmap",
        "/local_costmap/clear_entirely_local_costmap",
    )
    map_frame: Name = "map"
    odom_frame: Name = "odom"
    base_frame: Name = "base_link"
    footprint_frame: Name = "base_footprint"
    """Published as the parent of `base_frame`, at the same place."""
    lidar_frame: Name = "{name}"
    publish_map: Literal["auto", "always", "never"] = "auto"
    """`auto`: where nobody else publishes it."""
    localisation: Literal["auto", "given", "own"] = "auto"
    """Whether RVSG gives the transform from map to odom or the system finds it; `auto`: given where nobody reads the
    initial pose."""
    joint_states: tuple[Name, ...] = ()
    """Joints that are published on /joint_states, all at 0."""
    nodes: tuple[Name, ...] = ()
    """Lifecycle nodes that must be active; empty: all that are found, the action's among them."""
    start_limit_s: Positive = 60.0
    """Wall time from start to active and localised."""
    answer_limit_s: Positive = 3.0
    """Wall time without a command after which nodes are asked whether they are alive, and in which they answer."""
    settle_s: Annotated[float, Field(ge=0, le=60)] = 1.0
    """Simulated time between clearing the costmaps and sending the goal."""
    control_hz: Annotated[float, Field(gt=0, le=200)] | None = None
    """Expected rate of velocity commands; None: from `params`, else from the running nodes, else 20 Hz."""
    reliable: dict[str, bool] = Field(default_factory=dict)
    """Topics whose subscription asks for (or does without) reliable delivery; default: as the publisher offers."""

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if self.params is not None and (self.launch is None or "{params}" not in self.launch):
            raise ValueError("params: launch must hold {params} where the file's path goes")
        if self.values and self.params is None:
            raise ValueError("values: give params, the file whose values they replace")
        if self.restart and self.launch is None:
            raise ValueError("restart: only a system that launch starts can be restarted")
        if self.launch is not None and self.speed != 1.0 and self.params is None:
            raise ValueError("speed: give params, so that Nav2's wall-clock rates can be scaled")
        return self

    def parameter_text(self) -> str | None:
        """Return the parameter file with the values that replace its own; None where no file is given."""
        if self.params is None:
            return None
        text, path = read_text(Path(self.params)), Path(self.params)
        return with_values_in_file(text, path, dict(_paths(self.values))) if self.values else text

    @property
    def first_domain(self) -> int:
        """The domain to use, or the first one to try: as given, else that of ROS_DOMAIN_ID, else 0."""
        if self.domain is not None:
            return self.domain
        text = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
        if not text.isdecimal() or int(text) > 232:
            raise InputError(f"ROS_DOMAIN_ID is {text!r}. Expected a number from 0 to 232.", code="ros2-domain")
        return int(text)


def _paths(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield nested values with their paths, e.g. `PathAlign.scale`."""
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _paths(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


Options = TypeVar("Options", bound=Ros2Options)


def read_options(given: dict[str, Any]) -> Ros2Options:
    """Return the checked options of the stack `ros2`.

    Raises:
        InputError: names every wrong option.
    """
    return checked(given, Ros2Options, "stack ros2")


def checked(given: dict[str, Any], model: type[Options], where: str) -> Options:
    """Return options as a record of that class; see `read_options`."""
    try:
        options = model.model_validate(given)
    except ValidationError as error:
        raise invalid_options(error, model, where) from None
    if options.params is not None and not Path(options.params).is_file():
        raise InputError(f"{where}: params: there is no file {options.params}.", code="params-missing")
    return options


def scan_topic(options: Ros2Options, lidars: Sequence[Lidar], index: int) -> str:
    """Return the topic of a lidar."""
    return _filled(options.scan if index == 0 else options.further_scans, lidars[index].name, index)


def lidar_frame(options: Ros2Options, lidars: Sequence[Lidar], index: int) -> str:
    """Return the frame of a lidar."""
    return _filled(options.lidar_frame, lidars[index].name, index)


def _filled(pattern: str, name: str, index: int) -> str:
    plain = "".join(letter if letter.isalnum() else "_" for letter in name)
    return pattern.replace("{name}", plain).replace("{index}", str(index))
