"""Options of the embedded simulator, its profiles, and the numbers that are drawn for one run."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from rvsg.core.angles import wrap
from rvsg.core.documents import invalid_options
from rvsg.core.errors import UnknownName
from rvsg.core.records import Record
from rvsg.core.seeds import stream
from rvsg.scenario.scenario import BODY_RADIUS_M, HUNAVSIM_RADIUS_M
from rvsg.simulation.embedded.localisation import Localisation, known_offset, particle_filter
from rvsg.simulation.embedded.people.crowd import (
    KEEP_RIGHT_M,
    PERIOD_S,
    PUBLISHED_EARLY_START,
    PUBLISHED_START_S,
    Anticipation,
    PeopleOptions,
    beginning,
    begins_early,
)
from rvsg.simulation.embedded.state import Scene, Settings, Surroundings
from rvsg.world.world import Route, World

Floats = NDArray[np.float64]


Scale = Annotated[float, Field(ge=0, le=10)]


class Noise(Record):
    """Every source of randomness of a run by its name; each factor scales its spread, 0 switches it off.

    Each source draws from a stream of its own, named like it, of the run's seed: switching one off leaves the
    others as they were. `human_factors` concerns humans whose force factors are drawn, `clock` the ratio of
    simulated to wall time, `localisation` the offset of the robot's map
    (AMCL draws equal numbers in every run where it is 0), `human_start` and `robot_start` when they
    begin to move, `phases` the timers of people, scans, smoother and costmaps, `lidar` the ranges, `gait` the legs'
    phase, `log_interval` the rows of the log, `result_delay` the time from reaching the goal to the last row.
    """

    human_factors: Scale = 1.0
    clock: Scale = 1.0
    localisation: Scale = 1.0
    human_start: Scale = 1.0
    robot_start: Scale = 1.0
    phases: Scale = 1.0
    lidar: Scale = 1.0
    gait: Scale = 1.0
    log_interval: Scale = 1.0
    result_delay: Scale = 1.0


class SimulatorOptions(Record):
    """The simulator's options. The defaults are the profile `default`: how things should be.

    `human_model`: people anticipate each other and the robot as recorded people do, or follow HuNavSim's social force.
    `keep_right_m`: how far to the right of their way people who anticipate still pass on the right of who comes
    towards them; negative: on the left. `clock_ratio` and `clock_ratio_sd`: simulated over wall seconds of a run (the
    log and the time limit count wall seconds); a `clock_slow_share` of the runs has `clock_slow_ratio` instead.
    `yaw_gain`: true over commanded yaw rate. `goals_in_map_frame`: a route's goal is given in the frame
    of the robot's map, not of the world. `localisation`: the robot knows where its map lies, up to an offset that is
    constant in a run and spreads by `localisation_sd_m` per axis, or it finds out by AMCL, beginning with its start
    taken as a pose in the map. `human_start_s`: bounds of the time at which people begin to walk, from the first
    row on, `robot_start_s` the same of the robot; with the chance `human_early_start` people begin 0.2 s sooner and the
    robot 0.035 s later. `human_ticks_from_start`: the timer of people's ticks begins with them, not at a random phase.
    `settling_m`: how far (forward, left) the robot stands from its start after it was put there; it decides which way
    a human on the very same point is pushed. `lidar_rays`, `lidar_range_m` and `lidar_noise_m` replace the
    robot's own, for each of its lidars. `result_delay_s`: bounds of
    the wall time from success to the last row of the log. `human_defects`: people behave with the defects of HuNavSim
    as the study ran it. `humans_displayed_late`: the lidars see people as the study's Gazebo displayed
    them: not at all before they begin to walk, and then one tick (0.1 s) late. `solid_walls`: the robot's body cannot
    enter what its lidars see.
    """

    profile: Literal["default", "hunavsim", "published-study"] = "default"
    human_model: Annotated[
        Literal["anticipation", "social-force"], Field(exclude_if=lambda model: model == "social-force")
    ] = "anticipation"
    keep_right_m: Annotated[float, Field(ge=-1.0, le=1.0, exclude_if=lambda value: value == KEEP_RIGHT_M)] = (
        KEEP_RIGHT_M
    )
    clock_ratio: Annotated[float, Field(gt=0.2, le=2.0)] = 1.0
    clock_ratio_sd: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    clock_slow_ratio: Annotated[float, Field(gt=0.2, le=2.0)] = 1.0
    clock_slow_share: Annotated[float, Field(ge=0, le=1)] = 0.0
    yaw_gain: Annotated[float, Field(gt=0.1, le=2.0)] = 1.0
    goals_in_map_frame: bool = False
    localisation: Literal["known", "amcl"] = "known"
    localisation_sd_m: Annotated[float, Field(ge=0, le=1.0)] = 0.04
    human_start_s: tuple[float, float] = (0.0, 0.1)
    settling_m: tuple[float, float] = (0.0, 0.0)
    human_early_start: Annotated[float, Field(ge=0, le=1)] = 0.0
    human_ticks_from_start: bool = False
    robot_start_s: tuple[float, float] = (0.0, 0.05)
    lidar_rays: Annotated[int, Field(ge=11, le=4000)] | None = None
    lidar_range_m: Annotated[float, Field(ge=3.5, le=100)] | None = None
    lidar_noise_m: Annotated[float, Field(ge=0, le=1.0)] | None = None
    result_delay_s: tuple[float, float] = (0.01, 0.065)
    human_defects: bool = False
    humans_displayed_late: bool = False
    solid_walls: bool = True
    noise: Noise = Noise()


_PUBLISHED: dict[str, Any] = {
    "human_model": "social-force",
    # Speeds of straight driving in the logs: two kinds of runs, as if on two machines or days.
    "clock_ratio": 0.9853,
    "clock_ratio_sd": 0.0022,
    "clock_slow_ratio": 0.9632,
    "clock_slow_share": 0.36,
    "yaw_gain": 0.755,
    "goals_in_map_frame": True,
    "localisation": "amcl",
    "settling_m": (-2.85e-7, -1.64e-7),
    "human_defects": True,
    # Runs with people waiting near the robot begin exactly like those without anybody near, and where somebody starts
    # on the robot it reacts later than to a person seen at once.
    "humans_displayed_late": True,
    "solid_walls": False,
    "human_start_s": PUBLISHED_START_S,
    "human_early_start": PUBLISHED_EARLY_START,
    "human_ticks_from_start": True,
    "robot_start_s": (-0.06, 0.03),
}

PROFILES: dict[str, dict[str, Any]] = {
    "default": {},
    "hunavsim": {"human_model": "social-force"},
    "published-study": _PUBLISHED,
}


def profile(name: str = "default", **changes: Any) -> SimulatorOptions:
    """The options of a named profile, with changes; `noise` may be a mapping of source to factor.

    Raises UnknownName for an unknown profile, InvalidOptions naming every wrong option.
    """
    if name not in PROFILES:
        raise UnknownName("simulator profile", name, PROFILES)
    try:
        return SimulatorOptions.model_validate({"profile": name, **PROFILES[name], **changes})
    except ValidationError as error:
        raise invalid_options(error, SimulatorOptions, "simulator options") from None


LATE_ROBOT_S = 0.035
"""How much later the robot begins in the runs in which people begin sooner; from the logs, like their share."""
LONG_INTERVALS = 0.57
"""The share of the log's rows that come 0.51 s after the one before, not 0.50 s; from 20 892 intervals in the logs."""


