"""The base class of stacks on the built-in Nav2, and Nav2 with DWB, which runs within the compiled loop."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Field, ValidationError, create_model, model_validator

from rvsg.core.documents import WrongValue, invalid_options
from rvsg.core.records import Record
from rvsg.robots.robot import (
    Behaviours,
    CostmapFilter,
    Costmaps,
    Dwb,
    MonitorPolygon,
    Polygon,
    Robot,
    SafetyZone,
    Smoother,
)
from rvsg.simulation.stacks.nav2_keys import DWB, NEGATIVE
from rvsg.simulation.stacks.parameters import Parameter, of_costmaps, of_dwb, of_monitor, value_at, with_values
from rvsg.simulation.stacks.protocol import LocalObservation, LocalPlanner, Task

AS_JAZZY: Mapping[str, Any] = {"smoothed": True, "waits_for_costmaps": True, "gives_up_without_plan": True}
"""Keys of the robot's `navigation.behaviours` of a stack that is to act as Nav2 since Jazzy does."""
SECTIONS: dict[str, type[Record]] = {
    "smoother": Smoother,
    "costmaps": Costmaps,
    "behaviours": Behaviours,
}


class Nav2Settings(Record):
    """What a stack on the built-in Nav2 changes of the robot's navigation parameters."""

    smoother: dict[str, Any] = Field(default_factory=dict)
    """Keys of the robot's `navigation.smoother`, likewise the next ones."""
    costmaps: dict[str, Any] = Field(default_factory=dict)
    behaviours: dict[str, Any] = Field(default_factory=dict)
    collision_monitor: tuple[MonitorPolygon, ...] = ()
    """Polygons of Nav2's collision monitor, instead of the robot's."""
    costmap_filters: tuple[CostmapFilter, ...] = ()
    """Nav2's keepout and speed filters with their masks."""
    footprint: Polygon | None = None
    """What Nav2 takes for the robot's outline; its body stays what it is."""
    padding_m: Annotated[float, Field(ge=0, le=0.5)] | None = None
    safety_zones: tuple[SafetyZone, ...] = ()
    """Zones of safety scanners besides the robot's; they limit the speed of the base."""


class Configured(LocalPlanner):
    """A local planner whose options are the fields of its `Settings`."""

    answer_time_s: ClassVar[float | None] = None
    Settings: ClassVar[type[Nav2Settings]] = Nav2Settings
    own_behaviours: ClassVar[Mapping[str, Any]] = {}
    """Keys of the robot's `navigation.behaviours` that this stack sets, unless the options tell."""

    def __init__(self, **options: Any) -> None:
        try:
            self.settings: Any = self.Settings.model_validate(options)
            for section, kind in SECTIONS.items():
                kind.model_validate(getattr(self.settings, section, {}))
        except ValidationError as error:
            raise invalid_options(error, self.Settings, f"options of the stack {self.name}") from None

    @classmethod
    def default_options(cls) -> dict[str, Any]:
        """Return every field of `Settings` with its default."""
        return cls.Settings().model_dump(mode="json")

    @property
    def options(self) -> dict[str, Any]:
        """The effective options; those of the robot's navigation only where they are set."""
        return {
            key: value
            for key, value in self.settings.model_dump(mode="json").items()
            if key not in Nav2Settings.model_fields or key in self.settings.model_fields_set
        }

    def planner_parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Return the parameters of the local planner itself."""
        return ()

    def planner_options(self, robot: Robot) -> Mapping[str, Any]:
        """Return options of the local planner that the robot has where the stack has none."""
        return {}

    def full_speed(self, robot: Robot) -> float:
        """Return the speed that the limits of a speed filter are shares of."""
        return robot.dwb.max_speed_m_s or 0.0

    def tunable_parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Return the parameters of the planner, of inflation and of the polygons of the collision monitor."""
        adapted = self.adapt(robot)
        options = {**adapted.navigation.model_dump(mode="json"), **self.settings.model_dump(mode="json")}
        sections = {key: adapted.navigation.model_dump(mode="json")[key] for key in SECTIONS}
        options |= self.planner_options(adapted)
        declared = (*self.planner_parameters(robot), *of_costmaps(), *of_monitor(options["collision_monitor"]))
        known = {**options, **sections}
        found = ((each, value_at(known, each.name)) for each in declared)
        return tuple(each.with_present(each.high if present is None else present) for each, present in found)

    def planner_changes(self, robot: Robot) -> Mapping[str, Any]:
        """Return what the options change of the robot's `navigation.dwb`."""
        return {}

    def adapt(self, robot: Robot) -> Robot:
        """Return the robot with these navigation parameters."""
        given = self.settings
        sections = {key: getattr(given, key) for key in SECTIONS if getattr(given, key, None)}
        if planner := self.planner_changes(robot):
            sections["dwb"] = planner
        if self.own_behaviours:
            sections["behaviours"] = {**self.own_behaviours, **given.behaviours}
        parts = {key: getattr(robot.navigation, key).replace(**values) for key, values in sections.items()}
        if given.collision_monitor:
            parts["collision_monitor"] = given.collision_monitor
        if given.costmap_filters:
            full = self.full_speed(robot.replace(navigation=robot.navigation.replace(**parts)))
            parts["costmap_filters"] = tuple(each.replace(full_m_s=full) for each in given.costmap_filters)
        changes: dict[str, Any] = {"navigation": robot.navigation.replace(**parts)} if parts else {}
        if given.footprint is not None:
            changes |= {"footprint": given.footprint, "body": robot.outline}
        if given.padding_m is not None:
            changes["padding_m"] = given.padding_m
        if given.safety_zones:
            changes["safety_zones"] = (*robot.safety_zones, *given.safety_zones)
        if not changes:
            return robot
        try:
            return robot.replace(**changes)
        except ValidationError as error:
            raise invalid_options(error, Robot, f"the stack {self.name} does not fit the robot {robot.name}") from None


class _DwbOptions(Nav2Settings):
    """What `DwbSettings` has beside the parameters of the table."""

    critics: tuple[str, ...] | None = None
    """Those that score; None: all of Nav2's default."""

    @model_validator(mode="before")
    @classmethod
    def _no_section(cls, values: Any) -> Any:
        if isinstance(values, Mapping) and isinstance(old := values.get("dwb"), Mapping):
            names = {field: name for name, field in DWB.items()}
            renamed = ", ".join(f"dwb.{key} is {names.get(key, 'no option')}" for key in old)
            raise WrongValue(f"the options of DWB have Nav2's own names: {renamed}", "dwb")
        return values


def _dwb_settings() -> Any:
    """Return the record of DWB's parameters under Nav2's names; None: the robot's own value."""
    fields: dict[str, dict[str, Any]] = {}
    for name, field in DWB.items():
        info = Dwb.model_fields[field]
        kind: Any = Annotated[(info.annotation, *info.metadata)] if info.metadata else info.annotation
        if info.default is None:  # a limit: 0 stands for none
            kind = Annotated[kind, BeforeValidator(partial(_limit, sign=-1 if name in NEGATIVE else 1))]
        critic, _, key = name.rpartition(".")
        fields.setdefault(critic, {})[key] = (kind | None, None)
    critics = {name: create_model(name, __base__=Record, **inner) for name, inner in fields.items() if name}
    own = {**fields[""], **{name: (kind, kind()) for name, kind in critics.items()}}
    return create_model("DwbSettings", __base__=_DwbOptions, __doc__="The options of `nav2-dwb`.", **own)


def _limit(value: Any, sign: int) -> Any:
    """Return a limit as a robot has it, above 0."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return (abs(value) if sign < 0 else value) or None


DwbSettings: type[Nav2Settings] = _dwb_settings()


class Nav2Dwb(Configured):
    """Nav2 with DWB, NavFn and the default behaviour tree, by default with the parameters of the robot."""

    name: ClassVar[str] = "nav2-dwb"
    version = "2"
    own_behaviours: ClassVar[Mapping[str, Any]] = AS_JAZZY
    title: ClassVar[str] = "Nav2 (Jazzy) with DWB, NavFn and the default behaviour tree: the default"
    Settings: ClassVar[type[Nav2Settings]] = DwbSettings

    def planner_parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Return the weights of DWB's critics, its horizon and its speed."""
        return of_dwb(robot)

    def planner_options(self, robot: Robot) -> Mapping[str, Any]:
        """Return DWB's parameters under Nav2's names."""
        return with_values({}, {name: getattr(robot.navigation.dwb, field) for name, field in DWB.items()})

    def planner_changes(self, robot: Robot) -> Mapping[str, Any]:
        """Return the robot's `navigation.dwb` as far as options are set."""
        options = self.settings.model_dump()
        values = {field: value for name, field in DWB.items() if (value := value_at(options, name)) is not None}
        if (critics := self.settings.critics) is not None:
            scored = (name for name in DWB if name.endswith(".scale") and not name.startswith("BaseObstacle"))
            values |= {DWB[name]: 0.0 for name in scored if name.partition(".")[0] not in critics}
            values |= {"check_footprint": True} if "ObstacleFootprint" in critics else {}
        if robot.limits.lateral_m_s == 0.0 and "max_lateral_m_s" in values:
            values["max_lateral_m_s"] = 0.0
        return values

    @property
    def options(self) -> dict[str, Any]:
        """The options that differ from the robot's own parameters."""
        options = {key: value for key, value in super().options.items() if key in self.settings.model_fields_set}
        for critic in options.keys() & {name.partition(".")[0] for name in DWB if "." in name}:
            options[critic] = {key: value for key, value in options[critic].items() if value is not None}
        return options

    def reset(self, task: Task) -> None:
        """Do nothing: the compiled loop holds the planner."""

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        """Never called."""
        raise NotImplementedError(f"{self.name} runs within the compiled loop")


class Nav2DwbHumble(Nav2Dwb):
    """Nav2 of Humble as the published study ran it, bit for bit what `nav2-dwb` was in version 1."""

    name: ClassVar[str] = "nav2-dwb-humble"
    version = "1"
    own_behaviours: ClassVar[Mapping[str, Any]] = {}
    title: ClassVar[str] = "Nav2 (Humble) with DWB, as the published study ran it: the default of published-study"