def body_radius_m(options: SimulatorOptions) -> float:
    """Return half of the width of people for whom a scenario gives none."""
    return BODY_RADIUS_M if options.human_model == "anticipation" else HUNAVSIM_RADIUS_M


def people_options(options: SimulatorOptions) -> PeopleOptions:
    """Return what of the options concerns people."""
    low, high = options.human_start_s
    middle, scale = 0.5 * (low + high), options.noise.human_start
    anticipates = options.human_model == "anticipation"
    return PeopleOptions(
        published_defects=options.human_defects,
        anticipation=Anticipation(keep_right_m=options.keep_right_m) if anticipates else None,
        factor_noise=options.noise.human_factors,
        start_jitter_s=(middle + scale * (low - middle), middle + scale * (high - middle)),
        early_start=min(1.0, options.noise.human_start) * options.human_early_start,
        leg_phase_noise=options.noise.gait > 0.0,
    )


def draw_settings(
    world: World, route: Route, options: SimulatorOptions, around: Surroundings, seed: int
) -> tuple[Settings, Scene, tuple[float, float]]:
    """The drawn numbers of a run, the scene, and the offset between world and map."""
    noise = options.noise
    clock = _clock(options, seed)
    spread = 0.0 if options.localisation == "amcl" else noise.localisation * options.localisation_sd_m
    shift = spread * stream(seed, "localisation").standard_normal(2)
    low, high = options.result_delay_s
    delay = 0.5 * (low + high) + noise.result_delay * (high - low) * (stream(seed, "result").random() - 0.5)
    low, high = options.robot_start_s
    start = 0.5 * (low + high) + noise.robot_start * (high - low) * (stream(seed, "robot/start").random() - 0.5)
    if begins_early(people_options(options).early_start, seed):
        start += LATE_ROBOT_S
    scene, closed = around.scene_at(route.start.x, route.start.y)
    offset = (world.map_offset[0] + float(shift[0]), world.map_offset[1] + float(shift[1]))
    phase = 0.0
    scan_phase = 0
    if noise.phases > 0.0:
        phase = 0.01 * int(stream(seed, "phases/people").integers(0, 10))
        scan_phase = int(stream(seed, "phases/lidar").integers(0, 10))
    if options.human_ticks_from_start:
        phase = beginning(people_options(options), seed) % PERIOD_S
    settings = Settings(
        clock=float(clock),
        yaw_gain=float(options.yaw_gain),
        time_limit_s=float(route.time_limit_s),
        result_delay_s=float(max(0.0, delay)),
        people_phase_s=float(phase),
        scan_phase_ticks=scan_phase,
        robot_start_s=float(start),
        lidar_noise=float(noise.lidar),
        humans_displayed_late=options.humans_displayed_late,
        solid_walls=options.solid_walls,
        closed=bool(closed),
    )
    return settings, scene, offset


def _clock(options: SimulatorOptions, seed: int) -> float:
    """Simulated over wall seconds of a run; the mean of all runs where its noise is off."""
    if options.clock_ratio_sd == 0.0 and options.clock_slow_share == 0.0:
        return options.clock_ratio
    rng = stream(seed, "clock")
    spread = options.clock_ratio_sd * rng.standard_normal()
    share = options.clock_slow_share
    mean = share * options.clock_slow_ratio + (1.0 - share) * options.clock_ratio
    drawn = (options.clock_slow_ratio if rng.random() < share else options.clock_ratio) + spread
    return float(mean + options.noise.clock * (drawn - mean))


def new_localisation(
    world: World, route: Route, options: SimulatorOptions, around: Surroundings, offset: tuple[float, float], seed: int
) -> Localisation:
    """What the robot knows of its place at the start."""
    if options.localisation == "known":
        return known_offset(*offset)
    return particle_filter(
        around.beam_scores,
        world.occupancy,
        around.robot.lidars[0],
        (route.start.x, route.start.y, float(wrap(route.start.yaw))),
        around.robot.lidars[0].noise_m * options.noise.lidar,
        stream(seed if options.noise.localisation > 0.0 else 0, "localisation"),
        differential=around.robot.drive.kind != "omnidirectional",
    )


def draw_phases(options: SimulatorOptions, seed: int) -> Floats:
    """Phases of smoother, local and global map in seconds."""
    if options.noise.phases == 0.0:
        return np.zeros(3)
    return 0.01 * np.array(
        [stream(seed, f"phases/{name}").integers(0, n) for name, n in (("smoother", 5), ("local", 20), ("global", 100))]
    )


def draw_intervals(options: SimulatorOptions, seed: int, route: Route) -> Floats:
    """Wall seconds between rows of the log: the first feedback message, every 10 ms, after 0.5 s.

    In the published logs that is the 50th message, or, as often as `LONG_INTERVALS` says, the 51st; nothing between.
    """
    rows = int(route.time_limit_s / 0.5) + 4
    long = stream(seed, "log").random(rows) < LONG_INTERVALS
    spread = options.noise.log_interval * (long.astype(np.float64) - LONG_INTERVALS)
    return np.asarray(0.5 + 0.01 * (LONG_INTERVALS + spread), np.float64)
